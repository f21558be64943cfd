//! Every function of `shaders/shared/` is tested. Reflection lists the functions. The body of a test kernel calls each of
//! them, or the list below says which test covers it.

use std::collections::BTreeSet;

use taugate::internals::gpu::shader;
use taugate::internals::wgsl::SOURCES;

use crate::shader_function::ShaderFunction;

/// Functions that no test kernel calls, and the tests that cover them.
const ELSEWHERE: &[(&str, &str)] = &[
    ("load_aim", "a wall that is scanned has the radiance of the closed form"),
    ("clearcoat_alpha", "renders of textured coats agree with the oracle"),
    ("pack_coated_point", "point_words on varying coats"),
    ("unpack_coated_point", "make_varying_bsdf on varying coats"),
    ("transform_uv", "base_color on transformed textures"),
    ("stretch_at", "transmitted"),
    ("medium_span", "transmitted"),
    ("point_in_grid", "pass_grid"),
    ("direction_in_grid", "pass_grid"),
    ("grid_margin", "grid_span"),
    ("grid_density", "medium_density"),
    ("cell_corners", "pass_grid"),
    ("cell_at", "pass_grid"),
    ("cell_density", "pass_grid"),
    ("cell_integral", "pass_grid"),
    ("one_minus_exp", "free_flight"),
    ("minus_log_rest", "free_flight"),
    ("normalised", "free_flight"),
    ("solid_index", "eta_towards"),
    ("henyey_greenstein", "phase_value"),
    ("draine", "phase_value"),
    ("draine_norm", "phase_value"),
    ("draine_share", "sample_phase_cosine"),
    ("sample_henyey_greenstein", "sample_phase_cosine"),
    ("sample_draine", "sample_phase_cosine"),
    ("table_value", "phase_value"),
    ("table_interval", "phase_value"),
    ("load_node", "phase_value"),
    ("sample_table", "sample_phase_cosine"),
    ("evaluate_medium_vertex", "renders of foggy rooms agree with the oracle"),
    ("sample_medium_vertex", "sample_phase_cosine; renders of foggy rooms agree with the oracle"),
    ("is_in_medium", "renders of foggy rooms agree with the oracle"),
    ("is_drawn_in_gate", "light that scatters once has the radiance of the closed form"),
    ("can_draw_in_gate", "light that scatters once has the radiance of the closed form"),
    ("query_segment", "light that scatters once has the radiance of the closed form"),
    ("segment_start", "light that scatters once has the radiance of the closed form"),
    ("guiding_interval", "renders of foggy rooms agree with the oracle"),
    ("flight_to_event", "free_flight"),
    ("end_share", "free_flight"),
    ("mean_extinction", "density_gain"),
    ("density_gain", "MIS weights only; renders of foggy rooms agree with the oracle"),
    ("follows_connected", "renders of foggy rooms agree with the oracle"),
    ("scattered_share", "an estimate; renders of foggy rooms agree with the oracle"),
    ("is_in_solid", "renders of foggy rooms with glass agree with the oracle"),
    ("fly", "free_flight"),
    ("note_crossing", "fog in meshes is fog in boxes"),
    ("enclosing_medium", "fog in meshes is fog in boxes"),
    ("passes_boundary", "fog in meshes is fog in boxes"),
    ("last_stretch", "transmitted"),
    ("traced_transmittance", "fog in meshes is fog in boxes"),
    ("depths_towards", "transmitted"),
    ("solid_towards", "glass with media inside agrees with the oracle"),
    ("solid_of", "as solid_towards"),
    ("path_solid", "as solid_towards"),
    ("with_solid", "as solid_towards"),
    ("arrive_in_medium", "renders of foggy rooms agree with the oracle"),
    ("segment_depths", "transmitted"),
    ("flight_density", "MIS weights only; renders of foggy rooms agree with the oracle"),
    ("is_sun", "connection_weight on suns"),
    ("medium_receiver", "an estimate; renders of foggy rooms agree with the oracle"),
    ("flight_uniforms", "as random4"),
    ("gate_interval", "light that scatters once has the radiance of the closed form"),
    ("distance_at", "light that scatters once has the radiance of the closed form"),
    ("draw_in_gate", "light that scatters once has the radiance of the closed form"),
    ("shading_normal", "surface_at is compared with the oracle on smooth meshes"),
    ("sample_triangle", "sample_emission on a triangle"),
    ("sample_punctual", "sample_emission on points and spots"),
    ("sample_beam", "sample_emission on beams"),
    ("delta_sample", "bsdf_sample on mirrors and smooth glass"),
    ("coat_fresnel", "bsdf_eval on plastics"),
    ("lobe_albedo", "coat_albedo"),
    ("is_coated", "bsdf_eval and bsdf_sample on coated materials"),
    ("add_clearcoat", "as is_coated"),
    ("clearcoat_albedo", "as is_coated"),
    ("clearcoat_fresnel", "as is_coated"),
    ("clearcoat_passes", "as is_coated"),
    ("is_retroreflector", "bsdf_eval and bsdf_sample on retroreflectors"),
    ("add_retroreflection", "as is_retroreflector"),
    ("intersect_triangle", "trace against a test of all triangles"),
    ("intersect_four", "trace against a test of all triangles"),
    ("to_ray", "trace against a test of all triangles, and watertight"),
    ("turn_to_last", "trace against a test of all triangles, and watertight"),
    ("ray_axes", "trace against a test of all triangles, and watertight"),
    ("edge_area", "trace against a test of all triangles, and watertight"),
    ("plane_normal", "surface_at is compared with the oracle; slivers in watertight"),
    ("random_words", "random4"),
    ("random_below", "choose_emitter among very many emitters, bit by bit"),
    ("multiply_wide", "random_below"),
    ("next_uniform", "the frequencies of descend in the sampler's tests"),
    ("next_fine_uniform", "rare children in the sampler's tests"),
    ("lets_pass", "transmittance of translucent quads in trace; decals in one plane in tests/stress"),
    ("traverse", "trace is its only caller and is compared with a test of all triangles"),
    ("safe_inverse", "trace along the axes"),
    ("extract_byte", "trace, which would misread nodes"),
    ("descend", "tests/sampler"),
    ("live_buckets", "bucket_power"),
    ("live_powers", "bucket_power"),
    ("shares_through_gate", "power_through_gate"),
    ("push_subtree", "the frequencies of descend_by_importance"),
    ("unshadowed", "images against closed forms and the oracle; pairs runs the whole kernel `connect`"),
    ("can_connect", "as unshadowed"),
    ("connectable_or_none", "as unshadowed"),
    ("write_candidate", "as unshadowed"),
    ("query_deterministic", "images of scenes with point lights, spot lights and beams"),
    ("draw_deterministic", "images of scenes with many lamps"),
    ("begin_work_item", "as unshadowed"),
    ("load_sky_row", "sky_towards and sample_sky"),
    ("load_sky_texel", "as load_sky_row"),
    ("keep_escape", "weights of a path sum to 1"),
    ("emit_from_sky", "images under a sky against closed forms and the oracle"),
    ("clear_slots", "as unshadowed"),
    ("transmits", "eta_towards, in scatter"),
    ("has_normal", "vertex_cosine"),
    ("is_one_sided", "faces"),
    ("sample_encoded", "sample_texture for colours, point_words for data"),
    ("add_details", "surface_at is compared with the oracle on meshes with colours and tangents"),
    ("unpack_color", "as add_details"),
    ("faces_bump", "scattering_normal and normal_probability, in scatter"),
    ("scattering_normal", "steps and connections at vertices with turned normals, in scatter"),
    ("bump_probability", "as scattering_normal"),
    ("normal_probability", "as scattering_normal"),
    ("vertex_bsdf", "evaluate_shade_point and evaluate_light_vertex"),
    ("segment_between", "as unshadowed"),
    ("connection_time", "travel_time and optical_length, at the edges of shells"),
    ("is_unoccluded", "images of scenes with occluders"),
    ("advance", "the parity tests of trace, reintersect and arrive; images"),
    ("is_too_late", "images with and without --no-cull"),
    ("vertex_importance", "images by lcs against closed forms and the oracle: a wrong probability would bias them"),
    ("outgoing_light", "as vertex_importance"),
    ("choose_in_leaf", "as vertex_importance"),
    ("resample", "as vertex_importance"),
    ("time_group", "estimators responses: gates from one render agree with the closed form"),
    ("light_vertex_tau", "estimators responses: histograms agree with the closed form"),
    ("target_function", "as vertex_importance"),
    ("total_power", "frequencies of the leaves in importance"),
    ("sensor_sample", "crops against whole images in estimators/determinism; a unit test of the samples of tiles"),
    ("samples_of_pixel", "as sensor_sample; images of a lit triangle in estimators"),
    ("random_vertices", "weights of a path sum to 1"),
    ("sample_count_ratios", "weights of a path sum to 1"),
    ("unpack_vertex", "load_light_vertex and load_shade_point"),
];

fn all() -> Vec<&'static ShaderFunction> {
    [
        crate::math::KERNELS,
        crate::bsdf::KERNELS,
        crate::bsdf_edges::KERNELS,
        crate::bsdf_parts::KERNELS,
        crate::bsdf_sample::KERNELS,
        crate::bump::KERNELS,
        crate::camera::KERNELS,
        crate::emitter::KERNELS,
        crate::grid::KERNELS,
        crate::importance::KERNELS,
        crate::lightcone::KERNELS,
        crate::medium::KERNELS,
        crate::phase::KERNELS,
        crate::point::KERNELS,
        crate::receiver::KERNELS,
        crate::scatter::KERNELS,
        crate::shell_edge::KERNELS,
        crate::sky::KERNELS,
        crate::sobol::KERNELS,
        crate::texels::KERNELS,
        crate::texture::KERNELS,
        crate::trace::KERNELS,
        crate::vertex::KERNELS,
        crate::watertight::KERNELS,
        crate::weights::KERNELS,
    ]
    .concat()
}

/// Names of all functions that the shared modules declare.
fn declared() -> BTreeSet<String> {
    let shared = SOURCES.iter().filter(|(path, _)| path.starts_with("shared/"));
    shared
        .flat_map(|(path, text)| {
            let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
            module.functions.iter().filter_map(|(_, f)| f.name.clone()).collect::<Vec<_>>()
        })
        .collect()
}

#[test]
fn every_shared_function_is_tested() {
    let called: BTreeSet<String> = all().iter().flat_map(|kernel| kernel.called()).collect();
    let declared = declared();
    let excused: BTreeSet<String> = ELSEWHERE.iter().map(|(name, _)| name.to_string()).collect();
    let forgotten: Vec<_> = declared.iter().filter(|f| !called.contains(*f) && !excused.contains(*f)).collect();
    assert!(forgotten.is_empty(), "no test kernel calls {forgotten:?}; test them, or add them to ELSEWHERE");
    let stale: Vec<_> = excused.iter().filter(|f| !declared.contains(*f) || called.contains(*f)).collect();
    assert!(stale.is_empty(), "remove from ELSEWHERE: {stale:?} no longer exist or have a test kernel");
    assert!(
        declared.len() > 60 && called.len() > 40,
        "{} functions declared, {} called by test kernels",
        declared.len(),
        called.len()
    );
}

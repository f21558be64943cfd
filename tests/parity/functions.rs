//! Every function of `shaders/shared/` is tested. Reflection lists the functions. The body of a test kernel calls each of
//! them, or the list below says which test covers it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use taugate::internals::gpu::shader;
use taugate::internals::wgsl::SOURCES;

use crate::shader_function::{ShaderFunction, calls};

/// How a function is tested that no test kernel calls itself.
enum Cover {
    /// Through this function of `shaders/shared/`, which calls it.
    Caller(&'static str),
    /// By this file in `tests/`, and this test in it.
    Test(&'static str, &'static str),
}
use Cover::{Caller, Test};

/// Functions that no test kernel calls itself.
const ELSEWHERE: &[(&str, Cover)] = &[
    ("is_in_reach", Test("parity/pairs.rs", "near_pairs_pass_the_query_kernels")),
    ("load_leaf_vertex", Test("parity/pairs.rs", "near_pairs_pass_the_query_kernels")),
    ("sensor_velocity", Test("estimators/doppler.rs", "paths_of_a_scene_that_grows_become_longer_by_their_length")),
    ("emitter_velocity", Test("estimators/doppler.rs", "paths_of_a_scene_that_grows_become_longer_by_their_length")),
    ("instance_velocity", Test("estimators/doppler.rs", "paths_of_a_scene_that_grows_become_longer_by_their_length")),
    ("vertex_velocity", Test("estimators/doppler.rs", "paths_of_a_scene_that_grows_become_longer_by_their_length")),
    ("growth_to", Test("estimators/doppler.rs", "paths_of_a_scene_that_grows_become_longer_by_their_length")),
    ("growth_before", Test("estimators/doppler.rs", "paths_of_a_scene_that_grows_become_longer_by_their_length")),
    ("connected_growth", Test("estimators/doppler.rs", "paths_of_a_scene_that_grows_become_longer_by_their_length")),
    ("recorded", Test("estimators/doppler.rs", "paths_of_a_scene_that_grows_become_longer_by_their_length")),
    ("emitter_probability", Test("estimators/doppler.rs", "paths_of_a_scene_that_grows_become_longer_by_their_length")),
    ("apparent_time", Test("estimators/fmcw.rs", "a_beat_is_that_of_a_path_at_rest")),
    ("crop_index", Test("estimators/device_film.rs", "images_on_the_device_have_the_same_bits")),
    ("triangle_of", Test("ray_queries.rs", "closed_meshes_do_not_leak")),
    ("pack_weights", Caller("grow_frontier")),
    ("unpack_weights", Caller("sample_frontier")),
    ("subtree_weights", Caller("sample_frontier")),
    ("to_sphere", Caller("arcs_in_triangle")),
    ("normal_to_sphere", Caller("search_part")),
    ("lobe_probabilities_of", Caller("lobe_probabilities")),
    ("lobe_distance2", Caller("henyey_greenstein")),
    ("angle_of", Caller("arcs_in_triangle")),
    ("at_angle", Caller("point_on_arcs")),
    ("arc_in_half_plane", Caller("arcs_in_triangle")),
    ("is_on_arc", Caller("arcs_in_triangle")),
    ("cross2", Caller("arcs_in_triangle")),
    ("plane_weights", Caller("point_on_arcs")),
    ("in_order", Caller("arcs_in_triangle")),
    ("arc_ends", Caller("arcs_in_triangle")),
    ("four_and", Caller("arcs_in_triangle")),
    ("scaled_normal", Caller("may_meet")),
    ("unpack_bvh_node", Caller("search_part")),
    ("focal_sum", Caller("search_part")),
    ("ellipsoid_importance", Caller("draw_on_ellipsoid")),
    ("choose_child", Caller("draw_on_ellipsoid")),
    ("sums_before", Caller("draw_on_ellipsoid")),
    ("with_even_share", Caller("draw_on_ellipsoid")),
    ("descend_bvh", Caller("draw_on_ellipsoid")),
    ("focus_cosine", Caller("draw_on_ellipsoid")),
    ("focus_at", Test("estimators/ellipsoids.rs", "glass_alpha_and_fog_agree_with_the_oracle")),
    ("nearest_four", Caller("search_part")),
    ("farthest_four", Caller("search_part")),
    ("search_four", Caller("search_part")),
    ("auxiliary_density2", Test("parity/weights.rs", "weights_with_ellipsoidal_connections_sum_to_one")),
    ("sum_over_auxiliary", Test("parity/weights.rs", "weights_with_ellipsoidal_connections_sum_to_one")),
    ("sum_over_sensor_auxiliary", Test("parity/weights.rs", "weights_with_ellipsoidal_connections_sum_to_one")),
    ("auxiliary_sum", Test("parity/weights.rs", "weights_with_ellipsoidal_connections_sum_to_one")),
    ("previous_distance", Test("parity/weights.rs", "weights_with_ellipsoidal_connections_sum_to_one")),
    ("drawn_travel_time", Test("estimators/ellipsoids.rs", "glass_alpha_and_fog_agree_with_the_oracle")),
    ("travel_time_at", Test("estimators/ellipsoids.rs", "thin_gates_of_a_sphere_agree_with_the_closed_form")),
    ("length_over_auxiliary", Test("estimators/ellipsoids.rs", "glass_alpha_and_fog_agree_with_the_oracle")),
    ("can_connect_over_surface", Test("estimators/ellipsoids.rs", "glass_alpha_and_fog_agree_with_the_oracle")),
    ("ellipsoid_key", Test("estimators/ellipsoids.rs", "glass_alpha_and_fog_agree_with_the_oracle")),
    ("connect_over", Test("estimators/ellipsoids.rs", "glass_alpha_and_fog_agree_with_the_oracle")),
    ("draw_on_triangle", Test("estimators/ellipsoids.rs", "glass_alpha_and_fog_agree_with_the_oracle")),
    ("next_word", Caller("descend")),
    ("surface_vertex", Caller("arrive")),
    ("has_narrow_laser", Test("estimators/waveforms.rs", "a_waveform_in_fog_has_the_closed_form_in_each_bin")),
    ("lit_share", Test("estimators/waveforms.rs", "a_waveform_in_fog_has_the_closed_form_in_each_bin")),
    ("load_aim", Test("estimators/scan.rs", "a_wall_has_the_radiance_of_the_closed_form")),
    ("clearcoat_alpha", Test("estimators/surface.rs", "a_textured_coat_reflects_in_proportion_to_its_texels")),
    ("pack_coated_point", Caller("point_words")),
    ("unpack_coated_point", Caller("unpack_point")),
    ("transform_uv", Caller("base_color")),
    ("stretch_at", Caller("optical_depths")),
    ("medium_span", Caller("media_extent")),
    ("point_in_grid", Caller("pass_grid")),
    ("direction_in_grid", Caller("pass_grid")),
    ("grid_margin", Caller("grid_span")),
    ("grid_density", Caller("medium_density")),
    ("cell_corners", Caller("pass_grid")),
    ("cell_at", Caller("pass_grid")),
    ("cell_density", Caller("pass_grid")),
    ("cell_integral", Caller("pass_grid")),
    ("one_minus_exp", Caller("free_flight")),
    ("minus_log_rest", Caller("free_flight")),
    ("normalised", Caller("free_flight")),
    ("solid_index", Caller("eta_towards")),
    ("henyey_greenstein", Caller("phase_value")),
    ("draine", Caller("phase_value")),
    ("draine_norm", Caller("phase_value")),
    ("draine_share", Caller("sample_phase_cosine")),
    ("sample_henyey_greenstein", Caller("sample_phase_cosine")),
    ("sample_draine", Caller("sample_phase_cosine")),
    ("table_value", Caller("phase_value")),
    ("table_interval", Caller("phase_value")),
    ("load_node", Caller("phase_value")),
    ("sample_table", Caller("sample_phase_cosine")),
    ("evaluate_medium_vertex", Test("estimators/fog.rs", "a_foggy_room_agrees_with_the_oracle")),
    ("sample_medium_vertex", Test("estimators/fog.rs", "a_foggy_room_agrees_with_the_oracle")),
    ("can_draw_in_gate", Test("estimators/fog.rs", "light_that_scatters_once_has_the_radiance_of_the_closed_form")),
    ("query_segment", Test("estimators/fog.rs", "light_that_scatters_once_has_the_radiance_of_the_closed_form")),
    ("segment_start", Test("estimators/fog.rs", "light_that_scatters_once_has_the_radiance_of_the_closed_form")),
    ("guiding_interval", Test("estimators/fog.rs", "a_foggy_room_agrees_with_the_oracle")),
    ("flight_to_event", Caller("free_flight")),
    ("end_probability_of", Caller("free_flight")),
    ("guided_end_probability", Caller("guided_flight")),
    ("event_choice", Caller("free_flight")),
    ("mean_extinction", Caller("density_gain")),
    ("scattered_share", Test("estimators/fog.rs", "a_foggy_room_agrees_with_the_oracle")),
    ("is_in_solid", Test("estimators/fog_and_glass.rs", "fog_does_not_enter_clear_glass")),
    ("fly", Test("estimators/fog.rs", "a_foggy_room_agrees_with_the_oracle")),
    ("note_crossing", Test("estimators/null_boundaries.rs", "fog_in_meshes_is_fog_in_boxes")),
    ("enclosing_medium", Test("estimators/null_boundaries.rs", "fog_in_meshes_is_fog_in_boxes")),
    ("passes_boundary", Test("estimators/null_boundaries.rs", "fog_in_meshes_is_fog_in_boxes")),
    ("last_stretch", Caller("optical_depths")),
    ("traced_transmittance", Test("estimators/null_boundaries.rs", "fog_in_meshes_is_fog_in_boxes")),
    ("depths_towards", Test("estimators/fog.rs", "a_foggy_room_agrees_with_the_oracle")),
    ("solid_towards", Test("estimators/interiors.rs", "glass_with_media_inside_agrees_with_the_oracle")),
    ("solid_of", Test("estimators/interiors.rs", "glass_with_media_inside_agrees_with_the_oracle")),
    ("path_solid", Test("estimators/interiors.rs", "glass_with_media_inside_agrees_with_the_oracle")),
    (
        "solid_around",
        Test("estimators/inside_glass.rs", "a_beam_in_milky_glass_around_the_camera_agrees_with_the_oracle"),
    ),
    ("lens_direction", Test("parity/lens.rs", "rays_through_a_lens_are_those_of_the_model")),
    ("lens_image", Test("parity/lens.rs", "rays_through_a_lens_are_those_of_the_model")),
    ("lens_spread", Test("parity/lens.rs", "rays_through_a_lens_are_those_of_the_model")),
    ("has_lens", Test("parity/lens.rs", "rays_through_a_lens_are_those_of_the_model")),
    ("to_lens", Test("parity/lens.rs", "rays_through_a_lens_are_those_of_the_model")),
    ("from_lens", Test("estimators/aperture.rs", "camera_rays_blur_a_panel_as_the_closed_form_says")),
    ("vignetting", Test("estimators/lens.rs", "camera_rays_lose_the_light_of_the_vignetting")),
    ("has_vignetting", Test("estimators/lens.rs", "camera_rays_lose_the_light_of_the_vignetting")),
    ("vignetting_row", Caller("vignetting")),
    ("distort", Caller("lens_image")),
    ("determinant_of", Caller("lens_spread")),
    ("fisheye_distance", Caller("lens_image")),
    ("eta_around", Test("estimators/inside_glass.rs", "a_camera_in_clear_glass_agrees_with_the_oracle")),
    ("with_solid", Test("estimators/interiors.rs", "glass_with_media_inside_agrees_with_the_oracle")),
    ("is_sun", Test("estimators/sun.rs", "estimators_agree_with_the_oracle_in_sunlight")),
    ("medium_receiver", Test("estimators/fog.rs", "a_foggy_room_agrees_with_the_oracle")),
    ("flight_uniforms", Test("estimators/fog.rs", "a_foggy_room_agrees_with_the_oracle")),
    ("event_count", Caller("query_segment")),
    ("whole_gate", Caller("event_gate")),
    ("event_stratum", Caller("event_gate")),
    ("event_uniforms", Test("estimators/waveforms.rs", "a_waveform_in_fog_has_the_closed_form_in_each_bin")),
    ("event_gate", Test("estimators/waveforms.rs", "a_waveform_in_fog_has_the_closed_form_in_each_bin")),
    ("event_cycle", Test("estimators/waveforms.rs", "a_waveform_in_fog_has_the_closed_form_in_each_bin")),
    ("gate_interval", Test("estimators/fog.rs", "light_that_scatters_once_has_the_radiance_of_the_closed_form")),
    ("distance_at", Test("estimators/fog.rs", "light_that_scatters_once_has_the_radiance_of_the_closed_form")),
    ("gate_distribution", Caller("draw_in_gate")),
    ("gate_density", Caller("draw_in_gate")),
    ("event_density", Test("estimators/beam_in_fog.rs", "a_beam_on_a_grid_has_the_light_of_flights")),
    ("flight_share", Test("estimators/beam_in_fog.rs", "a_beam_on_a_grid_has_the_light_of_flights")),
    ("sensor_vertex", Test("estimators/beam_in_fog.rs", "a_beam_on_a_grid_has_the_light_of_flights")),
    ("draw_in_gate", Test("estimators/fog.rs", "light_that_scatters_once_has_the_radiance_of_the_closed_form")),
    ("shading_normal", Caller("surface_at")),
    ("sample_triangle", Caller("sample_emission")),
    ("sample_punctual", Caller("sample_emission")),
    ("sample_beam", Caller("sample_emission")),
    ("delta_sample", Caller("bsdf_sample")),
    ("coat_fresnel", Caller("bsdf_eval")),
    ("lobe_albedo", Caller("coat_albedo")),
    ("albedo_between", Caller("lobe_albedo")),
    ("is_coated", Caller("bsdf_eval")),
    ("add_clearcoat", Caller("bsdf_eval")),
    ("clearcoat_albedo", Caller("bsdf_eval")),
    ("clearcoat_fresnel", Caller("bsdf_eval")),
    ("clearcoat_passes", Caller("bsdf_eval")),
    ("is_retroreflector", Caller("bsdf_eval")),
    ("add_retroreflection", Caller("bsdf_eval")),
    ("intersect_triangle", Caller("trace")),
    ("intersect_four", Caller("trace")),
    ("to_ray", Caller("trace")),
    ("turn_to_last", Caller("trace")),
    ("ray_axes", Caller("trace")),
    ("edge_area", Caller("trace")),
    ("plane_normal", Caller("surface_at")),
    ("random_key", Caller("random4")),
    ("entry_after", Test("estimators/responses.rs", "every_gate_agrees_with_the_closed_form")),
    ("photon_level", Caller("photon_levels")),
    ("photon_levels", Test("estimators/merging.rs", "a_wall_behind_a_slab_is_seen_through_it")),
    ("radius_per_length", Caller("merge_radius")),
    ("photon_cell", Test("estimators/merging.rs", "a_wall_behind_a_slab_is_seen_through_it")),
    ("photon_list", Test("estimators/merging.rs", "a_wall_behind_a_slab_is_seen_through_it")),
    ("merge_radius", Test("estimators/merging.rs", "a_wall_behind_a_slab_is_seen_through_it")),
    ("gathered_measure", Test("estimators/merging.rs", "a_wall_behind_a_slab_is_seen_through_it")),
    ("is_near", Caller("gathered")),
    ("gathered", Test("estimators/merging.rs", "a_wall_behind_a_slab_is_seen_through_it")),
    ("random_words", Caller("random4")),
    ("random_below", Test("parity/emitter.rs", "a_million_emitters_are_chosen_uniformly")),
    ("multiply_wide", Caller("random_below")),
    ("next_uniform", Caller("descend")),
    ("next_fine_uniform", Test("sampler/stress.rs", "a_rare_first_child_is_drawn_as_rarely_as_it_should")),
    ("passes_thin_glass", Test("estimators/thin_glass.rs", "a_wall_behind_a_sheet_is_dimmed_and_not_delayed")),
    ("passes_sheet", Test("estimators/thin_glass.rs", "a_wall_behind_a_sheet_is_dimmed_and_not_delayed")),
    ("has_holes", Caller("passes_sheet")),
    ("is_clear", Caller("passes_sheet")),
    ("passes_for_sure", Test("estimators/waveforms.rs", "a_waveform_is_dimmed_by_panes")),
    ("sheet_at", Test("estimators/thin_glass.rs", "a_wall_behind_a_sheet_is_dimmed_and_not_delayed")),
    ("surface_bsdf", Caller("sheet_at")),
    ("note_sheet", Caller("passes_sheet")),
    ("forget_sheets", Caller("trace")),
    ("and_then", Caller("note_sheet")),
    ("transit_before", Test("estimators/thin_glass.rs", "fog_is_seen_through_a_sheet")),
    ("pass_sheets_before", Test("estimators/thin_glass.rs", "fog_is_seen_through_a_sheet")),
    ("pass_sheets", Test("estimators/thin_glass.rs", "two_tinted_sheets_multiply")),
    ("traced_delay", Test("estimators/thin_glass.rs", "thick_sheets_delay_light")),
    ("gate_weight_before_delays", Test("estimators/thin_glass.rs", "thick_sheets_delay_light")),
    ("glass_reflectance", Test("estimators/thin_glass.rs", "a_sheet_reflects_the_rest_from_both_sides")),
    ("passes_straight", Test("estimators/thin_glass.rs", "a_sheet_reflects_the_rest_from_both_sides")),
    ("bsdf_eval_thin_transmission", Test("estimators/sky.rs", "thin_glass_vanishes_under_a_white_sky")),
    ("is_on_sheet", Test("estimators/sky.rs", "thin_glass_vanishes_under_a_white_sky")),
    ("is_thin", Caller("make_bsdf")),
    ("bounds_solid", Caller("surface_vertex")),
    ("lets_pass", Test("parity/trace.rs", "alpha_lets_its_share_of_rays_through")),
    ("traverse", Caller("trace")),
    ("safe_inverse", Caller("trace")),
    ("extract_byte", Caller("trace")),
    ("descend", Test("sampler/main.rs", "draws_have_the_probabilities_of_the_walk")),
    ("live_buckets", Caller("bucket_power")),
    ("live_powers", Caller("bucket_power")),
    ("shares_through_gate", Caller("power_through_gate")),
    ("push_subtree", Caller("grow_frontier")),
    ("unshadowed", Test("parity/pairs.rs", "near_pairs_pass_the_query_kernels")),
    ("can_connect", Test("parity/pairs.rs", "near_pairs_pass_the_query_kernels")),
    ("connectable_or_none", Test("parity/pairs.rs", "near_pairs_pass_the_query_kernels")),
    ("write_candidate", Test("parity/pairs.rs", "near_pairs_pass_the_query_kernels")),
    ("query_deterministic", Test("estimators/sphere.rs", "light_cone_shell_queries_agree_with_the_closed_form")),
    ("draw_deterministic", Test("estimators/lamps.rs", "many_points_in_one_place_agree_with_the_closed_form")),
    ("begin_work_item", Test("parity/pairs.rs", "near_pairs_pass_the_query_kernels")),
    ("load_sky_row", Caller("sky_towards")),
    ("load_sky_texel", Caller("sky_towards")),
    ("keep_escape", Test("parity/weights.rs", "weights_of_a_path_sum_to_one")),
    ("emit_from_sky", Test("estimators/sky.rs", "estimators_agree_with_the_oracle_under_the_image_of_a_sky")),
    ("end_work_item", Test("parity/pairs.rs", "near_pairs_pass_the_query_kernels")),
    ("write_marks", Caller("write_candidate")),
    ("mark_words", Caller("end_work_item")),
    ("transmits", Caller("eta_towards")),
    ("has_normal", Caller("vertex_cosine")),
    ("is_one_sided", Caller("faces")),
    ("sample_encoded", Caller("sample_texture")),
    ("add_details", Test("parity/bump.rs", "normal_maps_and_vertex_colours_agree_with_the_oracle")),
    ("unpack_color", Test("parity/bump.rs", "normal_maps_and_vertex_colours_agree_with_the_oracle")),
    ("faces_bump", Caller("scattering_normal")),
    ("scattering_normal", Test("parity/scatter.rs", "steps_agree_with_connections")),
    ("bump_probability", Test("parity/scatter.rs", "steps_agree_with_connections")),
    ("normal_probability", Test("parity/scatter.rs", "steps_agree_with_connections")),
    ("vertex_bsdf", Caller("evaluate_shade_point")),
    ("connection_time", Test("parity/shell_edge.rs", "the_gate_is_half_open")),
    ("is_unoccluded", Test("estimators/agreement.rs", "cornell_box_agrees_with_the_oracle")),
    ("advance", Test("estimators/agreement.rs", "cornell_box_agrees_with_the_oracle")),
    ("is_too_late", Test("estimators/orthographic.rs", "culling_removes_no_light")),
    ("vertex_importance", Test("estimators/sphere.rs", "resampled_queries_agree_with_the_closed_form")),
    ("choose_in_leaf", Test("estimators/sphere.rs", "resampled_queries_agree_with_the_closed_form")),
    ("resample", Test("estimators/sphere.rs", "resampled_queries_agree_with_the_closed_form")),
    ("max_queries", Test("estimators/fog.rs", "a_foggy_room_agrees_with_the_oracle")),
    ("time_group", Test("estimators/responses.rs", "short_responses_of_lcs_agree_with_the_closed_form")),
    ("light_vertex_tau", Test("estimators/responses.rs", "every_gate_agrees_with_the_closed_form")),
    ("observe", Test("estimators/responses.rs", "every_gate_agrees_with_the_closed_form")),
    ("target_function", Test("estimators/sphere.rs", "resampled_queries_agree_with_the_closed_form")),
    ("total_power", Test("parity/importance.rs", "leaves_come_up_with_the_probability_they_report")),
    ("pixel_seed", Caller("sensor_sample")),
    ("sensor_sample", Test("estimators/determinism.rs", "a_crop_is_a_part_of_the_whole_image")),
    ("passing_samples", Test("estimators/thin_glass.rs", "a_sheet_reflects_the_rest_from_both_sides")),
    ("samples_of_pixel", Test("estimators/determinism.rs", "a_crop_is_a_part_of_the_whole_image")),
    ("random_vertices", Test("parity/weights.rs", "weights_of_a_path_sum_to_one")),
    ("sample_count_ratios", Test("parity/weights.rs", "weights_of_a_path_sum_to_one")),
    ("unpack_vertex", Caller("load_light_vertex")),
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
        crate::ellipsoid::KERNELS,
        crate::emitter::KERNELS,
        crate::grid::KERNELS,
        crate::importance::KERNELS,
        crate::lens::KERNELS,
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

/// The functions that the shared modules declare, and the names of those that each calls.
fn declared() -> BTreeMap<String, BTreeSet<String>> {
    let mut all: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (path, text) in SOURCES.iter().filter(|(path, _)| path.starts_with("shared/")) {
        let (module, _) = shader::compose(path, text).and_then(|c| c.parse()).unwrap_or_else(|e| panic!("{e}"));
        for (_, function) in module.functions.iter() {
            let mut names = vec![];
            calls(&module, &function.body, &mut names);
            all.entry(function.name.clone().expect("functions have names")).or_default().extend(names);
        }
    }
    all
}

/// Whether `caller` calls `function`, itself or through others.
fn reaches(declared: &BTreeMap<String, BTreeSet<String>>, caller: &str, function: &str) -> bool {
    let called = declared.get(caller).into_iter().flatten();
    called.into_iter().any(|name| name == function || reaches(declared, name, function))
}

/// Whether a file in `tests/` has this test, and runs it always.
fn has_test(file: &str, name: &str) -> bool {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(file);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let lines: Vec<&str> = text.lines().collect();
    let head = format!("fn {name}() {{");
    let Some(at) = lines.iter().position(|line| *line == head) else { return false };
    let attributes: Vec<&&str> = lines[..at].iter().rev().take_while(|line| line.starts_with("#[")).collect();
    attributes.contains(&&"#[test]") && !attributes.iter().any(|line| line.starts_with("#[ignore"))
}

#[test]
fn every_shared_function_is_tested() {
    let called: BTreeSet<String> = all().iter().flat_map(|kernel| kernel.called()).collect();
    let declared = declared();
    let excused: BTreeSet<&str> = ELSEWHERE.iter().map(|(name, _)| *name).collect();
    let forgotten: Vec<_> = declared.keys().filter(|f| !called.contains(*f) && !excused.contains(f.as_str())).collect();
    assert!(forgotten.is_empty(), "no test kernel calls {forgotten:?}; test them, or add them to ELSEWHERE");
    let stale: Vec<_> = excused.iter().filter(|f| !declared.contains_key(**f) || called.contains(**f)).collect();
    assert!(stale.is_empty(), "remove from ELSEWHERE: {stale:?} no longer exist or have a test kernel");
    let mut wrong = vec![];
    for (name, cover) in ELSEWHERE {
        match cover {
            Caller(caller) if !called.contains(*caller) && !excused.contains(caller) => {
                wrong.push(format!("{name}: nothing tests {caller}"));
            }
            Caller(caller) if !reaches(&declared, caller, name) => {
                wrong.push(format!("{name}: {caller} does not call it"));
            }
            Test(file, test) if !has_test(file, test) => wrong.push(format!("{name}: no test {test} runs in {file}")),
            _ => (),
        }
    }
    assert!(wrong.is_empty(), "correct ELSEWHERE:\n{}", wrong.join("\n"));
    assert!(!has_test("estimators/agreement.rs", "all_strategies_agree"), "an ignored test counts");
    assert!(
        declared.len() > 60 && called.len() > 40,
        "{} functions declared, {} called by test kernels",
        declared.len(),
        called.len()
    );
}

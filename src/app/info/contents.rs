//! The part of the report that depends on the scene file alone.

use std::collections::HashMap;

use taugate::internals::input::resolve::emitting_nodes;
use taugate::internals::job::feasible;
use taugate::internals::render::sheets::glass;
use taugate::internals::scene::{
    Aperture, Distortion, Lens, Light as SceneLight, Medium as SceneMedium, Scene, SkyImage, Vignetting,
};

use super::media::Medium;
use super::{Camera, Emitter, Report};

/// The report about a scene, without what depends on the settings.
pub fn report(scene: &Scene) -> Report {
    let mut used = vec![false; scene.materials.len()];
    scene.instances.iter().for_each(|i| used[scene.meshes[i.mesh as usize].material as usize] = true);
    let used_materials = || scene.materials.iter().zip(&used).filter(|(_, used)| **used).map(|(m, _)| m);
    let materials = used_materials().map(|m| m.name.clone());
    let interiors = used_materials().filter_map(|m| Some(describe_interior(&m.name, m.interior.as_ref()?))).collect();
    let emitters = emitters(scene).map(|(node, kind)| Emitter { node, kind, watts: None });
    let cameras = scene.cameras.iter().map(|camera| {
        let (degrees_high, metres_high) =
            (camera.projection.yfov().map(f64::to_degrees), camera.projection.view_height());
        let position = camera.transform.translation.to_array();
        let (name, lens, resolution) = (camera.name.clone(), describe_lens(&camera.lens), camera.resolution);
        Camera { name, position, degrees_high, metres_high, lens, resolution }
    });
    Report {
        triangles: scene.instances.iter().map(|i| scene.meshes[i.mesh as usize].triangles.len()).sum(),
        instances: scene.instances.len(),
        meshes: scene.meshes.len(),
        mesh_triangles: scene.meshes.iter().map(|mesh| mesh.triangles.len()).sum(),
        bounds: feasible::bounds(scene).map(|(low, high)| (low.to_array(), high.to_array(), (high - low).length())),
        cameras: cameras.collect(),
        emitters: emitters.collect(),
        materials: materials.collect(),
        materials_in_file: scene.materials.len(),
        interiors,
        glass: glass(scene),
        textures: scene.textures.len(),
        images: scene.images.len(),
        texels: scene.images.iter().map(|i| u64::from(i.width) * u64::from(i.height)).sum(),
        media: scene.media.iter().map(Medium::new).collect(),
        warnings: scene.warnings.clone(),
        render: None,
        notes: vec![],
    }
}

/// What a lens does, in a few words; `None` for a pinhole with square pixels.
fn describe_lens(lens: &Lens) -> Option<String> {
    // Without the noise of units that were converted.
    let rounded = |x: f64| (1e6 * x).round() / 1e6;
    let pixels =
        (lens.pixel_aspect != 1.0).then(|| format!("pixels {} times as wide as high", rounded(lens.pixel_aspect)));
    let distortion = match lens.distortion {
        Distortion::None => None,
        Distortion::Rational { .. } => Some("distortion".to_string()),
        Distortion::Fisheye(_) => Some("fisheye".to_string()),
    };
    let aperture = lens.aperture.as_ref().map(|Aperture { diameter, focus, .. }| match focus.is_finite() {
        true => format!("aperture of {} mm in focus at {} m", rounded(1e3 * diameter), rounded(*focus)),
        false => format!("aperture of {} mm in focus at infinity", rounded(1e3 * diameter)),
    });
    let vignetting = match lens.vignetting {
        Vignetting::None => None,
        Vignetting::Cos4 => Some("vignetting by cos4".to_string()),
        Vignetting::Table(_) => Some("vignetting by a table".to_string()),
    };
    let parts: Vec<String> = [pixels, distortion, aperture, vignetting].into_iter().flatten().collect();
    (!parts.is_empty()).then(|| parts.join(", "))
}

/// The nodes that emit, each with a description of its emitter.
pub fn emitters(scene: &Scene) -> impl Iterator<Item = (String, String)> {
    // The first light of a node decides its kind.
    let lights: HashMap<&str, &SceneLight> = scene.lights.iter().rev().map(|l| (l.node.as_str(), l)).collect();
    let kind = move |node: &str| lights.get(node).map_or("emissive mesh".into(), |light| describe(light, scene));
    emitting_nodes(scene).into_iter().map(move |node| (node.to_string(), kind(node)))
}

/// Describes `light`. For a sky, also gives the irradiance on a floor that sees the whole upper half of the sky.
fn describe(light: &SceneLight, scene: &Scene) -> String {
    if !light.kind.is_sky() {
        return light.kind.describe();
    }
    let constant = SkyImage::constant();
    let irradiance = scene.sky.as_ref().unwrap_or(&constant).irradiance_from_above();
    let strength = light.kind.strength();
    let [r, g, b] = [0, 1, 2].map(|k| irradiance[k] * f64::from(strength[k]));
    let image = scene.sky.as_ref().map(|sky| format!(", image of {}x{} pixels", sky.width, sky.height));
    let image = image.unwrap_or_default();
    format!("{}{image}, irradiance ({r:.4}, {g:.4}, {b:.4}) W/m^2 on an open floor", light.kind.describe())
}

/// Describes the medium inside meshes of a material.
fn describe_interior(material: &str, medium: &SceneMedium) -> String {
    let numbers = |sigma: [f64; 3]| sigma.map(feasible::short).join(", ");
    let (scattering, absorption) = (numbers(medium.sigma_s), numbers(medium.sigma_a));
    let events = Medium::new(medium).events();
    format!("{material} contains a medium: {events}; scattering ({scattering}), absorption ({absorption}) per metre")
}

//! `taugate info`: what is in a scene.

use std::fmt::Write;
use std::process::ExitCode;

use glam::DVec3;
use taugate::resolve::emitting_nodes;
use taugate::scene::{LightKind, Scene};

use crate::cli::InfoArgs;

pub fn run(args: &InfoArgs) -> anyhow::Result<ExitCode> {
    let scene = taugate::scene::gltf::load(&args.scene)?;
    super::print(&describe(&scene));
    Ok(ExitCode::SUCCESS)
}

fn describe(scene: &Scene) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: String| writeln!(text, "{name:<11} {value}").expect("a string takes any text");

    let unique: usize = scene.meshes.iter().map(|mesh| mesh.triangles.len()).sum();
    let placed: usize = scene.instances.iter().map(|i| scene.meshes[i.mesh as usize].triangles.len()).sum();
    line(
        "triangles",
        format!("{placed} placed by {} instances of {} meshes ({unique})", scene.instances.len(), scene.meshes.len()),
    );
    match bounds(scene) {
        Some((low, high)) => {
            let show = |v: DVec3| format!("({:.3}, {:.3}, {:.3})", v.x, v.y, v.z);
            line("bounds", format!("{} to {} m, diagonal {:.3} m", show(low), show(high), (high - low).length()));
        }
        None => line("bounds", "no triangles".into()),
    }
    for camera in &scene.cameras {
        let size = camera.resolution.map(|[w, h]| format!(", {w}x{h} pixels")).unwrap_or_default();
        let at = camera.transform.translation;
        let degrees = camera.yfov.to_degrees();
        line(
            "camera",
            format!("{} at ({:.3}, {:.3}, {:.3}), {degrees:.1} degrees high{size}", camera.name, at.x, at.y, at.z),
        );
    }
    for node in emitting_nodes(scene) {
        let light = scene.lights.iter().find(|light| light.node == node);
        line("emitter", format!("{node}: {}", light.map_or("emissive mesh".into(), |light| kind(&light.kind))));
    }

    let mut used = vec![false; scene.materials.len()];
    scene.instances.iter().for_each(|i| used[scene.meshes[i.mesh as usize].material as usize] = true);
    let count = used.iter().filter(|&&u| u).count();
    let texels: u64 = scene.images.iter().map(|i| u64::from(i.width) * u64::from(i.height)).sum();
    line("materials", format!("{count} used of {}", scene.materials.len()));
    line("textures", format!("{} with {texels} texels in {} images", scene.textures.len(), scene.images.len()));
    for warning in &scene.warnings {
        line("warning", warning.clone());
    }
    text
}

fn kind(kind: &LightKind) -> String {
    match kind {
        LightKind::Point { .. } => "point light".into(),
        LightKind::Spot { outer, .. } => format!("spot light, {:.1} degrees wide", 2.0 * outer.to_degrees()),
        LightKind::Beam { radius, .. } => format!("collimated beam, radius {radius} m"),
        LightKind::Directional { .. } => "directional light (steady renders only)".into(),
    }
}

/// World bounds of all placed triangles.
fn bounds(scene: &Scene) -> Option<(DVec3, DVec3)> {
    let corners = scene.instances.iter().flat_map(|instance| {
        let positions = &scene.meshes[instance.mesh as usize].positions;
        positions.iter().map(|p| instance.transform.transform_point3(DVec3::new(p[0].into(), p[1].into(), p[2].into())))
    });
    corners.map(|p| (p, p)).reduce(|(low, high), (p, _)| (low.min(p), high.max(p)))
}

//! Which strategy forms which kind of light, for people who ask what a render will show.

use super::emitters::EmitterKind;
use super::photons;
use super::prepared_scene::PreparedScene;
use crate::scene::Scene;
use crate::settings::{Settings, Strategies};

/// One sentence per kind of light in the scene: the kind, and what forms it. `prepared` is the prepared `scene`.
pub fn formed_light(scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Vec<String> {
    let has = |kind: EmitterKind| prepared.emitters.table.iter().any(|entry| EmitterKind::of(entry) == kind);
    let mut lines = vec![];
    if has(EmitterKind::Triangle) {
        lines.push("light of lamps with a surface: connections to points on them, and rays that hit them".into());
    }
    if has(EmitterKind::Sky) {
        lines.push("light of the sky: rays towards it, and rays that leave the scene".into());
    }
    if photons::lamps(prepared).next().is_none() {
        return lines;
    }
    lines.push("light of lamps without a surface: connections to them, and to surfaces that they light".into());
    if !photons::has_smooth_objects(prepared) {
        return lines;
    }
    let is_aimed = scene.cameras[settings.camera()].projection.aims().is_some();
    let splats = settings.estimator().record().light_subpaths && settings.strategies() == Strategies::All && !is_aimed;
    let merges = photons::merges(scene, settings, prepared);
    let by_merging = || match merges {
        true => format!("merging within {} pixels or less", settings.merge_radius()),
        false => "nothing".into(),
    };
    let caustics = if splats { "light subpaths that connect to the camera".into() } else { by_merging() };
    lines.push(format!("their light over smooth glass or mirrors (caustics): {caustics}"));
    lines.push(format!("the same, seen over smooth glass or mirrors: {}", by_merging()));
    lines
}

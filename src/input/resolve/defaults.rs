//! Choice of the default estimator.

use crate::estimators::{Conditions, GateWidth};
use crate::scene::{Light, Material, Scene};
use crate::settings::units::Gate;
use crate::settings::*;

/// A gate is wide if its width is larger than this fraction of the scene's diagonal.
const WIDE_GATE: f64 = 0.4;

/// The estimator whose record fits this gate, this scene and these emitters.
pub(super) fn estimator(gate: Gate, scene: &Scene, emitters: &Emitters) -> Estimator {
    let is_beam = |light: &Light| light.kind.needs_light_subpaths() && emitters.include(&light.node);
    let width = if gate.hi - gate.lo <= WIDE_GATE * scene.diagonal() {
        GateWidth::Narrow
    } else if gate == Gate::OPEN {
        GateWidth::Open
    } else {
        GateWidth::Wide
    };
    Estimator::default_for(&Conditions {
        gate: width,
        focuses_light: focuses_light(scene),
        has_beam: scene.lights.iter().any(is_beam),
    })
}

/// Roughness below which a glossy surface focuses light so sharply that `pt` seldom finds the light.
const SHARP: f32 = 0.3;

/// Whether the scene has a material that can focus light: glass, or metal, gloss or a clear coat of low roughness.
fn focuses_light(scene: &Scene) -> bool {
    let focuses = |m: &Material| {
        m.transmission > 0.0
            || (m.roughness < SHARP && (m.metallic > 0.0 || m.specular > 0.0))
            || (m.clearcoat_roughness < SHARP && m.clearcoat > 0.0)
    };
    scene.materials.iter().any(focuses)
}

//! What is done when nothing says it.

use crate::estimators::{Conditions, GateWidth};
use crate::scene::{Light, Material, Scene};
use crate::settings::units::Gate;
use crate::settings::*;

/// Part of the scene's diagonal from which on a gate is wide.
const WIDE_GATE: f64 = 0.4;

/// The estimator whose record says that it suits this gate and scene.
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

/// Roughness below which gloss gathers light so sharply that `pt` seldom finds it.
const SHARP: f32 = 0.3;

/// Whether glass, or a sharp mirror or gloss, can gather light.
fn focuses_light(scene: &Scene) -> bool {
    let focuses =
        |m: &Material| m.transmission > 0.0 || (m.roughness < SHARP && (m.metallic > 0.0 || m.specular > 0.0));
    scene.materials.iter().any(focuses)
}

//! How the parts of the scene move, as the kernels read it (`shaders/shared/doppler.wgsl`).

use glam::{DAffine3, DVec3};

use super::emitters::EmitterSet;
use super::space::RenderSpace;
use crate::error::{Error, Result};
use crate::scene::{Projection, Scene, Velocities};
use crate::settings::Settings;
use crate::settings::doppler::Doppler;

/// Whether the image depends on velocities.
pub fn are_needed(settings: &Settings) -> bool {
    settings.doppler() != Doppler::OFF || settings.responses().chirp().is_some()
}

/// The speed in m/s in whose units the kernels count velocities.
fn unit(settings: &Settings) -> f64 {
    settings.doppler().speed().unwrap_or(1.0)
}

/// The length in metres by which a path seems longer to an FMCW sensor, per rate of its growth in the unit of the kernels; 0 for other sensors.
pub fn range_coupling(settings: &Settings) -> f64 {
    settings.responses().chirp().map_or(0.0, |chirp| chirp.coupling() * unit(settings))
}

/// The texels: the velocity of the sensor, those of the emitters of `emitters.table` with their probabilities, and three rows per instance. All are in units of the
/// speed that saturates the colours, or in m/s. Empty if the image depends on no velocities. Fails if a velocity is not known. For an FMCW sensor, a scene
/// without velocities is at rest.
pub fn table(scene: &Scene, settings: &Settings, emitters: &EmitterSet, space: &RenderSpace) -> Result<Vec<[f32; 4]>> {
    if !are_needed(settings) {
        return Ok(vec![]);
    }
    let at_rest =
        || Velocities { instances: vec![Some(DAffine3::ZERO); scene.instances.len()], ..Velocities::default() };
    let velocities = match &scene.velocities {
        Some(velocities) => velocities,
        None if settings.doppler() == Doppler::OFF => &at_rest(),
        None => {
            return Err(Error::advice(
                "--doppler records how the objects of an animated scene move, but the velocities of this scene are not known: ",
                "open a file with animations, and choose the moment with --at",
            ));
        }
    };
    let speed = unit(settings);
    check(scene, settings, velocities)?;
    let texel = |v: DVec3, last: f64| [v.x / speed, v.y / speed, v.z / speed, last / speed].map(|x| x as f32);
    let of = |list: &[DVec3], index: usize| list.get(index).copied().unwrap_or_default();
    let mut texels = vec![texel(of(&velocities.cameras, settings.camera()), 0.0)];
    // Emissive triangles come first, and move as their instances do.
    texels.extend(emitters.table.iter().enumerate().map(|(index, entry)| {
        let light = index.checked_sub(emitters.triangles.len()).map(|k| emitters.sources[k]);
        // The way to a light at infinity does not change.
        let light = light.filter(|&light| !scene.lights[light].kind.is_distant());
        let [x, y, z, _] = texel(light.map_or(DVec3::ZERO, |light| of(&velocities.lights, light)), 0.0);
        [x, y, z, entry.select_pdf]
    }));
    for rate in &velocities.instances {
        let in_render_space = rate.unwrap_or(DAffine3::ZERO)
            * DAffine3::from_translation(space.origin)
            * DAffine3::from_scale(DVec3::splat(space.unit));
        let rows = in_render_space.matrix3.transpose();
        let last = in_render_space.translation;
        texels.extend([texel(rows.x_axis, last.x), texel(rows.y_axis, last.y), texel(rows.z_axis, last.z)]);
    }
    Ok(texels)
}

/// Fails if the image needs a velocity that is not known.
fn check(scene: &Scene, settings: &Settings, velocities: &Velocities) -> Result<()> {
    let unknown = velocities.instances.iter().position(|rate| rate.is_none_or(|rate| !rate.is_finite()));
    if let Some(index) = unknown {
        return Err(Error::advice(
            format!(
                "--doppler and --fmcw cannot tell how the points of '{}' move, because its mesh changes its shape, or it appears or disappears; ",
                scene.instances[index].node
            ),
            "choose another moment with --at, or leave them out",
        ));
    }
    let camera = &scene.cameras[settings.camera()];
    let moves = velocities.cameras.get(settings.camera()).is_some_and(|&velocity| velocity != DVec3::ZERO);
    if moves && matches!(camera.projection, Projection::Orthographic { .. }) {
        return Err(Error::advice(
            "--doppler and --fmcw take the sensor as a point, but an orthographic camera that moves may also turn; ",
            "use a perspective camera",
        ));
    }
    Ok(())
}

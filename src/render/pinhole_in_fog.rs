//! A warning about a lamp at the pinhole in fog. The fog directly before both scatters back more light than any image can show.

use std::collections::BTreeMap;

use glam::DVec3;

use super::space::RenderSpace;
use super::travel_time_bounds::Box3;
use crate::scene::{Light, Medium, Scene};
use crate::settings::Settings;

/// Returns a warning, with the remedy, if a lamp in use is at the pinhole, a medium there scatters, and light without a travel time is
/// inside the gate. `sensor`: the points where camera rays start. `powers`: powers of the emitters in use, by name.
pub fn warning(
    scene: &Scene,
    settings: &Settings,
    space: &RenderSpace,
    sensor: Box3,
    powers: &BTreeMap<String, f64>,
) -> Option<String> {
    let is_at_pinhole = |position: DVec3| sensor.is_at(space.point(position));
    let is_lamp = |light: &&Light| light.kind.spreads_from_a_point() && powers.contains_key(&light.node);
    let mut lights = scene.lights.iter().filter(is_lamp);
    let lamp = lights.find(|light| is_at_pinhole(light.position))?;
    let contains = |medium: &&Medium| {
        medium.extent().is_none_or(|[lo, hi]| lo.cmple(lamp.position).all() && lamp.position.cmple(hi).all())
    };
    let scatters = scene.media.iter().rev().find(contains).is_some_and(|medium| medium.sigma_s != [0.0; 3]);
    (scatters && settings.responses().support().lo <= 0.0).then(|| {
        format!(
            "the lamp '{}' is at the pinhole and in fog. The brightness of the fog has no upper limit there, so the image stays noisy: move \
             the lamp with --headlamp-offset, or let the gate begin later than 0 m",
            lamp.node
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Kind, build};
    use crate::render::PreparedScene;
    use crate::scene::LightKind;
    use crate::settings::units::Gate;

    #[test]
    fn a_lamp_at_the_pinhole_in_fog_is_named() {
        let fog = |sigma_s: f64| Medium { sigma_s: [sigma_s; 3], ..Medium::default() };
        let far = DVec3::splat(100.0);
        let elsewhere = Medium { bounds: Some([far, far + 1.0]), ..fog(0.1) };
        let warnings = |medium: Medium, offset: f64, start: f64| {
            let mut scene = build(Kind::CornellBox);
            let eye = scene.cameras[0].transform.translation;
            scene.add_light(
                "headlamp",
                eye + DVec3::X * offset,
                DVec3::NEG_Z,
                LightKind::Point { intensity: [1.0; 3] },
            );
            scene.media.push(medium);
            let gate = Gate { lo: start, hi: 9.0 };
            let settings = Settings::builder().gate(gate).build().unwrap();
            PreparedScene::new(&scene, &settings).unwrap().warnings(&scene, &settings)
        };
        let found = warnings(fog(0.1), 0.0, 0.0);
        assert!(found.len() == 1 && found[0].starts_with("the lamp 'headlamp' is at the pinhole"), "{found:?}");
        for (medium, offset, start) in
            [(fog(0.0), 0.0, 0.0), (elsewhere, 0.0, 0.0), (fog(0.1), 0.1, 0.0), (fog(0.1), 0.0, 0.5)]
        {
            assert_eq!(warnings(medium, offset, start), Vec::<String>::new(), "{offset} {start}");
        }
    }
}

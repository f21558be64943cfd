//! Suns: directional lights, infinitely far away, in renders without a gate.

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, light, material, plastic};
use taugate::internals::generate::shapes::{cuboid, quad};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::{LightKind, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::agreement::{against, assert_none, oracle, oracle_samples, unlike_estimators};
use super::cells::{Cells, renderer, settings};

const STEADY: (f64, f64) = (0.0, f64::INFINITY);
const IRRADIANCE: f32 = 3.0;
const ALBEDO: f32 = 0.6;

fn sun(scene: &mut Scene, name: &str, direction: DVec3, irradiance: [f32; 3]) {
    light(scene, name, DVec3::ZERO, direction, LightKind::Directional { irradiance });
}

/// A diffuse wall in sunlight that arrives at `cosine` to its normal. Everything is `scale` metres large and `away` metres from
/// the origin of the world.
fn wall(cosine: f64, scale: f64, away: f64) -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("grey", [ALBEDO; 3]));
    let centre = DVec3::X * away;
    let corner = centre + DVec3::new(-scale, -scale, -2.0 * scale);
    add(&mut scene, "wall", grey, quad(corner, DVec3::X * 2.0 * scale, DVec3::Y * 2.0 * scale, [1.0; 2]));
    camera(&mut scene, centre, centre + DVec3::NEG_Z, 0.5, [8, 8]);
    let sine = (1.0 - cosine * cosine).sqrt();
    sun(&mut scene, "sun", DVec3::new(0.6 * sine, -0.8 * sine, -cosine), [IRRADIANCE; 3]);
    scene
}

fn radiance(estimator: Estimator, scene: &Scene) -> (f64, f64) {
    let mut renderer = renderer(scene, &settings(estimator, [8, 8]).build().unwrap());
    Cells::measure(&mut renderer, Gate::OPEN, 8, 1, 8, 100).whole()
}

/// The radiance is albedo / pi times the irradiance times the cosine, for every size and place of the scene.
#[test]
fn a_wall_in_the_sun_has_the_radiance_of_the_closed_form() {
    for (cosine, scale, away) in
        [(1.0, 1.0, 0.0), (0.5, 1.0, 0.0), (0.02, 1.0, 30.0), (0.5, 1e4, 0.0), (0.5, 1e-4, 1.0)]
    {
        let truth = f64::from(ALBEDO * IRRADIANCE) / std::f64::consts::PI * cosine;
        let estimators = if scale == 1.0 { &Estimator::ALL[..] } else { &[Estimator::Bdpt, Estimator::Lcs] };
        for &estimator in estimators {
            let (mean, error) = radiance(estimator, &wall(cosine, scale, away));
            eprintln!("{estimator} cosine {cosine}, scale {scale}: {mean:.6} +- {error:.6}, closed form {truth:.6}");
            // The directions to the far point that stands for the sun differ by about 2e-6.
            let tolerance = 4.5 * error + truth * (1e-5 + 4e-6 / cosine);
            assert!((mean - truth).abs() <= tolerance, "{estimator} cosine {cosine}, scale {scale}: {mean} +- {error}");
            // Negative control: light that is off by 5 % is noticed, unless it grazes the wall.
            assert!(
                cosine < 0.5 || (mean - 1.05 * truth).abs() > tolerance,
                "{estimator} cosine {cosine}: the test is too weak"
            );
        }
    }
}

#[test]
fn a_wall_with_its_back_to_the_sun_is_black() {
    let mut scene = wall(0.5, 1.0, 0.0);
    scene.lights[0].direction.z *= -1.0;
    for estimator in Estimator::ALL {
        assert_eq!(radiance(estimator, &scene), (0.0, 0.0), "{estimator}");
    }
}

/// The Cornell box with a glossy block. Sunlight falls in from the open side. There is no glass, because the oracle and `pt` do not
/// find the light of a sun through glass.
pub fn sunny_box() -> Scene {
    let mut scene = build(Kind::CornellBox);
    let gloss = material(&mut scene, plastic("gloss", [0.4, 0.5, 0.4], 0.4));
    add(&mut scene, "gloss", gloss, cuboid(DVec3::new(-0.9, 0.0, 0.4), DVec3::new(-0.5, 0.3, 0.8)));
    sun(&mut scene, "sun", DVec3::new(0.3, -0.5, -0.8).normalize(), [6.0, 5.0, 4.0]);
    scene
}

fn agrees(name: &str, scene: &Scene) {
    assert_none(against(
        name,
        &unlike_estimators(scene),
        scene,
        &[STEADY],
        &oracle(scene, &[STEADY], [24, 16], oracle_samples()),
    ));
}

#[test]
fn estimators_agree_with_the_oracle_in_sunlight() {
    agrees("sun and lamp", &sunny_box());
    let mut dark = sunny_box();
    dark.materials.iter_mut().for_each(|material| material.emission = [0.0; 3]);
    agrees("sun alone", &dark);
}

/// With more than eight lamps, queries and random draws choose among the lamps, and suns are among them.
#[test]
#[ignore = "takes ten seconds; one sun is compared with the oracle always"]
fn suns_among_many_lamps_agree_with_the_oracle() {
    let mut scene = sunny_box();
    sun(&mut scene, "second sun", DVec3::new(-0.5, -0.2, -0.7).normalize(), [1.0, 2.0, 3.0]);
    for i in 0..8 {
        let place = DVec3::new(0.2 * f64::from(i) - 0.7, 1.2 + 0.05 * f64::from(i), 0.3);
        light(&mut scene, &format!("lamp {i}"), place, DVec3::NEG_Y, LightKind::Point { intensity: [0.3; 3] });
    }
    agrees("suns and lamps", &scene);
}

/// The light of a sun has no travel time, so a renderer of a scene with a sun rejects gates.
#[test]
fn a_renderer_with_a_sun_takes_no_gate() {
    let mut renderer = renderer(&wall(0.5, 1.0, 0.0), &settings(Estimator::Bdpt, [8, 8]).build().unwrap());
    let error = renderer.restart(1, Gate { lo: 1.0, hi: 2.0 }).unwrap_err().to_string();
    assert!(error.contains("infinitely far away"), "{error}");
    assert!(renderer.restart(1, Gate::OPEN).is_ok());
}

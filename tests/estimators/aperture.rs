//! Thin lenses against closed forms: the circle of confusion, its light, and travel times; with camera rays and with connections of light
//! vertices to the lens (t = 1). A lens that also distorts, against the oracle.

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, light, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::generate::zoo;
use taugate::internals::render::Renderer;
use taugate::internals::scene::{Aperture, Distortion, Lens, LightKind, Projection, Scene};
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Sampling};

use super::agreement::{against, assert_none, feature_against_oracle, feature_estimators, oracle, oracle_samples};
use super::cells::{renderer, settings};

const SIZE: [u32; 2] = [32, 32];
/// Focal length in pixels.
const FOCAL: f64 = 100.0;
const FOCUS: f64 = 2.0;
const DIAMETER: f64 = 0.3;
const ALBEDO: f64 = 0.6;

/// A camera at the origin that looks at -Z.
fn scene(aperture: Option<Aperture>) -> Scene {
    let mut scene = Scene::default();
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1.0, SIZE);
    let camera = &mut scene.cameras[0];
    camera.projection = Projection::Perspective { yfov: 2.0 * (0.5 * f64::from(SIZE[1]) / FOCAL).atan() };
    camera.lens = Lens { aperture, ..Lens::PINHOLE };
    scene
}

fn disc() -> Option<Aperture> {
    Some(Aperture { diameter: DIAMETER, focus: FOCUS, blades: 0 })
}

/// A square panel around the axis of the camera at the distance `z`, `width` wide, with radiance 1.
fn panel(aperture: Option<Aperture>, z: f64, width: f64) -> Scene {
    let mut scene = scene(aperture);
    let bright = material(&mut scene, emitter("panel", [1.0; 3]));
    let corner = DVec3::new(-0.5 * width, -0.5 * width, -z);
    add(&mut scene, "panel", bright, quad(corner, width * DVec3::X, width * DVec3::Y, [1.0; 2]));
    scene
}

/// Beams of zero width that meet a wall at the distance `z` on the axis of the camera.
fn spot(aperture: Option<Aperture>, z: f64, beams: usize) -> Scene {
    let mut scene = scene(aperture);
    let wall = material(&mut scene, diffuse("wall", [ALBEDO as f32; 3]));
    add(&mut scene, "wall", wall, quad(DVec3::new(-9.0, -9.0, -z), 18.0 * DVec3::X, 18.0 * DVec3::Y, [1.0; 2]));
    for k in 0..beams {
        let kind = LightKind::Beam { power: [2.0 / beams as f32; 3], radius: 0.0 };
        light(&mut scene, &format!("beam {k}"), DVec3::new(0.0, 0.0, 1.0 - z), DVec3::NEG_Z, kind);
    }
    scene
}

/// Light of all pixels, and its mean square distance from the centre of the image along one axis, in pixels.
fn moments(renderer: &Renderer) -> [f64; 2] {
    let image = renderer.film().mean();
    let (mut sum, mut squares) = (0.0, 0.0);
    for (index, rgb) in image.chunks(3).enumerate() {
        let [x, y] = [index % SIZE[0] as usize, index / SIZE[0] as usize].map(|k| k as f64 + 0.5 - 16.0);
        sum += f64::from(rgb[0]);
        squares += 0.5 * (x * x + y * y) * f64::from(rgb[0]);
    }
    [sum, squares / sum]
}

fn pt(scene: &Scene, gate: Gate) -> [f64; 2] {
    let settings = settings(Estimator::Pt, SIZE).sampling(Sampling::Uniform).max_depth(1).gate(gate).build().unwrap();
    let mut renderer = renderer(scene, &settings);
    (0..400).for_each(|_| renderer.iterate(16).unwrap_or_else(|e| panic!("{e}")));
    moments(&renderer)
}

/// Diameter in pixels of the circle of confusion of points at the distance `z`.
fn circle(z: f64) -> f64 {
    DIAMETER * FOCAL * (z - FOCUS).abs() / (z * FOCUS)
}

#[test]
fn camera_rays_blur_a_panel_as_the_closed_form_says() {
    let whole = Gate { lo: 0.0, hi: f64::INFINITY };
    for z in [1.5, 2.0, 4.0] {
        let width = 6.0 * z / FOCAL;
        // Squares of the panel and of the disc add up, and those of the pixels, whose light counts at their centres (Sheppard). In focus, the
        // panel ends at the edges of six pixels.
        let of_pixels = if z == FOCUS { -1.0 / 12.0 } else { 1.0 / 12.0 };
        let expected = 6.0f64.powi(2) / 12.0 + circle(z).powi(2) / 16.0 + of_pixels;
        let [light, square] = pt(&panel(disc(), z, width), whole);
        eprintln!("{z} m: light {light:.3} of 36, mean square {square:.4} of {expected:.4}");
        assert!(
            (light / 36.0 - 1.0).abs() < 0.002 && (square / expected - 1.0).abs() < 0.01,
            "{z} m: {light} {square}"
        );
        // Negative control: the pinhole.
        let [_, sharp] = pt(&panel(None, z, width), whole);
        assert_eq!((sharp / expected - 1.0).abs() < 0.01, z == FOCUS, "{z} m: {sharp}");
    }
    // The corners of a square aperture lie on the circle: R^2 / 6 instead of R^2 / 4.
    let square_aperture = Aperture { blades: 4, ..disc().unwrap() };
    let [light, square] = pt(&panel(Some(square_aperture), 4.0, 0.24), whole);
    let expected = 3.0 + circle(4.0).powi(2) / 24.0 + 1.0 / 12.0;
    assert!(
        (light / 36.0 - 1.0).abs() < 0.002 && (square / expected - 1.0).abs() < 0.01,
        "{light} {square} {expected}"
    );
}

#[test]
fn connections_to_the_lens_blur_a_spot_as_the_closed_form_says() {
    let truth = ALBEDO / std::f64::consts::PI * 2.0 * FOCAL * FOCAL;
    for z in [2.0, 4.0] {
        let settings = settings(Estimator::Bdpt, SIZE).max_depth(2).build().unwrap();
        let mut renderer = renderer(&spot(disc(), z, 16), &settings);
        (0..300).for_each(|_| renderer.iterate(1).unwrap_or_else(|e| panic!("{e}")));
        let [light, square] = moments(&renderer);
        // In focus, the spot is at the corner of four pixels, whose centres are half a pixel away.
        let expected = if z == FOCUS { 0.25 } else { circle(z).powi(2) / 16.0 + 1.0 / 12.0 };
        eprintln!("{z} m: light {:.5}, mean square {square:.4} of {expected:.4}", light * z * z / truth);
        assert!((light * z * z / truth - 1.0).abs() < 1e-4, "{z} m: {light}");
        assert!((square / expected - 1.0).abs() < 0.04, "{z} m: {square} instead of {expected}");
    }
}

/// All rays of a point in focus have the travel time of the pinhole. From the rim, the point is 5.6 mm farther away.
#[test]
fn points_in_focus_have_the_travel_time_of_a_pinhole() {
    let around = |tau: f64| Gate { lo: tau - 1e-3, hi: tau + 1e-3 };
    let width = 6.0 * FOCUS / FOCAL;
    // The corners of the panel are 1.8 mm farther away than its centre, so a smaller panel is tested.
    let [light, _] = pt(&panel(disc(), FOCUS, width / 3.0), around(FOCUS));
    assert!((light / 4.0 - 1.0).abs() < 0.02, "camera rays: {light}");
    let settings = settings(Estimator::Bdpt, SIZE).max_depth(2).gate(around(1.0 + FOCUS)).build().unwrap();
    let mut renderer = renderer(&spot(disc(), FOCUS, 16), &settings);
    (0..20).for_each(|_| renderer.iterate(1).unwrap_or_else(|e| panic!("{e}")));
    let truth = ALBEDO / std::f64::consts::PI * 2.0 * FOCAL * FOCAL / (FOCUS * FOCUS);
    let [light, _] = moments(&renderer);
    assert!((light / truth - 1.0).abs() < 1e-4, "t = 1: {light} instead of {truth}");
    // Negative control: a lens that is focused elsewhere has other times.
    let elsewhere = Aperture { focus: 1.0, ..disc().unwrap() };
    let [partial, _] = pt(&panel(Some(elsewhere), FOCUS, width / 3.0), around(FOCUS));
    assert!(partial < 3.0, "{partial}");
}

/// A room with every material, seen by a wide lens that also distorts the image.
#[test]
fn a_room_through_a_lens_agrees_with_the_oracle() {
    for (name, light) in [("area", zoo::Light::Area), ("beam", zoo::Light::Beam)] {
        let mut scene = zoo::zoo(light);
        let sharp = scene.clone();
        let distortion = Distortion::Rational { radial: [-0.25, 0.06, 0.0, 0.0, 0.0, 0.0], tangential: [4e-3, -3e-3] };
        let aperture = Some(Aperture { diameter: 0.3, focus: 2.0, blades: 0 });
        scene.cameras[0].lens = Lens { distortion, aperture, ..Lens::PINHOLE };
        let gates = [(6.0, 7.5), (0.0, f64::INFINITY)];
        assert_none(feature_against_oracle(name, &scene, &gates, [24, 16]));
        let of_pinhole = oracle(&sharp, &gates, [24, 16], oracle_samples());
        assert!(!against(name, &feature_estimators(&scene), &scene, &gates, &of_pinhole).is_empty());
    }
}

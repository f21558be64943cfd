//! Light that is reflected inside the slab, and light that is scattered twice with glass before, between and after.

use std::f64::consts::PI;

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, glass, light, material};
use taugate::internals::generate::shapes::{cuboid, quad};
use taugate::internals::scene::{LightKind, Material, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::super::cells::{Cells, is_long, renderer, settings, threshold};
use super::{ALBEDO, INDEX, INTENSITY, SIDE, THICKNESS, WALL, face, mean_over_view, slab};

/// Light that crosses the slab at an angle from the axis, and is reflected `pairs` times twice inside: the distance from the axis at
/// which it meets the wall, the derivative of this distance, and the travel time.
fn crossing(angle: f64, pairs: u32) -> (f64, f64, f64) {
    let (sine, cosine) = angle.sin_cos();
    let sine_inside = sine / INDEX;
    let cosine_inside = (1.0 - sine_inside * sine_inside).sqrt();
    let (free, inside) = (WALL - THICKNESS, f64::from(2 * pairs + 1) * THICKNESS);
    let rho = free * sine / cosine + inside * sine_inside / cosine_inside;
    let slope = free / (cosine * cosine) + inside * cosine / (INDEX * cosine_inside.powi(3));
    (rho, slope, free / cosine + INDEX * inside / cosine_inside)
}

/// Share of the light that crosses the slab in this way.
fn passed(angle: f64, pairs: u32) -> f64 {
    let reflected = face(angle.sin());
    (1.0 - reflected).powi(2) * reflected.powi(2 * pairs as i32)
}

/// Radiance and travel time of light with so many pairs of reflections on the way out and on the way back.
fn reflected_in_slab(angle: f64, out: u32, back: u32) -> (f64, f64) {
    let angle = angle.max(1e-6);
    let (rho, _, back_time) = crossing(angle, back);
    // The angle at the lamp of the light that meets the same point.
    let mut from_lamp = angle;
    for _ in 0..20 {
        let (at, slope, _) = crossing(from_lamp, out);
        from_lamp += (rho - at) / slope;
    }
    let (_, slope, out_time) = crossing(from_lamp, out);
    let irradiance = INTENSITY * passed(from_lamp, out) * from_lamp.sin() / (rho * slope);
    (ALBEDO / PI * irradiance * passed(angle, back), out_time + back_time)
}

/// Light with one pair of reflections, on the way out or on the way back, has a gate of its own. It is 0.3 % of the light without.
#[test]
fn light_reflected_twice_inside_a_slab_has_its_own_gate() {
    let gate = Gate { lo: 8.19, hi: 8.23 };
    let of_order = |out, back| {
        mean_over_view(|angle| reflected_in_slab(angle, out, back), |tau| if gate.contains(tau) { 1.0 } else { 0.0 })
    };
    assert!(of_order(0, 0) == 0.0 && of_order(1, 1) == 0.0 && of_order(1, 0) > 0.0);
    let truth = of_order(1, 0) + of_order(0, 1);
    let s = settings(Estimator::Bdpt, [SIDE, SIDE]).light_paths(200).build().unwrap();
    let iterations = if is_long() { 64 } else { 4 };
    let (found, error) = Cells::measure(&mut renderer(&slab(), &s), gate, 4, iterations, 16, 700).whole();
    eprintln!("{found:.4e} +- {error:.1e}, expected {truth:.4e}");
    let off = |truth: f64| ((found - truth).abs() - 5e-3 * truth).max(0.0) / error;
    // Without the reflections on one of the ways, half of the light would be missing.
    assert!(off(truth) < threshold(1) && off(0.8 * truth) > threshold(1), "{found} +- {error}, not {truth}");
}

/// Two walls that face each other, with panes of this glass before the camera and between the walls. `None`: without panes.
fn corner(panes: Option<Material>) -> Scene {
    let mut scene = Scene::default();
    let wall = |scene: &mut Scene, name: &str, x: f64| {
        let white = material(scene, diffuse(name, [ALBEDO as f32; 3]));
        add(scene, name, white, quad(DVec3::new(x, -1.0, -3.0), DVec3::Z, 2.0 * DVec3::Y, [1.0; 2]));
    };
    wall(&mut scene, "left", -1.0);
    wall(&mut scene, "right", 1.0);
    if let Some(glass) = panes {
        let pane = material(&mut scene, glass);
        add(&mut scene, "window", pane, cuboid(DVec3::new(-4.0, -4.0, -1.05), DVec3::new(4.0, 4.0, -1.0)));
        add(&mut scene, "divider", pane, cuboid(DVec3::new(-0.01, -4.0, -5.0), DVec3::new(0.01, 4.0, -1.2)));
    }
    // All light falls on the wall that the camera does not see.
    let spot = LightKind::Spot { intensity: [INTENSITY as f32; 3], inner: 0.15, outer: 0.2 };
    light(&mut scene, "lamp", DVec3::ZERO, DVec3::new(-1.0, 0.0, -2.2).normalize(), spot);
    camera(&mut scene, DVec3::new(0.2, 0.0, 0.0), DVec3::new(1.0, 0.0, -2.5), 0.1, [SIDE, SIDE]);
    scene
}

/// Light that both walls scatter passes glass before, between and after: lamp, S, D, S, D, S, camera. Panes with an index of 1 change
/// nothing, so connections show the same light without them. Merging at both walls would find it twice.
#[test]
fn light_that_could_merge_at_two_places_counts_once() {
    // Light of one wall takes less than 6 m, and light that is scattered three times more than 8 m.
    let gate = Gate { lo: 6.2, hi: 8.0 };
    let measure = |panes: Option<Material>, iterations: u32, seed: u32| {
        let s = settings(Estimator::Bdpt, [SIDE, SIDE]).light_paths(200).max_depth(11).build().unwrap();
        Cells::measure(&mut renderer(&corner(panes), &s), gate, 4, iterations, 16, seed).whole()
    };
    let (truth, spread) = measure(None, if is_long() { 32 } else { 4 }, 720);
    let clear = Material { ior: 1.0, ..glass("clear") };
    let (found, error) = measure(Some(clear), if is_long() { 32 } else { 2 }, 760);
    eprintln!("{found:.5e} +- {error:.1e}, expected {truth:.5e} +- {spread:.1e}");
    let off = |truth: f64| ((found - truth).abs() - 5e-3 * truth).max(0.0) / error.hypot(spread);
    assert!(truth > 0.0 && off(truth) < threshold(1) && off(2.0 * truth) > threshold(1), "{found}, not {truth}");
    assert!(off(1.25 * truth) > threshold(1), "{found} +- {error} could be {}", 1.25 * truth);
}

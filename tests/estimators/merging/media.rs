//! Fog and milk behind smooth glass. Closed forms of light that is scattered once.

use std::f64::consts::PI;

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, glass, light, material};
use taugate::internals::generate::shapes::{cuboid, quad};
use taugate::internals::scene::{LightKind, Material, Medium, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::super::cells::{Cells, renderer, settings, threshold};
use super::{INDEX, INTENSITY, SIDE, THICKNESS, face, slab};

/// Thin fog behind the slab: light of one event in it, in a gate, integrated over the depths of the events that the axis sees.
#[test]
fn fog_behind_a_slab_is_seen_through_it() {
    let (scattering, near, far) = (0.05f64, -1.5, -3.5);
    let mut scene = slab();
    // No light passes beside the slab.
    let lamp = LightKind::Spot { intensity: [INTENSITY as f32; 3], inner: 0.11, outer: 0.12 };
    scene.lights[0].kind = lamp;
    let bounds = Some([DVec3::new(-8.0, -8.0, -3.9), DVec3::new(8.0, 8.0, near)]);
    scene.media = vec![Medium { sigma_s: [scattering; 3], bounds, ..Medium::default() }];
    let time = |z: f64| 2.0 * (-z - THICKNESS + INDEX * THICKNESS);
    let gate = Gate { lo: time(-2.5), hi: time(far) };
    let passed = (1.0 - face(1e-6)).powi(2);
    let steps = 1000;
    let of_step = |k: u32| {
        let z = 2.5 + (f64::from(k) + 0.5) / f64::from(steps);
        let irradiance = INTENSITY * passed / (z - THICKNESS + THICKNESS / INDEX).powi(2);
        scattering / (4.0 * PI) * irradiance * passed * (-2.0 * scattering * (z + near)).exp()
    };
    let truth = (0..steps).map(of_step).sum::<f64>() / f64::from(steps);
    for estimator in [Estimator::Bdpt, Estimator::Lcs] {
        let s = settings(estimator, [SIDE, SIDE]).light_paths(200).max_depth(6).build().unwrap();
        let (found, error) = Cells::measure(&mut renderer(&scene, &s), gate, 4, 4, 16, 500).whole();
        eprintln!("{estimator}: {found:.4e} +- {error:.1e}, expected {truth:.4e}");
        let off = |truth: f64| ((found - truth).abs() - 1e-2 * truth).max(0.0) / error.max(1e-9);
        assert!(off(truth) < threshold(2) && off(0.9 * truth) > threshold(2), "{found} +- {error}, not {truth}");
    }
}

/// A cube of milk 2.5 m before camera and lamp. With an index of 1, its surface is no vertex of the path, and connections find the light;
/// with the index of water, merging does. The medium itself is the same.
#[test]
fn milk_behind_its_smooth_surface_is_as_bright_as_it_should_be() {
    let (scattering, front) = (1.0f64, 2.5f64);
    for index in [1.0f64, 1.33] {
        let mut scene = Scene::default();
        let grey = material(&mut scene, diffuse("wall", [0.5; 3]));
        add(&mut scene, "wall", grey, quad(DVec3::new(-9.0, -9.0, -6.0), 18.0 * DVec3::X, 18.0 * DVec3::Y, [1.0; 2]));
        let interior = Some(Medium { sigma_s: [scattering; 3], ..Medium::default() });
        let milk = material(&mut scene, Material { ior: index as f32, interior, ..glass("milk") });
        let half = DVec3::new(0.5, 0.5, 0.0);
        let (near, far) = (-front * DVec3::Z, -(front + 1.0) * DVec3::Z);
        add(&mut scene, "milk", milk, cuboid(far - half, near + half));
        let spot = LightKind::Spot { intensity: [INTENSITY as f32; 3], inner: 0.03, outer: 0.04 };
        light(&mut scene, "lamp", DVec3::ZERO, DVec3::NEG_Z, spot);
        camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.02, [SIDE, SIDE]);
        let time = |depth: f64| 2.0 * (front + index * depth);
        let gate = Gate { lo: time(0.1), hi: time(0.9) };
        let passed = 1.0 - ((index - 1.0) / (index + 1.0)).powi(2);
        let steps = 1000;
        let of_step = |k: u32| {
            let depth = 0.1 + 0.8 * (f64::from(k) + 0.5) / f64::from(steps);
            let irradiance = INTENSITY * passed / (front + depth / index).powi(2);
            0.8 * scattering / (4.0 * PI) * irradiance * passed / (index * index) * (-2.0 * scattering * depth).exp()
        };
        let truth = (0..steps).map(of_step).sum::<f64>() / f64::from(steps);
        // Four segments: light that is scattered once. Boundaries with an index of 1 are no vertices.
        let depth = if index > 1.0 { 4 } else { 2 };
        for estimator in [Estimator::Bdpt, Estimator::Lcs] {
            let s = settings(estimator, [SIDE, SIDE]).light_paths(200).max_depth(depth).build().unwrap();
            let (found, error) = Cells::measure(&mut renderer(&scene, &s), gate, 4, 2, 16, 520).whole();
            eprintln!("{index}, {estimator}: {found:.5e} +- {error:.1e}, expected {truth:.5e}");
            let off = |truth: f64| ((found - truth).abs() - 2e-2 * truth).max(0.0) / error.max(1e-9);
            assert!(off(truth) < threshold(4) && off(0.9 * truth) > threshold(4), "{found} +- {error}, not {truth}");
        }
    }
}

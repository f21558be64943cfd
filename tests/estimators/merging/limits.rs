//! Merging beside other strategies, and in the limits of small lamps, short gates and small radii.

use glam::{DAffine3, DMat3, DVec3};
use taugate::Emitters;
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, glass, light, material, mesh, place};
use taugate::internals::generate::shapes::{cuboid, icosphere, quad};
use taugate::internals::scene::{LightKind, Mesh, Scene};
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::pixels::Pixels;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Merge, Responses};
use taugate_oracle::path_tracer;

use super::super::cells::{Cells, renderer, settings, threshold};
use super::{ALBEDO, INTENSITY, SIDE, behind_slab, slab};

/// A wall 1.6 m before the camera, behind glass, and a lamp above the camera: a point, or a ball of this radius with the same intensity.
fn behind(shape: &Mesh, at: DAffine3, radius: Option<f64>) -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("wall", [ALBEDO as f32; 3]));
    add(&mut scene, "wall", grey, quad(DVec3::new(-2.0, -2.0, -1.6), 4.0 * DVec3::X, 4.0 * DVec3::Y, [1.0; 2]));
    let clear = material(&mut scene, glass("glass"));
    let shape = mesh(&mut scene, "glass", clear, shape.clone());
    place(&mut scene, "glass", shape, at);
    let lamp = DVec3::new(0.0, 0.35, 0.0);
    match radius {
        None => light(&mut scene, "lamp", lamp, DVec3::NEG_Z, LightKind::Point { intensity: [INTENSITY as f32; 3] }),
        Some(radius) => {
            let ball = icosphere(radius, 3);
            // The mean projected area of a convex body is a quarter of its surface (Cauchy).
            let corner = |k: u32| DVec3::from(ball.positions[k as usize].map(f64::from));
            let area = |t: &[u32; 3]| 0.5 * (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0])).length();
            let projected = ball.triangles.iter().map(area).sum::<f64>() / 4.0;
            let shine = material(&mut scene, emitter("shine", [(INTENSITY / projected) as f32; 3]));
            let ball = mesh(&mut scene, "lamp", shine, ball);
            place(&mut scene, "lamp", ball, DAffine3::from_translation(lamp));
        }
    }
    camera(&mut scene, DVec3::ZERO, DVec3::new(0.0, -0.1, -1.0), 0.3, [SIDE, SIDE]);
    scene
}

/// Where a ball of glass is, between camera and wall.
fn ball_at() -> DAffine3 {
    DAffine3::from_translation(DVec3::new(0.0, -0.05, -0.6))
}

/// A slab that is not parallel to the wall, and the ball.
fn objects() -> [(&'static str, Mesh, DAffine3); 2] {
    let turn = DMat3::from_rotation_x(0.4);
    let pane = cuboid(DVec3::new(-0.6, -0.6, -0.02), DVec3::new(0.6, 0.6, 0.02));
    let tilted = DAffine3::from_mat3_translation(turn, DVec3::new(0.0, 0.0, -0.5));
    [("tilted slab", pane, tilted), ("ball", icosphere(0.15, 4), ball_at())]
}

/// A lamp that shrinks: path tracing, which hits it by chance, approaches what merging finds for a point.
#[test]
#[ignore = "takes minutes: cargo test --release --test estimators shrinks_to_a_point -- --ignored --nocapture"]
fn a_lamp_that_shrinks_to_a_point_is_the_limit_behind_glass() {
    // Light that glass reflects to the camera without the wall takes less. Light of the largest lamp over the wall takes 3.1 m.
    let gate = Gate { lo: 2.9, hi: 8.0 };
    for (name, shape, at) in objects() {
        let measure = |radius: Option<f64>, estimator, iterations: u32| {
            let scene = behind(&shape, at, radius);
            let s = settings(estimator, [SIDE, SIDE]).light_paths(200).max_depth(8).build().unwrap();
            Cells::measure(&mut renderer(&scene, &s), gate, 16, iterations, 16, 800).whole()
        };
        let (point, error) = measure(None, Estimator::Bdpt, 4);
        eprintln!("{name}: a point, merged: {point:.5} +- {error:.1e}");
        let mut last = 0.0;
        for (radius, iterations) in [(0.1, 16), (0.05, 64)] {
            let (found, spread) = measure(Some(radius), Estimator::Pt, iterations);
            eprintln!("{name}: radius {radius}: {found:.5} +- {spread:.1e}");
            last = (found - point).abs() - 1e-2 * point - threshold(2) * spread.hypot(error);
        }
        assert!(last < 0.0, "{name}: the smallest lamp is not like the point");
    }
}

/// The same limit, found by an independent path tracer in f64, which hits the ball by chance.
#[test]
#[ignore = "takes 15 minutes: cargo test --release --test estimators small_lamp_in_f64 -- --ignored --nocapture"]
fn merging_for_a_point_is_near_a_small_lamp_in_f64() {
    let (gate, resolution) = (Gate { lo: 2.9, hi: 8.0 }, [SIDE, SIDE]);
    // A ball as lens bends the light of a large lamp more.
    for ((name, shape, at), radius) in objects().into_iter().zip([0.1, 0.05]).rev() {
        let s = settings(Estimator::Bdpt, resolution).light_paths(200).max_depth(8).build().unwrap();
        let (point, error) =
            Cells::measure(&mut renderer(&behind(&shape, at, None), &s), gate, 16, 16, 16, 900).whole();
        let (bins, emitters) = (vec![(gate.lo, gate.hi)], Emitters::Scene);
        let s = path_tracer::Settings { camera: 0, resolution, spp: 20_000, seed: 11, max_depth: 8, bins, emitters };
        let film = path_tracer::render(&behind(&shape, at, Some(radius)), &s);
        let pixels = &film.bins[0];
        let spread = pixels.iter().map(|pixel| pixel.variance[0]).sum::<f64>().sqrt() / pixels.len() as f64;
        let found = film.average(0);
        eprintln!(
            "{name}: a point, merged: {point:.5} +- {error:.1e}; radius {radius}, f64: {found:.5} +- {spread:.1e}"
        );
        let noise = spread.hypot(error);
        let off = |truth: f64| ((point - truth).abs() - 1e-2 * truth).max(0.0) / noise;
        assert!(noise < 0.01 * found && off(found) < threshold(2), "{name}: {point}, not {found} +- {noise}");
        assert!(off(1.06 * found) > threshold(2), "{name}: {point} could be {}", 1.06 * found);
    }
}

/// Lamps with a surface are found by other strategies, which keep their bits beside glass.
#[test]
fn merging_leaves_lamps_with_a_surface_alone() {
    let scene = behind(&icosphere(0.15, 2), ball_at(), Some(0.05));
    let image = |merge| {
        let s = settings(Estimator::Lcs, [SIDE, SIDE]).light_paths(200).merge(merge).build().unwrap();
        let mut renderer = renderer(&scene, &s);
        (0..2).for_each(|_| renderer.iterate(2).unwrap());
        assert!(renderer.merged().is_none());
        renderer.film().mean().into_iter().map(f32::to_bits).collect::<Vec<_>>()
    };
    let on = image(Merge::Auto);
    assert!(on.iter().any(|&bits| bits != 0) && on == image(Merge::Off));
}

/// Two gates that abut see together what a gate over both sees: the same photons, so rounding is the only difference.
#[test]
fn abutting_gates_add_up_behind_a_slab() {
    let scene = slab();
    let image = |gate: Gate| {
        let s = settings(Estimator::Bdpt, [SIDE, SIDE]).light_paths(200).gate(gate).build().unwrap();
        let mut renderer = renderer(&scene, &s);
        (0..2).for_each(|_| renderer.iterate(8).unwrap());
        renderer.film().mean()
    };
    let of = |lo: f64, hi: f64| image(Gate { lo, hi });
    let (first, second, both) = (of(8.04, 8.06), of(8.06, 8.08), of(8.04, 8.08));
    let sum = |values: &[f32]| values.iter().map(|&x| f64::from(x)).sum::<f64>();
    assert!(sum(&first) > 0.1 * sum(&both) && sum(&second) > 0.1 * sum(&both));
    let is_near = |((a, b), both): ((&f32, &f32), &f32)| (a + b - both).abs() <= 1e-4 * both.max(1e-3);
    let apart = first.iter().zip(&second).zip(&both).filter(|&pair| !is_near(pair)).count();
    assert_eq!(apart, 0, "of {} values", both.len());
    // The bins of a histogram are gates too.
    let bins = Responses::from(Gates::new(Gate { lo: 8.04, hi: 8.08 }, 2).unwrap());
    let s = settings(Estimator::Bdpt, [SIDE, SIDE]).light_paths(200).responses(bins).build().unwrap();
    let mut renderer = renderer(&scene, &s);
    (0..2).for_each(|_| renderer.iterate(8).unwrap());
    for (k, gate) in [&first, &second].into_iter().enumerate() {
        let bin = sum(&renderer.responses().unwrap().unwrap().mean(k));
        assert!((bin / sum(gate) - 1.0).abs() < 0.02, "bin {k}: {bin}, {}", sum(gate));
    }
}

/// The slope of `values` over `places` in a double logarithmic plot.
fn slope(places: &[f64], values: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().map(|x| x.ln()).sum::<f64>() / v.len() as f64;
    let (x0, y0) = (mean(places), mean(values));
    let pairs = || places.iter().zip(values).map(|(x, y)| (x.ln() - x0, y.ln() - y0));
    pairs().map(|(x, y)| x * y).sum::<f64>() / pairs().map(|(x, _)| x * x).sum::<f64>()
}

/// The lamp of the slab is a spot whose light falls off around the axis. Merging within an angle a, in units of the spot's, takes a^2 of
/// the light in the middle.
#[test]
#[ignore = "takes a minute: cargo test --release --test estimators square_of_the_radius -- --ignored --nocapture"]
fn the_bias_falls_as_the_square_of_the_radius() {
    let (outer, view) = (0.02f64, 2e-3f64);
    let mut scene = slab();
    scene.lights[0].kind = LightKind::Spot { intensity: [INTENSITY as f32; 3], inner: 0.0, outer: outer as f32 };
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, view, [SIDE, SIDE]);
    scene.cameras.swap_remove(0);
    scene.cameras[0].resolution = Some([4, 4]);
    let radii = [0.3, 0.42, 0.6];
    let measure = |share: f64| {
        let pixels = share * outer / (view / 4.0);
        let s = settings(Estimator::Bdpt, [4, 4]).merge_radius(Pixels::try_from(pixels).unwrap()).light_paths(200);
        let mut renderer = renderer(&scene, &s.build().unwrap());
        let gate = Gate { lo: 8.04, hi: 8.06 };
        // Small images have 4,096 photons in an iteration. Only the first iteration has the full radius.
        let rounds = 90;
        (0..rounds).map(|k| Cells::measure(&mut renderer, gate, 4, 1, 1, 1000 + 100 * k).mean(0)).sum::<f64>()
            / f64::from(rounds)
    };
    let steps = 32;
    let at = |k: u32| view * ((f64::from(k) + 0.5) / f64::from(steps) - 0.5);
    let pixels = (0..steps).flat_map(|row| (0..steps).map(move |column| (row, column)));
    let of_pixel = |(row, column)| {
        let angle = at(row).hypot(at(column));
        behind_slab(angle).0 * (1.0 - (angle / outer).powi(2)).powi(2)
    };
    let truth = pixels.map(of_pixel).sum::<f64>() / f64::from(steps * steps);
    // The mean of the spot's profile over a disk lacks a^2 - a^4 / 3.
    let bias = radii.map(|a| (1.0 - measure(a) / truth) / (1.0 - a * a / 3.0));
    let slope = slope(&radii, &bias);
    eprintln!("radii {radii:?}: bias without its fourth order {bias:?}, slope {slope:.3}");
    assert!((slope - 2.0).abs() < 0.1);
    assert!(radii.iter().zip(&bias).all(|(a, bias)| (bias / (a * a) - 1.0).abs() < 0.1));
}

/// The mean square of the error falls with the power -2/3 of the number of iterations, because the radius shrinks.
#[test]
#[ignore = "takes a minute: cargo test --release --test estimators power_of_the_iterations -- --ignored --nocapture"]
fn the_error_falls_with_a_power_of_the_iterations() {
    let s = settings(Estimator::Bdpt, [SIDE, SIDE]).light_paths(200).build().unwrap();
    let mut renderer = renderer(&slab(), &s);
    let counts = [16u32, 32, 64, 128];
    let errors: Vec<f64> = counts
        .into_iter()
        .map(|count| {
            let pixels = Cells::measure(&mut renderer, Gate { lo: 8.04, hi: 8.08 }, 1, count, 1, 840).averages();
            let seeds = f64::from(super::super::cells::seeds());
            seeds * pixels.iter().map(|(mean, variance)| variance / (mean * mean)).sum::<f64>() / pixels.len() as f64
        })
        .collect();
    let counts = counts.map(f64::from);
    let slope = slope(&counts, &errors);
    eprintln!("relMSE {errors:?} after {counts:?} iterations: slope {slope:.3}");
    assert!((slope + 2.0 / 3.0).abs() < 0.1);
}

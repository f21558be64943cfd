//! Ellipsoidal connections, of `epc` and of `lcs`, in gates that bdpt hardly ever hits. Tests in other files cover `epc` in
//! wide gates.

use super::agreement::{against, assert_none, bin, oracle, oracle_samples, settings_against};
use super::cells::{Cells, disagreements, is_long, renderer, settings, threshold};
use glam::DVec3;
use taugate::internals::generate::parts::light;
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::generate::{Kind, build};
use taugate::internals::render::Renderer;
use taugate::internals::scene::{LightKind, Medium, PhaseFunction, Scene};
use taugate::internals::self_check::sphere::gated_radiance;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Settings, UseEllipsoids};

/// Gates that begin here hold light that was scattered at least twice, so every path has an auxiliary vertex.
const BEGIN: f64 = 3.3;
/// The last gate is 16 f32 steps wide.
const WIDTHS: [f64; 4] = [0.1, 1e-2, 1e-4, 16.0 / (1u32 << 22) as f64];

#[test]
fn thin_gates_of_a_sphere_agree_with_the_closed_form() {
    for settings in
        [settings(Estimator::Epc, [16, 16]), settings(Estimator::Lcs, [16, 16]).ellipsoids(UseEllipsoids::On)]
    {
        let widths = if is_long() { &WIDTHS[..] } else { &[WIDTHS[1], WIDTHS[3]] };
        thin_gates_of_a_sphere(&settings.light_paths(2000).build().unwrap(), vec![], widths);
    }
}

/// In water, light takes longer by the group index, and the water absorbs on all segments of a connection. Deterministic vertices are
/// in the water too.
#[test]
#[ignore = "takes ten seconds; thin gates of a sphere in air are tested always"]
fn thin_gates_of_a_sphere_in_water_agree_with_the_closed_form() {
    let settings = settings(Estimator::Epc, [16, 16]).light_paths(2000).build().unwrap();
    let water = Medium { ior: 1.33, group_ior: 1.36, sigma_a: [0.2; 3], ..Medium::default() };
    thin_gates_of_a_sphere(&settings, vec![water], &WIDTHS[1..2]);
}

/// Gates that begin at [`BEGIN`] and have these widths. In a medium, the ends of the gates are multiplied by its group index.
fn thin_gates_of_a_sphere(settings: &Settings, media: Vec<Medium>, widths: &[f64]) {
    let factor = media.first().map_or(1.0, |medium| f64::from(medium.group_ior));
    let sigma_a = media.first().map_or(0.0, |medium| medium.sigma_a[0]);
    let scene = Scene { media, ..build(Kind::GatedSphere { radius: 1.0, subdivisions: 4, albedo: 0.5 }) };
    let mut renderer = renderer(&scene, settings);
    for width in widths {
        let end = BEGIN + width;
        let gate = Gate { lo: factor * BEGIN, hi: factor * end };
        let (mean, error) = Cells::measure(&mut renderer, gate, 16, 1, 8, 40).whole();
        let truth = gated_radiance(1.0, 0.5, BEGIN, end) * (-sigma_a * 0.5 * (BEGIN + end)).exp();
        eprintln!("width {width:.1e}: {:.4} +- {:.4} of the closed form", mean / truth, error / truth);
        assert!(error < 0.02 * truth, "width {width}: {mean} +- {error}");
        // The sphere is a mesh of 5,120 flat triangles, so its light differs a little from the closed form.
        let allowed = 0.005 * truth;
        assert!(
            (mean - truth).abs() < allowed + threshold(widths.len()) * error,
            "width {width}: {mean} against {truth}"
        );
        assert!((1.1 * mean - truth).abs() > allowed + threshold(1) * error, "10 % more light is not rejected");
    }
}

/// Abutting gates add up to the gate that covers both, for which `lcs` forms no ellipsoidal connections. The blocks of the room hide
/// large parts of the ellipsoids.
#[test]
#[ignore = "takes ten seconds; thin gates of a sphere are tested always"]
fn abutting_thin_gates_add_up_to_one() {
    let scene = build(Kind::CornellBox);
    let gates = [Gate { lo: 8.0, hi: 8.02 }, Gate { lo: 8.02, hi: 8.04 }];
    let renderer = |estimator, ellipsoids| {
        renderer(&scene, &settings(estimator, [16, 16]).max_depth(5).ellipsoids(ellipsoids).build().unwrap())
    };
    let whole = Gate { lo: gates[0].lo, hi: gates[1].hi };
    let whole = Cells::measure(&mut renderer(Estimator::Lcs, UseEllipsoids::Off), whole, 16, 1, 16, 400);
    for (estimator, ellipsoids) in [(Estimator::Lcs, UseEllipsoids::On), (Estimator::Epc, UseEllipsoids::Auto)] {
        let mut renderer = renderer(estimator, ellipsoids);
        let [first, second] = gates.map(|gate| Cells::measure(&mut renderer, gate, 16, 1, 8, 40));
        let sum = first.plus(&second);
        eprintln!("{estimator:?}: {:?} and {:?}", sum.whole(), whole.whole());
        assert_none(disagreements(&sum, &whole));
        assert!(
            !disagreements(&sum.times(0.85), &whole).is_empty(),
            "{estimator:?}: 85 % of the light is not rejected"
        );
    }
}

/// A renderer for a wide gate accepts a thin one, and the reverse, but a new renderer would give other bits.
#[test]
fn a_renderer_takes_gates_of_any_width() {
    let scene = build(Kind::CornellBox);
    let gates = [Gate { lo: 6.0, hi: 6.5 }, Gate { lo: 6.0, hi: 6.0001 }];
    for (own, other) in [(gates[0], gates[1]), (gates[1], gates[0])] {
        let mut renderer = renderer(&scene, &settings(Estimator::Lcs, [8, 8]).gate(own).build().unwrap());
        assert!(renderer.can_restart(&own.into()) && !renderer.can_restart(&other.into()));
        renderer.restart(1, other).unwrap();
        renderer.iterate(4).unwrap();
        assert!(renderer.film().mean().iter().any(|&x| x > 0.0));
    }
}

/// The scene in fog, so that events in fog are neighbours of auxiliary vertices.
fn foggy(scene: Scene) -> Scene {
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.5 };
    Scene { media: vec![Medium { sigma_s: [0.15, 0.1, 0.2], sigma_a: [0.02; 3], phase, ..Medium::default() }], ..scene }
}

/// In fog, `epc` alone has ellipsoidal connections. Long runs also compare both estimators in the room without fog.
#[test]
fn glass_alpha_and_fog_agree_with_the_oracle() {
    let gates = [(5.0, 5.5), (8.0, 8.5), (5.5, 6.0)];
    let mut scenes = vec![("fog", foggy(zoo(Light::Punctual)))];
    if is_long() {
        scenes.push(("lamp", zoo(Light::Area)));
    }
    for (name, scene) in scenes {
        let truth = oracle(&scene, &gates, [24, 20], oracle_samples());
        // Few paths meet these gates, so the comparison notices only large differences, and a shifted gate.
        let noticed = if scene.media.is_empty() { 1.5 } else { 2.0 };
        let compare = |settings| assert_none(settings_against(name, settings, &scene, &gates[..2], &truth, noticed));
        compare(settings(Estimator::Epc, truth.resolution));
        if scene.media.is_empty() {
            compare(settings(Estimator::Lcs, truth.resolution).ellipsoids(UseEllipsoids::On));
        }
        let shifted = against(name, &[Estimator::Epc], &scene, &gates[..1], &bin(&truth, 2));
        assert!(!shifted.is_empty(), "{name}: a gate that is shifted by its width is not rejected");
    }
}

/// More than eight lamps are in the trees, and none of them shines red.
/// `cargo test --release --test estimators -- --ignored many_green_lamps`
#[test]
#[ignore = "takes ten seconds; lamps in the trees are tested always"]
fn many_green_lamps_keep_their_light_in_thin_gates() {
    let scene = |power: f32| {
        let mut scene = build(Kind::CornellBox);
        scene.materials.iter_mut().for_each(|material| material.emission = [0.0; 3]);
        for k in 0..9 {
            let at = DVec3::new(-0.4 + 0.1 * f64::from(k), 1.8, 0.1 * f64::from(k % 3));
            light(
                &mut scene,
                &format!("lamp {k}"),
                at,
                DVec3::NEG_Y,
                LightKind::Point { intensity: [0.0, power, 0.0] },
            );
        }
        scene
    };
    let gate = Gate { lo: 7.0, hi: 7.01 };
    let cells = |power: f32, ellipsoids: UseEllipsoids, iterations: u32, seed: u32| {
        let settings = settings(Estimator::Lcs, [16, 16]).max_depth(5).ellipsoids(ellipsoids).build().unwrap();
        let cells = Cells::measure(&mut renderer(&scene(power), &settings), gate, 8, iterations, 16, seed);
        eprintln!("{ellipsoids:?}: {:?}", cells.whole());
        cells
    };
    let without = cells(1.0, UseEllipsoids::Off, 2, 400);
    assert_none(disagreements(&cells(1.0, UseEllipsoids::On, 1, 40), &without));
    // Negative control: lamps of 1.3 times the power.
    assert!(!disagreements(&cells(1.3, UseEllipsoids::On, 1, 40), &without).is_empty());
}

/// `lcs` with and without ellipsoidal connections has the same mean in every cell.
/// `cargo test --release --test estimators -- --ignored ellipsoidal_connections_leave`
#[test]
#[ignore = "takes two minutes; thin gates of a sphere are tested always"]
fn ellipsoidal_connections_leave_the_mean_of_lcs() {
    let gate = Gate { lo: 8.0, hi: 8.02 };
    let later = Gate { lo: gate.lo + 0.5, hi: gate.hi + 0.5 };
    for light in [Light::Area, Light::Punctual, Light::Beam] {
        let scene = zoo(light);
        let renderer = |ellipsoids: UseEllipsoids| {
            let settings = settings(Estimator::Lcs, [24, 20]).max_depth(6).ellipsoids(ellipsoids);
            renderer(&scene, &settings.build().unwrap())
        };
        let cells = |renderer: &mut Renderer, gate: Gate, seed: u32| Cells::measure(renderer, gate, 8, 1, 16, seed);
        let mut on = renderer(UseEllipsoids::On);
        let with = cells(&mut on, gate, 40);
        let without = cells(&mut renderer(UseEllipsoids::Off), gate, 400);
        eprintln!("{light:?}: {:?} and {:?}", with.whole(), without.whole());
        assert_none(disagreements(&with, &without));
        assert!(
            !disagreements(&cells(&mut on, later, 40), &without).is_empty(),
            "{light:?}: a later gate is not rejected"
        );
    }
}

//! Fog beside clear glass, empty space and many lamps: cases in which a segment of a subpath holds no fog, or more than one solid.

use glam::{DAffine3, DVec3};
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, glass, light, material, mesh, place};
use taugate::internals::generate::shapes::{cuboid, icosphere, quad};
use taugate::internals::render::Renderer;
use taugate::internals::scene::{LightKind, Material, Medium, PhaseFunction, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::units::Gate;

use super::agreement::{against, assert_none, bin, feature_estimators, oracle, oracle_samples};
use super::cells::{Cells, disagreements, renderer, settings};

const SIZE: [u32; 2] = [16, 8];

fn fog(sigma_s: f64) -> Medium {
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.3 };
    Medium { sigma_s: [sigma_s; 3], sigma_a: [0.1 * sigma_s; 3], phase, ..Medium::default() }
}

/// A floor and a wall in fog, seen from the front.
fn scene_with(media: Vec<Medium>) -> Scene {
    let mut scene = Scene { media, ..Scene::default() };
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let grey = material(&mut scene, diffuse("grey", [0.6, 0.5, 0.4]));
    add(&mut scene, "floor", grey, quad(DVec3::new(-2.0, 0.0, -1.5), z * 3.0, x * 4.0, [1.0; 2]));
    add(&mut scene, "wall", grey, quad(DVec3::new(-2.0, 0.0, -1.0), x * 4.0, y * 2.5, [1.0; 2]));
    camera(&mut scene, DVec3::new(0.0, 0.9, 2.2), DVec3::new(0.0, 0.5, 0.0), 0.6, SIZE);
    scene
}

/// The oracle finds light of a surface through glass, but not light of a point.
fn add_lamp(scene: &mut Scene) {
    let shine = material(scene, emitter("lamp", [1.0; 3]));
    add(scene, "lamp", shine, quad(DVec3::new(-2.0, 2.0, -1.0), DVec3::X * 4.0, DVec3::Z * 4.0, [1.0; 2]));
}

/// A point light of 3 `power` W/sr.
fn add_bulb(scene: &mut Scene, at: DVec3, power: f64) {
    light(scene, "bulb", at, DVec3::NEG_Y, LightKind::Point { intensity: [(3.0 * power) as f32; 3] });
}

fn ball(scene: &mut Scene, inside: Material, radius: f64, at: DVec3) {
    let inside = material(scene, inside);
    let round = mesh(scene, "ball", inside, icosphere(radius, 2));
    place(scene, "ball", round, DAffine3::from_translation(at));
}

fn cells(scene: &Scene, estimator: Estimator, gate: Gate, iterations: u32, seed: u32) -> Cells {
    let s = settings(estimator, SIZE).max_depth(6).build().unwrap();
    let cells = Cells::measure(&mut renderer(scene, &s), gate, 8, iterations, 16, seed);
    eprintln!("{estimator}: {:?}", cells.whole());
    cells
}

/// Compares `lcs` with `bdpt` on `scene(1.0)`, and asserts that `lcs` on `scene(wrong)` differs. `iterations`: of `bdpt` and of `lcs`.
fn lcs_agrees_with_bdpt(scene: impl Fn(f64) -> Scene, wrong: f64, gate: Gate, iterations: [u32; 2]) {
    let truth = cells(&scene(1.0), Estimator::Bdpt, gate, iterations[0], 1);
    assert_none(disagreements(&truth, &cells(&scene(1.0), Estimator::Lcs, gate, iterations[1], 300)));
    assert!(!disagreements(&truth, &cells(&scene(wrong), Estimator::Lcs, gate, iterations[1], 300)).is_empty());
}

/// Fog around clear glass does not enter it, also not between its surface and an opaque object inside.
#[test]
fn fog_does_not_enter_clear_glass() {
    let scene = |wall: f64| {
        let at = DVec3::new(0.0, 0.9, 1.2);
        // The fog would fill half of the ball.
        let bounds = Some([-0.4, 0.4].map(|x| at + DVec3::splat(x)));
        let mut scene = scene_with(vec![Medium { bounds, ..fog(10.0) }]);
        add_lamp(&mut scene);
        ball(&mut scene, glass("smooth"), 0.7, at);
        let white = material(&mut scene, diffuse("white", [wall as f32; 3]));
        add(&mut scene, "cube", white, cuboid(at - DVec3::splat(0.25), at + DVec3::splat(0.25)));
        scene
    };
    let gates = [(3.0, 5.0), (0.0, f64::INFINITY)];
    let truth = oracle(&scene(0.8), &gates, SIZE, oracle_samples());
    assert_none(against("fog", &feature_estimators(&scene(0.8)), &scene(0.8), &gates, &truth));
    // Negative control: a darker cube.
    assert!(!against("darker cube", &[Estimator::Lcs], &scene(0.4), &gates[1..], &bin(&truth, 1)).is_empty());
}

/// The events of fog on the segment before rough glass are not drawn again on the segment inside the glass. Negative control: a lamp
/// of 1.2 times the power.
#[test]
#[ignore = "takes ten seconds; clear glass in fog is tested always"]
fn events_before_rough_glass_are_drawn_once() {
    let scene = |power: f64| {
        let mut scene = scene_with(vec![fog(0.6)]);
        add_bulb(&mut scene, DVec3::new(-0.6, 1.8, 0.6), power);
        ball(&mut scene, Material { roughness: 0.6, ..glass("rough") }, 0.6, DVec3::new(0.0, 0.65, 0.6));
        scene
    };
    lcs_agrees_with_bdpt(scene, 1.2, Gate { lo: 2.5, hi: 4.0 }, [4, 1]);
}

/// A box of fog before empty space: segments that leave the scene hold events too. Negative control: fog that is 1.3 times as dense.
#[test]
fn fog_before_empty_space_scatters_light() {
    let scene = |density: f64| {
        let bounds = Some([[-1.0, -1.0, -2.0], [1.0, 1.0, 1.0]].map(DVec3::from));
        let mut scene = Scene { media: vec![Medium { bounds, ..fog(0.05 * density) }], ..Scene::default() };
        add_bulb(&mut scene, DVec3::new(0.2, 0.3, -0.5), 1.0);
        camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.6, SIZE);
        scene
    };
    lcs_agrees_with_bdpt(scene, 1.3, Gate { lo: 0.5, hi: f64::INFINITY }, [4, 1]);
}

/// Light through a layer of air in water. In this gate, light that crosses water alone is too late. Negative control: a lamp of twice
/// the power.
#[test]
#[ignore = "takes ten seconds; light that scatters in water, and glass with media inside, are tested always"]
fn light_through_air_in_water_arrives_in_time() {
    let scene = |power: f64| {
        let mut scene = Scene { media: vec![Medium { ior: 1.33, group_ior: 1.33, ..fog(0.3) }], ..Scene::default() };
        add_bulb(&mut scene, DVec3::new(0.0, 3.0, -2.0), power);
        let air = material(&mut scene, Material { roughness: 0.3, ior: 1.0, ..glass("air") });
        add(&mut scene, "layer", air, cuboid(DVec3::new(-3.0, 1.0, -6.0), DVec3::new(3.0, 2.5, 0.0)));
        camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.6, SIZE);
        scene
    };
    lcs_agrees_with_bdpt(scene, 2.0, Gate { lo: 4.2, hi: 4.8 }, [12, 4]);
}

/// With more lamps than shade points connect to one by one, a histogram of `lcs` draws no events in the gate.
#[test]
#[ignore = "takes ten seconds; histograms, fog and many lamps are tested always, one by one"]
fn histograms_in_fog_under_many_lamps_agree() {
    let scene = |power: f32| {
        let mut scene = scene_with(vec![fog(0.3)]);
        for k in 0..20 {
            let at = DVec3::new(-1.5 + 0.15 * f64::from(k), 1.2 + 0.03 * f64::from(k), 0.4);
            light(&mut scene, &format!("lamp {k}"), at, DVec3::NEG_Y, LightKind::Point { intensity: [power; 3] });
        }
        scene
    };
    let gates = Gates::new(Gate { lo: 0.0, hi: 30.0 }, 10).unwrap();
    let whole = |estimator, power, seed| {
        let s = settings(estimator, SIZE).max_depth(6).responses(gates).build().unwrap();
        let scene = scene(power);
        let mut renderer: Renderer = renderer(&scene, &s);
        let images = (0..super::cells::seeds()).map(|k| {
            renderer.restart(seed + k, gates).unwrap();
            renderer.iterate(8).unwrap();
            let film = renderer.responses().unwrap().unwrap();
            (0..film.responses()).map(|k| mean(&film.mean(k))).collect::<Vec<f64>>()
        });
        let images: Vec<Vec<f64>> = images.collect();
        let lit = (0..images[0].len()).filter(|&k| images[0][k] > 0.0);
        Cells::grey(lit.map(|k| images.iter().map(|image| image[k]).collect()).collect())
    };
    let truth = whole(Estimator::Bdpt, 0.3, 1);
    assert_none(disagreements(&truth, &whole(Estimator::Lcs, 0.3, 300)));
    // Negative control: lamps of 1.2 times the power.
    assert!(!disagreements(&truth, &whole(Estimator::Lcs, 0.36, 300)).is_empty());
}

fn mean(image: &[f32]) -> f64 {
    image.iter().map(|&x| f64::from(x)).sum::<f64>() / image.len() as f64
}

//! Gated caustics: a glass ball focuses light, and a mirror reflects light, onto a diffuse floor. No connection finds these
//! paths. They are found by t = 1 (a light vertex on the floor, connected to the pinhole) and s = 0 (a camera path that hits the
//! lamp through the glass).

use std::sync::OnceLock;

use super::agreement::{against, assert_none, bin, oracle};
use super::cells::{Cells, disagreements, renderer, settings};
use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, glass, material, mesh, metal, place};
use taugate::internals::generate::shapes::{icosphere, quad};
use taugate::internals::scene::Scene;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Strategies};
use taugate_oracle::path_tracer::Film;

const RADIUS: f64 = 0.4;
const SIZE: [u32; 2] = [24, 16];
/// A gate around the arrival of the light that is focused by the ball. Its path is 2.75 m from the floor to the pinhole, 2 m from
/// the lamp to the floor, and half the ball's diameter more because glass slows light.
const CAUSTIC: (f64, f64) = (5.0, 5.3);

/// The ball stands between a small lamp and the floor; the mirror stands upright beside it.
fn scene() -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("grey", [0.6, 0.5, 0.4]));
    let clear = material(&mut scene, glass("ball"));
    let silver = material(&mut scene, metal("mirror", [0.95; 3], 0.0));
    let shine = material(&mut scene, emitter("lamp", [40.0; 3]));
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    add(&mut scene, "floor", grey, quad(DVec3::new(-2.0, 0.0, -1.5), z * 3.0, x * 4.0, [1.0; 2]));
    add(&mut scene, "wall", grey, quad(DVec3::new(-2.0, 0.0, -1.5), x * 4.0, y * 2.5, [1.0; 2]));
    let ball = mesh(&mut scene, "ball", clear, icosphere(RADIUS, 3));
    place(&mut scene, "ball", ball, glam::DAffine3::from_translation(DVec3::new(-0.6, 0.6, 0.0)));
    add(&mut scene, "mirror", silver, quad(DVec3::new(1.2, 0.1, -0.6), z * 1.2, y * 0.9, [1.0; 2]));
    add(&mut scene, "lamp", shine, quad(DVec3::new(-0.75, 2.0, -0.15), x * 0.3, z * 0.3, [1.0; 2]));
    camera(&mut scene, DVec3::new(0.0, 1.2, 2.4), DVec3::new(0.0, 0.2, 0.0), 0.9, SIZE);
    scene
}

fn cells(estimator: Estimator, strategies: Strategies, first_seed: u32) -> Cells {
    let s = settings(estimator, SIZE).max_depth(8).strategies(strategies).light_paths(4000).build().unwrap();
    Cells::measure(&mut renderer(&scene(), &s), Gate { lo: CAUSTIC.0, hi: CAUSTIC.1 }, 8, 1, 8, first_seed)
}

#[test]
fn caustics_agree_with_bdpt() {
    let truth = cells(Estimator::Bdpt, Strategies::All, 1);
    for estimator in [Estimator::LcsPaper, Estimator::Lcs] {
        let got = cells(estimator, Strategies::All, 200);
        eprintln!("{estimator}: {:?}, bdpt {:?}", got.whole(), truth.whole());
        assert_none(disagreements(&truth, &got));
    }
    // Negative control: without s = 0 and t = 1 there are no caustics.
    assert!(!disagreements(&truth, &cells(Estimator::LcsPaper, Strategies::Paper, 400)).is_empty());
}

const GATES: [(f64, f64); 2] = [CAUSTIC, (0.0, f64::INFINITY)];

/// The oracle's images through `GATES`, then through a third gate, in which the caustic would arrive if glass did not slow light. This
/// gate is earlier than the first one by half the ball's diameter. The oracle hits the lamp through the glass by chance: over a
/// hundred times per cell with 3,200 samples per pixel.
fn truth() -> &'static Film {
    static TRUTH: OnceLock<Film> = OnceLock::new();
    TRUTH.get_or_init(|| {
        let early = (CAUSTIC.0 - RADIUS, CAUSTIC.1 - RADIUS);
        oracle(&scene(), &[GATES[0], GATES[1], early], SIZE, 3200)
    })
}

/// `pt` is left out: it hits the lamp by chance too, and takes fewer samples than the oracle.
#[test]
fn caustics_agree_with_the_oracle() {
    let estimators = [Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs];
    assert_none(against("caustics", &estimators, &scene(), &GATES, truth()));
}

/// Negative control: the gate in which the caustic would arrive without the delay in glass.
#[test]
fn caustics_without_their_delay_are_rejected() {
    let early = bin(truth(), GATES.len());
    assert!(!against("caustics, early", &[Estimator::Lcs], &scene(), &GATES[..1], &early).is_empty());
}

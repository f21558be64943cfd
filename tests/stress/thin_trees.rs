//! Thin gates have the right energy six kilometres from the pinhole. The light vertices are points on a lamp, or points that the
//! lamp lights. `lcs-paper` keeps them in its 3D tree and its 4D tree, and `lcs` in one tree; `bdpt` has no trees. The truth is an
//! integral in f64, computed with a lattice rule.

use std::f64::consts::PI;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use taugate::internals::generate::parts::{camera, diffuse, emitter, material, mesh, place};
use taugate::internals::generate::shapes::quad;
use taugate::internals::render::{PreparedScene, StrategyImages};
use taugate::internals::scene::Scene;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Settings};

use super::cells::{Cells, device, renderer, settings, threshold};

/// Distance from the pinhole to the wall in view, in metres. All travel times are between 4096 m and 8192 m.
const DISTANCE: f64 = 6000.0;
/// Distance of neighbouring f32 numbers between 4096 m and 8192 m, in metres.
const STEP: f64 = 1.0 / 2048.0;
/// Width of a gate in f32 steps: an eighth of a metre.
const STEPS: f64 = 256.0;
/// Half the side of the square of the wall that is in view, in metres.
const SEEN: f64 = 0.5;
const ALBEDO: f32 = 0.5;
const RADIANCE: f32 = 4.0;

/// A rectangle: a corner, its two sides from there, and the normal of its front.
struct Sheet {
    corner: DVec3,
    sides: [DVec3; 2],
    normal: DVec3,
}

impl Sheet {
    fn new(corner: [f64; 3], u: DVec3, v: DVec3) -> Sheet {
        Sheet { corner: DVec3::from(corner) - DISTANCE * DVec3::Z, sides: [u, v], normal: u.cross(v).normalize() }
    }

    fn at(&self, u: f64, v: f64) -> DVec3 {
        self.corner + u * self.sides[0] + v * self.sides[1]
    }

    fn area(&self) -> f64 {
        self.sides[0].cross(self.sides[1]).length()
    }
}

/// The scene at the far end. The pinhole sees only a part of one wall.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Far {
    /// A lamp that shines onto the wall.
    Lamp,
    /// A lamp that faces away from the part of the wall in view. It lights another wall, whose scattered light reaches this part.
    Scattered,
}

impl Far {
    /// Distances from the wall are multiples of [`STEP`], so z coordinates are exact in f32. The rounding of x and y is far below that of
    /// travel times.
    fn lamp(self) -> Sheet {
        match self {
            Far::Lamp => Sheet::new([-0.2, 0.6, 0.6875], DVec3::Y * 0.4, DVec3::X * 0.4),
            Far::Scattered => Sheet::new([-0.6, 0.9, 0.6875], DVec3::Z * 0.1875, DVec3::Y * 0.2),
        }
    }

    /// The wall is so large that little light reaches its edges. Rays start above their surface, by 2^-19 of the distance from the
    /// pinhole: here a centimetre. Light that falls closer than this to an open edge may be wrongly caught or lost.
    fn other_wall() -> Sheet {
        Sheet::new([-1.0, -1.5, 0.0], DVec3::Y * 5.0, DVec3::Z * 3.0)
    }

    fn scene(self) -> Scene {
        let mut scene = Scene::default();
        let grey = material(&mut scene, diffuse("grey", [ALBEDO; 3]));
        let shine = material(&mut scene, emitter("lamp", [RADIANCE; 3]));
        let mut put = |name, material, s: Sheet| {
            let local = s.corner + DISTANCE * DVec3::Z;
            let shape = quad(local, s.sides[0], s.sides[1], [1.0; 2]);
            // The node's transform moves the shape away, because vertex positions are in f32 and the transform is in f64.
            let index = mesh(&mut scene, name, material, shape);
            let there = DAffine3::from_translation(-DISTANCE * DVec3::Z);
            place(&mut scene, name, index, there);
        };
        put("wall", grey, Sheet::new([-1.0, -0.6, 0.0], DVec3::X * 1.6, DVec3::Y * 1.2));
        if self == Far::Scattered {
            put("other wall", grey, Far::other_wall());
        }
        put("lamp", shine, self.lamp());
        camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 2.0 * (SEEN / DISTANCE).atan(), [16, 16]);
        scene
    }

    /// Number of segments of the paths in [`Far::path`]. The tests exclude longer paths with `max_depth`.
    fn depth(self) -> u32 {
        if self == Far::Lamp { 2 } else { 3 }
    }

    /// Radiance and travel time of the path for a point of the unit cube. Pairs of coordinates give the point on the film, the
    /// point on the lamp, and the direction from the lamp to the other wall.
    fn path(self, p: &[f64; 6]) -> (f64, f64) {
        let lamp = self.lamp();
        let seen = DVec3::new(SEEN * (2.0 * p[0] - 1.0), SEEN * (2.0 * p[1] - 1.0), -DISTANCE);
        let from = lamp.at(p[2], p[3]);
        let emitted = f64::from(RADIANCE) * lamp.area();
        let scatter = f64::from(ALBEDO) / PI;
        let geometry = |a: DVec3, na: DVec3, b: DVec3, nb: DVec3| {
            let (w, d2) = (b - a, (b - a).length_squared());
            (na.dot(w).max(0.0) * nb.dot(-w).max(0.0) / (d2 * d2), d2.sqrt())
        };
        if self == Far::Lamp {
            let (g, d) = geometry(from, lamp.normal, seen, DVec3::Z);
            return (emitted * g * scatter, d + seen.length());
        }
        // The direction from the lamp has a density proportional to the cosine, which cancels the geometry term.
        let (sine, angle) = (p[4].sqrt(), 2.0 * PI * p[5]);
        let w = DVec3::new(-(1.0 - p[4]).sqrt(), sine * angle.cos(), sine * angle.sin());
        let other = Far::other_wall();
        let d1 = (other.corner.x - from.x) / w.x;
        let between = from + d1 * w;
        let inside = other.sides.map(|side| (between - other.corner).dot(side) / side.length_squared());
        if !inside.iter().all(|p| (0.0..1.0).contains(p)) {
            return (0.0, 0.0);
        }
        let (g2, d2) = geometry(between, other.normal, seen, DVec3::Z);
        // The lamp may block the segment between the walls.
        let crossing = between + (seen - between) * ((lamp.corner.x - between.x) / (seen.x - between.x)) - lamp.corner;
        let part = lamp.sides.map(|side| crossing.dot(side) / side.length_squared());
        if part.iter().all(|p| (0.0..1.0).contains(p)) {
            return (0.0, 0.0);
        }
        (emitted * PI * g2 * scatter * scatter, d1 + d2 + seen.length())
    }

    /// Three gates that light reaches, from early to late. Their ends are f32 numbers.
    fn gates(self) -> [Gate; 3] {
        let starts = if self == Far::Lamp { [0.9, 1.05, 1.25] } else { [1.7, 1.95, 2.3] };
        starts.map(|after| {
            let lo = ((DISTANCE + after) / STEP).floor() * STEP;
            Gate { lo, hi: lo + STEPS * STEP }
        })
    }

    /// Mean radiance of the image in each gate, with gates `wider` times as wide. The integral uses Kronecker's lattice with
    /// Roberts' generalised golden ratio, eight shifts of `points` points each. Panics if the standard error over the shifts
    /// exceeds `precise` times the mean.
    fn truth(self, points: u32, wider: f64, precise: f64) -> [f64; 3] {
        let ratio = (0..60).fold(2.0f64, |x, _| (1.0 + x).powf(1.0 / 7.0));
        let step: [f64; 6] = std::array::from_fn(|k| ratio.powi(-(k as i32) - 1));
        let gates = self.gates();
        let shifted = |shift: u32| {
            let mut sums = [0.0; 3];
            for i in 0..points {
                let offset = |k: usize| 0.754_877_666 * f64::from(shift) * (k + 1) as f64;
                let point = std::array::from_fn(|k| (f64::from(i) * step[k] + offset(k)).fract());
                let (value, tau) = self.path(&point);
                for (sum, gate) in sums.iter_mut().zip(&gates) {
                    if gate.lo <= tau && tau < gate.lo + wider * (gate.hi - gate.lo) {
                        *sum += value / f64::from(points);
                    }
                }
            }
            sums
        };
        let all: Vec<[f64; 3]> = (0..8u32).into_par_iter().map(shifted).collect();
        std::array::from_fn(|gate| {
            let mean = all.iter().map(|s| s[gate]).sum::<f64>() / 8.0;
            let error = (all.iter().map(|s| (s[gate] - mean).powi(2)).sum::<f64>() / 56.0).sqrt();
            assert!(error < precise * mean, "{self:?}: the lattice has an error of {:.3} %", 100.0 * error / mean);
            mean
        })
    }
}

fn far_settings(far: Far, estimator: Estimator, light_paths: u32) -> Settings {
    settings(estimator, [16, 16]).max_depth(far.depth()).light_paths(light_paths).build().unwrap()
}

/// Relative bias, averaged over the gates, and the standard error of this average.
fn bias(far: Far, estimator: Estimator, truth: &[f64; 3], light_paths: u32, iterations: u32) -> (f64, f64) {
    let mut renderer = renderer(&far.scene(), &far_settings(far, estimator, light_paths));
    let (mut off, mut variance) = (0.0, 0.0);
    for (i, (gate, truth)) in far.gates().into_iter().zip(truth).enumerate() {
        let (mean, error) = Cells::measure(&mut renderer, gate, 16, iterations, 16, 1 + 100 * i as u32).whole();
        println!(
            "{far:?} {estimator} [{}, {}): {:+.3} % +- {:.3} %",
            gate.lo,
            gate.hi,
            100.0 * (mean / truth - 1.0),
            100.0 * error / truth
        );
        off += (mean / truth - 1.0) / 3.0;
        variance += (error / truth / 3.0).powi(2);
    }
    println!("{far:?} {estimator}: bias {:+.3} % +- {:.3} %", 100.0 * off, 100.0 * variance.sqrt());
    (off, variance.sqrt())
}

const ESTIMATORS: [Estimator; 3] = [Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs];

#[test]
fn gates_of_256_steps_have_their_energy_through_the_trees() {
    for far in [Far::Lamp, Far::Scattered] {
        let truth = far.truth(1 << 20, 1.0, 1e-3);
        let wider = far.truth(1 << 20, 1.1, 1e-3);
        for estimator in ESTIMATORS {
            let (off, error) = bias(far, estimator, &truth, 4000, 1);
            // A bias of up to 0.5 % passes even if it is significant. `lcs` is so precise that the errors of the lattice and of rounded
            // travel times may be significant.
            let allowed = 0.005_f64.max(threshold(6) * error);
            assert!(error < 0.02 && off.abs() < allowed, "{far:?} {estimator}: {off} +- {error}");
            // Negative control: compared with the truth for gates a tenth wider, the image must be significantly too dark.
            let ratio = truth.iter().zip(&wider).map(|(t, w)| t / w).sum::<f64>() / 3.0;
            let control = (1.0 + off) * ratio - 1.0;
            assert!(control < -threshold(1) * error, "{far:?} {estimator}: too noisy to tell");
        }
    }
}

/// Asserts that `measure` returns a bias of at most 0.5 %, or one that is not significant, for every scene and estimator.
/// `measure` receives the truth of all gates.
fn assert_small(measure: impl Fn(Far, Estimator, &[f64; 3]) -> (f64, f64)) {
    let mut wrong = vec![];
    for far in [Far::Lamp, Far::Scattered] {
        let truth = far.truth(1 << 22, 1.0, 5e-4);
        for estimator in ESTIMATORS {
            let (off, error) = measure(far, estimator, &truth);
            if off.abs() > 0.005_f64.max(threshold(6) * error) {
                wrong.push(format!("{far:?} {estimator}: {off} +- {error}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Bias below 0.5 % in gates of 256 steps. `cargo test --release --test stress -- --ignored --nocapture through_the_trees`
#[test]
#[ignore = "takes minutes"]
fn the_bias_of_256_steps_is_small_through_the_trees() {
    assert_small(|far, estimator, truth| bias(far, estimator, truth, 20_000, 8));
}

/// The same in the middle gate, for one strategy alone with MIS weight 1. It connects a light vertex to the wall in view. With s = 1, the
/// vertex lies on the lamp; with s = 2, the lamp lights it.
#[test]
#[ignore = "takes minutes"]
fn connections_alone_have_the_energy_through_the_trees() {
    assert_small(|far, estimator, truth| {
        let (gate, truth) = (far.gates()[1], truth[1]);
        let s = far_settings(far, estimator, 20_000).change().gate(gate).build().unwrap();
        let scene = far.scene();
        let prepared = PreparedScene::new(&scene, &s).expect("a lamp");
        let mut parts = StrategyImages::new(&device(), &scene, &s, &prepared).expect("small images");
        for _ in 0..512 {
            parts.iterate(16).expect("an iteration");
        }
        let own = parts.images().iter().find(|i| (i.s, i.t) == (far.depth() - 1, 2)).expect("the strategy exists");
        let (mean, error) = own.unweighted.image_mean();
        let (off, error) = (mean / truth - 1.0, error.expect("512 iterations") / truth);
        println!("{far:?} {estimator} ({}, 2): {:+.3} % +- {:.3} %", own.s, 100.0 * off, 100.0 * error);
        (off, error)
    });
}

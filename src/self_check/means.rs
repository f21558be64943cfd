//! Checks the mean over an image against a closed form, or against the stored mean of long renders. Other tests compare these
//! renders with an independent path tracer.

use glam::{DAffine3, DVec3};

use super::fog::{Coefficients, gated_single_scattering, henyey_greenstein};
use super::sphere::gated_radiance;
use super::{Method, Verdict};
use crate::compare::statistics::{normal_score, sidak_threshold};
use crate::error::Result;
use crate::estimators::Ellipsoids;
use crate::generate::numbers::sin_cos;
use crate::generate::{Kind, build, parts, zoo::Light};
use crate::gpu::Device;
use crate::render::Renderer;
use crate::scene::{AlphaMode, LightKind, Material, Medium, PhaseFunction, Scene};
use crate::settings::units::Gate;
use crate::settings::{Edge, Estimator, Response, Responses, Settings};

/// Probability that a correct device fails at least one of the tests (Sidak).
const SIGNIFICANCE: f64 = 1e-3;
/// Upper bound on the number of tests.
const TESTS: usize = 180;
/// Relative error of the means that is allowed for 32-bit arithmetic, and for the flat facets of the sphere.
const ROUNDING: f64 = 2e-4;
/// Number of lamps in the sphere with many lamps: more than the estimators connect one by one.
const LAMPS: usize = 12;
/// Distance of the [`LAMPS`] lamps from the centre, relative to the radius. The lamps stand in opposite pairs, so the relative error
/// of the closed form is about the square of this distance.
const ASIDE: f64 = 0.01;
/// Width and height of images of the sphere in pixels. All pixels have the same expected value, so few of them suffice.
const SPHERE_SIDE: u32 = 32;
/// Fraction of the light that passes through the veil in the sphere.
const PASSES: f64 = 0.75;
/// Distance of the veil from the wall, relative to the radius.
const VEIL: f64 = 1e-4;
/// Coefficients of the fog per metre, and the mean cosine of its phase function.
const FOG: Coefficients = Coefficients { sigma_s: 0.1, sigma_t: 0.12 };
const FOG_COSINE: f64 = 0.6;
/// Place of the lamp in the fog relative to the pinhole, in metres, and its intensity in W / sr.
const FOG_LAMP: DVec3 = DVec3::new(0.7, 0.2, -1.0);
const FOG_INTENSITY: f32 = 5.0;
/// Number of iterations, from which the standard error is estimated.
const ITERATIONS: u32 = 24;
/// Samples per pixel in each iteration.
const SAMPLES: u32 = 2;
const SEED: u32 = 4;

/// A scene, and the expected means of its images through some gates.
pub struct Case {
    pub name: &'static str,
    pub scene: Scene,
    pub way: Way,
    pub expected: Vec<ExpectedMean>,
}

/// How the images of a case are rendered.
#[derive(Clone, Copy, PartialEq)]
pub enum Way {
    /// One gate after the other, with the same kernels.
    OneByOne,
    /// As `OneByOne`, of light that scatters once.
    ScatteredOnce,
    /// As `OneByOne`, in a gate so thin that the estimator forms ellipsoidal connections. Only for estimators that do so.
    Ellipsoids,
    /// All gates at once: a response for each of them.
    AtOnce,
}

/// Expected mean over pixels and channels of the image through a gate, and the standard error of this mean (0 for a closed form).
#[derive(Clone, Copy)]
pub struct ExpectedMean {
    pub gate: Gate,
    pub mean: f64,
    pub error: f64,
}

/// All scenes whose means are checked.
pub fn cases() -> Vec<Case> {
    let case = |name, scene, expected| Case { name, scene, way: Way::OneByOne, expected };
    let zoo = |light| build(Kind::Zoo(light));
    let stored = |lo, hi, mean, error| ExpectedMean { gate: Gate { lo, hi }, mean, error };
    let sphere = |albedo, gates: &[(f64, f64)]| {
        gates.iter().map(|&(lo, hi)| stored(lo, hi, gated_radiance(1.0, albedo, lo, hi), 0.0)).collect()
    };
    let sphere_of = |albedo| {
        let mut scene = build(Kind::GatedSphere { radius: 1.0, subdivisions: 5, albedo });
        scene.cameras[0].resolution = Some([SPHERE_SIDE; 2]);
        scene
    };
    let open = Gate::OPEN;
    // The stored means combine `bdpt` and `lcs` (without a gate: `bdpt` and `pt`), each with 2,048 samples per pixel, weighted by
    // their inverse variances.
    vec![
        case("the sphere", sphere_of(0.5), sphere(0.5, &[(1.95, 2.25), (3.0, 3.5), (5.0, 6.0)])),
        // Light passes through the veil twice per reflection.
        Case {
            name: "the sphere behind a veil, lit by twelve lamps",
            scene: by_many_lamps(behind_a_veil(sphere_of(0.8))),
            way: Way::OneByOne,
            expected: sphere(0.8 * PASSES * PASSES, &[(1.95, 3.5)]),
        },
        case(
            "the zoo lit by a lamp",
            zoo(Light::Area),
            vec![stored(open.lo, open.hi, 2.9892e-2, 4.7e-5), stored(7.4, 7.8, 1.6064e-3, 4.5e-6)],
        ),
        case("the zoo lit by a point and a spot", zoo(Light::Punctual), vec![stored(5.0, 8.0, 1.41081e-2, 6.6e-6)]),
        case("the zoo lit by a beam", zoo(Light::Beam), vec![stored(7.0, 8.0, 1.33640e-2, 1.17e-5)]),
        Case {
            name: "a lamp in fog",
            scene: in_fog(),
            way: Way::ScatteredOnce,
            expected: vec![stored(1.5, 2.5, scattered_once(1.5, 2.5), 0.0)],
        },
        Case {
            name: "the sphere in a thin gate",
            scene: sphere_of(0.5),
            way: Way::Ellipsoids,
            expected: sphere(0.5, &[(3.3, 3.301)]),
        },
        Case {
            name: "the sphere in three gates at once",
            scene: sphere_of(0.5),
            way: Way::AtOnce,
            expected: sphere(0.5, &[(1.95, 3.0), (3.0, 4.0), (4.0, 6.0)]),
        },
    ]
}

/// A lamp in fog without surfaces. The field of view is so narrow that all pixels have the same expected value.
fn in_fog() -> Scene {
    let mut scene = Scene::default();
    let lamp = LightKind::Point { intensity: [FOG_INTENSITY; 3] };
    parts::light(&mut scene, "lamp", FOG_LAMP, DVec3::NEG_Z, lamp);
    parts::camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.02f64.to_radians(), [SPHERE_SIDE; 2]);
    scene.media = vec![Medium {
        sigma_s: [FOG.sigma_s; 3],
        sigma_a: [FOG.sigma_t - FOG.sigma_s; 3],
        phase: PhaseFunction::HenyeyGreenstein { g: FOG_COSINE },
        ..Medium::default()
    }];
    scene
}

/// Radiance of [`in_fog`] through a gate, by light that scatters once.
fn scattered_once(lo: f64, hi: f64) -> f64 {
    let phase = |cosine| henyey_greenstein(FOG_COSINE, cosine);
    gated_single_scattering(FOG, phase, FOG_INTENSITY.into(), FOG_LAMP, DVec3::NEG_Z, [lo, hi])
}

/// The sphere with a black, partly transparent surface just in front of its wall.
fn behind_a_veil(mut scene: Scene) -> Scene {
    let black = parts::diffuse("veil", [0.0; 3]);
    let base_color = [0.0, 0.0, 0.0, (1.0 - PASSES) as f32];
    let black = parts::material(&mut scene, Material { alpha_mode: AlphaMode::Blend, base_color, ..black });
    let wall = scene.meshes[0].clone();
    let mesh = parts::mesh(&mut scene, "veil", black, wall);
    parts::place(&mut scene, "veil", mesh, DAffine3::from_scale(DVec3::splat(1.0 - VEIL)));
    scene
}

/// The sphere with its lamp divided into [`LAMPS`] lamps around the centre. Opposite lamps have the same power; pairs differ.
fn by_many_lamps(mut scene: Scene) -> Scene {
    let lamp = scene.lights.pop().expect("the sphere has a lamp");
    let LightKind::Point { intensity } = lamp.kind else { panic!("the lamp of the sphere is a point") };
    let pairs = LAMPS / 2;
    let all: usize = (1..=pairs).map(|share| 2 * share).sum();
    for share in 1..=pairs {
        let height = 2.0 * (share as f64 - 0.5) / pairs as f64 - 1.0;
        let (sin, cos) = sin_cos(2.4 * share as f64);
        let across = (1.0 - height * height).sqrt();
        let away = ASIDE * DVec3::new(across * cos, height, across * sin);
        let part = LightKind::Point { intensity: intensity.map(|i| i * share as f32 / all as f32) };
        parts::light(&mut scene, "one", away, DVec3::NEG_Z, part);
        parts::light(&mut scene, "its opposite", -away, DVec3::NEG_Z, part);
    }
    scene
}

impl Case {
    /// Whether the estimator finds the light of this scene, in a short time. `epc` searches all triangles for each connection.
    pub fn is_for(&self, estimator: Estimator) -> bool {
        let record = estimator.record();
        let triangles: usize = self.scene.meshes.iter().map(|mesh| mesh.triangles.len()).sum();
        let is_slow = record.ellipsoids == Ellipsoids::Enumerated && triangles > 10_000;
        if is_slow || (self.way == Way::Ellipsoids && record.for_thin_gates.is_none()) {
            return false;
        }
        !self.scene.lights.iter().any(|light| estimator.misses(&light.kind))
    }

    /// Renders the scene through each gate, and calls `done` with the name and the result of each check.
    pub fn check(&self, device: &Device, method: Method, done: &mut dyn FnMut(&str, Result<Verdict>)) {
        let renderer = self.settings(method).and_then(|settings| Renderer::new(device, &self.scene, &settings));
        let mut renderer = match renderer {
            Ok(renderer) => renderer,
            Err(error) => return done(self.name, Err(error)),
        };
        let verdicts: Vec<Result<Verdict>> = match self.way {
            Way::AtOnce => match self.check_at_once(&mut renderer) {
                Ok(verdicts) => verdicts.into_iter().map(Ok).collect(),
                Err(error) => return done(self.name, Err(error)),
            },
            _ => self.expected.iter().map(|expected_mean| expected_mean.check(&mut renderer)).collect(),
        };
        for (expected_mean, verdict) in self.expected.iter().zip(verdicts) {
            let gate = if expected_mean.gate.is_open() { "no gate".into() } else { expected_mean.gate.to_string() };
            done(&format!("{}, {gate}", self.name), verdict);
        }
    }

    fn settings(&self, method: Method) -> Result<Settings> {
        let few = "light-paths = 2000";
        match self.way {
            Way::OneByOne | Way::Ellipsoids => method.settings(&self.scene, few),
            Way::ScatteredOnce => method.settings(&self.scene, &format!("{few}\nmax-depth = 2")),
            Way::AtOnce => method.settings(&self.scene, few)?.change().responses(self.responses()?).build(),
        }
    }

    /// A response for each gate.
    fn responses(&self) -> Result<Responses> {
        let gates = self.expected.iter().map(|expected_mean| expected_mean.gate);
        Responses::new(gates.enumerate().map(|(k, gate)| Response::new(k.to_string(), gate, Edge::Sharp)).collect())
    }

    /// Renders all gates at once. `renderer` was made for [`Case::responses`].
    fn check_at_once(&self, renderer: &mut Renderer) -> Result<Vec<Verdict>> {
        renderer.restart(SEED, self.responses()?)?;
        // For each gate: the means of the image in the iterations, and their sum so far.
        let mut means: Vec<(Vec<f64>, f64)> = vec![Default::default(); self.expected.len()];
        for iteration in 1..=ITERATIONS {
            renderer.iterate(SAMPLES)?;
            let images = renderer.responses()?.expect("there are several responses");
            for (k, (means, sum)) in means.iter_mut().enumerate() {
                let image = images.mean(k);
                let mean = image.iter().map(|&x| f64::from(x)).sum::<f64>() / image.len() as f64;
                let new = f64::from(iteration) * mean;
                means.push(new - *sum);
                *sum = new;
            }
        }
        let verdict = |(expected_mean, (means, sum)): (&ExpectedMean, (Vec<f64>, f64))| {
            let n = f64::from(ITERATIONS);
            let mean = sum / n;
            let spread: f64 = means.iter().map(|x| (x - mean) * (x - mean)).sum();
            expected_mean.compare(mean, (spread / (n * (n - 1.0))).sqrt())
        };
        Ok(self.expected.iter().zip(means).map(verdict).collect())
    }
}

impl ExpectedMean {
    pub fn check(&self, renderer: &mut Renderer) -> Result<Verdict> {
        renderer.restart(SEED, self.gate)?;
        for _ in 0..ITERATIONS {
            renderer.iterate(SAMPLES)?;
        }
        let (mean, own_error) = renderer.film().image_mean();
        Ok(self.compare(mean, own_error.expect("there are several iterations")))
    }

    /// Compares a mean with the standard error `own_error`, estimated from [`ITERATIONS`] iterations.
    fn compare(&self, mean: f64, own_error: f64) -> Verdict {
        let rounding = ROUNDING * self.mean;
        let error = (own_error * own_error + self.error * self.error + rounding * rounding).sqrt();
        let z = normal_score((mean - self.mean) / error, f64::from(ITERATIONS - 1));
        let found = format!("expected {:.4e}, found {mean:.4e} +- {own_error:.1e} (z = {z:.1})", self.mean);
        let is_right = z.abs() < sidak_threshold(SIGNIFICANCE, TESTS);
        if is_right { Verdict::Right(found) } else { Verdict::Wrong(found) }
    }
}

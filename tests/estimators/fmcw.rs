//! Beat spectra of an FMCW sensor, compared with the travel times of the same scene.

use taugate::Job;
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::render::Renderer;
use taugate::internals::scene::Scene;
use taugate::internals::settings::{Estimator, Sampling};

use super::cells::renderer;
use super::doppler::moving;

/// How fast everything grows, per second. With a coupling of 1.934 s, each path seems 1.5 times as long in a rising sweep.
const RATE: f64 = 0.5 / 1.934_144_6;

/// The light in each of 20 bins from `lo` to `hi`, with these settings.
fn spectrum(scene: &Scene, estimator: Estimator, fmcw: Option<&str>, [lo, hi]: [f64; 2], iterations: u32) -> Vec<f64> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, taugate::internals::generate::glb::write(&zoo(Light::Punctual))).unwrap();
    let gates = format!("{lo}m..{hi}m/20");
    let flags = [("gates", &*gates), ("estimator", estimator.name()), ("resolution", "20x14")];
    let flags = flags.into_iter().chain(fmcw.map(|chirp| ("fmcw", chirp)));
    let settings = Job::open_with(&path, flags).unwrap().settings().clone();
    let settings = settings.change().sampling(Sampling::Uniform).build().unwrap();
    let mut renderer = renderer(scene, &settings);
    (0..iterations).for_each(|_| renderer.iterate(4).unwrap());
    let sum = |renderer: &Renderer, k: usize| {
        renderer.responses().unwrap().unwrap().mean(k).iter().map(|&x| f64::from(x)).sum()
    };
    (0..20).map(|k| sum(&renderer, k)).collect()
}

/// If everything grows by a factor of 1 + k t, a path of the length L grows by k L, and has the beat of a path of the length
/// L |1 + k x coupling|.
#[test]
fn a_beat_is_that_of_a_path_at_rest() {
    let scene = moving(zoo(Light::Punctual), |p| RATE * p);
    let differences = |a: &[f64], b: &[f64]| {
        let scale = b.iter().sum::<f64>() / b.len() as f64;
        a.iter().zip(b).map(|(a, b)| (a - b).abs() / scale).fold(0.0, f64::max)
    };
    for (estimator, iterations, tolerance) in [(Estimator::Bdpt, 3, 2e-3), (Estimator::Lcs, 12, 0.3)] {
        let at_rest = spectrum(&scene, estimator, None, [2.0, 10.0], iterations);
        // Rising, and falling so fast that negative beats are seen as positive ones: |1 - 2.5 / 2| = 1 / 4.
        for (chirp, factor) in [("1550nm,1GHz,10us", 1.5), ("1550nm,1GHz,-25us", 0.25)] {
            let beats = spectrum(&scene, estimator, Some(chirp), [2.0 * factor, 10.0 * factor], iterations);
            let error = differences(&beats, &at_rest);
            assert!(error < tolerance, "{estimator}, {chirp}: {error}");
            if estimator == Estimator::Lcs {
                continue;
            }
            // Siblings: another factor, and a scene at rest.
            let other = spectrum(&scene, estimator, Some(chirp), [2.2 * factor, 11.0 * factor], iterations);
            assert!(differences(&other, &at_rest) > 1.5 * tolerance, "{estimator}, {chirp}");
            let still =
                spectrum(&zoo(Light::Punctual), estimator, Some(chirp), [2.0 * factor, 10.0 * factor], iterations);
            assert!(differences(&still, &at_rest) > 1.5 * tolerance, "{estimator}, {chirp}: at rest");
        }
    }
}

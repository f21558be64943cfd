//! Convergence over up to a million samples per pixel, and independence of seeds, pixels and iterations.

use taugate::internals::generate::{Kind, build};
use taugate::internals::render::Renderer;
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::cells::{renderer, settings, threshold};
use super::image;
use super::wall::{gated_pixels, wall};

/// Slope of log relMSE over log samples per pixel, up to 16 x 4^`steps` samples. The image has `side` x `side` pixels; the relMSE
/// covers the pixels that the edge of the gated ring crosses. Each pixel has a closed form, and with `pt` pixels are independent.
fn slope(side: u32, steps: u32) -> f64 {
    const YFOV: f64 = 1.2;
    let gate = Gate { lo: 4.3, hi: 4.9 };
    let scene = wall(2.0, YFOV, [side, side]);
    let s = settings(Estimator::Pt, [side, side]).max_depth(2).light_paths(1).build().unwrap();
    let mut renderer = renderer(&scene, &s);
    renderer.restart(11, gate).unwrap();
    let truth = gated_pixels(2.0, YFOV, side as usize, gate.lo, gate.hi);
    let full = gated_pixels(2.0, YFOV, side as usize, 0.0, 100.0);
    let crossed = |i: &usize| (0.1..0.9).contains(&(truth[*i] / full[*i]));
    let crossed: Vec<usize> = (0..truth.len()).filter(crossed).collect();
    assert!(crossed.len() >= 16, "{}", crossed.len());
    let mut points = vec![];
    for step in 0..=steps {
        let samples = 16 * 4u64.pow(step);
        while renderer.film().samples() < samples {
            renderer.iterate(16).unwrap_or_else(|e| panic!("{e}"));
        }
        let mean = renderer.film().mean();
        // The order of rows does not matter, because the ring is symmetric.
        let errors = crossed.iter().map(|&i| (f64::from(mean[3 * i]) / truth[i] - 1.0).powi(2));
        let relmse = errors.sum::<f64>() / crossed.len() as f64;
        println!("{samples} samples: relMSE {relmse:.3e}, times samples {:.3}", relmse * samples as f64);
        points.push(((samples as f64).ln(), relmse.ln()));
    }
    let n = points.len() as f64;
    let (mx, my) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let slope = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum::<f64>()
        / points.iter().map(|p| (p.0 - mx).powi(2)).sum::<f64>();
    println!("{} pixels, slope {slope:.3}", crossed.len());
    slope
}

/// The relMSE of p pixels has a relative standard error of sqrt(2 / p), so the standard error of the slope over four
/// factors of 4 is about 0.03.
#[test]
fn errors_fall_with_the_samples() {
    assert!((slope(20, 4) + 1.0).abs() < 0.1);
}

/// 1,048,576 samples per pixel.
#[test]
#[ignore = "takes minutes"]
fn a_million_samples_still_converge() {
    assert!((slope(14, 8) + 1.0).abs() < 0.1);
}

/// For every lag, the z-score of the correlation between `images[i]` and `images[i + lag]`, over all i with wrap-around. Pixels
/// of an image may be correlated, so the standard error comes from the spread of the pairs.
fn lag_scores(images: &[Vec<f32>], lags: &[usize]) -> Vec<f64> {
    let n = images.len();
    let channels = images[0].len();
    let mean: Vec<f64> =
        (0..channels).map(|c| images.iter().map(|x| f64::from(x[c])).sum::<f64>() / n as f64).collect();
    let deviation: Vec<Vec<f64>> =
        images.iter().map(|x| x.iter().zip(&mean).map(|(&v, m)| f64::from(v) - m).collect()).collect();
    // Deviations from the mean of n independent images have the covariance -variance / n.
    let variance = deviation.iter().flatten().map(|d| d * d).sum::<f64>() / (n - 1) as f64;
    let score = |lag: &usize| {
        let product = |i: usize| dot(&deviation[i], &deviation[(i + lag) % n]) + variance / n as f64;
        z_score(&(0..n).map(product).collect::<Vec<_>>())
    };
    lags.iter().map(score).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// The mean of the values, divided by its standard error.
fn z_score(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    mean / (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt()
}

const LAGS: [usize; 6] = [1, 2, 3, 4, 16, 64];
const GATE: Gate = Gate { lo: 8.0, hi: 10.0 };

fn cornell(estimator: Estimator) -> Renderer {
    let s = settings(estimator, [12, 12]).max_depth(5).light_paths(64).build().unwrap();
    renderer(&build(Kind::CornellBox), &s)
}

fn seeds(estimator: Estimator, n: u32) -> Vec<Vec<f32>> {
    let mut renderer = cornell(estimator);
    (0..n).map(|seed| image(&mut renderer, seed, GATE, 1, 1)).collect()
}

/// Images of single iterations of one seed, computed as differences of the running mean.
fn iterations(estimator: Estimator, n: u32) -> Vec<Vec<f32>> {
    let mut renderer = cornell(estimator);
    renderer.restart(5, GATE).unwrap();
    let mut before = vec![0.0f64; 3 * 144];
    (1..=n)
        .map(|i| {
            renderer.iterate(1).unwrap_or_else(|e| panic!("{e}"));
            let total: Vec<f64> = renderer.film().mean().iter().map(|&x| f64::from(x) * f64::from(i)).collect();
            let own = total.iter().zip(&before).map(|(t, b)| (t - b) as f32).collect();
            before = total;
            own
        })
        .collect()
}

fn independent(name: &str, scores: &[f64]) {
    println!("{name}: z = {scores:.2?}");
    assert!(scores.iter().all(|z| z.abs() < threshold(scores.len())), "{name}: z = {scores:.2?}");
}

#[test]
fn neighbouring_seeds_are_independent() {
    let images = seeds(Estimator::Pt, 256);
    independent("pt, seeds", &lag_scores(&images, &LAGS));
    // Negative control: every image contains a tenth of the next seed's image.
    let leak = |i: usize| {
        images[i].iter().zip(&images[(i + 1) % images.len()]).map(|(a, b)| a + 0.1 * b).collect::<Vec<f32>>()
    };
    let leaking: Vec<_> = (0..images.len()).map(leak).collect();
    assert!(lag_scores(&leaking, &[1])[0] > threshold(1));
}

#[test]
#[ignore = "takes minutes"]
fn seeds_and_iterations_of_every_estimator_are_independent() {
    for estimator in Estimator::ALL {
        independent(&format!("{estimator:?}, seeds"), &lag_scores(&seeds(estimator, 1024), &LAGS));
        independent(&format!("{estimator:?}, iterations"), &lag_scores(&iterations(estimator, 1024), &LAGS));
    }
}

/// With `pt`, pixels share no random numbers and no light paths.
#[test]
#[ignore = "takes a minute"]
fn pixels_are_independent_and_64_seeds_have_a_64th_of_the_variance() {
    let images = seeds(Estimator::Pt, 2048);
    let n = images.len() as f64;
    let channel = |c: usize| images.iter().map(|x| f64::from(x[c])).collect::<Vec<f64>>();
    let green: Vec<Vec<f64>> = (0..144).map(|p| channel(3 * p + 1)).collect();
    let centred: Vec<Vec<f64>> = green
        .iter()
        .map(|values| {
            let mean = values.iter().sum::<f64>() / n;
            values.iter().map(|v| v - mean).collect()
        })
        .collect();
    let pairs = |step: usize| {
        let product = |s: usize| (0..144 - step).map(|p| centred[p][s] * centred[p + step][s]).sum::<f64>();
        z_score(&(0..images.len()).map(product).collect::<Vec<_>>())
    };
    independent("pt, pixels", &[pairs(1), pairs(2), pairs(12), pairs(13)]);

    let single: f64 = centred.iter().map(|v| dot(v, v)).sum::<f64>() / (n - 1.0);
    let groups = |v: &Vec<f64>| {
        let means: Vec<f64> = v.chunks_exact(64).map(|group| group.iter().sum::<f64>() / 64.0).collect();
        dot(&means, &means) / (n / 64.0 - 1.0)
    };
    let of_means: Vec<f64> = centred.iter().map(groups).collect();
    let ratio = 64.0 * of_means.iter().sum::<f64>() / single;
    // The variance of a pixel, estimated from 32 means, has a relative standard error of sqrt(2 / 31).
    let error = 64.0 * of_means.iter().map(|v| v * v * 2.0 / 31.0).sum::<f64>().sqrt() / single;
    println!("64 x variance of the mean of 64 seeds / variance of one = {ratio:.3} +- {error:.3}");
    assert!((ratio - 1.0).abs() < 4.0 * error && error < 0.1);
}

/// The samples of one iteration are stratified together; different iterations are independent. The spread of iterations therefore
/// gives the right error. If one low-discrepancy sequence ran on through all iterations, the ratio in this test would be 4.
#[test]
fn the_variance_between_iterations_is_that_between_seeds() {
    const SEEDS: u32 = 128;
    let mut renderer = cornell(Estimator::Pt);
    let films: Vec<(Vec<f32>, Vec<f32>)> = (0..SEEDS)
        .map(|seed| {
            renderer.restart(seed, Gate::OPEN).unwrap();
            (0..8).for_each(|_| renderer.iterate(8).unwrap_or_else(|e| panic!("{e}")));
            (renderer.film().mean(), renderer.film().variance_of_mean())
        })
        .collect();
    let n = f64::from(SEEDS);
    // For each pixel: the mean of the reported variances, and the variance of its mean over the seeds. With `pt`, pixels are
    // independent.
    let channel = |c: usize| {
        let mean = films.iter().map(|f| f64::from(f.0[c])).sum::<f64>() / n;
        let reported = films.iter().map(|f| f64::from(f.1[c])).sum::<f64>() / n;
        [reported, films.iter().map(|f| (f64::from(f.0[c]) - mean).powi(2)).sum::<f64>() / (n - 1.0)]
    };
    let pixels: Vec<[f64; 2]> = (0..144).map(|p| [0, 1].map(|k| (0..3).map(|c| channel(3 * p + c)[k]).sum())).collect();
    let sum = |k: usize| pixels.iter().map(|p| p[k]).sum::<f64>();
    let ratio = sum(0) / sum(1);
    let error = pixels.iter().map(|p| (p[0] - ratio * p[1]).powi(2)).sum::<f64>().sqrt() / sum(1);
    println!("reported variance / variance between seeds = {ratio:.3} +- {error:.3}");
    assert!((ratio - 1.0).abs() < 4.0 * error && error < 0.04);
}

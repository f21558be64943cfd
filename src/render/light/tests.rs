//! Light vertices in an infinite medium spread as a closed form says.

use glam::{DVec3, Vec3};

use super::Tally;
use crate::generate::parts::{camera, light};
use crate::gpu::Device;
use crate::render::{Renderer, Stats};
use crate::scene::{LightKind, Medium, PhaseFunction, Scene};
use crate::settings::{Estimator, Settings};
use crate::wgsl::layout::NONE;
use crate::wgsl::layout::constants::VERTEX_IN_MEDIUM;

/// Ends of the intervals of travel time, in mean free paths.
const ENDS: [f64; 6] = [0.5, 1.0, 2.0, 5.0, 10.0, 20.0];
const ITERATIONS: usize = 8;

/// The wrong scattering coefficient of the negative control, relative to the right one.
const WRONG: f64 = 1.05;

/// The mean squared distance (m^2) from the lamp of all light that has travelled for `tau` metres, in a medium that scatters
/// `sigma_s` times per metre with the mean cosine `g` and absorbs nothing.
fn second_moment(sigma_s: f64, g: f64, tau: f64) -> f64 {
    let s = sigma_s * (1.0 - g);
    2.0 * (s * tau - 1.0 + (-s * tau).exp()) / (s * s)
}

/// For each interval: the mean squared distance of the light from the lamp over the closed form, and the standard error of this
/// ratio. The medium scatters once per metre, with the mean cosine `g`. First for the right closed form, then for the one with the
/// scattering coefficient [`WRONG`].
fn moments(g: f64) -> [Vec<(f64, f64)>; 2] {
    let phase = PhaseFunction::HenyeyGreenstein { g };
    let media = vec![Medium { sigma_s: [1.0; 3], phase, ..Medium::default() }];
    let mut scene = Scene { media, ..Scene::default() };
    light(&mut scene, "lamp", DVec3::ZERO, DVec3::NEG_Y, LightKind::Point { intensity: [1.0; 3] });
    camera(&mut scene, DVec3::Z * 5.0, DVec3::ZERO, 0.5, [4, 4]);
    let settings = Settings::builder().estimator(Estimator::Bdpt).resolution([4, 4]).seed(3);
    // Light travels 20 mean free paths in about 20 segments, and hardly ever in more than 60.
    let settings = settings.max_depth(60).light_paths(16_000).splat_paths(0).build().unwrap();
    let device = Device::open(None).expect("this test needs a Vulkan device: run ./setup.sh");
    let mut renderer = Renderer::new(&device, &scene, &settings).unwrap();
    let space = renderer.plan.space;
    let lamp = space.point(DVec3::ZERO);
    let mut ratios = [vec![vec![]; ENDS.len() - 1], vec![vec![]; ENDS.len() - 1]];
    for _ in 0..ITERATIONS {
        let iteration = renderer.next_iteration(1);
        let pool = renderer.light.run(&renderer.plan, iteration, |_| ()).unwrap().pool;
        renderer.finish_iteration(1, 0.0);
        // The squared distance found, and the one expected with either coefficient.
        let mut sums = vec![[0.0; 3]; ENDS.len() - 1];
        for v in pool.vertices.iter().filter(|v| v.flags & VERTEX_IN_MEDIUM != 0) {
            let tau = f64::from(v.tau) * space.unit;
            let Some(k) = ENDS.windows(2).position(|ends| (ends[0]..ends[1]).contains(&tau)) else { continue };
            let distance = (Vec3::from(v.position) - lamp).as_dvec3().length() * space.unit;
            let weight = f64::from(v.throughput[0]);
            sums[k][0] += weight * distance * distance;
            sums[k][1] += weight * second_moment(1.0, g, tau);
            sums[k][2] += weight * second_moment(WRONG, g, tau);
        }
        for (k, [found, expected, wrong]) in sums.iter().enumerate() {
            ratios[0][k].push(found / expected);
            ratios[1][k].push(found / wrong);
        }
    }
    let n = ITERATIONS as f64;
    let mean = |ratios: &[f64]| ratios.iter().sum::<f64>() / n;
    let error = |ratios: &[f64]| {
        let m = mean(ratios);
        (ratios.iter().map(|r| (r - m).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt()
    };
    ratios.map(|intervals| intervals.iter().map(|ratios| (mean(ratios), error(ratios))).collect())
}

#[test]
fn light_in_a_medium_spreads_as_the_closed_form_says() {
    for g in [0.8, 0.0, -0.3] {
        let [found, wrong] = moments(g);
        println!("g = {g}: {found:.4?}");
        // 5 standard errors, because there are 15 values and the errors come from 8 iterations; and the claim of ACCURACY, 0.5 %.
        assert!(
            found.iter().all(|(ratio, error)| (ratio - 1.0).abs() < (5.0 * error).min(0.005) && *error < 0.005),
            "g = {g}: {found:?}"
        );
        // Negative control: a coefficient that is wrong by 5 %. Light that has hardly changed its direction does not depend on it.
        let mut turned = wrong.iter().zip(ENDS).filter(|(_, begin)| (1.0 - g) * begin >= 1.0).map(|(value, _)| value);
        assert!(turned.all(|(ratio, error)| (ratio - 1.0).abs() > 5.0 * error), "g = {g}: {wrong:?}");
    }
}

#[test]
fn a_splat_in_no_pixel_blames_the_device() {
    let mut tally =
        Tally { observe: crate::render::plan::Observe::Nothing, pixels: 4, inside_gate: 0, dropped: 0, misplaced: 0 };
    let (one, mut seen) = (1.0f32.to_bits(), vec![]);
    for (red, pixel) in [(one, 3), (one, NONE), (f32::NAN.to_bits(), 0)] {
        tally.report([red, one, one, pixel], 1.0, 2, &mut |splat| seen.push(splat.pixel));
    }
    let mut stats = Stats::default();
    tally.add_to(&mut stats).unwrap();
    assert_eq!((&seen[..], stats.inside_gate, stats.dropped), (&[3][..], 1, 1));
    tally.report([one, one, one, 4], 1.0, 2, &mut |_| panic!("there is no pixel 4"));
    let error = tally.add_to(&mut stats).unwrap_err().to_string();
    assert!(error.contains("it computes wrongly"), "{error}");
}

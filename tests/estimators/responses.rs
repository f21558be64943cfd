//! Many gates from one render: every gate gets the light that a separate render finds, and abutting gates add up to the whole.

use super::cells::{is_long, renderer, seeds, settings, threshold, tuned};
use super::drive::open;
use super::lamps::sphere_of;
use taugate::internals::generate::zoo::Light;
use taugate::internals::generate::{Kind, build};
use taugate::internals::gpu::Drive;
use taugate::internals::render::{Renderer, Tuning};
use taugate::internals::scene::{Medium, PhaseFunction, Scene};
use taugate::internals::self_check::sphere::gated_radiance;
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Edge, Estimator, Response, Responses, Sampling, SettingsBuilder};

const SIZE: [u32; 2] = [20, 14];

fn gates(lo: f64, hi: f64, count: u32) -> Gates {
    Gates::new(Gate { lo, hi }, count).unwrap()
}

fn binned(estimator: Estimator, gates: Gates) -> SettingsBuilder {
    settings(estimator, SIZE).responses(gates)
}

fn rendered(mut renderer: Renderer) -> Renderer {
    renderer.estimate_response_variance();
    [2, 3, 2].iter().for_each(|&samples| renderer.iterate(samples).unwrap_or_else(|e| panic!("{e}")));
    renderer
}

/// Gates with these ends, none of which abut.
fn separate(ends: &[[f64; 2]]) -> Responses {
    let gates = ends.iter().map(|&[lo, hi]| Gate { lo, hi }).enumerate();
    Responses::new(gates.map(|(k, gate)| Response::new(format!("{k}"), gate, Edge::Sharp)).collect()).unwrap()
}

/// Two thin gates with a gap between them: a render leaves out the light of the gap. Each gate agrees with the closed form.
#[test]
#[ignore = "takes five seconds; every gate of a histogram is tested always"]
fn gates_far_apart_agree_with_the_closed_form() {
    let responses = separate(&[[2.6, 2.8], [6.0, 6.4]]);
    assert_eq!(responses.gap(), Some(Gate { lo: 2.8, hi: 6.0 }));
    let all = [Estimator::Lcs, Estimator::Epc, Estimator::LcsPaper, Estimator::Bdpt, Estimator::Pt];
    let estimators = if is_long() { &all[..] } else { &all[..1] };
    let limit = threshold(estimators.len() * responses.len());
    for &estimator in estimators {
        let means = means(&sphere(), estimator, &responses, 500);
        for (k, z) in z_scores(&means, &responses, 1.0).into_iter().enumerate() {
            assert!(z.abs() < limit, "{estimator}, gate {k}: z = {z:.2}");
        }
        // Negative control: gates that are 3 % late.
        let late = z_scores(&means, &responses, 1.03);
        assert!(late.into_iter().any(|z| z.abs() > limit), "{estimator}: late gates pass");
    }
}

/// Several responses, or one with edges, are short if they are lit for at most a tenth of the diagonal in total. That is 0.35 m here. Then
/// `lcs` queries its trees, and chooses a vertex for each sixteenth of the support. Negative control: the closed form for responses that
/// are 3 % late.
#[test]
fn short_responses_of_lcs_agree_with_the_closed_form() {
    let soft = Response::new("soft", Gate { lo: 2.95, hi: 3.15 }, Edge::Ramp(0.1));
    let cases = [
        Responses::from(gates(2.9, 3.2, 6)),
        separate(&[[2.7, 2.8], [3.4, 3.5]]),
        Responses::new(vec![soft]).unwrap(),
        // So thin that there are ellipsoidal connections too.
        Responses::from(gates(3.3, 3.301, 4)),
    ];
    let count = cases.iter().map(Responses::len).sum();
    let scene = sphere();
    for (n, responses) in cases.iter().enumerate() {
        let settings = settings(Estimator::Lcs, [12, 12]).responses(responses.clone()).build().unwrap();
        let mut renderer = renderer(&scene, &settings);
        let shares_record_with = |others: &Responses| renderer.can_restart(others);
        // A renderer restarts only with responses of its own record. `wide`: lit for more than a tenth of the diagonal. The gates in the
        // second check are thinner than 0.04 % of it.
        let wide = [gates(2.9, 3.3, 6).into(), separate(&[[2.7, 2.9], [3.4, 3.6]])];
        assert!(!wide.iter().any(shares_record_with), "case {n}: the record for histograms");
        assert_eq!(shares_record_with(&gates(3.3, 3.3001, 6).into()), n == 3, "case {n}: the record for thin gates");

        let means = means_of(&mut renderer, responses, 700);
        for (k, z) in z_scores(&means, responses, 1.0).into_iter().enumerate() {
            assert!(z.abs() < threshold(count), "case {n}, response {k}: z = {z:.2}");
        }
        let late = z_scores(&means, responses, 1.03);
        assert!(late.iter().any(|z| z.abs() > threshold(count)), "case {n}: late responses pass: {late:?}");
    }
}

/// The bits of the images of all responses and of their variances.
fn bits(renderer: &Renderer) -> Vec<u32> {
    let film = renderer.responses().unwrap().expect("there are several responses");
    let of_pixel = |pixel| film.means_of(pixel).chain(film.variances_of(pixel));
    (0..film.pixels()).flat_map(of_pixel).map(f32::to_bits).collect()
}

/// Checks that the gates add up to the film, whose gate spans all of them. The order of additions differs, so a pixel may differ
/// by a few steps of f32. Returns the number of gates with light.
fn add_up(scene: &Scene, settings: SettingsBuilder) -> usize {
    let rendered = rendered(renderer(scene, &settings.build().unwrap()));
    let (whole, film) = (rendered.film().mean(), rendered.responses().unwrap().unwrap());
    let images: Vec<Vec<f32>> = (0..film.responses()).map(|k| film.mean(k)).collect();
    for (i, &whole) in whole.iter().enumerate() {
        let sum: f64 = images.iter().map(|image| f64::from(image[i])).sum();
        assert!((sum - f64::from(whole)).abs() <= 2e-6 * f64::from(whole), "value {i}: {sum} and {whole}");
    }
    assert!(whole.iter().any(|&x| x > 0.0), "a black image proves nothing");
    images.iter().filter(|image| image.iter().any(|&x| x > 0.0)).count()
}

#[test]
#[ignore = "takes ten seconds; every gate is compared with the closed form always"]
fn gates_add_up_to_the_whole() {
    // From emitters in view (s = 0) to long paths, with t = 1.
    let area = build(Kind::Zoo(Light::Area));
    for sampling in [Sampling::Uniform, Sampling::Adaptive] {
        assert!(add_up(&area, binned(Estimator::Lcs, gates(0.0, 20.0, 9)).sampling(sampling)) > 5);
    }
    assert!(add_up(&build(Kind::Zoo(Light::Beam)), binned(Estimator::Bdpt, gates(5.0, 25.0, 300))) > 100);
}

const RADIUS: f32 = 1.0;
const ALBEDO: f32 = 0.5;

fn sphere() -> Scene {
    build(Kind::GatedSphere { radius: RADIUS, subdivisions: 6, albedo: ALBEDO })
}

/// Mean over all pixels in each gate, with its squared standard error.
fn means(scene: &Scene, estimator: Estimator, responses: &Responses, first_seed: u32) -> Vec<[f64; 2]> {
    let settings = settings(estimator, [16, 16]).responses(responses.clone()).build().unwrap();
    means_of(&mut renderer(scene, &settings), responses, first_seed)
}

/// As [`means`], with a renderer for these responses.
fn means_of(renderer: &mut Renderer, responses: &Responses, first_seed: u32) -> Vec<[f64; 2]> {
    let mut means = vec![vec![]; responses.len()];
    for seed in 0..seeds() {
        renderer.restart(first_seed + seed, responses.clone()).unwrap();
        renderer.iterate(8).unwrap();
        for (k, means) in means.iter_mut().enumerate() {
            // If there is only one response, the image shows it.
            means
                .push(mean(&renderer.responses().unwrap().map_or_else(|| renderer.film().mean(), |film| film.mean(k))));
        }
    }
    assert_eq!(renderer.stats().dropped, 0);
    let statistics = |means: Vec<f64>| {
        let n = means.len() as f64;
        let mean = means.iter().sum::<f64>() / n;
        [mean, means.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / ((n - 1.0) * n)]
    };
    means.into_iter().map(statistics).collect()
}

/// z-scores of [`means`] in the sphere, against the closed form of responses that are `stretch` times as late.
fn z_scores(means: &[[f64; 2]], responses: &Responses, stretch: f64) -> Vec<f64> {
    let z = |(response, [mean, variance]): (&Response, &[f64; 2])| {
        let truth = closed_form(response, stretch);
        eprintln!("{}: {mean} +- {}, closed form {truth}", response.describe(), variance.sqrt());
        (mean - truth) / variance.sqrt()
    };
    responses.iter().zip(means).map(z).collect()
}

/// Light of the sphere in a response that is `stretch` times as late: the sum over slices in which its weight is nearly constant.
fn closed_form(response: &Response, stretch: f64) -> f64 {
    let Gate { lo, hi } = response.support();
    let slices = if response.is_box() { 1 } else { 300 };
    let end = |n: u32| lo + (hi - lo) * f64::from(n) / f64::from(slices);
    let slice = |n: u32| {
        let radiance = gated_radiance(RADIUS.into(), ALBEDO.into(), stretch * end(n), stretch * end(n + 1));
        response.weight(0.5 * (end(n) + end(n + 1))) * radiance
    };
    (0..slices).map(slice).sum()
}

#[test]
fn every_gate_agrees_with_the_closed_form() {
    let gates = gates(2.25, 8.25, 12).into();
    let mut cases = vec![(sphere(), Estimator::Lcs)];
    if is_long() {
        cases.push((sphere(), Estimator::Bdpt));
        // More lamps than are connected one by one.
        cases.push((sphere_of(20, 6), Estimator::Lcs));
    }
    for (scene, estimator) in cases {
        let means = means(&scene, estimator, &gates, 100);
        for (k, z) in z_scores(&means, &gates, 1.0).into_iter().enumerate() {
            assert!(z.abs() < threshold(12), "{estimator:?}, gate {k}: z = {z:.2}");
        }
        let wrong = z_scores(&means, &gates, 1.02).into_iter().filter(|z| z.abs() > threshold(12)).count();
        assert!(wrong > 3, "{estimator:?}: gates that are off by 2 % are rejected {wrong} times only");
    }
}

/// The sphere, filled with fog.
fn foggy_sphere() -> Scene {
    let mut scene = sphere();
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.5 };
    scene.media.push(Medium { sigma_s: [0.3; 3], sigma_a: [0.05; 3], phase, ..Medium::default() });
    scene
}

#[test]
#[ignore = "takes ten seconds; short responses and fog are tested always, one by one"]
fn a_short_histogram_in_fog_has_the_light_of_bdpt() {
    // These gates leave out most light vertices, so lcs draws from a part of them. Long runs have a room with mirrors too.
    let mut scenes = vec![(foggy_sphere(), gates(3.0, 4.2, 4))];
    if is_long() {
        scenes.push((build(Kind::Zoo(Light::Area)), gates(8.0, 10.0, 4)));
    }
    for (scene, gates) in scenes {
        let [lcs, bdpt] =
            [(Estimator::Lcs, 200), (Estimator::Bdpt, 300)].map(|(e, seed)| means(&scene, e, &gates.into(), seed));
        let z = |factor: f64| -> Vec<f64> {
            let pairs = lcs.iter().zip(&bdpt);
            pairs.map(|([a, va], [b, vb])| (factor * a - b) / (factor * factor * va + vb).sqrt()).collect()
        };
        assert!(z(1.0).iter().all(|z| z.abs() < threshold(8)), "{:?}", z(1.0));
        assert!(z(1.1).iter().any(|z| z.abs() > threshold(8)), "10 % more light goes unnoticed: {:?}", z(1.1));
    }
}

#[test]
#[ignore = "takes five seconds; `determinism` and `drive` test this for one gate always"]
fn tiles_and_drive_do_not_change_the_bits() {
    let scene = build(Kind::Zoo(Light::Area));
    let settings = binned(Estimator::Lcs, gates(5.0, 12.0, 20)).build().unwrap();
    let usual = bits(&rendered(renderer(&scene, &settings)));
    let tuning = Tuning { tile: Some(100), workgroup: 32, ..Tuning::default() };
    let tiled = rendered(tuned(&scene, &settings, tuning));
    assert!(usual == bits(&tiled), "a tile of 100 paths");
    let card = rendered(Renderer::with_tuning(&open(Drive::CARD), &scene, &settings, tuning).unwrap());
    assert!(usual == bits(&card), "a graphics card");
    let other = settings.change().seed(9).build().unwrap();
    assert!(usual != bits(&rendered(renderer(&scene, &other))), "another seed");
}

/// If the contributions of another bounce may not fit, the host reads those of earlier bounces first. Nothing is lost, and they keep
/// their order.
#[test]
fn contributions_that_do_not_fit_are_read_in_between() {
    let scene = build(Kind::Zoo(Light::Area));
    let settings = binned(Estimator::Bdpt, gates(5.0, 12.0, 20)).max_depth(8).build().unwrap();
    for drive in [Drive::CPU, Drive::CARD] {
        let device = open(drive);
        // Room for all bounces, for a few, and for one.
        let [all, few, one] = [None, Some(3000), Some(0)].map(|observed| {
            let tuning = Tuning { tile: Some(100), observed, ..Tuning::default() };
            let rendered = rendered(Renderer::with_tuning(&device, &scene, &settings, tuning).unwrap());
            (bits(&rendered), rendered.stats().waits, rendered.stats().inside_gate)
        });
        assert!(all.0.iter().any(|&bits| bits != 0), "a black image proves nothing");
        assert!(few.0 == all.0 && one.0 == all.0, "{drive:?}: the bits differ");
        assert_eq!([few.2, one.2], [all.2; 2], "{drive:?}");
        assert!(all.1 < few.1 && few.1 < one.1, "{drive:?}: {} waits, {} and {}", all.1, few.1, one.1);
    }
}

#[test]
fn a_render_of_one_gate_does_not_continue_with_several() {
    let settings = binned(Estimator::Bdpt, gates(5.0, 12.0, 20)).build().unwrap();
    let mut renderer = renderer(&sphere(), &settings);
    let error = renderer.restart(0, Gate { lo: 5.0, hi: 6.0 }).unwrap_err().to_string();
    assert!(error.contains("make a new renderer"), "{error}");
    renderer.restart(0, gates(5.0, 6.0, 2)).unwrap();
    assert_eq!(renderer.responses().unwrap().unwrap().responses(), 2);
}

#[test]
fn a_pulsed_laser_adds_up_the_gates_of_all_pulses() {
    // Light arrives until about 12 m. So with a period of 3 m, the gate 9..10 m sees light of four pulses.
    let parts = gates(0.0, 40.0, 40);
    let folded = Response::new("folded", Gate { lo: 9.0, hi: 10.0 }, Edge::Sharp).repeated(3.0);
    let parts = (0..40).map(|k| Response::new(format!("{k}"), parts.gate(k), Edge::Sharp));
    let responses = Responses::new(parts.chain([folded]).collect()).unwrap();
    let rendered =
        rendered(renderer(&sphere(), &settings(Estimator::Bdpt, SIZE).responses(responses).build().unwrap()));
    let film = rendered.responses().unwrap().unwrap();
    let sum: f64 = (0..40).step_by(3).map(|k| mean(&film.mean(k))).sum();
    let found = mean(&film.mean(40));
    assert!((found / sum - 1.0).abs() < 1e-5, "{found} and {sum}");
    assert!(mean(&film.mean(9)) < 0.9 * sum, "one pulse gives the same");
}

/// The mean over all pixels and channels.
fn mean(image: &[f32]) -> f64 {
    image.iter().map(|&x| f64::from(x)).sum::<f64>() / image.len() as f64
}

#[test]
fn a_response_is_a_weighted_sum_of_thin_gates() {
    // Both renders have the same support, so they find the same light with the same random numbers.
    let scene = sphere();
    let thin = gates(2.0, 9.0, 4000);
    let ramp = Response::new("ramp", Gate { lo: 3.0, hi: 5.0 }, Edge::Ramp(1.5));
    let gauss = Response::new("gauss", Gate { lo: 4.0, hi: 5.0 }, Edge::Gauss(0.4));
    let rows = vec![[2.0, 0.2], [3.5, 3.0], [5.0, 3.0], [5.0, 0.5], [9.0, 0.0]];
    let table = Response::table("table", rows, None).unwrap();
    let responses = Responses::new(vec![ramp, gauss, table]).unwrap();
    assert_eq!(responses.support(), thin.whole());

    let settings = binned(Estimator::Bdpt, thin).build().unwrap();
    let histogram = rendered(renderer(&scene, &settings));
    let histogram: Vec<f64> = (0..4000).map(|k| mean(&histogram.responses().unwrap().unwrap().mean(k))).collect();
    let settings = settings.change().responses(responses.clone()).build().unwrap();
    let curves = rendered(renderer(&scene, &settings));
    for (k, response) in responses.iter().enumerate() {
        let middle = |k: usize| 0.5 * (thin.gate(k as u32).lo + thin.gate(k as u32).hi);
        let sum: f64 = histogram.iter().enumerate().map(|(k, light)| light * response.weight(middle(k))).sum();
        let found = mean(&curves.responses().unwrap().unwrap().mean(k));
        assert!((found / sum - 1.0).abs() < 1e-3, "{}: {found} and {sum}", response.name());
        let shifted: f64 =
            histogram.iter().enumerate().map(|(k, light)| light * response.weight(middle(k) + 0.02)).sum();
        assert!((found / shifted - 1.0).abs() > 1e-3, "{}: a shift of 2 cm goes unnoticed", response.name());
    }

    // If a render has only one response, the image shows it.
    let alone = Responses::new(vec![responses.iter().nth(1).unwrap().clone()]).unwrap();
    let alone = rendered(renderer(&scene, &settings.change().responses(alone).build().unwrap()));
    assert!(alone.responses().unwrap().is_none());
    let ratio = mean(&alone.film().mean()) / mean(&curves.responses().unwrap().unwrap().mean(1));
    assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
}

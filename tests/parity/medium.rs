//! `shared/medium.wgsl`: transmittance and flights through two overlapping media, compared with f64.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::wgsl::layout::constants::{PHASE_LOBES, PHASE_RAYLEIGH};
use taugate::internals::wgsl::layout::{Frame, Medium};

use crate::shader_function::{Contents, ShaderFunction, contents};
use crate::values::{direction, dvec, frame, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&TRANSMITTANCE, &FLIGHT];

const TRANSMITTANCE: ShaderFunction = ShaderFunction {
    imports: &["medium"],
    input: "o: vec3<f32>, length: f32, d: vec3<f32>, pad: u32",
    result: "transmitted: vec3<f32>, first: f32, last: f32, pad0: f32, pad1: f32, pad2: f32",
    body: "result.transmitted = transmitted(optical_depths(input.o, input.d, input.length));
        let extent = media_extent(input.o, input.d);
        result.first = extent.x;
        result.last = extent.y;",
};

const FLIGHT: ShaderFunction = ShaderFunction {
    imports: &["guided_flight"],
    input: "u: vec3<f32>, kind: u32",
    result: "weight: vec3<f32>, distance: f32, medium: u32, scattered: u32, pad0: u32, pad1: u32",
    body: "let o = vec3<f32>(-3.0, 0.1, 0.2);
        let d = vec3<f32>(1.0, 0.0, 0.0);
        let throughput = vec3<f32>(1.0, 0.5, 2.0);
        var flight = free_flight(o, d, 6.0, throughput, input.kind == 1u, input.u);
        if (input.kind == 2u) {
            flight = guided_flight(o, d, 6.0, 0.5, 1.0, throughput, input.u);
        }
        result.weight = flight.weight;
        result.distance = flight.distance;
        result.medium = flight.medium;
        result.scattered = u32(flight.scattered);",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Ray {
    o: [f32; 3],
    length: f32,
    d: [f32; 3],
    pad: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Draw {
    u: [f32; 3],
    /// 0: flight on a light subpath; 1: on a sensor subpath; 2: on a sensor subpath, guided into the gate.
    kind: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Flight {
    weight: [f32; 3],
    distance: f32,
    medium: u32,
    scattered: u32,
    pad: [u32; 2],
}

/// A box of coloured fog, and a smaller box that extends beyond it. Where they overlap, only the smaller box counts.
fn media() -> [Medium; 2] {
    let large = Medium {
        lo: [-2.0, -1.0, -1.0],
        phase: PHASE_LOBES,
        hi: [2.0, 1.0, 1.0],
        share: 0.0,
        sigma_s: [0.3, 0.1, 0.0],
        g: 0.7,
        sigma_a: [0.05, 0.0, 0.4],
        g2: 0.7,
        ..Zeroable::zeroed()
    };
    let small = Medium {
        lo: [0.5, -0.5, -0.5],
        phase: PHASE_RAYLEIGH,
        hi: [2.5, 0.5, 0.5],
        sigma_s: [0.5, 1.5, 0.2],
        sigma_a: [0.0, 0.1, 0.0],
        ..large
    };
    [large, small]
}

fn buffers(media: &[Medium], change: impl FnOnce(&mut Frame)) -> [Contents; 4] {
    let frame = frame(|f| {
        f.media_count = media.len() as u32;
        change(f);
    });
    [contents("media", media), contents("grids", &[[0u32; 20]; 2]), contents("densities", &[0u32; 4]), frame]
}

/// Coefficients of scattering and absorption at a point.
fn coefficients(p: DVec3) -> [DVec3; 2] {
    let inside = |m: &&Medium| p.cmpge(dvec(&m.lo)).all() && p.cmplt(dvec(&m.hi)).all();
    let media = media();
    media.iter().rev().find(inside).map_or([DVec3::ZERO; 2], |m| [dvec(&m.sigma_s), dvec(&m.sigma_a)])
}

/// Sum over `steps` short steps of a ray: the transmittance to its end, and the light that is scattered on the way.
fn march(o: DVec3, d: DVec3, length: f64, steps: u32) -> [DVec3; 2] {
    let width = length / f64::from(steps);
    let (mut depth, mut scattered) = (DVec3::ZERO, DVec3::ZERO);
    for i in 0..steps {
        let [sigma_s, sigma_a] = coefficients(o + (f64::from(i) + 0.5) * width * d);
        depth += 0.5 * width * (sigma_s + sigma_a);
        scattered += width * sigma_s * (-depth).exp();
        depth += 0.5 * width * (sigma_s + sigma_a);
    }
    [(-depth).exp(), scattered]
}

#[test]
fn the_last_medium_counts_along_a_ray() {
    let mut pcg = Pcg::new(5);
    let mut rays: Vec<Ray> = (0..500)
        .map(|_| {
            let o = DVec3::from_array([0, 1, 2].map(|_| 5.0 * pcg.uniform() - 2.5));
            Ray { o: vec3(o), length: 6.0 * pcg.uniform() as f32, d: vec3(direction(&mut pcg)), pad: 0 }
        })
        .collect();
    // Along an axis, on a face of a box, and beside all boxes.
    let along = |o: [f32; 3]| Ray { o, length: 6.0, d: [1.0, 0.0, 0.0], pad: 0 };
    rays.extend([along([-3.0, 0.0, 0.0]), along([-2.0, 0.9, 0.0]), along([-3.0, 3.0, 0.0])]);
    let found: Vec<[f32; 8]> = TRANSMITTANCE.run(&rays, &buffers(&media(), |_| ()));
    for (ray, [r, g, b, first, last, ..]) in rays.iter().zip(found) {
        let [expected, _] = march(dvec(&ray.o), dvec(&ray.d), ray.length.into(), 20_000);
        let error = (dvec(&[r, g, b]) - expected).abs().max_element();
        assert!(error < 1e-3, "{ray:?}: {:?}, {expected}", [r, g, b]);
        let clear = last < 0.0 || first > ray.length;
        assert!(!clear || [r, g, b] == [1.0; 3], "{ray:?}: media from {first} to {last}");
    }
}

/// Flights of a kind through a gate; the lamp is at (-2, 1.5, 0.2).
fn flights(media: &[Medium], kind: u32, gate: [f32; 2]) -> Vec<Flight> {
    flights_from(media, kind, gate, |u| u as f32)
}

/// As `flights`. `first` maps a uniform to the number that chooses between the end of the ray and an event.
fn flights_from(media: &[Medium], kind: u32, gate: [f32; 2], first: impl Fn(f64) -> f32) -> Vec<Flight> {
    let mut pcg = Pcg::new(8);
    let draws: Vec<Draw> = (0..400_000)
        .map(|_| Draw { u: [first(pcg.uniform()), pcg.uniform() as f32, pcg.uniform() as f32], kind })
        .collect();
    let buffers = buffers(media, |f| {
        (f.emitter_lo, f.emitter_hi) = ([-2.0, 1.5, 0.2], [-2.0, 1.5, 0.2]);
        [f.gate_lo, f.gate_hi] = gate;
    });
    FLIGHT.run(&draws, &buffers)
}

/// Distance from the start of the flights to the event from which a path to the lamp has the total length `path`.
fn reach(path: f64) -> f64 {
    let (mut lo, mut hi) = (0.0, 10.0);
    for _ in 0..60 {
        let s: f64 = 0.5 * (lo + hi);
        let via = s + (DVec3::new(-3.0 + s, 0.1, 0.2) - DVec3::new(-2.0, 1.5, 0.2)).length();
        *if via < path { &mut lo } else { &mut hi } = s;
    }
    lo
}

/// Checks the mean weights of the flights: `transmitted` at the end of the ray, `scattered` at events.
fn check(name: &str, found: &[Flight], transmitted: DVec3, scattered: DVec3) {
    for (events, expected) in [(0, transmitted), (1, scattered)] {
        let n = found.len() as f64;
        let values = || found.iter().map(|f| if f.scattered == events { dvec(&f.weight) } else { DVec3::ZERO });
        let mean = values().sum::<DVec3>() / n;
        let square = values().map(|v| v * v).sum::<DVec3>() / n;
        let error = ((square - mean * mean) / n).max(DVec3::ZERO);
        let error = DVec3::new(error.x.sqrt(), error.y.sqrt(), error.z.sqrt());
        let wrong = (mean - expected).abs().cmpgt(4.5 * error + 1e-6).any();
        assert!(!wrong, "{name}, events {events}: {mean} +- {error}, {expected}");
    }
}

#[test]
fn flights_have_the_mean_of_the_transmittance_and_of_the_scattered_light() {
    let (o, d) = (DVec3::new(-3.0, 0.1, 0.2), DVec3::X);
    let [transmitted, scattered] = march(o, d, 6.0, 200_000);
    for (kind, gate) in [(0, [0.0; 2]), (1, [0.0; 2]), (2, [5.0, 30.0])] {
        let found = flights(&media(), kind, gate);
        check(&format!("kind {kind}"), &found, transmitted, scattered);
        let inside = |f: &Flight| coefficients(o + f64::from(f.distance) * d)[0].max_element() > 0.0;
        // An event at the very end of a medium may be rounded out of it.
        let outside = found.iter().filter(|f| f.scattered == 1 && !inside(f)).count();
        assert!(kind == 2 || outside < found.len() / 10_000, "{outside} events are outside of the media");
    }
}

/// If the gate ends before the ray does, no flight reaches the end of the ray, and no event is too late.
#[test]
fn guided_flights_end_inside_the_gate() {
    let last = reach(6.0 - 0.5);
    let [_, scattered] = march(DVec3::new(-3.0, 0.1, 0.2), DVec3::X, last, 200_000);
    let found = flights(&media(), 2, [5.0, 6.0]);
    check("guided", &found, DVec3::ZERO, scattered);
    assert!(found.iter().all(|f| f.scattered == 1 && f64::from(f.distance) < last + 1e-5));
    let first = reach(5.0 - 0.5);
    let share = found.iter().filter(|f| f64::from(f.distance) > first).count() as f64 / found.len() as f64;
    let unguided = 1.0 - march(DVec3::new(-3.0, 0.1, 0.2), DVec3::X, first, 200_000)[1].x / scattered.x;
    // A tenth of the events is drawn where light that scatters once is in the gate. `unguided` is the share of one channel.
    let expected = 0.1 + 0.9 * unguided;
    assert!((share - expected).abs() < 0.03 && unguided < 0.5, "{share}, {expected}");
}

/// Random numbers have steps of 2^-24. Outcomes that only a few steps choose have their probability nevertheless: an event in the
/// thinnest fog, and the end of a ray in thick fog.
#[test]
fn rare_outcomes_have_their_probability() {
    const STEP: f64 = 1.0 / (1 << 24) as f64;
    // All outcomes that this test counts are among the first or the last steps, so only these are drawn.
    const STEPS: f64 = 32.0;
    let step = |u: f64| (STEPS * u).floor() * STEP;
    let mean = |found: &[Flight], counts: &dyn Fn(&Flight) -> bool| {
        let weights = found.iter().filter(|f| counts(f)).map(|f| f64::from(f.weight[0]));
        STEPS * STEP * weights.sum::<f64>() / found.len() as f64
    };
    let fog = |sigma_s: f32| [Medium { sigma_s: [sigma_s; 3], sigma_a: [0.0; 3], ..media()[0] }];

    // The fog fills 4 m of the ray. Light from its last part is inside the gate.
    let gate = reach(7.5 - 0.5);
    for sigma_s in [4e-8, 9e-8] {
        let found = flights_from(&fog(sigma_s), 2, [7.5, 30.0], |u| (1.0 - STEP - step(u)) as f32);
        for [lo, hi] in [[1.0, gate], [gate, 5.0]] {
            let inside = |f: &Flight| f.scattered == 1 && (lo..hi).contains(&f64::from(f.distance));
            let ratio = mean(&found, &inside) / (f64::from(sigma_s) * (hi - lo));
            assert!((ratio - 1.0).abs() < 0.03, "{sigma_s} per metre, {lo} m to {hi} m: {ratio}");
        }
    }
    let found = flights_from(&fog(3.75), 0, [0.0; 2], |u| step(u) as f32);
    let ratio = mean(&found, &|f| f.scattered == 0) / (-15f64).exp();
    assert!((ratio - 1.0).abs() < 0.01, "an optical depth of 15: {ratio}");
}

/// A guided event may lie in the gap between two boxes. It carries no light, but its medium must exist.
#[test]
fn events_between_two_boxes_have_a_medium() {
    let [large, small] = media();
    let apart = [Medium { hi: [-0.5, 1.0, 1.0], ..large }, small];
    let found = flights(&apart, 2, [5.0, 30.0]);
    let events = || found.iter().filter(|f| f.scattered == 1);
    assert!(events().all(|f| f.medium < 2));
    let in_gap = events().filter(|f| f.distance > 2.6 && f.distance < 3.4);
    assert!(in_gap.clone().count() > 1000 && in_gap.clone().all(|f| f.weight == [0.0; 3]));
}

//! `shared/phase.wgsl`: values and samples of phase functions, compared with f64.

use std::f64::consts::TAU;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::render::leaf_record;
use taugate::internals::render::phase::{mean_cosine, set};
use taugate::internals::scene::PhaseFunction;
use taugate::internals::self_check::fog::integrate;
use taugate::internals::wgsl::layout::constants::VERTEX_IN_MEDIUM;
use taugate::internals::wgsl::layout::{Medium, PathVertex};
use taugate_oracle::phase::Phase;

use crate::shader_function::{ShaderFunction, contents};
use crate::values::{direction, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&PHASE, &ROUNDED_EVENT];

const PHASE: ShaderFunction = ShaderFunction {
    imports: &["phase"],
    input: "cosine: f32, u: f32, medium: u32, lobe: f32",
    result: "value: f32, cosine: f32",
    body: "let m = load_medium(input.medium);
        result.value = phase_value(m, input.cosine);
        result.cosine = sample_phase_cosine(m, vec2<f32>(input.u, input.lobe));",
};

/// An event in a medium as its leaf record describes it: the direction to its previous vertex is rounded.
const ROUNDED_EVENT: ShaderFunction = ShaderFunction {
    imports: &["leaf"],
    input: "to_previous: vec3<f32>, direction: u32, w: vec3<f32>, pad: u32",
    result: "exact: f32, rounded: f32",
    body: "var v: PathVertex;
        v.flags = VERTEX_IN_MEDIUM;
        v.to_previous = input.to_previous;
        result.exact = 4.0 * PI * phase_value(load_medium(0u), -dot(input.to_previous, input.w));
        v.to_previous = normalize(unpack_direction(input.direction));
        result.rounded = outgoing_light(v, input.w, 0.0);",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Angle {
    cosine: f32,
    u: f32,
    medium: u32,
    lobe: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Event {
    to_previous: [f32; 3],
    direction: u32,
    w: [f32; 3],
    pad: u32,
}

fn draine(g: f64, g_draine: f64, alpha: f64, weight_draine: f64) -> PhaseFunction {
    PhaseFunction::HenyeyGreensteinDraine { g, g_draine, alpha, weight_draine }
}

/// Phase functions whose samples come from one distribution, and mixtures of two lobes.
fn functions() -> [Vec<PhaseFunction>; 2] {
    let lobe = |g| PhaseFunction::HenyeyGreenstein { g };
    let table =
        |cosines: &[f64], values: &[f64]| PhaseFunction::Table { cosines: cosines.into(), values: values.into() };
    // A hundred nodes with a narrow forward peak, as droplets have.
    let many: Vec<f64> = (0..=100).map(|i| 1.0 - 2.0 * (f64::from(100 - i) / 100.0).powi(3)).collect();
    let peak: Vec<f64> = many.iter().map(|c| Phase::new(&lobe(0.9)).density(*c) + 0.1 * (1.0 - c).powi(4)).collect();
    let single = vec![
        lobe(0.0),
        lobe(5e-4),
        lobe(0.8),
        lobe(-0.5),
        lobe(0.9),
        PhaseFunction::Rayleigh,
        draine(0.0, 0.0, 0.0, 1.0),
        draine(0.0, 0.0, 1.0, 1.0),
        draine(0.0, 0.58, 25.0, 1.0),
        draine(0.0, -0.4, 1e3, 1.0),
        draine(0.0, 0.9, 3.0, 1.0),
        draine(0.0, -0.95, 3.0, 1.0),
        table(&[-1.0, 1.0], &[1.0, 0.0]),
        table(&[-1.0, -0.5, 0.5, 0.7, 1.0], &[0.5, 0.0, 0.0, 0.2, 6.0]),
        table(&many, &peak),
    ];
    let mixtures = vec![
        PhaseFunction::DoubleHenyeyGreenstein { g: [0.9, -0.3], weight: 0.75 },
        lobe(0.99),
        lobe(0.999),
        lobe(-0.999),
        draine(0.99, 0.58, 25.0, 0.49),
    ];
    [single, mixtures]
}

/// Values and sampled cosines of all `functions`, for `count` random inputs each.
fn evaluate(functions: &[PhaseFunction], count: u32) -> Vec<(Angle, [f32; 2])> {
    let mut tables = vec![];
    let media: Vec<Medium> = functions
        .iter()
        .map(|function| {
            let mut medium = Medium::zeroed();
            set(function, &mut medium, &mut tables);
            medium
        })
        .collect();
    let mut pcg = Pcg::new(3);
    // Half of the cosines are uniform, and half lie where the function scatters to.
    let mut draw = |medium: u32| Angle {
        cosine: match pcg.uniform() < 0.5 {
            true => 2.0 * pcg.uniform() as f32 - 1.0,
            false => Phase::new(&functions[medium as usize]).sample(DVec3::Z, &mut pcg).z.clamp(-1.0, 1.0) as f32,
        },
        u: pcg.uniform() as f32,
        medium,
        lobe: pcg.uniform() as f32,
    };
    let inputs: Vec<Angle> = (0..media.len() as u32).flat_map(|m| vec![m; count as usize]).map(&mut draw).collect();
    tables.resize(tables.len().max(1), [0.0; 4]);
    let buffers = [contents("media", &media), contents("phase_tables", &tables)];
    let found = PHASE
        .compile(&[("HAS_TWO_LOBES", 1.0), ("HAS_RAYLEIGH", 1.0), ("HAS_DRAINE", 1.0), ("HAS_PHASE_TABLES", 1.0)])
        .run(&inputs, &buffers);
    inputs.into_iter().zip(found).collect()
}

/// Whether the cumulative distribution at each sampled cosine equals the random number from which the cosine was sampled.
fn samples_agree(phase: &Phase, results: &[(Angle, [f32; 2])], wrong: f64) -> bool {
    // The density has kinks, so its integral is summed over the intervals between the sorted cosines.
    let mut sorted: Vec<(f64, f64)> =
        results.iter().map(|(angle, [_, c])| (f64::from(*c), f64::from(angle.u))).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut last, mut share) = (-1.0, 0.0);
    sorted.into_iter().all(|(cosine, u)| {
        share += TAU * integrate(last, cosine, |c| phase.density(c) * (1.0 + wrong * c));
        last = cosine;
        (share - u).abs() < 1e-3
    })
}

#[test]
fn phase_functions_have_the_values_of_the_oracle() {
    let functions = functions().concat();
    for (input, [value, _]) in evaluate(&functions, 1000) {
        let function = &functions[input.medium as usize];
        let expected = Phase::new(function).density(input.cosine.into());
        assert!(
            (f64::from(value) - expected).abs() < 2e-4 * expected + 1e-6,
            "{function:?}: {input:?}: {value}, {expected}"
        );
    }
}

#[test]
fn sampled_cosines_invert_the_cumulative_distribution() {
    let [functions, _] = functions();
    let results = evaluate(&functions, 1000);
    for (function, results) in functions.iter().zip(results.chunks(1000)) {
        let phase = Phase::new(function);
        assert!(samples_agree(&phase, results, 0.0), "{function:?}");
        // A density that is 1 % too high forwards is rejected.
        assert!(!samples_agree(&phase, results, 0.01), "{function:?}");
    }
}

#[test]
fn mean_cosines_are_those_of_the_densities() {
    let lobes = |weight| draine(0.9, 0.4, 20.0, weight);
    let table = PhaseFunction::Table { cosines: vec![-1.0, -0.5, 0.7, 1.0], values: vec![0.5, 0.0, 0.2, 6.0] };
    let two = PhaseFunction::DoubleHenyeyGreenstein { g: [0.9, -0.4], weight: 0.85 };
    for function in [PhaseFunction::Rayleigh, two, lobes(0.3), lobes(1.0), table] {
        let phase = Phase::new(&function);
        let steps = 100_000;
        let cosine = |i: i32| 2.0 * (f64::from(i) + 0.5) / f64::from(steps) - 1.0;
        let mean = (0..steps).map(|i| cosine(i) * phase.density(cosine(i))).sum::<f64>() * 2.0 * TAU / f64::from(steps);
        assert!((mean - mean_cosine(&function)).abs() < 1e-4, "{function:?}: {mean}");
    }
}

#[test]
fn mixtures_have_their_mean_cosine() {
    let [_, functions] = functions();
    let count = 40_000;
    let results = evaluate(&functions, count);
    for (function, results) in functions.iter().zip(results.chunks(count as usize)) {
        let mean = results.iter().map(|(_, [_, c])| f64::from(*c)).sum::<f64>() / f64::from(count);
        let expected = mean_cosine(function);
        assert!((mean - expected).abs() < 0.008, "{function:?}: {mean}, {expected}");
        // A mean that is wrong by 2 % is rejected.
        assert!((mean - 1.02 * expected).abs() > 0.008, "{function:?}: {mean}, {expected}");
    }
}

/// A query must be able to choose each event that scatters light towards the shade point.
#[test]
fn rounded_events_may_contribute_wherever_their_table_is_positive() {
    let cosines = vec![-1.0, -0.5, 0.5, 0.7, 1.0];
    let table = PhaseFunction::Table { cosines, values: vec![0.5, 0.0, 0.0, 0.2, 6.0] };
    let (mut medium, mut nodes) = (Medium::zeroed(), vec![]);
    set(&table, &mut medium, &mut nodes);
    let mut pcg = Pcg::new(9);
    let inputs: Vec<Event> = (0..100_000)
        .map(|_| {
            let (flags, to_previous) = (VERTEX_IN_MEDIUM, vec3(direction(&mut pcg)));
            let record = leaf_record(&PathVertex { flags, to_previous, ..Zeroable::zeroed() });
            Event { to_previous, direction: record.direction, w: vec3(direction(&mut pcg)), pad: 0 }
        })
        .collect();
    let buffers = [contents("media", &[medium]), contents("phase_tables", &nodes)];
    let found: Vec<[f32; 2]> =
        ROUNDED_EVENT.compile(&[("HAS_PHASE_TABLES", 1.0), ("QUERIED_PUNCTUAL", 0.0)]).run(&inputs, &buffers);
    for (input, [exact, rounded]) in inputs.iter().zip(&found) {
        assert!(*exact == 0.0 || *rounded > 0.0, "{input:?}: {exact}, {rounded}");
    }
    let lit = found.iter().filter(|[exact, _]| *exact > 0.0).count();
    assert!(lit > found.len() / 4 && lit < found.len() * 3 / 4, "{lit}");
}

//! `shared/sobol.wgsl`: Sobol points against the generator matrices, and nested scrambling. Every stratum gets one point, and
//! points of different pixels are uniform and independent.

use bytemuck::{Pod, Zeroable};
use taugate::internals::generate::numbers::Pcg;

use crate::shader_function::ShaderFunction;
use crate::statistics::{chi_square, level};

pub const KERNELS: &[&ShaderFunction] = &[&SOBOL, &STRATIFIED];

const SOBOL: ShaderFunction = ShaderFunction {
    imports: &["sobol"],
    input: "number: u32, pad: u32, seed: vec2<u32>",
    result: "point: vec2<u32>, scrambled: u32, pad: u32",
    body: "result.point = sobol2(input.number); result.scrambled = owen_scramble(input.number, input.seed);",
};

/// Powers of two, powers of two minus 1, and random numbers.
fn numbers() -> Vec<u32> {
    let mut pcg = Pcg::new(31);
    let edges = (0..32).flat_map(|k| [1u32 << k, (1 << k) - 1, u32::MAX >> k]);
    edges.chain((0..5000).map(|_| pcg.next_u32())).collect()
}

/// The first two dimensions of Sobol's sequence from their direction numbers (Joe and Kuo 2008). The first dimension has the
/// unit matrix; the second has v_k = v_(k-1) ^ (v_(k-1) / 2).
fn by_directions(number: u32) -> [u32; 2] {
    let (mut x, mut y, mut direction) = (0, 0, 1u32 << 31);
    for k in 0..32 {
        if number >> k & 1 == 1 {
            x ^= 1 << (31 - k);
            y ^= direction;
        }
        direction ^= direction >> 1;
    }
    [x, y]
}

/// `owen_scramble` on the host, with its own reversal of digits: in the reversed word, digit `place` has the value 2^place.
fn scrambled(x: u32, [a, b]: [u32; 2]) -> u32 {
    let reversed: u32 = (0..32).map(|place| (x >> (31 - place) & 1) << place).sum();
    let mix = |v: u32, factor: u32| v ^ v.wrapping_mul(factor);
    let v = mix(reversed, 0x3d20_adea).wrapping_add(a).wrapping_mul(b | 1);
    mix(mix(v, 0x0552_6c56), 0x53a2_2864).reverse_bits()
}

#[test]
fn points_and_scrambling_are_those_of_the_scalar_twins() {
    let mut pcg = Pcg::new(32);
    let inputs: Vec<[u32; 4]> = numbers().into_iter().map(|n| [n, 0, pcg.next_u32(), pcg.next_u32()]).collect();
    let results: Vec<[u32; 4]> = SOBOL.run(&inputs, &[]);
    for (i, r) in inputs.iter().zip(&results) {
        assert_eq!(r[..2], by_directions(i[0]), "point {}", i[0]);
        assert_eq!(r[2], scrambled(i[0], [i[2], i[3]]), "{i:?}");
    }
}

/// If exactly the first k digits of two words are equal, exactly the first k digits of the scrambled words are equal.
#[test]
fn scrambling_is_nested() {
    let mut pcg = Pcg::new(33);
    let mut inputs: Vec<[u32; 4]> = vec![];
    for k in 0..32u32 {
        for _ in 0..100 {
            let (x, seed) = (pcg.next_u32(), [pcg.next_u32(), pcg.next_u32()]);
            let other = x ^ (1 << (31 - k)) ^ (pcg.next_u32() & ((1u64 << (31 - k)) - 1) as u32);
            inputs.extend([[x, 0, seed[0], seed[1]], [other, 0, seed[0], seed[1]]]);
        }
    }
    let results: Vec<[u32; 4]> = SOBOL.run(&inputs, &[]);
    for (i, r) in inputs.chunks(2).zip(results.chunks(2)) {
        let shared = |a: u32, b: u32| (a ^ b).leading_zeros();
        assert_eq!(shared(r[0][2], r[1][2]), shared(i[0][0], i[1][0]), "{i:?}");
    }
}

const STRATIFIED: ShaderFunction = ShaderFunction {
    imports: &["sobol"],
    input: "index: u32, iteration: u32, number: u32, seed: u32",
    result: "pixel: vec2<f32>, direction: vec2<f32>, lobe: vec2<f32>, other: vec2<f32>",
    body: "result.pixel = stratified2(input.index, input.iteration, input.number, PAIR_PIXEL, input.seed);
        result.direction = stratified2(input.index, input.iteration, input.number, PAIR_DIRECTION, input.seed);
        result.lobe = stratified2(input.index, input.iteration, input.number, PAIR_LOBE, input.seed);
        result.other = random4(STREAM_SENSOR, input.index, input.number, input.iteration, 0u, input.seed).xy;",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Pairs {
    pixel: [f32; 2],
    direction: [f32; 2],
    lobe: [f32; 2],
    other: [f32; 2],
}

/// The first `members` samples of each of `count` sets. A set has the samples of one pixel in one iteration; each set has
/// another pixel, and the iteration and the seed vary.
fn sets(count: u32, members: u32) -> Vec<Pairs> {
    let inputs: Vec<[u32; 4]> =
        (0..count * members).map(|i| [i / members, i / members % 7, i % members, 3 + i / members % 5]).collect();
    STRATIFIED.run(&inputs, &[])
}

/// Whether every elementary interval of area 1 / n contains exactly one of the n points.
fn is_a_net(points: &[[f32; 2]]) -> bool {
    let digits = points.len().ilog2();
    (0..=digits).all(|a| {
        let (columns, rows) = (1usize << a, 1usize << (digits - a));
        let mut held = vec![0; columns * rows];
        for [x, y] in points {
            held[(x * columns as f32) as usize * rows + (y * rows as f32) as usize] += 1;
        }
        held.iter().all(|&n| n == 1)
    })
}

#[test]
fn every_stratum_holds_one_point() {
    const MEMBERS: u32 = 256;
    let all = sets(50, MEMBERS);
    let mut scattered = 0;
    for of_a_set in all.chunks(MEMBERS as usize) {
        for k in 0..=8 {
            let of = |pair: fn(&Pairs) -> [f32; 2]| of_a_set[..1 << k].iter().map(pair).collect::<Vec<_>>();
            assert!(is_a_net(&of(|p| p.pixel)) && is_a_net(&of(|p| p.direction)) && is_a_net(&of(|p| p.lobe)), "{k}");
            // Independent random numbers must fail.
            scattered += usize::from(k >= 4 && is_a_net(&of(|p| p.other)));
        }
    }
    assert_eq!(scattered, 0, "sets of independent numbers that pass");
}

/// Each sample of a set is uniform over many sets. Coordinates of different pairs are independent, and so are samples with
/// the same number in two sets.
#[test]
fn numbers_are_uniform_and_sets_independent() {
    const SIDE: usize = 16;
    const MEMBERS: u32 = 4;
    let all = sets(100_000, MEMBERS);
    let test = |points: &[[f32; 2]]| {
        let mut counts = vec![0.0; SIDE * SIDE];
        points.iter().for_each(|p| counts[(p[0] * SIDE as f32) as usize * SIDE + (p[1] * SIDE as f32) as usize] += 1.0);
        chi_square(&counts, &vec![points.len() as f64 / counts.len() as f64; counts.len()])
    };
    let least = level(5 * MEMBERS as usize);
    for number in 0..MEMBERS as usize {
        let members: Vec<Pairs> = all.iter().skip(number).step_by(MEMBERS as usize).copied().collect();
        let joint: [fn(&Pairs, &Pairs) -> [f32; 2]; 5] = [
            |p, _| p.pixel,
            |p, _| p.direction,
            |p, _| [p.pixel[0], p.direction[0]],
            |p, _| [p.direction[1], p.lobe[1]],
            |p, next| [p.pixel[0], next.pixel[0]],
        ];
        for (which, of) in joint.iter().enumerate() {
            let points: Vec<[f32; 2]> = members.chunks(2).map(|two| of(&two[0], &two[1])).collect();
            let p = test(&points);
            assert!(p > least, "member {number}, {which}: p = {p:.1e}");
        }
        // Numbers that are slightly denser towards 0 must fail.
        let skewed: Vec<[f32; 2]> = members.iter().map(|p| p.pixel.map(|u| u.powf(1.03))).collect();
        assert!(test(&skewed) < least);
    }
}

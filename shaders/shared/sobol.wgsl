// Stratified random numbers: the first two dimensions of Sobol's sequence, scrambled by hashing (Burley 2020, "Practical Hash-based
// Owen Scrambling", JCGT 9(4)). The first 2^k numbers of a sequence lie one in each elementary interval of area 2^-k, each of them
// is uniform, and sequences of different keys are independent.
#import random

// Pairs of numbers that are stratified together: the sensor's point in the pixel, its first direction, and the choice of a lobe.
const PAIR_PIXEL: u32 = 0u;
const PAIR_DIRECTION: u32 = 1u;
const PAIR_LOBE: u32 = 2u;

// Nested uniform scrambling: flips each binary digit by a hash of those above it (Laine and Karras 2011, with the constants of
// Vegdahl 2021). An even factor and an addition carry no digit upward in the reversed word, an odd factor only mixes; two words of
// seed make every x uniform.
fn owen_scramble(x: u32, seed: vec2<u32>) -> u32 {
    var v = reverseBits(x);
    v ^= v * 0x3d20adeau;
    v += seed.x;
    v *= seed.y | 1u;
    v ^= v * 0x05526c56u;
    v ^= v * 0x53a22864u;
    return reverseBits(v);
}

// Point `number` of Sobol's (0, 2)-sequence, 32 digits a coordinate. The generator matrix of y is Pascal's triangle mod 2: digit i is
// the sum of the digits of `number` whose place contains i, bit by bit, which five steps add up.
fn sobol2(number: u32) -> vec2<u32> {
    var y = number;
    y ^= (y >> 1u) & 0x55555555u;
    y ^= (y >> 2u) & 0x33333333u;
    y ^= (y >> 4u) & 0x0f0f0f0fu;
    y ^= (y >> 8u) & 0x00ff00ffu;
    y ^= y >> 16u;
    return vec2<u32>(reverseBits(number), reverseBits(y));
}

// Two uniforms in [0, 1): member `number` of the set of `pair` that pixel `index` has in an iteration. Sets are independent.
fn stratified2(index: u32, iteration: u32, number: u32, pair: u32, seed: u32) -> vec2<f32> {
    let a = pcg4d(vec4<u32>(index, iteration, (STREAM_STRATA << 28u) | (2u * pair), seed));
    let b = pcg4d(vec4<u32>(index, iteration, (STREAM_STRATA << 28u) | (2u * pair + 1u), seed));
    // Shuffled, so that members of the same number in two sets have nothing in common.
    let p = sobol2(owen_scramble(number, a.xy));
    let u = vec2<u32>(owen_scramble(p.x, b.xy), owen_scramble(p.y, b.zw));
    return vec2<f32>(u >> vec2<u32>(8u)) * (1.0 / 16777216.0);
}

// Stratified random numbers: the first two dimensions of the Sobol sequence, Owen-scrambled by hashing (Burley 2020,
// "Practical Hash-based Owen Scrambling", JCGT 9(4)). The first 2^k points of a sequence have one point in each elementary
// interval of area 2^-k. Each point alone is uniform. Sequences with different keys are independent.
#import random

// Pairs of numbers that are stratified together: the point in the pixel, the first direction of the sensor subpath, the
// choice of a lobe for that direction, and the first flight through fog.
const PAIR_PIXEL: u32 = 0u;
const PAIR_DIRECTION: u32 = 1u;
const PAIR_LOBE: u32 = 2u;
const PAIR_FLIGHT: u32 = 3u;
// The choice of passing the first and the second sheet of thin glass.
const PAIR_SHEET: u32 = 4u;
// The point of the aperture.
const PAIR_APERTURE: u32 = 5u;

// Nested uniform (Owen) scrambling: flips each binary digit by a hash of the higher digits (Laine and Karras 2011, with the
// constants of Vegdahl 2021). In each step below, the change of a bit depends only on lower bits of the reversed word, which are
// the higher digits of x. Two words of seed make the result uniform for every x.
fn owen_scramble(x: u32, seed: vec2<u32>) -> u32 {
    var v = reverseBits(x);
    v ^= v * 0x3d20adeau;
    v += seed.x;
    v *= seed.y | 1u;
    v ^= v * 0x05526c56u;
    v ^= v * 0x53a22864u;
    return reverseBits(v);
}

// Point `number` of the Sobol (0, 2)-sequence, with 32 binary digits per coordinate. The generator matrix of y is Pascal's
// triangle mod 2. By Lucas's theorem, digit i of y is the sum mod 2 of all digits j of `number` with (i & j) == i. Five steps
// form these sums, one step for each bit of i.
fn sobol2(number: u32) -> vec2<u32> {
    var y = number;
    y ^= (y >> 1u) & 0x55555555u;
    y ^= (y >> 2u) & 0x33333333u;
    y ^= (y >> 4u) & 0x0f0f0f0fu;
    y ^= (y >> 8u) & 0x00ff00ffu;
    y ^= y >> 16u;
    return vec2<u32>(reverseBits(number), reverseBits(y));
}

// Two uniforms in [0, 1), in steps of 2^-24: member `number` of the point set that pixel `index` uses for `pair` in an
// iteration. Point sets of different pixels, iterations, pairs or seeds are independent.
fn stratified2(index: u32, iteration: u32, number: u32, pair: u32, seed: u32) -> vec2<f32> {
    let a = random_words(STREAM_STRATA, index, iteration, 0u, 2u * pair, seed);
    let b = random_words(STREAM_STRATA, index, iteration, 0u, 2u * pair + 1u, seed);
    // The order of the points is shuffled, so that members with the same number in two sets are independent.
    let p = sobol2(owen_scramble(number, a.xy));
    let u = vec2<u32>(owen_scramble(p.x, b.xy), owen_scramble(p.y, b.zw));
    return vec2<f32>(u >> vec2<u32>(8u)) * (1.0 / 16777216.0);
}

// Random numbers as a function of where they are used: the same draw whatever the tile, crop or workgroup.

// One stream a purpose, so that a light path and a pixel of the same number stay independent.
const STREAM_SENSOR: u32 = 0u;
const STREAM_LIGHT: u32 = 1u;
const STREAM_QUERY: u32 = 2u;
const STREAM_ALPHA: u32 = 3u;
const STREAM_STRATA: u32 = 4u;

// Jarzynski and Olano 2020, "Hash Functions for GPU Rendering", pcg4d.
fn pcg4d(key: vec4<u32>) -> vec4<u32> {
    var v = key * 1664525u + 1013904223u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    v = v ^ (v >> vec4<u32>(16u));
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

// Four independent words. `index` is a pixel or a light path, and `sample` counts its samples over the whole render. `depth` is the
// bounce, and `dimension` the use within the bounce.
fn random_words(stream: u32, index: u32, sample: u32, depth: u32, dimension: u32, seed: u32) -> vec4<u32> {
    return pcg4d(vec4<u32>(index, sample, (stream << 28u) | (depth << 14u) | dimension, seed));
}

// The same as four uniforms in [0, 1).
fn random4(stream: u32, index: u32, sample: u32, depth: u32, dimension: u32, seed: u32) -> vec4<f32> {
    return vec4<f32>(random_words(stream, index, sample, depth, dimension, seed) >> vec4<u32>(8u)) * (1.0 / 16777216.0);
}

// Product of two words: its upper word and its lower one.
fn multiply_wide(a: u32, b: u32) -> vec2<u32> {
    let a_low = a & 0xffffu;
    let a_high = a >> 16u;
    let b_low = b & 0xffffu;
    let b_high = b >> 16u;
    let first = a_high * b_low + ((a_low * b_low) >> 16u);
    let second = a_low * b_high + (first & 0xffffu);
    return vec2<u32>(a_high * b_high + (first >> 16u) + (second >> 16u), a * b);
}

// The number below n that 64 random bits stand for, the upper word in x: floor(n bits / 2^64). Probabilities of two numbers differ by
// 2^-64 at most.
fn random_below(bits: vec2<u32>, n: u32) -> u32 {
    let product = multiply_wide(bits.x, n);
    let carried = multiply_wide(bits.y, n).x;
    return product.x + select(0u, 1u, product.y > 0xffffffffu - carried);
}

// Output permutation of PCG (O'Neill 2014, RXS-M-XS 32): turns the state of a linear generator into random bits.
fn hash32(state: u32) -> u32 {
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

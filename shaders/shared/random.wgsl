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

// Four independent uniforms in [0, 1): `index` is a pixel or light path, `sample` counts its samples over the whole
// render, `depth` the bounce, `dimension` the use within the bounce.
fn random4(stream: u32, index: u32, sample: u32, depth: u32, dimension: u32, seed: u32) -> vec4<f32> {
    let h = pcg4d(vec4<u32>(index, sample, (stream << 28u) | (depth << 14u) | dimension, seed));
    return vec4<f32>(h >> vec4<u32>(8u)) * (1.0 / 16777216.0);
}

// Output permutation of PCG (O'Neill 2014, RXS-M-XS 32): turns the state of a linear generator into random bits.
fn hash32(state: u32) -> u32 {
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Random numbers are a pure function of where they are used: pixel or path, sample, depth, dimension. So a draw does not
// depend on the tile, the crop or the workgroup size.

// One stream per purpose, so that a light path and a pixel with the same number draw independent numbers.
const STREAM_SENSOR: u32 = 0u;
const STREAM_LIGHT: u32 = 1u;
const STREAM_QUERY: u32 = 2u;
const STREAM_ALPHA: u32 = 3u;
const STREAM_STRATA: u32 = 4u;
const STREAM_PHOTON: u32 = 5u;
const STREAM_EVENT: u32 = 6u;

// Hash function pcg4d: four hashed words from four words (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering").
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

// Bits that are added to the depth in `random_key`, so that light subpaths, connections and photons do not share keys with sensor
// subpaths and queries.
const LIGHT_BIT: u32 = 0x1000u;
const CONNECTION_BIT: u32 = 0x2000u;
const PHOTON_BITS: u32 = 0x3000u;

// The key of a use of random numbers, for `pcg4d`. `index` is the number of the pixel or of the light path. `sample` counts the
// pixel's samples over the whole render; for a light path it is the iteration. `depth` is the bounce (below 2^12) and may have one of
// the bits above. `dimension` numbers the uses within the bounce, and is below 2^14.
fn random_key(stream: u32, index: u32, sample: u32, depth: u32, dimension: u32, seed: u32) -> vec4<u32> {
    return vec4<u32>(index, sample, (stream << 28u) | (depth << 14u) | dimension, seed);
}

// Four independent random words. Arguments: see `random_key`.
fn random_words(stream: u32, index: u32, sample: u32, depth: u32, dimension: u32, seed: u32) -> vec4<u32> {
    return pcg4d(random_key(stream, index, sample, depth, dimension, seed));
}

// Four independent uniforms in [0, 1), in steps of 2^-24. Arguments: see `random_key`.
fn random4(stream: u32, index: u32, sample: u32, depth: u32, dimension: u32, seed: u32) -> vec4<f32> {
    return vec4<f32>(random_words(stream, index, sample, depth, dimension, seed) >> vec4<u32>(8u)) * (1.0 / 16777216.0);
}

// Bit of the third word of a ray's key. It is 0 for the random choices at surfaces with alpha.
const FLIGHT_BIT: u32 = 0x2000u;

// Three independent uniforms in [0, 1) for a flight through media along the ray with this key. They are independent of the choices
// at surfaces with alpha.
fn flight_uniforms(key: vec4<u32>) -> vec3<f32> {
    let words = pcg4d(vec4<u32>(key.x, key.y, key.z | FLIGHT_BIT, key.w));
    return vec3<f32>(words.xyz >> vec3<u32>(8u)) * (1.0 / 16777216.0);
}

// Product of two words as 64 bits. x: upper word, y: lower word.
fn multiply_wide(a: u32, b: u32) -> vec2<u32> {
    let a_low = a & 0xffffu;
    let a_high = a >> 16u;
    let b_low = b & 0xffffu;
    let b_high = b >> 16u;
    let first = a_high * b_low + ((a_low * b_low) >> 16u);
    let second = a_low * b_high + (first & 0xffffu);
    return vec2<u32>(a_high * b_high + (first >> 16u) + (second >> 16u), a * b);
}

// Random integer below n from 64 random bits: floor(n bits / 2^64), with the upper word in `bits.x`. The probabilities of two
// integers differ by at most 2^-64.
fn random_below(bits: vec2<u32>, n: u32) -> u32 {
    let product = multiply_wide(bits.x, n);
    let carried = multiply_wide(bits.y, n).x;
    return product.x + select(0u, 1u, product.y > 0xffffffffu - carried);
}

// Output permutation of PCG (O'Neill 2014, RXS-M-XS 32): turns the state of a linear congruential generator into random bits.
fn hash32(state: u32) -> u32 {
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

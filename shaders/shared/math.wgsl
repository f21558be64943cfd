// Small helper functions that belong to no other module.

const PI: f32 = 3.14159265358979;
// The index of nothing: a missing vertex, triangle, texture or list.
const NONE: u32 = 0xffffffffu;

// Whether the driver's sine and cosine are accurate to the last digits. Vulkan guarantees an absolute error of 2^-11 only.
override EXACT_SINES: bool = false;

fn square(x: f32) -> f32 {
    return x * x;
}

fn max_component(v: vec3<f32>) -> f32 {
    return max(v.x, max(v.y, v.z));
}

fn luminance(c: vec3<f32>) -> f32 {
    return dot(c, vec3<f32>(0.2126, 0.7152, 0.0722));
}

// Whether all components are finite. WGSL has no isNan: a float whose exponent bits are all 1 is infinite or not a number.
fn is_finite(v: vec3<f32>) -> bool {
    let e = bitcast<vec3<u32>>(v) & vec3<u32>(0x7f800000u);
    return all(e != vec3<u32>(0x7f800000u));
}

// Right-handed orthonormal frame around the unit vector n. Its columns are tangent, bitangent and n (Duff et al. 2017, listing 3).
fn frame_around(n: vec3<f32>) -> mat3x3<f32> {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return mat3x3<f32>(
        vec3<f32>(1.0 + s * n.x * n.x * a, s * b, -s * n.x),
        vec3<f32>(b, s + n.y * n.y * a, -n.y),
        n,
    );
}

// Cosine and sine of phi, for phi in [0, 2 pi]. Both are accurate to float precision, because directions that are built from
// them must have length 1.
fn cosine_and_sine(phi: f32) -> vec2<f32> {
    if (EXACT_SINES) {
        return vec2<f32>(cos(phi), sin(phi));
    }
    // Cephes (Moshier 1992). First subtract the nearest multiple of pi / 2, in three parts so that no digits are lost. Then
    // evaluate polynomials of the remainder.
    let quarter = floor(phi * (2.0 / PI) + 0.5);
    let x = ((phi - quarter * 1.5703125) - quarter * 4.8375129699707031e-4) - quarter * 7.5497899548918822e-8;
    let z = x * x;
    let c = ((2.443315711809948e-5 * z - 1.388731625493765e-3) * z + 4.166664568298827e-2) * z * z - 0.5 * z + 1.0;
    let s = ((-1.9515295891e-4 * z + 8.3321608736e-3) * z - 1.6666654611e-1) * z * x + x;
    let turned = select(vec2<f32>(c, s), vec2<f32>(-s, c), (u32(quarter) & 1u) != 0u);
    return select(turned, -turned, (u32(quarter) & 2u) != 0u);
}

// Angle of the vector p, in [-pi, pi], to float precision (Cephes, Moshier 1992). Vulkan allows atan2 an error of 4096 ulp.
fn angle_of(p: vec2<f32>) -> f32 {
    let size = abs(p);
    let ratio = min(size.x, size.y) / max(size.x, size.y);
    let is_large = ratio > 0.41421356;
    let t = select(ratio, (ratio - 1.0) / (ratio + 1.0), is_large);
    let t2 = t * t;
    let series = ((8.05374449538e-2 * t2 - 1.38776856032e-1) * t2 + 1.99777106478e-1) * t2 - 3.33329491539e-1;
    let first = select(0.0, 0.25 * PI, is_large) + (series * t2 * t + t);
    let octants = select(first, 0.5 * PI - first, size.y > size.x);
    let upper = select(octants, PI - octants, p.x < 0.0);
    return select(upper, -upper, p.y < 0.0);
}

// Cosine-distributed unit direction around +z from two uniforms. Density per solid angle: cos(theta) / pi.
fn cosine_hemisphere(u: vec2<f32>) -> vec3<f32> {
    let r = sqrt(u.x);
    let turn = cosine_and_sine(2.0 * PI * u.y);
    return vec3<f32>(r * turn.x, r * turn.y, sqrt(max(0.0, 1.0 - u.x)));
}

// Barycentric weights of corners 1 and 2 of a uniformly distributed point of a triangle, from two uniforms.
fn uniform_triangle(u: vec2<f32>) -> vec2<f32> {
    let r = sqrt(u.x);
    return vec2<f32>(1.0 - r, r * u.y);
}

// Unit vector from octahedral coordinates, stored as two signed 16-bit fractions in one word.
fn decode_octahedral(packed: u32) -> vec3<f32> {
    let e = unpack2x16snorm(packed);
    let z = 1.0 - abs(e.x) - abs(e.y);
    let t = max(-z, 0.0);
    let x = e.x - select(-t, t, e.x >= 0.0);
    let y = e.y - select(-t, t, e.y >= 0.0);
    return normalize(vec3<f32>(x, y, z));
}

// The four bytes of a word as floats from 0 to 255, lowest byte first. The builtin unpack4xU8 is not used, because it
// requires 8-bit integers from the device.
fn bytes_to_floats(v: u32) -> vec4<f32> {
    return vec4<f32>(vec4<u32>(v & 0xffu, (v >> 8u) & 0xffu, (v >> 16u) & 0xffu, v >> 24u));
}

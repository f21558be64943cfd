// The sky: light that arrives from infinitely far away, from all directions. It is an equirectangular image with +Y up. The
// radiance is constant in each texel. A constant sky is an image of one texel.
#import scene
#import path

// First a header (SkyHeader). Then one texel per row: start and end of the row in the cumulative distribution over rows, and for
// each of its two edges the bits of sin^2(a / 2), where a is the angle between the edge and the nearer pole. The nearer pole is
// +Y for rows whose centre is not below the equator, otherwise -Y. Then for each row its texels, and one more as the end of the
// last texel: the bits of the radiance, and the start of the texel in the cumulative distribution within its row. The
// distributions are in units of 2^-31, so probabilities are exact.
@group(0) @binding(12) var sky: texture_1d<u32>;

struct SkyHeader {
    width: u32,
    height: u32,
    // Probability that a light subpath starts from the sky.
    select_pdf: f32,
    // Density per area of the point where a subpath from the sky starts: on a disk beside the scene, perpendicular to the subpath.
    disk_pdf: f32,
}

// The sky in one direction.
struct SkySample {
    // Unit vector towards the sky.
    direction: vec3<f32>,
    radiance: vec3<f32>,
    // Density per solid angle with which `sample_sky` samples the direction; 0 if it never does.
    pdf: f32,
}

fn load_sky() -> SkyHeader {
    let header = textureLoad(sky, 0u, 0);
    return SkyHeader(header.x, header.y, bitcast<f32>(header.z), bitcast<f32>(header.w));
}

fn load_sky_row(row: u32) -> vec4<u32> {
    return textureLoad(sky, 1u + row, 0);
}

fn load_sky_texel(header: SkyHeader, row: u32, column: u32) -> vec4<u32> {
    return textureLoad(sky, 1u + header.height + row * (header.width + 1u) + column, 0);
}

// The sky in the direction w (unit). The centre of the image is +X, and -Z is at a quarter of its width.
fn sky_towards(w: vec3<f32>) -> SkySample {
    let header = load_sky();
    let theta = angle_of(vec2<f32>(w.y, length(w.xz)));
    let phi = select(angle_of(w.xz), 0.0, all(w.xz == vec2<f32>(0.0)));
    let place = vec2<f32>(phi / (2.0 * PI) + 0.5, theta / PI) * vec2<f32>(f32(header.width), f32(header.height));
    let texel = min(vec2<u32>(max(place, vec2<f32>(0.0))), vec2<u32>(header.width - 1u, header.height - 1u));
    let row = load_sky_row(texel.y);
    let here = load_sky_texel(header, texel.y, texel.x);
    let end = load_sky_texel(header, texel.y, texel.x + 1u).w;
    let probability = f32(row.y - row.x) * f32(end - here.w) * exp2(-62.0);
    let solid_angle = abs(bitcast<f32>(row.w) - bitcast<f32>(row.z)) * (4.0 * PI) / f32(header.width);
    return SkySample(w, bitcast<vec3<f32>>(here.xyz), probability / solid_angle);
}

// Samples a direction in proportion to luminance, from four random words. The result comes from `sky_towards`, so
// that all strategies agree about directions near the edges of texels.
fn sample_sky(words: vec4<u32>) -> SkySample {
    let header = load_sky();
    let row_word = words.x >> 1u;
    var lo = 0u;
    var hi = header.height - 1u;
    while (lo < hi) {
        let middle = (lo + hi + 1u) / 2u;
        let above = load_sky_row(middle).x > row_word;
        lo = select(middle, lo, above);
        hi = select(hi, middle - 1u, above);
    }
    let y = lo;
    let column_word = words.y >> 1u;
    lo = 0u;
    hi = header.width - 1u;
    while (lo < hi) {
        let middle = (lo + hi + 1u) / 2u;
        let above = load_sky_texel(header, y, middle).w > column_word;
        lo = select(middle, lo, above);
        hi = select(hi, middle - 1u, above);
    }
    let u = vec2<f32>(words.zw >> vec2<u32>(8u)) * (1.0 / 16777216.0);
    let row = load_sky_row(y);
    let half_sine2 = mix(bitcast<f32>(row.z), bitcast<f32>(row.w), u.x);
    let cosine = 1.0 - 2.0 * half_sine2;
    let sine = 2.0 * sqrt(max(half_sine2 * (1.0 - half_sine2), 0.0));
    let turn = cosine_and_sine(2.0 * PI * (f32(lo) + u.y) / f32(header.width));
    let up = select(cosine, -cosine, 2u * y + 1u > header.height);
    return sky_towards(vec3<f32>(-sine * turn.x, up, -sine * turn.y));
}

// Texture lookup: wrap modes, filter, decoding of colours and data.
#import scene

// Linear values of sRGB channels in [0, 1] (IEC 61966-2-1).
fn srgb_to_linear(c: vec3<f32>) -> vec3<f32> {
    let low = c / 12.92;
    let high = pow((c + 0.055) / 1.055, vec3<f32>(2.4));
    return select(high, low, c <= vec3<f32>(0.04045));
}

// Texel coordinate `i` mapped into [0, size). `mode`: 0 repeat, 1 mirror, 2 clamp. With repeat and mirror, `i` must be in
// [-1, 2 size]; the result is in [0, size) for any `i`. There is no division, because divisions would take a fifth to half of the time of
// a look-up on lavapipe (docs/notebook/textures.md).
fn wrap_texel(i: i32, size: i32, mode: u32) -> i32 {
    // `i` modulo 2 size.
    let period = select(select(i, i + 2 * size, i < 0), i - 2 * size, i >= 2 * size);
    let repeated = select(period, period - size, period >= size);
    let mirrored = min(period, 2 * size - 1 - period);
    return clamp(select(select(repeated, mirrored, mode == 1u), i, mode == 2u), 0, size - 1);
}

// Meaning of the bytes of a texture. Colours: sRGB, with linear alpha. Data: four linear channels. Normals: as data, but
// from about -1 to 1. A byte of 128 means exactly 0, so that a flat normal map changes nothing.
const ENCODING_COLOR: u32 = 0u;
const ENCODING_DATA: u32 = 1u;
const ENCODING_NORMAL: u32 = 2u;

// The decoded channels of texel (x, y). Coordinates outside the texture are wrapped; see `wrap_texel` for their range.
fn texel(info: TextureInfo, x: i32, y: i32, encoding: u32) -> vec4<f32> {
    let i = wrap_texel(x, i32(info.width), info.sampler & 3u);
    let j = wrap_texel(y, i32(info.height), (info.sampler >> 2u) & 3u);
    let k = u32(j) * info.width + u32(i);
    let word = textureLoad(texels, info.first + (k >> 2u), 0)[k & 3u];
    if (encoding == ENCODING_NORMAL) {
        return (bytes_to_floats(word) - 128.0) / 127.0;
    }
    let c = unpack4x8unorm(word);
    if (encoding == ENCODING_COLOR) {
        return vec4<f32>(srgb_to_linear(c.xyz), c.w);
    }
    return c;
}

// Texture coordinates after the transform of the texture, whose index in `textures` is `first`: two columns, then the offset.
fn transform_uv(first: u32, uv: vec2<f32>) -> vec2<f32> {
    let columns = bitcast<vec4<f32>>(textureLoad(textures, first, 0));
    let offset = bitcast<vec4<f32>>(textureLoad(textures, first + 1u, 0));
    // The host limits the transform to 10^6. With coordinates in this range, no product is infinite.
    let p = clamp(uv, vec2<f32>(-1e9), vec2<f32>(1e9));
    return columns.xy * p.x + columns.zw * p.y + offset.xy;
}

// Linear RGB and alpha at texture coordinates uv of the mesh, filtered as the texture asks for; opaque white if `index` is NONE.
fn sample_texture(index: u32, uv: vec2<f32>) -> vec4<f32> {
    return sample_encoded(index, uv, ENCODING_COLOR);
}

// As `sample_texture`, for any encoding. `encoding` should be a constant, so that the compiler removes the other cases. Without a
// texture all channels are 1, which is no flat normal: test for a texture first.
fn sample_encoded(index: u32, coordinates: vec2<f32>, encoding: u32) -> vec4<f32> {
    if (index == NONE) {
        return vec4<f32>(1.0);
    }
    let info = load_texture(index);
    var uv = coordinates;
    if (HAS_TEXTURE_TRANSFORMS && (info.sampler >> TEXTURE_TRANSFORM_SHIFT) != 0u) {
        uv = transform_uv(info.sampler >> TEXTURE_TRANSFORM_SHIFT, uv);
    }
    // Repeat and mirror: reduced to one period of mirror, [0, 2], because `wrap_texel` needs indices in [-1, 2 size]. 2 occurs: tiny
    // negative coordinates round to it. Clamp: [-1, 2] is enough.
    let bounded = select(uv - 2.0 * floor(0.5 * uv), clamp(uv, vec2<f32>(-1.0), vec2<f32>(2.0)),
        vec2<bool>((info.sampler & 3u) == 2u, ((info.sampler >> 2u) & 3u) == 2u));
    let p = bounded * vec2<f32>(f32(info.width), f32(info.height));
    if ((info.sampler & 16u) == 0u) {
        return texel(info, i32(floor(p.x)), i32(floor(p.y)), encoding);
    }
    let base = floor(p - 0.5);
    let f = p - 0.5 - base;
    var sum = vec4<f32>(0.0);
    for (var k = 0; k < 4; k++) {
        let dx = k & 1;
        let dy = k >> 1u;
        let w = select(1.0 - f.x, f.x, dx == 1) * select(1.0 - f.y, f.y, dy == 1);
        sum += w * texel(info, i32(base.x) + dx, i32(base.y) + dy, encoding);
    }
    return sum;
}

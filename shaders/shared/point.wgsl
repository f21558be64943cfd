// The properties of a material at a point, if they vary over the surface, and how a vertex stores them.
#import material

struct PointProperties {
    base: vec3<f32>,
    metallic: f32,
    // GGX alpha. `unpack_point` returns 0 if the lobe is a delta.
    alpha: f32,
    coats: CoatFactors,
    // Texel that multiplies the transmission.
    transmission: f32,
}

// Texels that multiply the properties of the coats, each from 0 to 1.
struct CoatFactors {
    specular_color: vec3<f32>,
    // Strength of the dielectric coat.
    specular: f32,
    // Strength and perceptual roughness of the clear coat.
    clearcoat: f32,
    clearcoat_roughness: f32,
}

// The factors of coats without textures.
const WHITE_COATS = CoatFactors(vec3<f32>(1.0), 1.0, 1.0, 1.0);

// Whether a property other than the base colour varies over surfaces with this material.
fn varies(m: Material) -> bool {
    return HAS_SURFACE_TEXTURES && (m.flags & MATERIAL_VARIES) != 0u;
}

// The properties in three words. Each colour channel and the roughness have 16 bits. The words hold square roots of colours, so
// that dark colours lose no digits: the relative error is below 0.1 % for all sRGB bytes above 0. The metalness has 8 bits, as in
// the texture, and so has the transmission.
fn pack_point(p: PointProperties) -> vec3<u32> {
    if (HAS_COAT_TEXTURES) {
        return pack_coated_point(p);
    }
    let root = sqrt(p.base);
    return vec3<u32>(pack2x16unorm(root.xy), pack2x16unorm(vec2<f32>(root.z, sqrt(p.alpha))),
        pack4x8unorm(vec4<f32>(p.metallic, select(0.0, p.transmission, HAS_TRANSMISSION_TEXTURES), 0.0, 0.0)));
}

// The properties that `pack_point` has packed.
fn unpack_point(words: vec3<u32>) -> PointProperties {
    if (HAS_COAT_TEXTURES) {
        return unpack_coated_point(words);
    }
    let red_green = unpack2x16unorm(words.x);
    let blue_roughness = unpack2x16unorm(words.y);
    let root = vec3<f32>(red_green, blue_roughness.x);
    let alpha = square(blue_roughness.y);
    let rest = unpack4x8unorm(words.z);
    return PointProperties(root * root, rest.x, select(alpha, 0.0, alpha < DELTA_ALPHA), WHITE_COATS,
        select(1.0, rest.y, HAS_TRANSMISSION_TEXTURES));
}

// As `pack_point`, with the factors of the coats. The base colour and the roughness have 10 bits, all others have 8. The roots
// of colours have a step of at most 0.4 %, about the step of an sRGB byte. With HAS_TRANSMISSION_TEXTURES, all have 8 bits.
fn pack_coated_point(p: PointProperties) -> vec3<u32> {
    let factors = pack4x8unorm(vec4<f32>(p.metallic, p.coats.specular, p.coats.clearcoat, p.coats.clearcoat_roughness));
    if (HAS_TRANSMISSION_TEXTURES) {
        return vec3<u32>(pack4x8unorm(vec4<f32>(sqrt(p.base), p.transmission)),
            pack4x8unorm(vec4<f32>(sqrt(p.coats.specular_color), sqrt(p.alpha))), factors);
    }
    let base = vec3<u32>(sqrt(p.base) * 1023.0 + 0.5);
    let roughness = u32(sqrt(p.alpha) * 1023.0 + 0.5);
    let color = pack4x8unorm(vec4<f32>(sqrt(p.coats.specular_color), 0.0));
    return vec3<u32>(base.x | (base.y << 10u) | (base.z << 20u) | ((roughness >> 8u) << 30u),
        color | (roughness << 24u), factors);
}

// The properties that `pack_coated_point` has packed.
fn unpack_coated_point(words: vec3<u32>) -> PointProperties {
    let rest = unpack4x8unorm(words.z);
    let color = unpack4x8unorm(words.y);
    let factors = CoatFactors(color.xyz * color.xyz, rest.y, rest.z, rest.w);
    if (HAS_TRANSMISSION_TEXTURES) {
        let root = unpack4x8unorm(words.x);
        let alpha = square(color.w);
        return PointProperties(root.xyz * root.xyz, rest.x, select(alpha, 0.0, alpha < DELTA_ALPHA), factors, root.w);
    }
    let base = vec3<f32>((vec3<u32>(words.x) >> vec3<u32>(0u, 10u, 20u)) & vec3<u32>(1023u)) / 1023.0;
    let alpha = square(f32((words.y >> 24u) | ((words.x >> 30u) << 8u)) / 1023.0);
    return PointProperties(base * base, rest.x, select(alpha, 0.0, alpha < DELTA_ALPHA), factors, 1.0);
}

// Metalness (x) and GGX alpha (y) at a point with this material. `words`: `point_words` of the vertex.
fn metallic_and_alpha(m: Material, words: vec3<u32>) -> vec2<f32> {
    if (varies(m)) {
        let p = unpack_point(words);
        return vec2<f32>(p.metallic, p.alpha);
    }
    return vec2<f32>(m.metallic, m.alpha);
}

// Transmission at a point with this material. `words`: `point_words` of the vertex.
fn transmission_at(m: Material, words: vec3<u32>) -> f32 {
    if (HAS_TRANSMISSION_TEXTURES && varies(m)) {
        return m.transmission * unpack_point(words).transmission;
    }
    return m.transmission;
}

// GGX alpha of the clear coat where a texture multiplies its roughness by `factor`; 0 if the lobe is a delta.
fn clearcoat_alpha(m: Material, factor: f32) -> f32 {
    let alpha = m.clearcoat_alpha * square(factor);
    return select(alpha, 0.0, alpha < DELTA_ALPHA);
}

// Whether a point with this material has a clear coat whose lobe is not a delta.
fn has_rough_clearcoat(m: Material, words: vec3<u32>) -> bool {
    if (!HAS_CLEARCOAT || m.clearcoat <= 0.0) {
        return false;
    }
    if (HAS_COAT_TEXTURES && varies(m)) {
        let coats = unpack_point(words).coats;
        return coats.clearcoat > 0.0 && clearcoat_alpha(m, coats.clearcoat_roughness) >= DELTA_ALPHA;
    }
    return m.clearcoat_alpha >= DELTA_ALPHA;
}

// The properties of a material at a point, if they vary over the surface, and how a vertex stores them.
#import material

struct PointProperties {
    base: vec3<f32>,
    metallic: f32,
    // GGX alpha; 0 if the lobe is a delta.
    alpha: f32,
}

// Whether a property other than the base colour varies over surfaces with this material.
fn varies(m: Material) -> bool {
    return HAS_SURFACE_TEXTURES && m.surface_texture != NONE;
}

// The properties in three words. Each colour channel and the roughness have 16 bits. The words hold square roots of colours, so
// that dark colours lose no digits: the relative error is below 0.1 % for all sRGB bytes above 0. The metalness has 8 bits, as in
// the texture.
fn pack_point(p: PointProperties) -> vec3<u32> {
    let root = sqrt(p.base);
    return vec3<u32>(pack2x16unorm(root.xy), pack2x16unorm(vec2<f32>(root.z, sqrt(p.alpha))),
        pack4x8unorm(vec4<f32>(p.metallic, 0.0, 0.0, 0.0)));
}

// The properties that `pack_point` has packed.
fn unpack_point(words: vec3<u32>) -> PointProperties {
    let red_green = unpack2x16unorm(words.x);
    let blue_roughness = unpack2x16unorm(words.y);
    let root = vec3<f32>(red_green, blue_roughness.x);
    let alpha = square(blue_roughness.y);
    return PointProperties(root * root, unpack4x8unorm(words.z).x, select(alpha, 0.0, alpha < DELTA_ALPHA));
}

// Metalness (x) and GGX alpha (y) at a point with this material. `words`: `base_color` of the vertex.
fn metallic_and_alpha(m: Material, words: vec3<u32>) -> vec2<f32> {
    if (varies(m)) {
        let p = unpack_point(words);
        return vec2<f32>(p.metallic, p.alpha);
    }
    return vec2<f32>(m.metallic, m.alpha);
}

// Material records as the host writes them (src/render/material.rs). The host computes everything that depends
// on the material alone.
#import scene

struct Material {
    base_color: vec3<f32>,
    // Alpha factor of the base colour.
    opacity: f32,
    // Radiance, W / (m^2 sr).
    emission: vec3<f32>,
    // Density of emitter samples per area of this surface: selection probability of a triangle over its area. 0 if it
    // does not emit.
    emission_density: f32,
    metallic: f32,
    // GGX alpha. Below DELTA_ALPHA the lobe is a delta.
    alpha: f32,
    // Reflectance of the dielectric coat at normal incidence, in the channel where it is largest.
    f0: f32,
    // Index of refraction relative to the surroundings.
    ior: f32,
    transmission: f32,
    // 1 / (pi (1 - mean directional albedo of the coat)).
    diffuse_scale: f32,
    alpha_cutoff: f32,
    flags: u32,
    // Indices into `textures`, or NONE.
    base_texture: u32,
    emission_texture: u32,
    // Reflectance of the coat at grazing angles: specularFactor of KHR_materials_specular. 0: a surface without coat.
    f90: f32,
    // Index into `textures`, or NONE: green multiplies the roughness, blue the metalness.
    surface_texture: u32,
    // Index into `textures`, or NONE, and the factor on its red and green channels.
    normal_texture: u32,
    normal_scale: f32,
    // Strength of the clear coat over everything else, and its GGX alpha.
    clearcoat: f32,
    clearcoat_alpha: f32,
    // Reflectance of the dielectric coat at normal incidence, per channel, at most f90. If a texture multiplies this colour, only the
    // product with the texel is limited to f90.
    f0_color: vec3<f32>,
    // Indices into `textures`, or NONE. The specular colour (red, green, blue) multiplies `f0_color`, and the specular strength
    // (alpha) multiplies `f0_color` and `f90`. Red multiplies the clear coat, green its roughness.
    specular_color_texture: u32,
    specular_texture: u32,
    clearcoat_texture: u32,
    clearcoat_roughness_texture: u32,
    // Index into `media` of the medium inside, or NONE.
    interior: u32,
    // Share of the light that is reflected back to where it came from, and the GGX alpha of this lobe (retroreflector.wgsl).
    retroreflection: f32,
    retroreflector_alpha: f32,
    // Index into `textures`, or NONE: red multiplies the transmission.
    transmission_texture: u32,
    // Thin glass: its thickness, and the optical depth of what it contains along this thickness, per channel.
    thickness: f32,
    absorption: vec3<f32>,
    // Travel time per length inside solids of this material.
    group_index: f32,
}

const MATERIAL_DOUBLE_SIDED: u32 = 1u;
const MATERIAL_MASK: u32 = 2u;
const MATERIAL_BLEND: u32 = 4u;
// Properties other than the base colour vary over the surface.
const MATERIAL_VARIES: u32 = 8u;
// Surfaces with this material are thin glass (sheet.wgsl).
const MATERIAL_THIN: u32 = 16u;
const DELTA_ALPHA: f32 = 0.001;
// Minimum of the part of the light that a coat lets in on average. It keeps the scale of the base finite.
const MIN_BELOW_COAT: f32 = 1e-4;

// Number of texels of a material.
const MATERIAL_TEXELS: u32 = 10u;

fn load_material(index: u32) -> Material {
    let color = bitcast<vec4<f32>>(textureLoad(materials, MATERIAL_TEXELS * index, 0));
    let light = bitcast<vec4<f32>>(textureLoad(materials, MATERIAL_TEXELS * index + 1u, 0));
    let lobes = bitcast<vec4<f32>>(textureLoad(materials, MATERIAL_TEXELS * index + 2u, 0));
    let rest = textureLoad(materials, MATERIAL_TEXELS * index + 3u, 0);
    let images = textureLoad(materials, MATERIAL_TEXELS * index + 4u, 0);
    let bumps = textureLoad(materials, MATERIAL_TEXELS * index + 5u, 0);
    let specular = textureLoad(materials, MATERIAL_TEXELS * index + 6u, 0);
    var coats = vec4<u32>(NONE);
    if (HAS_COAT_TEXTURES || HAS_INTERIORS) {
        coats = textureLoad(materials, MATERIAL_TEXELS * index + 7u, 0);
    }
    var last = vec4<u32>(0u, 0u, NONE, 0u);
    if (HAS_RETROREFLECTORS || HAS_TRANSMISSION_TEXTURES || HAS_SHEETS) {
        last = textureLoad(materials, MATERIAL_TEXELS * index + 8u, 0);
    }
    let retroreflector = bitcast<vec2<f32>>(last.xy);
    var absorption = vec3<f32>(0.0);
    var group_index = lobes.w * SURROUNDING_IOR;
    if (HAS_SHEETS || HAS_GROUP_INDICES) {
        let inside = bitcast<vec4<f32>>(textureLoad(materials, MATERIAL_TEXELS * index + 9u, 0));
        absorption = inside.xyz;
        group_index = select(group_index, inside.w, HAS_GROUP_INDICES);
    }
    let numbers = bitcast<vec3<f32>>(rest.xyz);
    return Material(color.xyz, color.w, light.xyz, light.w, lobes.x, lobes.y, lobes.z, lobes.w,
        numbers.x, numbers.y, numbers.z, rest.w, images.x, images.y, bitcast<f32>(images.z), images.w,
        bumps.x, bitcast<f32>(bumps.y), bitcast<f32>(bumps.z), bitcast<f32>(bumps.w),
        bitcast<vec3<f32>>(specular.xyz), specular.w, coats.x, coats.y, coats.z, coats.w,
        retroreflector.x, retroreflector.y, last.z, bitcast<f32>(last.w), absorption, group_index);
}

// Whether surfaces with this material are thin glass.
fn is_thin(m: Material) -> bool {
    return HAS_SHEETS && (m.flags & MATERIAL_THIN) != 0u;
}

// Whether surfaces with this material bound a transmitting solid.
fn bounds_solid(m: Material) -> bool {
    return HAS_TRANSMISSION && m.transmission > 0.0 && !is_thin(m);
}

// Travel time per length inside solids of this material.
fn solid_index(material: u32) -> f32 {
    return load_material(material).group_index;
}

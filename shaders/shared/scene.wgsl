// The scene on the device: geometry, attributes, materials, textures, emitters. Declares the bindings 1 to 11 of group 0. Frame, sky,
// media, phase functions, grids and the camera's aims have the others.
#import frame
#import math

// A triangle: three corners in render space. Triangles are in the order of the BVH.
struct Triangle {
    v0: vec3<f32>,
    // Index into `instances`.
    instance: u32,
    v1: vec3<f32>,
    // Index of the first of its three entries in `corners`; NONE if it has neither normals nor texture coordinates.
    corner: u32,
    v2: vec3<f32>,
    // Index into `materials`, with TRIANGLE_ bits above it.
    material: u32,
}

// The corners have normals, which are interpolated.
const TRIANGLE_SMOOTH: u32 = 0x80000000u;
// The surface may let a ray pass (alphaMode MASK and BLEND).
const TRIANGLE_ALPHA: u32 = 0x40000000u;
// The corners have vertex colours or tangents, which are in `details`.
const TRIANGLE_DETAILED: u32 = 0x10000000u;
// The instance mirrors the mesh: seen from the front, the corners run clockwise.
const TRIANGLE_MIRRORED: u32 = 0x20000000u;
// The surface is a null boundary (boundary.wgsl).
const TRIANGLE_NULL: u32 = 0x08000000u;
// The surface is thin glass (sheet.wgsl).
const TRIANGLE_SHEET: u32 = 0x04000000u;
const TRIANGLE_MATERIAL: u32 = 0x00ffffffu;

struct VertexAttributes {
    // Octahedral coordinates in mesh space, 16 bits per coordinate.
    normal: u32,
    u: f32,
    v: f32,
}

// Attributes that only some meshes have. They have the same index as in `attributes`.
struct VertexDetails {
    // Linear vertex colour, 16 bits per channel: red and green, then blue and alpha.
    red_green: u32,
    blue_alpha: u32,
    // Tangent for the normal map: octahedral coordinates in mesh space. TANGENT_MIRRORED replaces their bit 16.
    tangent: u32,
}

// The green channel of the normal map points against cross(normal, tangent).
const TANGENT_MIRRORED: u32 = 0x10000u;

// The matrix that transforms normals: columns of the inverse transpose of the instance's linear part.
struct InstanceNormals {
    x: vec3<f32>,
    pad0: f32,
    y: vec3<f32>,
    pad1: f32,
    z: vec3<f32>,
    pad2: f32,
}

struct TextureInfo {
    // First word in `texels`.
    first: u32,
    width: u32,
    height: u32,
    // Bits 0-1: wrap u, 2-3: wrap v (0 repeat, 1 mirror, 2 clamp), 4: bilinear. From TEXTURE_TRANSFORM_SHIFT on: the word of
    // `textures` at which the texture's transform begins, or 0.
    sampler: u32,
}

const TEXTURE_TRANSFORM_SHIFT: u32 = 5u;

// One entry of the alias table over all emitters.
struct Emitter {
    // EMITTER_ constant of emitter.wgsl.
    kind: u32,
    // Triangles: index into `triangles`.
    triangle: u32,
    // Alias table: this entry is kept with probability `keep`, otherwise `other` is taken.
    keep: f32,
    other: u32,
    // Punctual lights and beams: position and unit direction. Suns: centre of the disk and unit direction. Sky: centre of the scene.
    position: vec3<f32>,
    // Probability that a light subpath starts from this emitter.
    select_pdf: f32,
    direction: vec3<f32>,
    // Spots: 1 - cosine of the outer half angle. Beams, suns and the sky: radius of the disk on which light subpaths start.
    outer: f32,
    // Intensity (point, spot) or power (beam, sun); fluxes are in the unit of `frame.wgsl`. Triangles and the sky: unused.
    strength: vec3<f32>,
    // Spots: 1 - cosine of the inner half angle.
    inner: f32,
    // Material of the glass around the emitter, an index into `materials`; NONE outside of glass.
    solid: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

// Here, a texture_1d<u32> is a texel buffer: an array of 16-byte words, each of which is loaded whole (src/gpu/spirv.rs gives
// the reason). If the array is larger than the device's texel buffers, the same array is a storage buffer
// (src/gpu/texels.rs).
// bvh_nodes: five texels per node.
@group(0) @binding(1) var bvh_nodes: texture_1d<u32>;
@group(0) @binding(2) var triangles: texture_1d<u32>;
@group(0) @binding(3) var<storage, read> corners: array<u32>;
@group(0) @binding(4) var<storage, read> attributes: array<VertexAttributes>;
@group(0) @binding(5) var instances: texture_1d<u32>;
// See material.wgsl.
@group(0) @binding(6) var materials: texture_1d<u32>;
@group(0) @binding(7) var textures: texture_1d<u32>;
// Four texels per word, row by row: texel k of a texture is component k % 4 of word `TextureInfo.first` + k / 4.
@group(0) @binding(8) var texels: texture_1d<u32>;
@group(0) @binding(9) var emitters: texture_1d<u32>;
// The directional albedo of the GGX lobe is f0 * x + f90 * y for an entry (x, y). f0 and f90 are the reflectances at normal and at
// grazing incidence. The table has ALBEDO_COLUMNS x ALBEDO_ROWS entries, over the square roots of cosine and alpha. Then come ALBEDO_ROWS
// entries: the cosine-weighted mean of each row over the hemisphere. Texel k holds the entries k and k + 1.
@group(0) @binding(10) var albedo_table: texture_1d<u32>;
@group(0) @binding(11) var<storage, read> details: array<VertexDetails>;
const ALBEDO_COLUMNS: u32 = 64u;
const ALBEDO_ROWS: u32 = 32u;

fn load_triangle(index: u32) -> Triangle {
    let a = textureLoad(triangles, 3u * index, 0);
    let b = textureLoad(triangles, 3u * index + 1u, 0);
    let c = textureLoad(triangles, 3u * index + 2u, 0);
    return Triangle(bitcast<vec3<f32>>(a.xyz), a.w, bitcast<vec3<f32>>(b.xyz), b.w, bitcast<vec3<f32>>(c.xyz), c.w);
}

fn load_instance(index: u32) -> InstanceNormals {
    let x = bitcast<vec4<f32>>(textureLoad(instances, 3u * index, 0));
    let y = bitcast<vec4<f32>>(textureLoad(instances, 3u * index + 1u, 0));
    let z = bitcast<vec4<f32>>(textureLoad(instances, 3u * index + 2u, 0));
    return InstanceNormals(x.xyz, 0.0, y.xyz, 0.0, z.xyz, 0.0);
}

fn load_texture(index: u32) -> TextureInfo {
    let info = textureLoad(textures, index, 0);
    return TextureInfo(info.x, info.y, info.z, info.w);
}

fn load_emitter(index: u32) -> Emitter {
    let choice = textureLoad(emitters, 5u * index, 0);
    let place = bitcast<vec4<f32>>(textureLoad(emitters, 5u * index + 1u, 0));
    let axis = bitcast<vec4<f32>>(textureLoad(emitters, 5u * index + 2u, 0));
    let power = bitcast<vec4<f32>>(textureLoad(emitters, 5u * index + 3u, 0));
    let around = textureLoad(emitters, 5u * index + 4u, 0);
    return Emitter(choice.x, choice.y, bitcast<f32>(choice.z), choice.w,
        place.xyz, place.w, axis.xyz, axis.w, power.xyz, power.w, around.x, around.y, around.z, around.w);
}

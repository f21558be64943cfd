// The surface at a hit point: position, normals, material, texture coordinates.
#import point
#import texture

struct Surface {
    position: vec3<f32>,
    // Distance along the geometric normal from the surface to the origin of a ray that leaves it: several times the rounding
    // error of the triangle's plane.
    offset: f32,
    // Unit geometric normal, on the front side.
    geometric: vec3<f32>,
    // Index into `materials`.
    material: u32,
    // Unit shading normal, on the side of `geometric`.
    normal: vec3<f32>,
    // TRIANGLE_ bits.
    flags: u32,
    uv: vec2<f32>,
    // Index into `triangles`.
    triangle: u32,
    // Linear vertex colour and alpha; white if the mesh has none.
    color: vec4<f32>,
    // Tangent for the normal map in world space, of any length, and the sign of its bitangent. Only set for meshes with a
    // normal map.
    tangent: vec4<f32>,
}

// 2^-19. The plane of a triangle is known to about 6 x 2^-24 of its largest coordinate. An offset of five times this error
// keeps rays from leaking through the triangle and from hitting the triangle that they leave.
const OFFSET_SCALE: f32 = 1.9073486e-6;

// The surface at the point of triangle `index` with barycentric weights u and v of corners 1 and 2.
fn surface_at(index: u32, u: f32, v: f32) -> Surface {
    let t = load_triangle(index);
    var s: Surface;
    s.triangle = index;
    // Interpolated from corner 0 along the edges: a coordinate that all corners share keeps its exact bits.
    s.position = t.v0 + (u * (t.v1 - t.v0) + v * (t.v2 - t.v0));
    let reach = max(max(abs(t.v0), abs(t.v1)), abs(t.v2));
    s.offset = OFFSET_SCALE * max_component(reach);
    s.material = t.material & TRIANGLE_MATERIAL;
    s.flags = t.material;
    let facing = select(1.0, -1.0, (t.material & TRIANGLE_MIRRORED) != 0u);
    s.geometric = facing * plane_normal(t.v1 - t.v0, t.v2 - t.v0);
    s.normal = s.geometric;
    s.uv = vec2<f32>(0.0);
    s.color = vec4<f32>(1.0);
    if (t.corner != NONE) {
        let numbers = vec3<u32>(corners[t.corner], corners[t.corner + 1u], corners[t.corner + 2u]);
        let a = attributes[numbers.x];
        let b = attributes[numbers.y];
        let c = attributes[numbers.z];
        let w = 1.0 - u - v;
        s.uv = w * vec2<f32>(a.u, a.v) + u * vec2<f32>(b.u, b.v) + v * vec2<f32>(c.u, c.v);
        var flips = false;
        if ((t.material & TRIANGLE_SMOOTH) != 0u) {
            let normal = shading_normal(a.normal, b.normal, c.normal, vec3<f32>(w, u, v), t.instance, s.geometric);
            flips = dot(normal, s.geometric) < 0.0;
            s.normal = select(normal, -normal, flips);
        }
        if ((HAS_VERTEX_COLORS || HAS_NORMAL_MAPS) && (t.material & TRIANGLE_DETAILED) != 0u) {
            add_details(&s, numbers, vec3<f32>(w, u, v), t.instance, facing);
        }
        if (HAS_NORMAL_MAPS && flips) {
            // A normal map turns the normal of the mesh. Where this normal is flipped, the turn must be flipped too.
            s.tangent = -s.tangent;
        }
    }
    return s;
}

// Adds the vertex colour and the tangent that `details` holds for the three corners. `facing` is -1 in mirrored instances.
fn add_details(s: ptr<function, Surface>, numbers: vec3<u32>, weights: vec3<f32>, instance: u32, facing: f32) {
    let a = details[numbers.x];
    let b = details[numbers.y];
    let c = details[numbers.z];
    if (HAS_VERTEX_COLORS) {
        (*s).color = weights.x * unpack_color(a) + weights.y * unpack_color(b) + weights.z * unpack_color(c);
    }
    if (HAS_NORMAL_MAPS) {
        let local = weights.x * decode_octahedral(a.tangent) + weights.y * decode_octahedral(b.tangent)
            + weights.z * decode_octahedral(c.tangent);
        // Tangents need the matrix of the instance. Up to a positive factor, it is the matrix of cofactors of the matrix for
        // normals, or minus that matrix in mirrored instances.
        let n = load_instance(instance);
        let world = cross(n.y, n.z) * local.x + cross(n.z, n.x) * local.y + cross(n.x, n.y) * local.z;
        let side = select(facing, -facing, (a.tangent & TANGENT_MIRRORED) != 0u);
        (*s).tangent = vec4<f32>(facing * world, side);
    }
}

fn unpack_color(d: VertexDetails) -> vec4<f32> {
    return vec4<f32>(unpack2x16unorm(d.red_green), unpack2x16unorm(d.blue_alpha));
}

// Unit normal of the plane of the edges a and b, which may have any length. If they span no plane: a unit vector
// perpendicular to the longer edge.
fn plane_normal(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    let size = max(max_component(abs(a)), max_component(abs(b)));
    let n = cross(a / size, b / size);
    let length2 = dot(n, n);
    if (length2 > 1e-30) {
        return n * inverseSqrt(length2);
    }
    return frame_around(normalize(select(b, a, dot(a, a) > dot(b, b)) / size))[0];
}

// Unit normal in world space, interpolated between the corners; on either side of the surface. It is `geometric` if the corner
// normals cancel.
fn shading_normal(a: u32, b: u32, c: u32, weights: vec3<f32>, instance: u32, geometric: vec3<f32>) -> vec3<f32> {
    let local = weights.x * decode_octahedral(a) + weights.y * decode_octahedral(b) + weights.z * decode_octahedral(c);
    let m = load_instance(instance);
    let world = m.x * local.x + m.y * local.y + m.z * local.z;
    let length2 = dot(world, world);
    if (!(length2 > 1e-12)) {
        return geometric;
    }
    return world * inverseSqrt(length2);
}

// Linear base colour (xyz) and alpha (w) at the point.
fn base_color(s: Surface) -> vec4<f32> {
    let m = load_material(s.material);
    var factor = vec4<f32>(m.base_color, m.opacity);
    if (HAS_VERTEX_COLORS) {
        factor *= s.color;
    }
    if (!HAS_TEXTURES) {
        return factor;
    }
    return factor * sample_texture(m.base_texture, s.uv);
}

// The properties of the material at the point, as a vertex stores them (see PathVertex.point_words).
fn point_words(s: Surface) -> vec3<u32> {
    let base = base_color(s).xyz;
    let m = load_material(s.material);
    if (!varies(m)) {
        return bitcast<vec3<u32>>(base);
    }
    let factors = sample_encoded(m.surface_texture, s.uv, ENCODING_DATA);
    return pack_point(PointProperties(base, m.metallic * factors.z, m.alpha * square(factors.y), coat_factors(m, s.uv),
        transmission_factor(m, s.uv)));
}

// The texels that multiply the properties of the dielectric coat and of the clear coat.
fn coat_factors(m: Material, uv: vec2<f32>) -> CoatFactors {
    if (!HAS_COAT_TEXTURES) {
        return WHITE_COATS;
    }
    return CoatFactors(sample_texture(m.specular_color_texture, uv).xyz,
        sample_encoded(m.specular_texture, uv, ENCODING_DATA).w,
        sample_encoded(m.clearcoat_texture, uv, ENCODING_DATA).x,
        sample_encoded(m.clearcoat_roughness_texture, uv, ENCODING_DATA).y);
}

// The texel that multiplies the transmission.
fn transmission_factor(m: Material, uv: vec2<f32>) -> f32 {
    if (!HAS_TRANSMISSION_TEXTURES) {
        return 1.0;
    }
    return sample_encoded(m.transmission_texture, uv, ENCODING_DATA).x;
}

// Minimum cosine between a normal of a normal map and the geometric normal: the map tilts a normal by up to 84 degrees.
const MIN_BUMP_COSINE: f32 = 0.1;

// The unit shading normal with the normal map, on the side of `geometric`. It is `normal`, bit by bit, where the map is flat.
fn bumped_normal(s: Surface) -> vec3<f32> {
    if (!HAS_NORMAL_MAPS) {
        return s.normal;
    }
    let m = load_material(s.material);
    if (m.normal_texture == NONE) {
        return s.normal;
    }
    let texel = sample_encoded(m.normal_texture, s.uv, ENCODING_NORMAL);
    let slope = m.normal_scale * texel.xy;
    let along = s.tangent.xyz - s.normal * dot(s.normal, s.tangent.xyz);
    let length2 = dot(along, along);
    if (all(slope == vec2<f32>(0.0)) || !(length2 > 1e-20 * dot(s.tangent.xyz, s.tangent.xyz))) {
        return s.normal;
    }
    let tangent = along * inverseSqrt(length2);
    let bitangent = s.tangent.w * cross(s.normal, tangent);
    let n = normalize(slope.x * tangent + slope.y * bitangent + max(texel.z, 1e-3) * s.normal);
    let height = dot(n, s.geometric);
    if (height >= MIN_BUMP_COSINE) {
        return n;
    }
    let across = n - height * s.geometric;
    let across2 = dot(across, across);
    if (across2 < 1e-12) {
        return s.geometric;
    }
    let sine = sqrt(1.0 - MIN_BUMP_COSINE * MIN_BUMP_COSINE);
    return MIN_BUMP_COSINE * s.geometric + sine * inverseSqrt(across2) * across;
}

// Radiance, W / (m^2 sr), that the surface emits from its front, and from its back if it is double-sided.
fn emission(s: Surface) -> vec3<f32> {
    let m = load_material(s.material);
    if (!HAS_TEXTURES || m.emission_texture == NONE) {
        return m.emission;
    }
    return m.emission * sample_texture(m.emission_texture, s.uv).xyz;
}

// Probability that a ray hits the surface at this point and does not pass (alphaMode MASK and BLEND). Opaque materials: 1.
fn coverage(s: Surface) -> f32 {
    let m = load_material(s.material);
    if ((m.flags & (MATERIAL_MASK | MATERIAL_BLEND)) == 0u) {
        return 1.0;
    }
    let alpha = base_color(s).w;
    return select(alpha, select(0.0, 1.0, alpha >= m.alpha_cutoff), (m.flags & MATERIAL_MASK) != 0u);
}

// Origin of a ray that leaves `position` along `direction`: moved by `offset` along the normal, to the side of the ray.
fn offset_origin(position: vec3<f32>, geometric: vec3<f32>, offset: f32, direction: vec3<f32>) -> vec3<f32> {
    return position + geometric * select(-offset, offset, dot(geometric, direction) >= 0.0);
}

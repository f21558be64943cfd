// The state that a subpath carries from bounce to bounce, and the record of a vertex that can be connected.
#import frame

// A subpath under way: the ray that is traced next. d_vcm and d_vc are Georgiev's partial MIS sums ("Implementing Vertex
// Connection and Merging", 2012, Sec. 4) with every term squared (power heuristic, beta = 2).
struct PathState {
    // Position of the last vertex, without offset. Travel times are measured from here, not from the origin of the ray.
    position: vec3<f32>,
    // Travel time at the last vertex, as optical path.
    tau: f32,
    // Unit direction of the ray.
    direction: vec3<f32>,
    // Travel time per length along the ray: see `eta_towards`.
    eta: f32,
    // Throughput over density. Sensor: omega_t. Light: phi_j, with the factor 1 / M.
    throughput: vec3<f32>,
    // PATH_ bits.
    flags: u32,
    // Offset from `position` to the origin of the ray.
    shift: vec3<f32>,
    // Light subpaths: probability of selecting the emitter that they started from. Photons: the bits of the triangle that they are aimed
    // at, or of NONE (photon_trace.wgsl). With HAS_DOPPLER see doppler.wgsl and `emitter_probability`.
    select_pdf: f32,
    d_vcm: f32,
    d_vc: f32,
    // Light subpaths: number of the emitter.
    emitter: u32,
    // The triangle that the ray leaves, or NONE.
    triangle: u32,
}

// With HAS_DOPPLER (doppler.wgsl). First the sensor, xyz: its velocity. Then one texel per emitter. xyz: its velocity, if it has no surface.
// w: probability that a light subpath starts from it. Then three texels per instance: its point p has the velocity dot(texel, (p, 1)), one
// component per texel.
@group(0) @binding(20) var velocities: texture_1d<u32>;

const PATH_ALIVE: u32 = 1u;
// The path has made no random choice yet: it follows a beam of zero radius, or the reflection of this beam by mirrors.
const PATH_DETERMINISTIC: u32 = 2u;
// The ray belongs to a bundle of parallel rays, such as those of a sun, the sky or an orthographic camera. The density per
// area of the next vertex does not fall with the distance.
const PATH_PARALLEL: u32 = 4u;
// Light subpaths: the last vertex is deterministic, and shade points connect to it. Or it is on a beam, and beam_events.wgsl also
// draws an event on this segment. In both cases, another kernel draws an event in the gate.
const PATH_LEAVES_CONNECTED: u32 = 8u;
// Light subpaths: from this bit on, the number of vertices that are not deterministic, at most 3.
const PATH_RANDOM_SHIFT: u32 = 4u;
// With MERGES: the last event was smooth, a perfect reflection or refraction. Photons from beams begin with this bit.
const PATH_SMOOTH: u32 = 64u;
// With MERGES, sensor subpaths: all events so far were smooth.
const PATH_ONLY_SMOOTH: u32 = 128u;
// From this bit on: code of the solid around the ray (solid.wgsl).
const PATH_SOLID_SHIFT: u32 = 20u;

// A vertex that can be connected: a light vertex v or a shade point q.
struct PathVertex {
    position: vec3<f32>,
    // v_tau or q_tau: travel time from the emitter, or to the sensor.
    tau: f32,
    // Throughput over density. Light: phi_j, with the factor 1 / M. Sensor: omega_t.
    throughput: vec3<f32>,
    // Index into `materials`; with VERTEX_IN_MEDIUM, into `media`. Vertices with VERTEX_EMITTER keep their EMIT_ profile here.
    material: u32,
    // Unit shading normal, on the side of `geometric`. Light vertices with VERTEX_FOLLOWS_CONNECTED, x: the share for which their splat
    // counts.
    normal: vec3<f32>,
    d_vcm: f32,
    // Unit geometric normal, on the side of `to_previous`.
    geometric: vec3<f32>,
    d_vc: f32,
    // Unit direction to the previous vertex of the subpath. Spots: the axis.
    to_previous: vec3<f32>,
    // VERTEX_ bits. The low byte is the number of segments between the vertex and the start of its subpath.
    flags: u32,
    // Properties of the point, in a form that depends on the vertex. Surface: the bits of the base colour; if other properties of
    // the material vary too, the words of `pack_point`. Spot: the bits of 1 - cosine of the outer (x) and inner (y) half angles.
    // Sun, y: the bits of the density per solid angle of the light subpaths, seen from `position`.
    point_words: vec3<u32>,
    // Travel time per length on the side of `to_previous`.
    eta: f32,
    // See Surface.offset.
    offset: f32,
    // Probability of selecting the emitter; 1 unless the vertex is deterministic. With HAS_ELLIPSOIDS see `previous_distance`, with
    // HAS_DOPPLER see doppler.wgsl.
    select_pdf: f32,
    // Light: number of the emitter. Sensor: number of the path in the tile.
    owner: u32,
    // Deterministic vertices, if only some of them are drawn: start of this vertex's interval in the cumulative distribution,
    // in units of 2^-32. The interval ends where the interval of the next vertex starts. With HAS_ELLIPSOIDS see `auxiliary_sum`, with
    // HAS_DOPPLER see doppler.wgsl.
    selection_cdf: u32,
}

const VERTEX_DEPTH: u32 = 0xffu;
// A point on an emitter (s = 1); its `material` is one of the EMIT_ profiles of emitter.wgsl.
const VERTEX_EMITTER: u32 = 0x100u;
const VERTEX_DETERMINISTIC: u32 = 0x200u;
// The side of `to_previous` is the front of the surface.
const VERTEX_FRONT: u32 = 0x400u;
// Light: from this bit on, the number of vertices that are not deterministic, including this vertex, at most 3.
const VERTEX_RANDOM_SHIFT: u32 = 12u;
// Sensor, with MERGES: the shade point gathers photons.
const VERTEX_MERGES: u32 = 0x1000u;
// The slot holds a vertex.
const VERTEX_VALID: u32 = 0x800u;
// The material lets light through, so light can leave on either side.
const VERTEX_TRANSMITS: u32 = 0x4000u;
// A normal map has turned the shading normal.
const VERTEX_BUMPED: u32 = 0x8000u;
// The vertex is a scattering event in a participating medium. `geometric` and `point_words` have no meaning, and
// `normal` has none but the share that its comment names; it is 0 otherwise.
const VERTEX_IN_MEDIUM: u32 = 0x10000u;
// Light: see `follows_connected`.
const VERTEX_FOLLOWS_CONNECTED: u32 = 0x20000u;
// Sensor: no light vertex may be connected to the shade point itself, only to events on the segment before it.
const VERTEX_SEGMENT_ONLY: u32 = 0x40000u;
// The vertex is on thin glass (sheet.wgsl), so light can leave on either side.
const VERTEX_SHEET: u32 = 0x80000u;
// From this bit on: code of the solid on the side of `to_previous` (solid.wgsl).
const VERTEX_SOLID_SHIFT: u32 = 20u;

// The segment of a sensor subpath before a shade point, for events that are drawn on it (shared/fog.wgsl). On beams, the segment of a
// light subpath.
struct FogSegment {
    // Throughput at the start of the segment.
    throughput: vec3<f32>,
    // Distance from the start to the surface that ends the segment, or 3e38. 0: no event may be drawn.
    limit: f32,
    // Partial MIS sums at the start of the segment.
    d_vcm: f32,
    d_vc: f32,
    // Distance from the start to the shade point; 0 if the ray left the scene.
    length: f32,
    // Code of the solid that the segment runs in (solid.wgsl).
    solid: u32,
}

// Unpacks a vertex from its seven texels.
fn unpack_vertex(texels: array<vec4<u32>, 7>) -> PathVertex {
    let place = bitcast<vec4<f32>>(texels[0]);
    let carried = texels[1];
    let normal = bitcast<vec4<f32>>(texels[2]);
    let geometric = bitcast<vec4<f32>>(texels[3]);
    let previous = texels[4];
    let color = texels[5];
    let rest = texels[6];
    return PathVertex(place.xyz, place.w, bitcast<vec3<f32>>(carried.xyz), carried.w, normal.xyz, normal.w,
        geometric.xyz, geometric.w, bitcast<vec3<f32>>(previous.xyz), previous.w, color.xyz, bitcast<f32>(color.w),
        bitcast<f32>(rest.x), bitcast<f32>(rest.y), rest.z, rest.w);
}

// Number of vertices of the light subpath, up to and including v, that are not deterministic; at most 3.
fn random_vertices(v: PathVertex) -> u32 {
    return (v.flags >> VERTEX_RANDOM_SHIFT) & 3u;
}

// Probability of selecting the emitter of a light subpath.
fn emitter_probability(s: PathState) -> f32 {
    if (HAS_DOPPLER) {
        return bitcast<f32>(textureLoad(velocities, 1u + s.emitter, 0).w);
    }
    return s.select_pdf;
}

// Probability of selecting the emitter of v, see PathVertex; 1 unless v is deterministic.
fn selection_pdf(v: PathVertex) -> f32 {
    if (HAS_DOPPLER) {
        if ((v.flags & VERTEX_DETERMINISTIC) != 0u) {
            return bitcast<f32>(textureLoad(velocities, 1u + v.owner, 0).w);
        }
        return 1.0;
    }
    return select(v.select_pdf, 1.0, HAS_ELLIPSOIDS && (v.flags & VERTEX_DETERMINISTIC) == 0u);
}

// Distance from v, which is neither deterministic nor on an emitter, to the previous vertex of its subpath. With HAS_ELLIPSOIDS, the
// field `select_pdf` holds it.
fn previous_distance(v: PathVertex) -> f32 {
    return v.select_pdf;
}

// MIS sum of the ellipsoidal connections that end at v: their auxiliary vertex is the one before v. Divided, as `d_vcm`, by the squared
// density of the strategy that traces v. With HAS_ELLIPSOIDS, the field `selection_cdf` holds it.
fn auxiliary_sum(v: PathVertex) -> f32 {
    if (!HAS_ELLIPSOIDS || (v.flags & VERTEX_DETERMINISTIC) != 0u) {
        return 0.0;
    }
    return bitcast<f32>(v.selection_cdf);
}

// x squared: a term of the power heuristic (Eq. 27, beta = 2). The result is finite, so that its product with 0 is 0.
fn mis(x: f32) -> f32 {
    let bounded = min(x, 1e15);
    return bounded * bounded;
}

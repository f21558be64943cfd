// What a subpath carries from bounce to bounce, and what a vertex keeps for its connections.
#import frame

// A subpath on its way: the ray to trace next. d_vcm and d_vc are Georgiev's partial MIS sums ("Implementing Vertex
// Connection and Merging", 2012, Sec. 4) with every term squared (power heuristic, beta = 2).
struct PathState {
    // The last vertex, exactly: travel times are measured from here, never along the shifted ray.
    position: vec3<f32>,
    // Travel time at the last vertex, as optical path.
    tau: f32,
    direction: vec3<f32>,
    // Refractive index of the medium the ray travels in.
    eta: f32,
    // Sensor: omega; light: phi. Throughput over density, 1/M included.
    throughput: vec3<f32>,
    // PATH_ bits.
    flags: u32,
    // From `position` to the origin of the ray.
    shift: vec3<f32>,
    // Light subpaths: probability of the emitter they started from.
    select_pdf: f32,
    d_vcm: f32,
    d_vc: f32,
    // Light subpaths: number of the emitter.
    emitter: u32,
    // The triangle that the ray leaves, NONE if it leaves none.
    triangle: u32,
}

const PATH_ALIVE: u32 = 1u;
// Nothing random has happened yet: a beam of zero radius, and mirrors behind it.
const PATH_DETERMINISTIC: u32 = 2u;
// Light: number of its vertices that are not deterministic, at most 3, from this bit on.
const PATH_RANDOM_SHIFT: u32 = 4u;

// A vertex that can be connected: a light vertex v or a shade point q.
struct PathVertex {
    position: vec3<f32>,
    // v_tau or q_tau: travel time from the emitter, or to the sensor.
    tau: f32,
    // Light: phi = throughput / density, 1/M included. Sensor: omega.
    throughput: vec3<f32>,
    // Index into `materials`; VERTEX_EMITTER vertices keep their emission profile here.
    material: u32,
    // Shading normal, on the side of `geometric`.
    normal: vec3<f32>,
    d_vcm: f32,
    // Geometric normal on the side of `to_previous`.
    geometric: vec3<f32>,
    d_vc: f32,
    // Unit direction to the previous vertex of its subpath. Spots: the axis.
    to_previous: vec3<f32>,
    // VERTEX_ bits, and the number of segments behind the vertex in the low byte.
    flags: u32,
    // Base colour at the point. Spots: 1 - cosine of the outer and inner half angles.
    base_color: vec3<f32>,
    // Refractive index of the medium on the side of `to_previous`.
    eta: f32,
    // See Surface.offset.
    offset: f32,
    // Probability of the emitter; 1 unless the vertex is deterministic.
    select_pdf: f32,
    // Light: number of the emitter. Sensor: number of the path in the tile.
    owner: u32,
    // Deterministic vertices of which some are drawn: where the interval of this vertex in the cumulative distribution begins, in
    // units of 2^-32. The interval ends where that of the next vertex begins.
    selection_cdf: u32,
}

const VERTEX_DEPTH: u32 = 0xffu;
// A point on an emitter (s = 1); its `material` is one of the EMIT_ profiles of emitter.wgsl.
const VERTEX_EMITTER: u32 = 0x100u;
const VERTEX_DETERMINISTIC: u32 = 0x200u;
// The side of `to_previous` is the front of the surface.
const VERTEX_FRONT: u32 = 0x400u;
// Light: as PATH_RANDOM_SHIFT, with this vertex.
const VERTEX_RANDOM_SHIFT: u32 = 12u;
// The slot holds a vertex.
const VERTEX_VALID: u32 = 0x800u;
// The material lets light through: there is something on either side.
const VERTEX_TRANSMITS: u32 = 0x4000u;

// A vertex from its seven texels.
fn unpack_vertex(texels: array<vec4<u32>, 7>) -> PathVertex {
    let place = bitcast<vec4<f32>>(texels[0]);
    let carried = texels[1];
    let normal = bitcast<vec4<f32>>(texels[2]);
    let geometric = bitcast<vec4<f32>>(texels[3]);
    let previous = texels[4];
    let color = bitcast<vec4<f32>>(texels[5]);
    let rest = texels[6];
    return PathVertex(place.xyz, place.w, bitcast<vec3<f32>>(carried.xyz), carried.w, normal.xyz, normal.w,
        geometric.xyz, geometric.w, bitcast<vec3<f32>>(previous.xyz), previous.w, color.xyz, color.w,
        bitcast<f32>(rest.x), bitcast<f32>(rest.y), rest.z, rest.w);
}

// Vertices of the light subpath up to v that are not deterministic, at most 3.
fn random_vertices(v: PathVertex) -> u32 {
    return (v.flags >> VERTEX_RANDOM_SHIFT) & 3u;
}

// Power heuristic (Eq. 27, beta = 2). Finite, so that a weight that is 0 makes 0 of it.
fn mis(x: f32) -> f32 {
    let bounded = min(x, 1e15);
    return bounded * bounded;
}

// Photons: the light of paths that no strategy forms, merged with sensor subpaths. Write S for a smooth event (a perfect reflection or
// refraction), D for any other, lamps without a surface and the camera included. A connection needs two neighbours of kind D. The path
// lamp, S, D, S, camera has none. A sensor subpath therefore gathers photons around its first D (vertex merging: Hachisuka et al.
// 2012, Georgiev et al. 2012). The radius falls over the iterations, so the bias does, too.
#import shade_point
#import vertex
#import gate
#import segment
#import camera

// Light that has arrived at a surface, or at an event in a medium, over a path which no connection could continue.
struct Photon {
    position: vec3<f32>,
    // Travel time from the lamp.
    tau: f32,
    // Unit direction in which the light travels.
    direction: vec3<f32>,
    // Travel time per length along `direction`.
    eta: f32,
    // Flux, divided by the number of photons. In a medium: times the length per volume that this flux travels.
    power: vec3<f32>,
    // VERTEX_DEPTH: number of segments from the lamp. VERTEX_IN_MEDIUM.
    flags: u32,
    // Unit geometric normal, on the side from which the light arrives. In a medium: its number in x.
    normal: vec3<f32>,
    // See photon_level.
    level: i32,
}

// Four texels per photon.
@group(1) @binding(4) var photons: texture_1d<u32>;
// Start of each list of photons, and the end of the last one.
@group(1) @binding(5) var<storage, read> photon_lists: array<u32>;

// Smallest cosine between the normals of a photon and of the surface that gathers it, and largest distance of the photon from its
// plane, over the radius. So corners and neighbouring surfaces do not exchange light.
const SAME_SURFACE_COSINE: f32 = 0.7;
const SAME_SURFACE_HEIGHT: f32 = 0.5;
// Largest error of a travel time, over the width of the gate; with several responses, over their mean width. The error comes from the
// curvature of the wavefront.
const GATE_SHARE: f32 = 0.1;
// The radius in media, over the radius on surfaces: fewer photons are near a point of a volume, and their light changes slowly with it.
const MEDIUM_FACTOR: f32 = 4.0;

fn load_photon(index: u32) -> Photon {
    let first = 4u * index;
    let place = bitcast<vec4<f32>>(textureLoad(photons, first, 0));
    let way = bitcast<vec4<f32>>(textureLoad(photons, first + 1u, 0));
    let carried = textureLoad(photons, first + 2u, 0);
    let normal = bitcast<vec4<f32>>(textureLoad(photons, first + 3u, 0));
    return Photon(place.xyz, place.w, way.xyz, way.w, bitcast<vec3<f32>>(carried.xyz), carried.w, normal.xyz, bitcast<i32>(normal.w));
}

// The level of the cells that suit a radius: their side is 2^(level + 1), which is more than the radius and at most twice as long. Photons
// far from the sensor are in larger cells, because points there gather over a larger radius.
fn photon_level(radius: f32) -> i32 {
    return max(i32(bitcast<u32>(radius) >> 23u) - 127, frame.lowest_photon_level);
}

// The cell of a point. The host computes the same (render/photons/map.rs).
fn photon_cell(position: vec3<f32>, level: i32) -> vec3<i32> {
    return vec3<i32>(floor(position * bitcast<f32>(u32(126 - level) << 23u)));
}

// The list that holds the photons of a cell, among those of other cells (Teschner et al. 2003).
fn photon_list(cell: vec3<i32>, level: i32) -> u32 {
    let c = vec3<u32>(cell);
    return ((c.x * 73856093u) ^ (c.y * 19349663u) ^ (c.z * 83492791u) ^ (u32(level) * 2654435769u)) & frame.photon_list_mask;
}

// The radius over the length of the sensor subpath.
fn radius_per_length(in_medium: bool) -> f32 {
    return frame.merge_radius * select(1.0, MEDIUM_FACTOR, in_medium);
}

// The radius within which the shade point q of a pixel gathers photons. It depends on the sensor subpath alone. It is at most twice as
// long as if the subpath went straight to q, and at most half of this way.
fn merge_radius(q: PathVertex, pixel: vec2<u32>) -> f32 {
    var length = select(q.tau / SURROUNDING_GROUP_INDEX, 1.0, HAS_ORTHOGRAPHIC);
    if (HAS_AIMS) {
        // The travel time begins at minus this length.
        length += load_aim(pixel).w;
    }
    let rate = radius_per_length(is_in_medium(q));
    var radius = rate * length;
    if (!HAS_ORTHOGRAPHIC) {
        radius = min(radius, min(2.0 * rate, 0.5) * distance(q.position, frame.sensor));
    }
    if (frame.gate_hi < 3e38) {
        // Along a spherical wavefront of this age, the time of arrival bends by eta r^2 / (2 age).
        let age = max(frame.gate_hi - q.tau, 0.0);
        radius = min(radius, sqrt(2.0 * GATE_SHARE * frame.merge_slot * age / q.eta));
    }
    return radius;
}

// The first and the last level of the photons within `radius` of q. There are none if the last one is below the first one.
fn photon_levels(q: PathVertex, radius: f32) -> vec2<i32> {
    let way = distance(q.position, frame.sensor);
    let nearest = select((way - radius) * (1.0 - 1e-5), 1.0, HAS_ORTHOGRAPHIC);
    let farthest = select((way + radius) * (1.0 + 1e-5), 1.0, HAS_ORTHOGRAPHIC);
    let rate = radius_per_length(is_in_medium(q));
    return vec2<i32>(photon_level(rate * nearest), min(photon_level(rate * farthest), frame.highest_photon_level));
}

// The area of the surface, or the volume of the medium, over which photons within `radius` of q are spread.
fn gathered_measure(q: PathVertex, radius: f32) -> f32 {
    return PI * radius * radius * select(1.0, radius * (4.0 / 3.0), is_in_medium(q));
}

// Whether p is within `radius` of q, and on the same surface or in the same medium.
fn is_near(q: PathVertex, p: Photon, radius: f32) -> bool {
    let offset = q.position - p.position;
    if (dot(offset, offset) >= radius * radius || is_in_medium(q) != ((p.flags & VERTEX_IN_MEDIUM) != 0u)) {
        return false;
    }
    if (is_in_medium(q)) {
        return u32(p.normal.x) == q.material;
    }
    return abs(dot(p.normal, q.geometric)) >= SAME_SURFACE_COSINE && abs(dot(offset, q.geometric)) <= SAME_SURFACE_HEIGHT * radius;
}

// xyz: light of photon `p` that q scatters towards the sensor, relative to the throughput of q and times the `gathered_measure`.
// 0 if q does not gather p. w: its travel time.
fn gathered(q: PathVertex, p: Photon, radius: f32) -> vec4<f32> {
    if (!is_near(q, p, radius) || (p.flags & VERTEX_DEPTH) + (q.flags & VERTEX_DEPTH) > frame.max_depth) {
        return vec4<f32>(0.0);
    }
    // The time of arrival at q, along the direction of the photon.
    let w = -p.direction;
    let tau = travel_time(p.tau, p.eta * dot(p.direction, q.position - p.position), q.tau);
    let in_gate = gate_weight(tau);
    if (in_gate == 0.0 || !faces(q, w)) {
        return vec4<f32>(0.0);
    }
    let cosine = select(max(abs(dot(q.geometric, w)), 1e-4), 1.0, is_in_medium(q));
    return vec4<f32>(p.power * evaluate_shade_point(q, w).value * (in_gate / cosine), tau);
}

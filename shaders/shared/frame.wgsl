// Constants of one iteration. Positions are in render space (`render/space.rs`), whose origin is at or near the sensor. Lengths and
// travel times (optical path, c = 1) are in the unit of render space, a power of two in metres. Areas and fluxes follow that unit;
// radiance does not depend on it.

struct Frame {
    // Camera axes in world space, unit length; the camera looks along `forward`.
    right: vec3<f32>,
    width: u32,
    up: vec3<f32>,
    height: u32,
    forward: vec3<f32>,
    seed: u32,
    // Half extents of the image plane at distance 1 from a pinhole, or of the sensor plane of an orthographic camera. If HAS_AIMS:
    // half extents of a pixel at distance 1.
    extent: vec2<f32>,
    // Area of a pixel on that plane.
    pixel_area: f32,
    // Sample count of the t = 1 strategies in the MIS weights: the number of light subpaths in the iteration, stored or not, over
    // the average number of samples per pixel, times the estimator's weight for t = 1.
    splat_sample_count: f32,
    // The gate [gate_lo, gate_hi) of optical path. gate_hi is 3e38 for an open gate. With HAS_DELAYS, gate_lo is earlier than the
    // start of the gate by the maximum delay on one segment, on two with ellipsoidal connections: light may still be delayed where this
    // bound is used.
    gate_lo: f32,
    gate_hi: f32,
    // A subpath stops once its whole path is known to take at least this time, and so to miss the gate. 3e38 switches this off.
    cull_hi: f32,
    // Rounding allowance of a travel time. Bounds are widened by it, so that rounding never prunes a valid vertex.
    rounding_allowance: f32,
    // Bounding box of all emitters.
    emitter_lo: vec3<f32>,
    iteration: u32,
    emitter_hi: vec3<f32>,
    // Stored light subpaths per iteration (M).
    light_paths: u32,
    // Maximum number of segments of a path.
    max_depth: u32,
    // Queries per shade point and tree (K).
    queries: u32,
    // Number of deterministic vertices (punctual lights, spots of thin beams), which come first in the pool.
    deterministic_count: u32,
    emitter_count: u32,
    // Roots of the 3D and the 4D tree: the index of a node, a leaf reference, or NONE.
    tree3_root: u32,
    tree4_root: u32,
    // Factors of the strategies s = 0, t = 1 and s >= 2 in the MIS sums. A factor is 0 if the strategy is switched off.
    // Otherwise it is 1 for s >= 2, and 1 / query_sample_count^2 for s = 0 and t = 1, because no query serves these two.
    keep_s0: f32,
    keep_t1: f32,
    keep_s2: f32,
    // The crop, in pixels of the whole film.
    crop_x: u32,
    crop_y: u32,
    crop_width: u32,
    crop_height: u32,
    // Number of the first sample of every pixel in this iteration. Numbers count over the whole render, so no pixel uses one twice.
    first_sample: u32,
    // Number of vertices on emitters that come right after the deterministic vertices. With pt, these are the emitter points. With
    // trees, these are the vertices of the 3D tree. 0 for other orders of the pool.
    emitter_vertex_count: u32,
    // Candidate slots per shade point.
    slots: u32,
    // Position of the camera: the pinhole, or the point where the axis meets the sensor plane.
    sensor: vec3<f32>,
    // Number of samples that a vertex chosen by a query counts for in the MIS weights (g in `weights.wgsl`).
    query_sample_count: f32,
    // Stored light subpaths over all light subpaths. Throughputs are normalised for the stored subpaths alone, so the splats
    // of all subpaths are multiplied by this share.
    splat_share: f32,
    // Number of media that fill boxes, grids or all space; where they overlap, the last one counts. Media inside of meshes follow in
    // `media`.
    media_count: u32,
    // From the centre of the film to the principal point, the point where the camera axis meets the film. In pixels, y down.
    principal_offset: vec2<f32>,
    // Travel times [gap_lo, gap_hi) inside the gate that count for no response, if HAS_GAP.
    gap_lo: f32,
    gap_hi: f32,
    // Ellipsoidal connections form only paths whose detour over the auxiliary vertex is at least this long. 3e38 if the gate is open.
    min_detour: f32,
    // Factor of the density of auxiliary vertices in MIS weights: group index / (gate width * MEAN_ARC), times the number of samples
    // that an ellipsoidal connection counts for (auxiliary.wgsl).
    auxiliary_density: f32,
    // Number of light vertices in the pool; 0 if the estimator builds no trees.
    vertex_count: u32,
    // Material of the glass around the camera, an index into `materials`; NONE outside of glass.
    sensor_solid: u32,
    // The start of the gate, if HAS_DELAYS.
    undelayed_lo: f32,
    // The radius within which a shade point gathers photons, over the length of the sensor subpath; with an orthographic camera, the
    // radius itself (shared/photon.wgsl).
    merge_radius: f32,
    // Photons are sorted into cubic cells. The number of lists of photons less 1, and the lowest and highest level of their cells. Without
    // photons, the lowest level is above the highest one. Cells share lists.
    photon_list_mask: u32,
    lowest_photon_level: i32,
    highest_photon_level: i32,
    // Width of the gate; with several responses, on average per response.
    merge_slot: f32,
    // With HAS_DISTORTION k1, k2, k3, k4 and k5, k6, p1, p2 of OpenCV; with HAS_FISHEYE its k1 to k4 (lens.wgsl).
    lens_radial: vec4<f32>,
    lens_rest: vec4<f32>,
    // The largest tangent of the angle to the view that the lens images; with HAS_FISHEYE the largest angle.
    lens_limit: f32,
    // With HAS_APERTURE: radius of the aperture, 1 over the distance in focus (0 at infinity), and number of blades (0: a disc).
    lens_radius: f32,
    inverse_focus: f32,
    blades: u32,
    // With HAS_VIGNETTING_TABLE: angles in radians to the view and shares of the light, two of each per vector, ascending by angle.
    vignetting: array<vec4<f32>, 16>,
}

// Parameters of one dispatch.
struct Dispatch {
    // Light subpaths and photons: number of the batch's first path within the iteration. First surfaces: number of the first pixel.
    // Ellipsoids of epc: index of the first part of the BVH. Sensor subpaths: number of entries that the host has already read of those
    // in `observed` (observed.wgsl), or NONE. `add_arrivals`: index in the film of the first pixel of the crop.
    first: u32,
    // Number of threads that have work, where the host knows this number. Ellipsoids of epc: number of parts of the BVH.
    count: u32,
    bounce: u32,
    // Index into `counters` of the length of the kernel's input list. `add_responses`: 0 if there are no squares.
    counter: u32,
    // Compaction: indices into `counters` of the lengths of the two output lists. `list_b` is NONE if there is one output
    // list, which then holds the numbers of the entries themselves. Images of responses: `list_a` is the number of responses.
    list_a: u32,
    list_b: u32,
    // First entry of the input list that this dispatch processes. `resolve`: number of pixels of the tile. `add_arrivals`: number of
    // entries per element of the list. `add_responses`: samples per pixel.
    rank: u32,
    // Light subpaths: NONE if each path samples its emitter. Otherwise the host fixes the emitters: the first path starts
    // from this one, each further path from the next one, and the paths yield their deterministic vertices only.
    emitter: u32,
}

// counters[COUNTER_TOTALS + i] is the sum of the lengths that list i has had since the host last wrote the counters.
const COUNTER_TOTALS: u32 = 8u;
// counters[COUNTER_TALLIES + i], i < 4, is the sum over the paths of a tile of component i of their tallies (gather.wgsl).
const COUNTER_TALLIES: u32 = 12u;

@group(0) @binding(0) var<storage, read> frame: Frame;
var<immediate> dispatch: Dispatch;

// Threads per workgroup. The image does not depend on it.
override WORKGROUP: u32 = 64u;
// Data that the kernels report to the host for each contribution, in addition to the image: nothing (0), the travel time, the
// strategy and MIS weight, or the pixel and travel time for the responses of the sensor.
override OBSERVE: u32 = 0u;
const OBSERVE_TIMES: u32 = 1u;
const OBSERVE_STRATEGIES: u32 = 2u;
const OBSERVE_RESPONSES: u32 = 3u;
// Switches that remove code for features that the scene does not contain.
override HAS_TEXTURES: bool = true;
// Properties other than the base colour vary over a surface.
override HAS_SURFACE_TEXTURES: bool = true;
// The dielectric coat or the clear coat vary over a surface.
override HAS_COAT_TEXTURES: bool = true;
override HAS_TEXTURE_TRANSFORMS: bool = true;
override HAS_NORMAL_MAPS: bool = true;
override HAS_VERTEX_COLORS: bool = true;
override HAS_ALPHA: bool = true;
override HAS_GLOSSY: bool = true;
override HAS_TRANSMISSION: bool = true;
// The transmission varies over a surface.
override HAS_TRANSMISSION_TEXTURES: bool = true;
// Whether subpaths may start with parallel rays (PATH_PARALLEL).
override HAS_PARALLEL: bool = true;
// Whether paths count how fast they get longer (doppler.wgsl). Not with HAS_ELLIPSOIDS or MERGES. Whether the image records this rate, and by
// what multiple of it a path seems longer to an FMCW sensor.
override HAS_DOPPLER: bool = false;
override RECORDS_DOPPLER: bool = false;
override RANGE_COUPLING: f32 = 0.0;
// Whether the scene has a sky (sky.wgsl).
override HAS_SKY: bool = true;
// Whether the scene has participating media.
override HAS_MEDIA: bool = true;
// Index of refraction and group index outside of transmitting solids. The travel time there is the group index times the length.
override SURROUNDING_IOR: f32 = 1.0;
override SURROUNDING_GROUP_INDEX: f32 = 1.0;
// Whether paths carry the code of the solid that they are in, because its medium may differ from the surroundings (solid.wgsl).
override HAS_INTERIORS: bool = true;
// Whether meshes bound media without bending light (boundary.wgsl).
override HAS_NULL_BOUNDARIES: bool = true;
// Whether shade points gather photons (merge.wgsl). Subpaths then note which of their events are smooth.
override MERGES: bool = false;
// Whether solids have a group index other than their index of refraction.
override HAS_GROUP_INDICES: bool = false;
// Whether the scene has thin glass (sheet.wgsl), and whether this glass delays light.
override HAS_SHEETS: bool = false;
override HAS_DELAYS: bool = false;
// Whether camera rays split at clear thin glass (sheet.wgsl).
override SPLITS_AT_SHEETS: bool = false;
// Whether a medium has a density grid (grid.wgsl).
override HAS_GRIDS: bool = true;
// Whether the events in a medium that are connected to deterministic vertices are drawn inside the gate (shared/fog.wgsl).
override DRAWS_IN_GATE: bool = true;
// Whether events on the lines of beams are also drawn inside the gate, for connections to the sensor (beam_events.wgsl). Needs
// DRAWS_IN_GATE.
override DRAWS_ON_BEAMS: bool = true;
// Whether the estimator forms ellipsoidal connections (ellipsoidal_connection.wgsl). Vertices then also store data for their MIS weights.
override HAS_ELLIPSOIDS: bool = false;
// Whether each shade point gets one of several ellipsoidal connections (ellipsoid_resample.wgsl). Otherwise each candidate may be one.
override RESAMPLES_ELLIPSOIDS: bool = false;
override HAS_SPECULAR_COLORS: bool = true;
override HAS_CLEARCOAT: bool = true;
override HAS_RETROREFLECTORS: bool = true;
// Whether the camera is orthographic. Its sensor is a plane, and its rays are parallel (PATH_PARALLEL).
override HAS_ORTHOGRAPHIC: bool = false;
// Whether a lens moves the points of the image: by the rational model of OpenCV, or as a fisheye (lens.wgsl). At most one is true.
override HAS_DISTORTION: bool = false;
override HAS_FISHEYE: bool = false;
// Whether the lens has an aperture, so that only points at one distance are in focus. Not with HAS_FISHEYE.
override HAS_APERTURE: bool = false;
// Whether pixels far from the axis get less light (vignetting.wgsl): by the fourth power of the cosine, or as a table says. At most one is
// true.
override HAS_COS4: bool = false;
override HAS_VIGNETTING_TABLE: bool = false;
// Whether each pixel looks at a point of its own (`aims` in camera.wgsl).
override HAS_AIMS: bool = false;
// Whether each pixel also has a laser of its own, as the beams of a LiDAR have. The only light is a spot at the sensor, and its axis is
// the direction of the pixel. Paths have at most two segments.
override HAS_OWN_LASERS: bool = false;
// With HAS_OWN_LASERS: tangent of half of the lasers' divergence.
override LASER_RADIUS: f32 = 0.0;
// Whether two responses lie so far apart that the travel times between them are left out (gate.wgsl).
override HAS_GAP: bool = false;
// Whether loops exit at their top. Some drivers lose the results of the last iteration of a loop that exits at
// its end (src/gpu/quirks.rs).
override EXIT_AT_TOP: bool = false;

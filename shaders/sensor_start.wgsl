// Starts the sensor subpaths of a tile: samples a point in the pixel, and computes the camera ray through this point.
#import doppler
#import weights
#import sobol
#import samples
#import vignetting

@group(2) @binding(0) var<storage, read_write> states: array<PathState>;
@group(2) @binding(1) var<storage, read_write> radiance: array<vec4<f32>>;
@group(2) @binding(2) var<storage, read_write> list: array<u32>;
@group(2) @binding(3) var<storage, read_write> tallies: array<vec4<u32>>;

// One thread starts one sample of one pixel.
@compute @workgroup_size(WORKGROUP)
fn sensor_start(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if (slot >= dispatch.count) {
        return;
    }
    let sensor = sensor_sample(slot);
    let u = stratified2(sensor.index, frame.iteration, sensor.number, PAIR_PIXEL, sensor.seed);
    var ray = camera_ray(sensor.pixel, u);
    let chief = ray.direction;
    var lens_length = 0.0;
    if (HAS_APERTURE) {
        let at = aperture_point(stratified2(sensor.index, frame.iteration, sensor.number, PAIR_APERTURE, sensor.seed));
        let to = to_lens(chief);
        ray = CameraRay(ray.origin + from_lens(vec3<f32>(at, 0.0)), from_lens(focused_ray(to, at)));
        lens_length = lens_path(to, at);
    }
    let length2 = dot(ray.direction, ray.direction);
    let direction = ray.direction * inverseSqrt(length2);

    var s: PathState;
    s.position = ray.origin;
    s.tau = 0.0;
    if (HAS_APERTURE) {
        s.tau = SURROUNDING_GROUP_INDEX * lens_length;
    }
    // A scanning sensor shortens the travel times of each pixel by a length of its own (`aims` in camera.wgsl).
    if (HAS_AIMS && !HAS_OWN_LASERS) {
        s.tau = -SURROUNDING_GROUP_INDEX * load_aim(sensor.pixel).w;
    }
    s.direction = direction;
    s.eta = eta_around(frame.sensor_solid);
    s.throughput = vec3<f32>(select(1.0, lit_share(), has_narrow_laser()));
    if (has_vignetting()) {
        s.throughput *= vignetting(to_lens(chief));
    }
    if (SPLITS_AT_SHEETS) {
        // The mean over all samples of the pixel is the sum of the means over both kinds of samples.
        let count = samples_of_pixel(slot);
        let passing = passing_samples(count);
        s.throughput *= f32(count) / f32(select(passing, count - passing, sensor.stops));
    }
    s.flags = with_solid(PATH_ALIVE | select(0u, PATH_PARALLEL, HAS_ORTHOGRAPHIC), solid_around(frame.sensor_solid));
    if (MERGES) {
        s.flags |= PATH_ONLY_SMOOTH;
    }
    s.shift = vec3<f32>(0.0);
    s.triangle = NONE;
    if (HAS_DOPPLER) {
        s.select_pdf = -s.eta * dot(direction, sensor_velocity());
    }
    start_sensor_sums(&s, inverseSqrt(length2), chief);
    states[slot] = s;
    radiance[slot] = vec4<f32>(0.0);
    tallies[slot] = vec4<u32>(0u);
    list[slot] = slot;
}

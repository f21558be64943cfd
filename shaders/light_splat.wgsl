// Strategy t = 1: connects every light vertex to the sensor. The gate is tested before the shadow ray is traced.
#import doppler
#import weights
#import segment
#import vignetting

@group(2) @binding(0) var<storage, read> vertices: array<PathVertex>;
@group(2) @binding(1) var<storage, read> list: array<u32>;
// xyz: bits of the radiance of the pixel from this vertex. w: the pixel's index in the crop, or NONE if there is no light. With
// OBSERVE_TIMES, w holds the bits of the travel time. All are integers, because a device may change floats that are denormal or no
// numbers.
@group(2) @binding(2) var<storage, read_write> splats: array<vec4<u32>>;
// With OBSERVE_STRATEGIES, the MIS weights of the splats; `splats` is then not multiplied by them. With OBSERVE_RESPONSES, the
// travel times.
@group(2) @binding(3) var<storage, read_write> splat_details: array<f32>;
@group(2) @binding(4) var<storage, read> counters: array<u32>;

// One thread connects one light vertex that was just reached.
@compute @workgroup_size(WORKGROUP)
fn light_splat(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= counters[dispatch.counter]) {
        return;
    }
    let slot = list[id.x];
    let v = vertices[slot];
    splats[slot] = vec4<u32>(vec3<u32>(0u), NONE);
    var chief = v.position - frame.sensor;
    var at = vec2<f32>(0.0);
    if (HAS_APERTURE) {
        at = aperture_point(random4(STREAM_LIGHT, dispatch.first + slot, frame.iteration, dispatch.bounce, 3u, frame.seed).xy);
        chief = from_lens(chief_ray(to_lens(chief) - vec3<f32>(at, 0.0), at));
    }
    let pixel = pixel_of(chief);
    // If an event is the only vertex between a deterministic vertex and the sensor, only sensor subpaths form the path
    // (shared/fog.wgsl), and `kept` is 0. If it is the only one between a beam and the sensor, beam_events.wgsl draws
    // such events too, and each of the two kinds counts for its share.
    let kept = select(1.0, v.normal.x, follows_connected(v));
    if ((v.flags & VERTEX_VALID) == 0u || pixel == NONE || kept == 0.0) {
        return;
    }
    let to_sensor = segment_to_sensor(v.position, at);
    let d = to_sensor.length;
    let w = to_sensor.direction;
    var sensor_tau = 0.0;
    if (HAS_APERTURE) {
        sensor_tau = SURROUNDING_GROUP_INDEX * lens_path(to_lens(chief), at);
    }
    var tau = travel_time(v.tau, optical_length(v, w, d), sensor_tau);
    let counted = gate_weight_before_delays(tau);
    if (counted == 0.0) {
        return;
    }
    let c = evaluate_light_vertex(v, w);
    let cosine = dot(-w, frame.forward);
    // Turns flux per area into mean radiance of the pixel (box filter). The factor is 1 / (d^2 pixel_area cos^3) for a pinhole.
    // It is 1 / pixel_area for an orthographic camera, because its rays do not spread.
    let density = pixel_pdf(cosine, chief);
    let spread = select(d * d, 1.0, HAS_ORTHOGRAPHIC);
    // The only copy of a deterministic vertex carries the whole power.
    let share = select(frame.splat_share, 1.0, (v.flags & VERTEX_DETERMINISTIC) != 0u);
    let depths = segment_depths(v, w, d);
    var value = v.throughput * c.value * transmitted(depths) * (counted * share * density / spread * kept);
    if (has_vignetting()) {
        value *= vignetting(to_lens(chief));
    }
    // A value that is not a number passes this test, because the host counts such values.
    if (max_component(value) <= 0.0) {
        return;
    }

    // Visibility between the vertex and the sensor.
    let key = random_key(STREAM_ALPHA, dispatch.first + slot, frame.iteration, LIGHT_BIT | dispatch.bounce, 1u, frame.seed);
    if (!is_unoccluded(ray_end(v, w), to_sensor.end, key)) {
        return;
    }
    value *= traced_transmittance(v, w, d);
    if (HAS_DELAYS) {
        tau += traced_delay();
        if (gate_weight(tau) == 0.0) {
            return;
        }
    }
    let reached = select(flight_density(depths.scattering), 1.0, HAS_ORTHOGRAPHIC);
    let weight = splat_weight(v, c, density * c.cosine / spread * reached);
    if (HAS_DOPPLER) {
        let growth = growth_to(v) + eta_towards(v, w) * dot(w, sensor_velocity() - vertex_velocity(v));
        value = recorded(value, growth);
        tau = apparent_time(tau, growth);
    }
    if (OBSERVE == OBSERVE_STRATEGIES) {
        splats[slot] = vec4<u32>(bitcast<vec3<u32>>(value), pixel);
        splat_details[slot] = weight;
        return;
    }
    if (OBSERVE == OBSERVE_RESPONSES) {
        splat_details[slot] = tau;
    }
    splats[slot] = vec4<u32>(bitcast<vec3<u32>>(value * weight), select(pixel, bitcast<u32>(tau), OBSERVE == OBSERVE_TIMES));
}

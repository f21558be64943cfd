// Connects shade points to the light vertices chosen for them: measurement contribution, MIS weight, visibility.
//
// For q = q^(t) and v = v^(s) the contribution is (Eq. 25)
//     w_{s,t} omega_t phi_j f_j(q) / (K P(j | q)),   f_j = f(q) cos f(v) cos V(q, v) / d^2,
// inside the gate. w_{s,t} is the power heuristic (Eq. 27) over all strategies that are kept, by Georgiev's partial sums:
// those that would have traced q from v stand in w_sensor, those that would have traced v from q in w_light.
#import candidate
#import visibility
#import scatter
#import camera
#import gate
#import shade_point
#import tree

// Path of each shade point that was queried, then slots of live candidates.
@group(2) @binding(1) var<storage, read> shade_list: array<u32>;
@group(2) @binding(2) var<storage, read> slot_list: array<u32>;
@group(2) @binding(3) var<storage, read> counters: array<u32>;
@group(2) @binding(4) var<storage, read> candidates: array<Candidate>;
// Contribution of a slot to its pixel; w: travel time, negative where no ray was traced.
@group(2) @binding(5) var<storage, read_write> contributions: array<vec4<f32>>;

// One thread, one candidate.
@compute @workgroup_size(WORKGROUP)
fn connect(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= counters[dispatch.counter]) {
        return;
    }
    let slot = slot_list[id.x];
    let q = load_shade_point(shade_list[slot / frame.slots]);
    let candidate = candidates[slot];
    let v = load_light_vertex(candidate.vertex);

    // Unshadowed contribution.
    let offset = v.position - q.position;
    let d2 = dot(offset, offset);
    let w = offset * inverseSqrt(d2);
    let at_q = connect_shade_point(q, w);
    let at_v = connect_light_vertex(v, -w);
    let weight = mis_weight(q, v, at_q, at_v, d2);
    let value = q.throughput * v.throughput * at_q.value * at_v.value * (candidate.weight * weight / d2);
    if (!(max_component(abs(value)) > 0.0)) {
        // Zero, or not a number: `gather` sorts them out.
        contributions[slot] = vec4<f32>(value, -1.0);
        return;
    }

    // Visibility between the points as the surfaces' rounding leaves them.
    let sensor = sensor_sample(dispatch.first + q.owner);
    let index = sensor.pixel.y * frame.width + sensor.pixel.x;
    let origin = leave(q.position, q.geometric, q.offset, w);
    let target_point = leave(v.position, v.geometric, v.offset, -w);
    let lane = (STREAM_ALPHA << 28u) | (1u << 27u) | (dispatch.bounce << 14u) | (slot % frame.slots);
    let hit = trace(origin, target_point - origin, 1.0, true, vec4<u32>(index, sensor.sample, lane, frame.seed));
    let tau = v.tau + medium_towards(q, w) * sqrt(d2) + q.tau;
    contributions[slot] = vec4<f32>(select(vec3<f32>(0.0), value, hit.triangle == NONE), tau);
}

// Eq. 27 with beta = 2 (Georgiev 2012, Eqs. 38 to 40).
fn mis_weight(q: PathVertex, v: PathVertex, at_q: Connection, at_v: Connection, d2: f32) -> f32 {
    let q_to_v = at_q.pdf * at_v.cosine / d2;
    let v_to_q = at_v.pdf * at_q.cosine / d2;
    let w_light = mis(q_to_v) * (v.d_vcm + v.d_vc * mis(at_v.pdf_reverse));
    let w_sensor = frame.keep_s2 * mis(v_to_q) * (q.d_vcm + q.d_vc * mis(at_q.pdf_reverse));
    return 1.0 / (1.0 + w_light + w_sensor);
}

// Connects shade points to the light vertices chosen for them: measurement contribution, MIS weight, visibility.
//
// For q = q^(t) and v = v^(s) the contribution is (Eq. 25)
//     w_{s,t} omega_t phi_j f_j(q) / (K P(j | q)),   f_j = f(q) cos f(v) cos V(q, v) / d^2,
// inside the gate. w_{s,t} is the power heuristic (Eq. 27) over all strategies that are kept, see `weights.wgsl`.
#import candidate
#import visibility
#import weights
#import gate
#import shade_point
#import tree

// Path of each shade point that was queried, then slots of live candidates.
@group(2) @binding(1) var<storage, read> shade_list: array<u32>;
@group(2) @binding(2) var<storage, read> slot_list: array<u32>;
@group(2) @binding(3) var<storage, read> counters: array<u32>;
@group(2) @binding(4) var<storage, read> candidates: array<Candidate>;
// Contribution of a slot to its pixel; w: travel time, negative where no ray was traced. To show strategies: without its
// MIS weight, which stands in w.
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
    let weight = connection_weight(q, v, at_q, at_v, d2);
    let counted = select(weight, 1.0, OBSERVE == OBSERVE_STRATEGIES);
    let value = q.throughput * v.throughput * at_q.value * at_v.value * (candidate.weight * counted / d2);
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
    let last = select(tau, weight, OBSERVE == OBSERVE_STRATEGIES);
    contributions[slot] = vec4<f32>(select(vec3<f32>(0.0), value, hit.triangle == NONE), last);
}

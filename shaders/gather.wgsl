// Adds the contributions of a shade point to its sensor subpath, slot by slot, so that the order of additions never changes.
#import candidate
#import frame
#import math

@group(2) @binding(0) var<storage, read> shade_list: array<u32>;
@group(2) @binding(1) var<storage, read> counters: array<u32>;
// See SLOTS_PER_MARK.
@group(2) @binding(2) var<storage, read> marks: array<u32>;
@group(2) @binding(3) var<storage, read> contributions: array<vec4<f32>>;
@group(2) @binding(4) var<storage, read_write> radiance: array<vec4<f32>>;
// Counts per path: samples dropped because they are not finite, shadow rays, contributions inside the gate, tried connections. The
// queries count the last ones.
@group(2) @binding(5) var<storage, read_write> tallies: array<vec4<u32>>;

// One thread adds up the contributions of one shade point.
@compute @workgroup_size(WORKGROUP)
fn gather(@builtin(global_invocation_id) id: vec3<u32>) {
    let rank = id.x;
    if (rank >= counters[dispatch.counter]) {
        return;
    }
    var sum = vec3<f32>(0.0);
    var tally = vec4<u32>(0u);
    var candidates = 0u;
    for (var word = 0u; word < mark_words(); word++) {
        let first = rank * frame.slots + word * SLOTS_PER_MARK;
        for (var rest = marks[rank * mark_words() + word]; rest != 0u; rest &= rest - 1u) {
            let c = contributions[first + firstTrailingBit(rest)];
            let finite = is_finite(c.xyz);
            tally.x += select(1u, 0u, finite);
            tally.y += select(0u, 1u, c.w > NOT_TRACED);
            tally.z += select(0u, 1u, finite && max_component(c.xyz) > 0.0);
            sum += select(vec3<f32>(0.0), c.xyz, finite);
            candidates += 1u;
        }
    }
    if (candidates > 0u) {
        let path = shade_list[rank];
        radiance[path] += vec4<f32>(sum, 0.0);
        tallies[path] += tally;
    }
}

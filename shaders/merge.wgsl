// Adds the light of photons around a shade point to its sensor subpath.
#import photon
#import math
#import observed
#import random
#import samples

@group(2) @binding(1) var<storage, read> shade_list: array<u32>;
@group(2) @binding(3) var<storage, read> counters: array<u32>;
@group(2) @binding(4) var<storage, read_write> radiance: array<vec4<f32>>;
// Counts per path: see gather.wgsl.
@group(2) @binding(5) var<storage, read_write> tallies: array<vec4<u32>>;

// With OBSERVE_RESPONSES, each slot reports one of its photons, chosen in proportion to its light, with the light of all of them. The slots
// take turns at intervals of frame.merge_slot, the width of a response, so that photons of different responses seldom share one.
const TIME_SLOTS: u32 = 4u;

// One thread gathers the photons of one shade point.
@compute @workgroup_size(WORKGROUP)
fn merge(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= counters[dispatch.counter]) {
        return;
    }
    let path = shade_list[id.x];
    let q = load_shade_point(path);
    let sensor = sensor_sample(q.owner);
    let radius = select(0.0, merge_radius(q, sensor.pixel), (q.flags & VERTEX_MERGES) != 0u);
    var sum = vec3<f32>(0.0);
    // Light of the chosen photon and its travel time, and the largest components of the light of all photons.
    var chosen: array<vec4<f32>, TIME_SLOTS>;
    var totals: array<f32, TIME_SLOTS>;
    var noise = random_words(STREAM_PHOTON, sensor.index, sensor.sample, dispatch.bounce, 0u, sensor.seed).x;
    if (radius > 0.0) {
        let levels = photon_levels(q, radius);
        for (var level = levels.x; level <= levels.y; level++) {
            let first = photon_cell(q.position - radius, level);
            let size = vec3<u32>(photon_cell(q.position + radius, level) - first + 1);
            for (var k = 0u; k < size.x * size.y * size.z; k++) {
                let cell = first + vec3<i32>(vec3<u32>(k % size.x, k / size.x % size.y, k / (size.x * size.y)));
                let list = photon_list(cell, level);
                let end = photon_lists[list + 1u];
                for (var i = photon_lists[list]; i < end; i++) {
                    let p = load_photon(i);
                    // Cells that share a list must not count each other's photons.
                    if (p.level != level || any(photon_cell(p.position, level) != cell)) {
                        continue;
                    }
                    let light = gathered(q, p, radius);
                    sum += light.xyz;
                    let brightness = max_component(light.xyz);
                    if (MERGED_ENTRIES > 0u && brightness > 0.0) {
                        let slot = time_slot(light.w);
                        totals[slot] += brightness;
                        noise = noise * 747796405u + 2891336453u;
                        if (f32(noise >> 8u) * (1.0 / 16777216.0) * totals[slot] < brightness) {
                            chosen[slot] = light;
                        }
                    }
                }
            }
        }
    }
    let factor = q.throughput / max(gathered_measure(q, radius), 1e-38);
    // Without photons, a radius of almost 0 would make this 0 times infinity.
    let light = select(vec3<f32>(0.0), factor * sum, sum != vec3<f32>(0.0));
    let finite = is_finite(light);
    if (finite && max_component(light) > 0.0) {
        radiance[path] += vec4<f32>(light, luminance(light));
        tallies[path].z += 1u;
    } else if (!finite) {
        tallies[path].x += 1u;
    }
    for (var slot = 0u; slot < MERGED_ENTRIES; slot++) {
        let one = chosen[slot];
        let all = factor * one.xyz * (totals[slot] / max(max_component(one.xyz), 1e-38));
        let is_lit = finite && totals[slot] > 0.0;
        observe(first_entry() + id.x * MERGED_ENTRIES + slot, vec4<f32>(select(vec3<f32>(0.0), all, is_lit), one.w), path, NONE);
    }
}

// The slot for light with travel time `tau`.
fn time_slot(tau: f32) -> u32 {
    return u32(max((tau - frame.undelayed_lo) / frame.merge_slot, 0.0)) % TIME_SLOTS;
}

// The entry in `observed` of the first shade point in `shade_list`: it comes after the paths and the candidates of this bounce and of
// earlier ones, and after the shade points of earlier bounces.
fn first_entry() -> u32 {
    let next = counters[LIVING_LIST + (dispatch.bounce + 1u) % 2u];
    let traced = dispatch.count + counters[COUNTER_TOTALS + LIVING_LIST] + counters[COUNTER_TOTALS + LIVING_LIST + 1u] - next;
    let shade_points = counters[COUNTER_TOTALS + SHADE_LIST] - counters[SHADE_LIST];
    return entry_after(traced, counters[COUNTER_TOTALS + CANDIDATE_LIST], shade_points);
}

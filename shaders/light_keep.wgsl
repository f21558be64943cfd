// Appends the vertices of the newest bounce of light subpaths to those of earlier bounces, so that the host reads all of them at once.
#import path

@group(2) @binding(0) var<storage, read> vertices: array<PathVertex>;
@group(2) @binding(1) var<storage, read> splats: array<vec4<u32>>;
@group(2) @binding(2) var<storage, read> splat_details: array<f32>;
// Numbers of the paths whose new vertices are kept.
@group(2) @binding(3) var<storage, read> list: array<u32>;
@group(2) @binding(4) var<storage, read> counters: array<u32>;
@group(2) @binding(5) var<storage, read_write> kept_vertices: array<PathVertex>;
@group(2) @binding(6) var<storage, read_write> kept_splats: array<vec4<u32>>;
// x: number of the path in the batch. y: bits of `splat_details` (light_splat.wgsl), or of 1 in renders without it.
@group(2) @binding(7) var<storage, read_write> kept_paths: array<vec2<u32>>;

// One thread copies one vertex.
@compute @workgroup_size(WORKGROUP)
fn light_keep(@builtin(global_invocation_id) id: vec3<u32>) {
    let count = counters[dispatch.counter];
    if (id.x >= count) {
        return;
    }
    let slot = list[id.x];
    let to = counters[COUNTER_TOTALS + dispatch.counter] - count + id.x;
    kept_vertices[to] = vertices[slot];
    kept_splats[to] = splats[slot];
    var detail = 1.0;
    if (OBSERVE == OBSERVE_STRATEGIES || OBSERVE == OBSERVE_RESPONSES) {
        detail = splat_details[slot];
    }
    kept_paths[to] = vec2<u32>(slot, bitcast<u32>(detail));
}

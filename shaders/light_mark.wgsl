// Marks for the compaction of light subpaths: which subpaths continue, and which have reached a vertex that the host needs.
// This kernel runs on devices for which the host does not inspect each bounce.
#import path

@group(2) @binding(0) var<storage, read> states: array<PathState>;
@group(2) @binding(1) var<storage, read> vertices: array<PathVertex>;
@group(2) @binding(2) var<storage, read> list: array<u32>;
@group(2) @binding(3) var<storage, read> counters: array<u32>;
// For each entry of `list`. Bit 0: the path continues, bit 1: its vertex is kept.
@group(2) @binding(4) var<storage, read_write> marks: array<u32>;

// One thread marks one light subpath that was just started or traced.
@compute @workgroup_size(WORKGROUP)
fn light_mark(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= counters[dispatch.counter]) {
        return;
    }
    let slot = list[id.x];
    let lives = select(0u, 1u, (states[slot].flags & PATH_ALIVE) != 0u);
    let kept = select(0u, 2u, (vertices[slot].flags & VERTEX_VALID) != 0u);
    marks[id.x] = lives | kept;
}

// Stable compaction in three steps: counts of chunks, their running sums, scatter. No atomics, so lists keep their order.
#import frame
#import math

// Bit 0: the entry goes to list_a, bit 1: to list_b.
@group(2) @binding(0) var<storage, read> marks: array<u32>;
// What an entry stands for.
@group(2) @binding(1) var<storage, read> source: array<u32>;
@group(2) @binding(2) var<storage, read_write> chunk_counts: array<vec2<u32>>;
@group(2) @binding(3) var<storage, read_write> list_a: array<u32>;
@group(2) @binding(4) var<storage, read_write> list_b: array<u32>;
// Lengths of lists; totals over the segment from COUNTER_TOTALS on.
@group(2) @binding(5) var<storage, read_write> counters: array<u32>;
// Workgroups for indirect dispatches, three words a list.
@group(2) @binding(6) var<storage, read_write> arguments: array<u32>;

const CHUNK: u32 = 32u;
const SCAN_THREADS: u32 = 64u;

// From here on `counters` holds the lengths added up over the submit, for statistics.
const COUNTER_TOTALS: u32 = 8u;

// Entries are paths of a list, or with one outgoing list the candidate slots of the shade points.
fn entry_count() -> u32 {
    return counters[dispatch.counter] * select(1u, frame.slots, dispatch.list_b == NONE);
}

// One thread, one chunk.
@compute @workgroup_size(WORKGROUP)
fn compact_count(@builtin(global_invocation_id) id: vec3<u32>) {
    let n = entry_count();
    let first = id.x * CHUNK;
    if (first >= n) {
        return;
    }
    var count = vec2<u32>(0u);
    for (var i = first; i < min(first + CHUNK, n); i++) {
        let m = marks[i];
        count += vec2<u32>(m & 1u, (m >> 1u) & 1u);
    }
    chunk_counts[id.x] = count;
}

var<workgroup> partial: array<vec2<u32>, SCAN_THREADS>;

// One workgroup: counts become first positions, totals become list lengths and dispatch sizes.
@compute @workgroup_size(SCAN_THREADS)
fn compact_scan(@builtin(local_invocation_index) thread: u32) {
    let chunks = (entry_count() + CHUNK - 1u) / CHUNK;
    let share = (chunks + SCAN_THREADS - 1u) / SCAN_THREADS;
    let lo = min(thread * share, chunks);
    let hi = min(lo + share, chunks);
    var sum = vec2<u32>(0u);
    for (var i = lo; i < hi; i++) {
        sum += chunk_counts[i];
    }
    partial[thread] = sum;
    workgroupBarrier();
    var position = vec2<u32>(0u);
    var total = vec2<u32>(0u);
    for (var i = 0u; i < SCAN_THREADS; i++) {
        position += select(vec2<u32>(0u), partial[i], i < thread);
        total += partial[i];
    }
    for (var i = lo; i < hi; i++) {
        let count = chunk_counts[i];
        chunk_counts[i] = position;
        position += count;
    }
    workgroupBarrier();
    if (thread == 0u) {
        set_length(dispatch.list_a, total.x);
        if (dispatch.list_b != NONE) {
            set_length(dispatch.list_b, total.y);
        }
    }
}

fn set_length(list: u32, length: u32) {
    counters[list] = length;
    counters[COUNTER_TOTALS + list] += length;
    arguments[3u * list] = (length + WORKGROUP - 1u) / WORKGROUP;
    arguments[3u * list + 1u] = 1u;
    arguments[3u * list + 2u] = 1u;
}

// One thread, one chunk.
@compute @workgroup_size(WORKGROUP)
fn compact_scatter(@builtin(global_invocation_id) id: vec3<u32>) {
    let n = entry_count();
    let first = id.x * CHUNK;
    if (first >= n) {
        return;
    }
    var position = chunk_counts[id.x];
    for (var i = first; i < min(first + CHUNK, n); i++) {
        let m = marks[i];
        var payload = i;
        if (dispatch.list_b != NONE) {
            payload = source[i];
        }
        if ((m & 1u) != 0u) {
            list_a[position.x] = payload;
            position.x += 1u;
        }
        if (dispatch.list_b != NONE && (m & 2u) != 0u) {
            list_b[position.y] = payload;
            position.y += 1u;
        }
    }
}

// Stable compaction in three steps: running sums of chunks within their block, running sums of blocks, scatter. No atomics, so lists
// keep their order. A block is what one workgroup counts: 64 chunks of 32 entries.
#import frame
#import math

// Texels of four entries. Bit 0: the entry goes to list_a, bit 1: to list_b.
@group(2) @binding(0) var marks: texture_1d<u32>;
// What an entry stands for.
@group(2) @binding(1) var<storage, read> source: array<u32>;
// Members of the chunks of the same block that come before each chunk; behind the last chunk, the same for blocks.
@group(2) @binding(2) var<storage, read_write> chunk_counts: array<vec2<u32>>;
@group(2) @binding(3) var<storage, read_write> list_a: array<u32>;
@group(2) @binding(4) var<storage, read_write> list_b: array<u32>;
// Lengths of lists, and their totals.
@group(2) @binding(5) var<storage, read_write> counters: array<u32>;
// Workgroups for indirect dispatches, three words each: for a thread per entry of a list, and from LISTS on for what compacts it.
@group(2) @binding(6) var<storage, read_write> arguments: array<u32>;

const CHUNK: u32 = 32u;
// Threads of a workgroup that adds up.
const SCAN_THREADS: u32 = 64u;

const LISTS: u32 = 4u;

// Entries are paths of a list, or with one outgoing list the candidate slots of the shade points, which are the other outgoing list
// of paths.
fn entry_count() -> u32 {
    return counters[dispatch.counter] * select(1u, frame.slots, dispatch.list_b == NONE);
}

// The entries from `first` < n on, a bit each, that go to list_a (x) and to list_b (y); none from n on.
fn chunk_members(first: u32, n: u32) -> vec2<u32> {
    var members = vec2<u32>(0u);
    for (var i = 0u; i < CHUNK; i += 4u) {
        let four = textureLoad(marks, (first + i) / 4u, 0);
        let place = vec4<u32>(0u, 1u, 2u, 3u) + i;
        let a = (four & vec4<u32>(1u)) << place;
        let b = ((four >> vec4<u32>(1u)) & vec4<u32>(1u)) << place;
        members |= vec2<u32>(a.x | a.y | a.z | a.w, b.x | b.y | b.z | b.w);
    }
    return members & vec2<u32>(0xffffffffu >> (CHUNK - min(CHUNK, n - first)));
}

var<workgroup> partial: array<vec2<u32>, SCAN_THREADS>;

// What the threads of a workgroup before this one have together, and what all of them have.
struct Sums {
    before: vec2<u32>,
    all: vec2<u32>,
}

fn sums_over_threads(thread: u32, own: vec2<u32>) -> Sums {
    partial[thread] = own;
    workgroupBarrier();
    var sums: Sums;
    for (var i = 0u; i < SCAN_THREADS; i++) {
        sums.before += select(vec2<u32>(0u), partial[i], i < thread);
        sums.all += partial[i];
    }
    return sums;
}

fn chunks_of(entries: u32) -> u32 {
    return (entries + CHUNK - 1u) / CHUNK;
}

// Of `all` items, those in [x, y) are a thread's share.
fn share_of(all: u32, thread: u32) -> vec2<u32> {
    let share = (all + SCAN_THREADS - 1u) / SCAN_THREADS;
    let lo = min(thread * share, all);
    return vec2<u32>(lo, min(lo + share, all));
}

// One thread, one chunk; one workgroup, one block: counts become positions within the block.
@compute @workgroup_size(SCAN_THREADS)
fn compact_count(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) block: vec3<u32>) {
    let n = entry_count();
    let first = id.x * CHUNK;
    var count = vec2<u32>(0u);
    if (first < n) {
        count = countOneBits(chunk_members(first, n));
    }
    let sums = sums_over_threads(thread, count);
    if (first < n) {
        chunk_counts[id.x] = sums.before;
    }
    if (thread == 0u) {
        chunk_counts[chunks_of(n) + block.x] = sums.all;
    }
}

// One workgroup: counts of blocks become their first positions, totals become list lengths and dispatch sizes. 32 Mi entries, the
// most that a tile on a card has with 32 slots per shade point, are 256 blocks per thread.
@compute @workgroup_size(SCAN_THREADS)
fn compact_scan(@builtin(local_invocation_index) thread: u32) {
    let chunks = chunks_of(entry_count());
    let share = chunks + share_of((chunks + SCAN_THREADS - 1u) / SCAN_THREADS, thread);
    var sum = vec2<u32>(0u);
    for (var i = share.x; i < share.y; i++) {
        sum += chunk_counts[i];
    }
    let sums = sums_over_threads(thread, sum);
    var position = sums.before;
    for (var i = share.x; i < share.y; i++) {
        let count = chunk_counts[i];
        chunk_counts[i] = position;
        position += count;
    }
    set_lengths(thread, sums.all);
}

// One workgroup: the three steps at once, for lists so short that a dispatch costs more than they do.
@compute @workgroup_size(SCAN_THREADS)
fn compact_short(@builtin(local_invocation_index) thread: u32) {
    let n = entry_count();
    let share = share_of(chunks_of(n), thread);
    var sum = vec2<u32>(0u);
    for (var i = share.x; i < share.y; i++) {
        sum += countOneBits(chunk_members(i * CHUNK, n));
    }
    let sums = sums_over_threads(thread, sum);
    var position = sums.before;
    for (var i = share.x; i < share.y; i++) {
        position = scatter_chunk(i * CHUNK, n, position);
    }
    set_lengths(thread, sums.all);
}

// After a barrier behind which no thread reads lengths.
fn set_lengths(thread: u32, total: vec2<u32>) {
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
    set_workgroups(list, length, WORKGROUP);
    let entries = length * select(1u, frame.slots, list == dispatch.list_b);
    set_workgroups(LISTS + list, chunks_of(entries), SCAN_THREADS);
}

fn set_workgroups(at: u32, threads: u32, size: u32) {
    arguments[3u * at] = (threads + size - 1u) / size;
    arguments[3u * at + 1u] = 1u;
    arguments[3u * at + 2u] = 1u;
}

// One thread, one chunk.
@compute @workgroup_size(SCAN_THREADS)
fn compact_scatter(@builtin(global_invocation_id) id: vec3<u32>, @builtin(workgroup_id) block: vec3<u32>) {
    let n = entry_count();
    let first = id.x * CHUNK;
    if (first < n) {
        scatter_chunk(first, n, chunk_counts[chunks_of(n) + block.x] + chunk_counts[id.x]);
    }
}

// Writes the members of a chunk to their lists from `position` on; returns where the next ones go.
fn scatter_chunk(first: u32, n: u32, position: vec2<u32>) -> vec2<u32> {
    let members = chunk_members(first, n);
    var to = position;
    for (var rest = members.x; rest != 0u; rest &= rest - 1u) {
        list_a[to.x] = payload(first + firstTrailingBit(rest));
        to.x += 1u;
    }
    if (dispatch.list_b != NONE) {
        for (var rest = members.y; rest != 0u; rest &= rest - 1u) {
            list_b[to.y] = payload(first + firstTrailingBit(rest));
            to.y += 1u;
        }
    }
    return to;
}

// What stands for an entry in the lists: paths their number, candidate slots their own.
fn payload(entry: u32) -> u32 {
    if (dispatch.list_b == NONE) {
        return entry;
    }
    return source[entry];
}

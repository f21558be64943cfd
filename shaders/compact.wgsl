// Stable compaction in three steps: count the members of each chunk, compute prefix sums of the counts, scatter the members.
// It uses no atomics, so lists keep their order.
#import candidate
#import frame
#import math

// One texel holds four entries. With two output lists, bit 0: the entry goes to list_a, bit 1: the entry goes to list_b. With one, an
// entry stands for the candidate slots of a shade point: see SLOTS_PER_MARK.
@group(2) @binding(0) var marks: texture_1d<u32>;
// The path that each entry stands for.
@group(2) @binding(1) var<storage, read> source: array<u32>;
// For each chunk: the number of its members. After `compact_scan`: the number of members in all earlier chunks.
@group(2) @binding(2) var<storage, read_write> chunk_counts: array<vec2<u32>>;
@group(2) @binding(3) var<storage, read_write> list_a: array<u32>;
@group(2) @binding(4) var<storage, read_write> list_b: array<u32>;
// Lengths of the lists, and their totals: see COUNTER_TOTALS.
@group(2) @binding(5) var<storage, read_write> counters: array<u32>;
// Sizes of indirect dispatches in workgroups, three words each. The first LISTS sizes give one thread per entry of a list. The
// next LISTS sizes give one thread per chunk, to compact the list.
@group(2) @binding(6) var<storage, read_write> arguments: array<u32>;

const CHUNK: u32 = 32u;
// Threads per workgroup of `compact_scan` and `compact_short`.
const SCAN_THREADS: u32 = 64u;

// Number of lists that `counters` and `arguments` have room for.
const LISTS: u32 = 4u;

// Number of entries to compact. With two output lists, the entries are the paths of the input list. With one output list, the
// entries are the marks of the shade points in the input list.
fn entry_count() -> u32 {
    return counters[dispatch.counter] * select(1u, mark_words(), dispatch.list_b == NONE);
}

// Entries with members in the chunk that begins at entry `first` < n, one bit per entry: x for list_a, y for list_b. Entries from n on have
// no members. With one output list, y has no meaning.
fn chunk_members(first: u32, n: u32) -> vec2<u32> {
    var members = vec2<u32>(0u);
    for (var i = 0u; i < CHUNK; i += 4u) {
        let four = textureLoad(marks, (first + i) / 4u, 0);
        let place = vec4<u32>(0u, 1u, 2u, 3u) + i;
        let a = select(four & vec4<u32>(1u), min(four, vec4<u32>(1u)), dispatch.list_b == NONE) << place;
        let b = ((four >> vec4<u32>(1u)) & vec4<u32>(1u)) << place;
        members |= vec2<u32>(a.x | a.y | a.z | a.w, b.x | b.y | b.z | b.w);
    }
    return members & vec2<u32>(0xffffffffu >> (CHUNK - min(CHUNK, n - first)));
}

// Number of members of the chunk that begins at entry `first` < n: x of list_a, y of list_b.
fn count_members(first: u32, n: u32) -> vec2<u32> {
    if (dispatch.list_b != NONE) {
        return countOneBits(chunk_members(first, n));
    }
    var count = 0u;
    for (var i = 0u; i < CHUNK; i += 4u) {
        let four = countOneBits(textureLoad(marks, (first + i) / 4u, 0));
        let inside = vec4<u32>(0u, 1u, 2u, 3u) + (first + i) < vec4<u32>(n);
        let counted = select(vec4<u32>(0u), four, inside);
        count += counted.x + counted.y + counted.z + counted.w;
    }
    return vec2<u32>(count, 0u);
}

var<workgroup> partial: array<vec2<u32>, SCAN_THREADS>;

// Sum over the threads of a workgroup before this thread, and sum over all threads of the workgroup.
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

// The range [x, y) of chunks that one thread processes, if there is only one workgroup.
fn share_of_chunks(thread: u32) -> vec2<u32> {
    let chunks = chunks_of(entry_count());
    let share = (chunks + SCAN_THREADS - 1u) / SCAN_THREADS;
    let lo = min(thread * share, chunks);
    return vec2<u32>(lo, min(lo + share, chunks));
}

// One thread counts one chunk.
@compute @workgroup_size(WORKGROUP)
fn compact_count(@builtin(global_invocation_id) id: vec3<u32>) {
    let n = entry_count();
    let first = id.x * CHUNK;
    if (first < n) {
        chunk_counts[id.x] = count_members(first, n);
    }
}

// One workgroup: counts of chunks become their first positions, and totals become list lengths and dispatch sizes.
@compute @workgroup_size(SCAN_THREADS)
fn compact_scan(@builtin(local_invocation_index) thread: u32) {
    let share = share_of_chunks(thread);
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

// One workgroup runs the three steps at once. It serves lists so short that further dispatches would cost more than the work.
@compute @workgroup_size(SCAN_THREADS)
fn compact_short(@builtin(local_invocation_index) thread: u32) {
    let n = entry_count();
    let share = share_of_chunks(thread);
    var sum = vec2<u32>(0u);
    for (var i = share.x; i < share.y; i++) {
        sum += count_members(i * CHUNK, n);
    }
    let sums = sums_over_threads(thread, sum);
    var position = sums.before;
    for (var i = share.x; i < share.y; i++) {
        position = scatter_chunk(i * CHUNK, n, position);
    }
    set_lengths(thread, sums.all);
}

// Call this only after a barrier, once no thread reads list lengths any more.
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
    set_workgroups(list, length);
    let entries = length * select(1u, mark_words(), list == dispatch.list_b);
    set_workgroups(LISTS + list, chunks_of(entries));
}

fn set_workgroups(at: u32, threads: u32) {
    arguments[3u * at] = (threads + WORKGROUP - 1u) / WORKGROUP;
    arguments[3u * at + 1u] = 1u;
    arguments[3u * at + 2u] = 1u;
}

// One thread scatters one chunk.
@compute @workgroup_size(WORKGROUP)
fn compact_scatter(@builtin(global_invocation_id) id: vec3<u32>) {
    let n = entry_count();
    let first = id.x * CHUNK;
    if (first < n) {
        scatter_chunk(first, n, chunk_counts[id.x]);
    }
}

// Writes the members of a chunk to their lists from `position` on. Returns the positions after the last members.
fn scatter_chunk(first: u32, n: u32, position: vec2<u32>) -> vec2<u32> {
    let members = chunk_members(first, n);
    var to = position;
    if (dispatch.list_b == NONE) {
        for (var rest = members.x; rest != 0u; rest &= rest - 1u) {
            to.x = list_slots(first + firstTrailingBit(rest), to.x);
        }
        return to;
    }
    for (var rest = members.x; rest != 0u; rest &= rest - 1u) {
        list_a[to.x] = source[first + firstTrailingBit(rest)];
        to.x += 1u;
    }
    for (var rest = members.y; rest != 0u; rest &= rest - 1u) {
        list_b[to.y] = source[first + firstTrailingBit(rest)];
        to.y += 1u;
    }
    return to;
}

// Writes the slots in the mark `entry` to list_a from `position` on. Returns the position after the last one.
fn list_slots(entry: u32, position: u32) -> u32 {
    let rank = entry / mark_words();
    let first = rank * frame.slots + (entry - rank * mark_words()) * SLOTS_PER_MARK;
    var to = position;
    for (var rest = textureLoad(marks, entry / 4u, 0)[entry % 4u]; rest != 0u; rest &= rest - 1u) {
        list_a[to] = first + firstTrailingBit(rest);
        to += 1u;
    }
    return to;
}

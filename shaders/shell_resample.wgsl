// lcs: draws K vertices of each tree for a shade point by importance, and chooses one of them. So K candidates cost one shadow
// ray. With several responses, it chooses one vertex of each tree for each part of the gate. All deterministic vertices in the
// first slots are kept. Bindings: shared/slots.wgsl.
#import resample
#import receiver

// One thread serves one shade point.
@compute @workgroup_size(WORKGROUP)
fn shell_resample(@builtin(global_invocation_id) id: vec3<u32>) {
    let rank = dispatch.rank + id.x;
    if (rank >= counters[dispatch.counter]) {
        return;
    }
    let item = begin_work_item(rank);
    if (!item.is_open) {
        end_work_item(item.q.owner);
        return;
    }
    let q = item.q;
    var used = item.used;
    let receiver = make_receiver(q);
    // One loop serves both trees: a second traversal would double the kernel's code.
    for (var tree = 0u; tree < 2u; tree++) {
        let root = select(frame.tree4_root, frame.tree3_root, tree == 0u);
        if (root == NONE) {
            continue;
        }
        var rng = random_words(STREAM_QUERY, item.index, item.sample, item.depth, 16u + tree, frame.seed).x;
        resample(root, q, receiver, used, &rng);
        used += TIME_GROUPS;
    }
    end_work_item(q.owner);
}

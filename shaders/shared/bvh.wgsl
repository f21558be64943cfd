// Nodes of the compressed wide BVH (Ylitie et al. 2017, 80 bytes), and the test of a ray against the boxes of their children.
#import scene

// Entries of the traversal stack. The host limits the depth of the BVH (`MAX_LEVELS` in src/bvh/mod.rs), so pushing needs no test.
const STACK_SIZE: u32 = 32u;

// Reciprocal of each component; finite for components that are 0.
fn safe_inverse(d: vec3<f32>) -> vec3<f32> {
    let tiny = vec3<f32>(1e-20);
    let signed_tiny = select(-tiny, tiny, d >= vec3<f32>(0.0));
    return 1.0 / select(d, signed_tiny, abs(d) < tiny);
}

// Byte `b` of the word x, 0 for the lowest.
fn extract_byte(x: u32, b: u32) -> u32 {
    return (x >> (b * 8u)) & 0xffu;
}

// Slack of the slab test, 24 x 2^-24 of each term. The ray parameter of a plane is a sum whose terms may cancel. So planes
// are moved outwards by the possible rounding error of the terms, and flat boxes keep their hits (after Ize 2013). The terms contain
// the inverse of the direction, and Vulkan allows a division an error of 2.5 ulp (5 x 2^-24). The slack is more than doubled, because
// `to_ray` also rounds the corners of the triangles. Near planes are moved as well. Where the ray
// hardly moves along an axis, the error of a near plane may exceed the slack of a far plane.
const SLAB_SLACK: f32 = 1.43e-6;

// The quantised planes of a node as ray parameters: byte times scale plus origin, for near and far planes.
struct Slabs {
    near_scale: vec3<f32>,
    near_origin: vec3<f32>,
    far_scale: vec3<f32>,
    far_origin: vec3<f32>,
    t_min: f32,
    t_max: f32,
}

// A node of the BVH, unpacked from its five texels (Ylitie et al. 2017, Sec. 4).
struct BvhNode {
    // First inner child (x), first triangle (y), and the meta bytes of children 0 to 3 (z) and 4 to 7 (w).
    children: vec4<u32>,
    // Bytes of the planes of each axis: lower planes of children 0 to 3 and 4 to 7, then their upper planes.
    x: vec4<u32>,
    y: vec4<u32>,
    z: vec4<u32>,
    // A plane lies at its byte times `scale` plus `origin`.
    origin: vec3<f32>,
    scale: vec3<f32>,
    // Bit i: child i is an inner node.
    inner: u32,
}

fn unpack_bvh_node(index: u32) -> BvhNode {
    let base = index * 5u;
    let n0 = textureLoad(bvh_nodes, base, 0);
    let scale = vec3<f32>(
        bitcast<f32>(extract_byte(n0.w, 0u) << 23u),
        bitcast<f32>(extract_byte(n0.w, 1u) << 23u),
        bitcast<f32>(extract_byte(n0.w, 2u) << 23u),
    );
    return BvhNode(textureLoad(bvh_nodes, base + 1u, 0), textureLoad(bvh_nodes, base + 2u, 0), textureLoad(bvh_nodes, base + 3u, 0),
        textureLoad(bvh_nodes, base + 4u, 0), bitcast<vec3<f32>>(n0.xyz), scale, n0.w >> 24u);
}

// Hit mask of four of a node's eight children: inner children in bits 24 to 31 by traversal priority, triangles in
// bits 0 to 23. `near` and `far` hold, for each axis, the bytes of the four near and far planes. `oct4` holds the
// octant of the ray in every byte.
fn intersect_four(meta4: u32, near: vec3<u32>, far: vec3<u32>, slabs: Slabs, oct4: u32) -> u32 {
    let inner4 = (meta4 & (meta4 << 1u)) & 0x10101010u;
    let inner_mask4 = (inner4 >> 4u) * 0xffu;
    let bit_index4 = (meta4 ^ (oct4 & inner_mask4)) & 0x1f1f1f1fu;
    let child_bits4 = (meta4 >> 5u) & 0x07070707u;
    let near_x = bytes_to_floats(near.x) * slabs.near_scale.x + slabs.near_origin.x;
    let near_y = bytes_to_floats(near.y) * slabs.near_scale.y + slabs.near_origin.y;
    let near_z = bytes_to_floats(near.z) * slabs.near_scale.z + slabs.near_origin.z;
    let far_x = bytes_to_floats(far.x) * slabs.far_scale.x + slabs.far_origin.x;
    let far_y = bytes_to_floats(far.y) * slabs.far_scale.y + slabs.far_origin.y;
    let far_z = bytes_to_floats(far.z) * slabs.far_scale.z + slabs.far_origin.z;
    let enter = max(max(near_x, near_y), max(near_z, vec4<f32>(slabs.t_min)));
    let leave_at = min(min(far_x, far_y), min(far_z, vec4<f32>(slabs.t_max)));
    let touched = enter <= leave_at;
    let a = select(0u, (child_bits4 & 0xffu) << (bit_index4 & 0xffu), touched.x);
    let b = select(0u, ((child_bits4 >> 8u) & 0xffu) << ((bit_index4 >> 8u) & 0xffu), touched.y);
    let c = select(0u, ((child_bits4 >> 16u) & 0xffu) << ((bit_index4 >> 16u) & 0xffu), touched.z);
    let d = select(0u, (child_bits4 >> 24u) << (bit_index4 >> 24u), touched.w);
    return a | b | c | d;
}

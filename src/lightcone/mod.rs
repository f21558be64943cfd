//! Sections 4 and 5 of the paper on the host: light vertices in space and travel time, and the trees over them.
//!
//! | symbol | here | unit |
//! |---|---|---|
//! | v, v_tau | position and travel time of a light vertex | length, optical path |
//! | q, q_tau | position and travel time of a shade point | length, optical path |
//! | phi_j | throughput / density of light vertex j, 1/M included | W, or radiance times area |
//! | tau_min, tau_max | gate | optical path |
//! | N_tau^-, N_tau^+ | smallest and largest v_tau below a node | optical path |
//! | Phi_N, Phi_b | power of a node, and of one of its buckets | as for phi, scaled to a total of 1 |
//! | B, K, M | buckets per node, queries per shade point and tree, light subpaths per iteration | |
//!
//! Lengths and optical paths are in the unit of render space (`render/space.rs`), as in the kernels. The queries run on the device.
//! The paper's queries are in `shaders/shell_query.wgsl` and `shared/query.wgsl`. Queries by importance are in
//! `shaders/shell_resample.wgsl`, `shared/importance.wgsl`, `shared/frontier.wgsl` and `shared/resample.wgsl`. Both prune with
//! `shared/lightcone.wgsl`.

pub mod gate;
pub mod tree;

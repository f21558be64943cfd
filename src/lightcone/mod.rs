//! Sections 4 and 5 of the paper on the host: light vertices in space and travel time, and the trees over them.
//!
//! | symbol | here | unit |
//! |---|---|---|
//! | v, v_tau | position and travel time of a light vertex | m relative to the sensor, m of optical path |
//! | q, q_tau | position and travel time of a shade point | as for v, v_tau |
//! | phi_j | throughput / density of light vertex j, 1/M included | W, or radiance times area |
//! | tau_min, tau_max | gate | m of optical path |
//! | N_tau^-, N_tau^+ | smallest and largest v_tau below a node | m of optical path |
//! | Phi_N, Phi_b | power of a node, and of one of its buckets | as for phi, scaled to a total of 1 |
//! | B, K, M | buckets per node, queries per shade point, light subpaths per iteration | |
//!
//! Kernels measure lengths in the unit of `render/space.rs` instead of metres. The queries run on the device. The paper's queries
//! are in `shaders/shell_query.wgsl` and `shared/query.wgsl`. Queries by importance are in `shaders/shell_resample.wgsl`,
//! `shared/importance.wgsl`, `shared/frontier.wgsl` and `shared/resample.wgsl`. Both prune with `shared/lightcone.wgsl`.

pub mod gate;
pub mod tree;

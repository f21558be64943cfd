//! The paper's sections 4 and 5 on the host: light vertices in space and travel time, and the trees over them.
//!
//! | symbol | here | unit |
//! |---|---|---|
//! | v, v_tau | position and travel time of a light vertex | m relative to the sensor, m of optical path |
//! | q, q_tau | position and travel time of a shade point | the same |
//! | phi_j | throughput / density of light vertex j, 1/M included | W, or radiance x area |
//! | tau_min, tau_max | gate | m of optical path |
//! | N_tau^-, N_tau^+ | least and greatest v_tau below a node | m of optical path |
//! | Phi_N, Phi_b | power of a node, of one of its buckets | that of phi, scaled to a total of 1 |
//! | B, K, M | buckets a node, queries a shade point, light subpaths | |
//!
//! Kernels count lengths in the unit of `render/space.rs` instead of metres. The queries themselves run on the device: those of the
//! paper in `shaders/shell_query.wgsl` and `shared/query.wgsl`, those by importance in `shaders/shell_resample.wgsl`,
//! `shared/importance.wgsl`, `frontier.wgsl` and `resample.wgsl`; both prune by `shared/lightcone.wgsl`.

pub mod gate;
pub mod tree;

//! `epc`: ellipsoidal path connections (Pediredla, Veeraraghavan and Gkioulekas 2019). As `bdpt`, but a connection that is too
//! short for the gate gets an auxiliary vertex on an ellipsoid. The path then has a travel time inside the gate.

use super::{COMMON_QUERY_KERNEL, Ellipsoids, Estimator, PoolOrder, Record};
use crate::wgsl::layout::constants::ESTIMATOR_EPC;

pub(super) static RECORD: Record = Record {
    name: "epc",
    is_default: |_| false,
    max_default_light_paths: 50_000,
    adaptive: true,
    light_subpaths: true,
    trees: None,
    pool_order: PoolOrder::ByPath,
    query_kernel: COMMON_QUERY_KERNEL,
    constants: &[("ESTIMATOR", ESTIMATOR_EPC)],
    slots: |pool| pool.longest_path,
    time_groups: 1,
    for_histograms: None,
    for_thin_gates: None,
    draws_per_query: 1,
    query_sample_count: |_, _| 1.0,
    splat_sample_weight: 1.0,
    draws_in_gate: false,
    ellipsoids: Ellipsoids::Enumerated,
    ellipsoid_sample_count: 1.0,
    renders_references: false,
    is_baseline: false,
    judge: Estimator::Bdpt,
};

//! `lcs-paper`: light-cone shell queries as in the paper (Secs. 5 and 6). A 3D tree holds the points on emitters, a 4D tree the
//! scattered vertices. Each shade point sends K queries per tree, and one shadow ray per query.

use super::{COMMON_QUERY_KERNEL, Ellipsoids, Estimator, PoolOrder, Record, TreeDefaults};
use crate::wgsl::layout::constants::ESTIMATOR_LCS_PAPER;

pub(super) static RECORD: Record = Record {
    name: "lcs-paper",
    is_default: |_| false,
    max_default_light_paths: 50_000,
    // The paper uses the same number of samples for all pixels.
    adaptive: false,
    light_subpaths: true,
    // In the paper each leaf holds one vertex (Sec. 5.2).
    trees: Some(TreeDefaults { queries: 1, leaf_size: 1, single: false, by_importance: false }),
    pool_order: PoolOrder::Trees,
    query_kernel: COMMON_QUERY_KERNEL,
    constants: &[("ESTIMATOR", ESTIMATOR_LCS_PAPER)],
    slots: |pool| pool.queries * pool.trees,
    time_groups: 1,
    for_histograms: None,
    for_thin_gates: None,
    draws_per_query: 1,
    query_sample_count: |_, _| 1.0,
    splat_sample_weight: 1.0,
    draws_in_gate: false,
    ellipsoids: Ellipsoids::None,
    ellipsoid_sample_count: 1.0,
    renders_references: false,
    is_baseline: false,
    judge: Estimator::Bdpt,
};

//! `lcs`: light-cone shell queries by importance. K candidates per tree are resampled to one shadow ray.

use super::{Estimator, GateWidth, PoolOrder, Record, TreeDefaults};

pub(super) static RECORD: Record = Record {
    name: "lcs",
    is_default: |c| c.gate == GateWidth::Narrow,
    // Queries choose the better the fewer vertices there are (docs/notebook/light-paths.md).
    max_default_light_paths: 8192,
    adaptive: true,
    light_subpaths: true,
    // One tree needs half as many queries, which choose among points on emitters as among the others
    // (docs/notebook/single-tree.md).
    trees: Some(TreeDefaults { queries: 16, leaf_size: 16, single: true, by_importance: true }),
    pool_order: PoolOrder::Trees,
    query_kernel: "shell_resample",
    constants: &[],
    slots: |pool| pool.trees,
    // A vertex that queries choose by what it contributes is worth many that subpaths happen to reach. 4 K is a compromise between
    // four scenes (docs/notebook/mis-sample-count.md).
    query_sample_count: |queries| 4.0 * queries as f32,
    // Light-tracing samples that matter are rare and bright here: what else could have found their paths is worth more than its
    // densities say (docs/notebook/splat-weight.md).
    splat_sample_weight: 0.25,
    renders_references: true,
    judge: Estimator::Bdpt,
};

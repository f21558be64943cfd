//! `lcs`: light-cone shell queries by importance. Each tree gives up to K candidates per shade point; resampling keeps one of
//! them for one shadow ray.

use super::{Estimator, GateWidth, PoolOrder, Record, TreeDefaults};
use crate::wgsl::layout::constants::MAX_TIME_GROUPS;

pub(super) static RECORD: Record = Record {
    name: "lcs",
    is_default: |c| c.gate == GateWidth::Narrow,
    // Queries choose better among fewer vertices (docs/notebook/light-paths.md).
    max_default_light_paths: 8192,
    adaptive: true,
    light_subpaths: true,
    // A single tree needs half as many queries as two trees. It holds points on emitters and scattered vertices alike
    // (docs/notebook/single-tree.md).
    trees: Some(TreeDefaults { queries: 16, leaf_size: 16, single: true, by_importance: true }),
    pool_order: PoolOrder::Trees,
    query_kernel: "shell_resample",
    constants: &[],
    slots: |pool| pool.trees * pool.time_groups,
    // One vertex per tree would leave most gates without light (docs/notebook/histograms.md).
    time_groups: MAX_TIME_GROUPS,
    // A vertex that queries choose by its contribution stands for more samples than one that a subpath happens to reach. 4 K is a
    // compromise between four scenes (docs/notebook/mis-sample-count.md). In fog, K: light that returned from far away is rare, and
    // one such vertex must not dominate the image.
    query_sample_count: |queries, has_media| if has_media { 1.0 } else { 4.0 } * queries as f32,
    // Light-tracing (t = 1) samples that matter are rare and bright in this estimator, so the other strategies get more weight
    // than their densities give them (docs/notebook/splat-weight.md).
    splat_sample_weight: 0.25,
    draws_in_gate: true,
    renders_references: true,
    judge: Estimator::Bdpt,
};

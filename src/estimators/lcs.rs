//! `lcs`: light-cone shell queries by importance. Each tree yields at most K candidates per shade point; resampling keeps one of
//! the candidates for one shadow ray. In a histogram over a wide range of travel times, nearly every vertex meets some bin, and
//! each bin needs connections. So `lcs` draws vertices evenly over travel time there, and traces a shadow ray to each of them.

use super::{COMMON_QUERY_KERNEL, Conditions, Ellipsoids, Fog, GateWidth, PLAIN, PoolOrder, Record, TreeDefaults};
use crate::wgsl::layout::constants::{ESTIMATOR_LCS_BY_TIME, MAX_TIME_GROUPS};

pub(super) static RECORD: Record =
    Record { for_histograms: Some(&FOR_HISTOGRAMS), for_thin_gates: Some(&FOR_THIN_GATES), ..GENERAL };

/// Whether `lcs` is the default. With a wide gate or none, nearly all vertices are valid: choosing among them by query costs time and gains
/// little. Exceptions are thick fog, and beams, whose light no connection to a lamp finds (docs/notebook/default-estimator.md).
pub(super) fn suits(c: &Conditions) -> bool {
    c.gate == GateWidth::Narrow || c.fog == Fog::Thick || (c.has_beam && !c.has_several)
}

const GENERAL: Record = Record {
    name: "lcs",
    is_default: suits,
    // Queries choose better among fewer vertices (docs/notebook/light-paths.md).
    // With several gates, each shade point has several connections. Light vertices that fit into the caches make them cheaper
    // (docs/notebook/long-histograms.md).
    max_default_light_paths: |has_several| if has_several { 2048 } else { 8192 },
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
    ..PLAIN
};

/// Hardly any pair of vertices meets a thin gate. So ellipsoidal connections, whose travel time lies inside the gate, are
/// formed too: eight candidates cost two shadow rays.
static FOR_THIN_GATES: Record = Record {
    slots: |pool| pool.trees * pool.time_groups + 1,
    for_histograms: Some(&FOR_HISTOGRAMS),
    ellipsoids: Ellipsoids::Resampled,
    // From 0.1 to 1 makes little difference (docs/notebook/ellipsoids-by-importance.md).
    ellipsoid_sample_count: 0.3,
    ..GENERAL
};

/// Queries of trees and resampling do not pay in a wide histogram. A chosen vertex serves one bin, at the cost of several
/// connections. Resampling favours bright bins, so dim bins get few vertices, and these are far too bright
/// (docs/notebook/long-histograms.md).
static FOR_HISTOGRAMS: Record = Record {
    pool_order: PoolOrder::ByTime,
    query_kernel: COMMON_QUERY_KERNEL,
    constants: &[("ESTIMATOR", ESTIMATOR_LCS_BY_TIME)],
    slots: |pool| pool.trees * pool.queries,
    time_groups: 1,
    // A query of a tree takes longer than two connections.
    draws_per_query: 2,
    // Six times this value makes the early gates noisier, and rare samples brighter. A quarter makes all gates noisier.
    query_sample_count: |queries, has_media| if has_media { 0.0625 } else { 0.125 } * queries as f32,
    splat_sample_weight: 1.0,
    ..GENERAL
};

//! `bdpt`: full bidirectional path tracing (Veach 1997, ch. 10). Each shade point is connected to every vertex of one light
//! subpath; paths outside the gate are rejected. `bdpt` is a baseline of the paper.

use super::{COMMON_QUERY_KERNEL, Ellipsoids, Estimator, Fog, GateWidth, PoolOrder, Record};
use crate::wgsl::layout::constants::ESTIMATOR_BDPT;

pub(super) static RECORD: Record = Record {
    name: "bdpt",
    // With a wide gate or none, nearly all vertices are valid: choosing among them by query costs time and gains little, except in
    // thick fog. Without gate and fog, `pt` is the default, unless a surface focuses light or a beam shines (docs/notebook/no-gate.md).
    is_default: |c| match (c.gate, c.fog) {
        (GateWidth::Narrow, _) | (_, Fog::Thick) => false,
        (GateWidth::Wide, _) | (GateWidth::Open, Fog::Thin) => true,
        (GateWidth::Open, Fog::None) => c.focuses_light || c.has_beam,
    },
    max_default_light_paths: 50_000,
    adaptive: true,
    light_subpaths: true,
    trees: None,
    pool_order: PoolOrder::ByPath,
    query_kernel: COMMON_QUERY_KERNEL,
    constants: &[("ESTIMATOR", ESTIMATOR_BDPT)],
    slots: |pool| pool.longest_path,
    time_groups: 1,
    for_histograms: None,
    for_thin_gates: None,
    draws_per_query: 1,
    query_sample_count: |_, _| 1.0,
    splat_sample_weight: 1.0,
    draws_in_gate: false,
    ellipsoids: Ellipsoids::None,
    ellipsoid_sample_count: 1.0,
    renders_references: true,
    is_baseline: true,
    judge: Estimator::LcsPaper,
};

//! `pt`: path tracing with next-event estimation. Light subpaths end on their emitters, so only the strategies with s <= 1 and
//! t >= 2 exist.

use super::{COMMON_QUERY_KERNEL, Ellipsoids, Estimator, Fog, GateWidth, PoolOrder, Record};
use crate::wgsl::layout::constants::ESTIMATOR_PT;

pub(super) static RECORD: Record = Record {
    name: "pt",
    // Without a gate it is the fastest estimator if nothing focuses light, no collimated beam shines, and there is no fog
    // (docs/notebook/no-gate.md).
    is_default: |c| c.gate == GateWidth::Open && c.fog == Fog::None && !c.focuses_light && !c.has_beam,
    max_default_light_paths: 50_000,
    adaptive: true,
    light_subpaths: false,
    trees: None,
    pool_order: PoolOrder::EmitterPoints,
    query_kernel: COMMON_QUERY_KERNEL,
    constants: &[("ESTIMATOR", ESTIMATOR_PT)],
    slots: |pool| u32::from(pool.has_emitter_vertices),
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
    is_baseline: true,
    judge: Estimator::Bdpt,
};

//! `pt`: path tracing with next-event estimation. Light subpaths end on their emitters, so only the strategies with s <= 1 and
//! t >= 2 exist.

use super::{Fog, GateWidth, PLAIN, PoolOrder, Record};
use crate::wgsl::layout::constants::ESTIMATOR_PT;

pub(super) static RECORD: Record = Record {
    name: "pt",
    // Without a gate it is the fastest estimator if nothing focuses light, no collimated beam shines, and there is no fog
    // (docs/notebook/no-gate.md).
    is_default: |c| c.gate == GateWidth::Open && c.fog == Fog::None && !c.focuses_light && !c.has_beam,
    light_subpaths: false,
    pool_order: PoolOrder::EmitterPoints,
    constants: &[("ESTIMATOR", ESTIMATOR_PT)],
    slots: |pool| u32::from(pool.has_emitter_vertices),
    is_baseline: true,
    ..PLAIN
};

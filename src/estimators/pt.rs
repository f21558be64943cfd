//! `pt`: path tracing with next-event estimation. Light subpaths end on their emitters, so only the strategies with s <= 1 and
//! t >= 2 exist.

use super::{Conditions, Fog, GateWidth, PLAIN, PoolOrder, Record};
use crate::wgsl::layout::constants::ESTIMATOR_PT;

/// Whether `pt` is the default. Without a gate it is the fastest estimator under a sun or a sky, whose light subpaths seldom reach what the
/// camera sees, if nothing focuses light, no collimated beam shines, and there is no fog (docs/notebook/no-gate.md).
pub(super) fn suits(c: &Conditions) -> bool {
    c.gate == GateWidth::Open && c.has_distant && c.fog == Fog::None && !c.focuses_light && !c.has_beam
}

pub(super) static RECORD: Record = Record {
    name: "pt",
    is_default: suits,
    light_subpaths: false,
    pool_order: PoolOrder::EmitterPoints,
    constants: &[("ESTIMATOR", ESTIMATOR_PT)],
    slots: |pool| u32::from(pool.has_emitter_vertices),
    is_baseline: true,
    ..PLAIN
};

//! `bdpt`: full bidirectional path tracing (Veach 1997, ch. 10). Each shade point is connected to every vertex of one light
//! subpath; paths outside the gate are rejected. `bdpt` is a baseline of the paper.

use super::{Estimator, Fog, GateWidth, PLAIN, PoolOrder, Record};
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
    pool_order: PoolOrder::ByPath,
    constants: &[("ESTIMATOR", ESTIMATOR_BDPT)],
    slots: |pool| pool.longest_path,
    renders_references: true,
    is_baseline: true,
    judge: Estimator::LcsPaper,
    ..PLAIN
};

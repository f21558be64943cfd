//! `bdpt`: full bidirectional path tracing (Veach 1997, ch. 10). Each shade point is connected to every vertex of one light
//! subpath; paths outside the gate are rejected. `bdpt` is a baseline of the paper.

use super::{Estimator, PLAIN, PoolOrder, Record, lcs, pt};
use crate::wgsl::layout::constants::ESTIMATOR_BDPT;

pub(super) static RECORD: Record = Record {
    name: "bdpt",
    is_default: |c| !lcs::suits(c) && !pt::suits(c),
    pool_order: PoolOrder::ByPath,
    constants: &[("ESTIMATOR", ESTIMATOR_BDPT)],
    slots: |pool| pool.longest_path,
    renders_references: true,
    is_baseline: true,
    judge: Estimator::LcsPaper,
    ..PLAIN
};

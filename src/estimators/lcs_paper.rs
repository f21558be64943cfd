//! `lcs-paper`: light-cone shell queries as in the paper (Secs. 5 and 6). A 3D tree holds the points on emitters, a 4D tree the
//! scattered vertices. Each shade point sends K queries per tree, and one shadow ray per query.

use super::{PLAIN, PoolOrder, Record, TreeDefaults};
use crate::wgsl::layout::constants::ESTIMATOR_LCS_PAPER;

pub(super) static RECORD: Record = Record {
    name: "lcs-paper",
    is_default: |_| false,
    // The paper uses the same number of samples for all pixels.
    adaptive: false,
    // In the paper each leaf holds one vertex (Sec. 5.2).
    trees: Some(TreeDefaults { queries: 1, leaf_size: 1, single: false, by_importance: false }),
    pool_order: PoolOrder::Trees,
    constants: &[("ESTIMATOR", ESTIMATOR_LCS_PAPER)],
    slots: |pool| pool.queries * pool.trees,
    ..PLAIN
};

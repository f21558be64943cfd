//! `epc`: ellipsoidal path connections (Pediredla, Veeraraghavan and Gkioulekas 2019). As `bdpt`, but a connection that is too
//! short for the gate gets an auxiliary vertex on an ellipsoid. The path then has a travel time inside the gate.

use super::{Ellipsoids, PLAIN, PoolOrder, Record};
use crate::wgsl::layout::constants::ESTIMATOR_EPC;

pub(super) static RECORD: Record = Record {
    name: "epc",
    is_default: |_| false,
    pool_order: PoolOrder::ByPath,
    constants: &[("ESTIMATOR", ESTIMATOR_EPC)],
    slots: |pool| pool.longest_path,
    ellipsoids: Ellipsoids::Enumerated,
    ..PLAIN
};

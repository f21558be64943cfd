//! The equations of the paper's sections 4 and 5, in f64. Times and lengths are in metres of optical path, with c = 1.
//!
//! Gates are half-open, [lo, hi), while the paper's gates are closed. A gate with hi <= lo is empty.

use glam::DVec3;
use taugate::Gate;

/// Axis-aligned box with min <= max on every axis. It may be a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    pub min: DVec3,
    pub max: DVec3,
}

/// Extent of a node in space, and in accumulated travel time: the closed interval [lo, hi] with lo <= hi.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    pub bounds: Bounds,
    pub tau: [f64; 2],
}

/// Total travel time of a connection (Eqs. 6 and 15).
pub fn connection_tau(v: DVec3, v_tau: f64, q: DVec3, q_tau: f64) -> f64 {
    v_tau + (v - q).length() + q_tau
}

/// Whether a path of travel time `tau` is recorded (Eq. 3, half-open).
pub fn in_gate(gate: Gate, tau: f64) -> bool {
    gate.contains(tau)
}

/// Whether the light vertex lies in the light-cone shell of the shade point (Eq. 7).
pub fn in_shell(gate: Gate, v: DVec3, v_tau: f64, q: DVec3, q_tau: f64) -> bool {
    in_gate(gate, connection_tau(v, v_tau, q, q_tau))
}

/// Inner and outer radius of the shell at `v_tau` (Eqs. 8 and 9). The outer radius is negative if no connection can be valid.
pub fn shell_radii(gate: Gate, v_tau: f64, q_tau: f64) -> (f64, f64) {
    ((gate.lo - v_tau - q_tau).max(0.0), gate.hi - v_tau - q_tau)
}

/// The v_tau of a light vertex at `v` on the light cone of total travel time `tau` (Eq. 10).
pub fn cone_v_tau(tau: f64, v: DVec3, q: DVec3, q_tau: f64) -> f64 {
    tau - q_tau - (v - q).length()
}

/// Minimum and maximum distance from `q` to a box (d_min and d_max of Eq. 18). d_min is 0 inside the box.
pub fn distances(q: DVec3, bounds: Bounds) -> (f64, f64) {
    let (mut near, mut far) = (0.0, 0.0);
    for axis in 0..3 {
        let (below, above) = (bounds.min[axis] - q[axis], q[axis] - bounds.max[axis]);
        let gap = below.max(above).max(0.0);
        near += gap * gap;
        let reach = (q[axis] - bounds.min[axis]).abs().max((q[axis] - bounds.max[axis]).abs());
        far += reach * reach;
    }
    (near.sqrt(), far.sqrt())
}

/// Closed interval that contains the travel time of every connection between `q` and the node (Eq. 18).
pub fn tau_range(node: Extent, q: DVec3, q_tau: f64) -> (f64, f64) {
    let (d_min, d_max) = distances(q, node.bounds);
    (node.tau[0] + d_min + q_tau, node.tau[1] + d_max + q_tau)
}

/// Whether the node is pruned, because no vertex in it has a valid connection (Eq. 19). The test is conservative: if it is false,
/// the node may still have no valid vertex. A node that only touches hi is pruned, because the gate is half-open.
pub fn pruned(gate: Gate, node: Extent, q: DVec3, q_tau: f64) -> bool {
    let (min_tau, max_tau) = tau_range(node, q, q_tau);
    max_tau < gate.lo || min_tau >= gate.hi || gate.hi <= gate.lo
}

/// Effective power of a node of the 3D tree, where all v_tau are 0 (Eqs. 20 to 22), in [0, power]. If all distances are equal,
/// the equation is 0/0, and the result is 0 or `power`. A node with result 0 may still have a valid vertex at the end of the
/// range of distances; only [`pruned`] shows that it has none.
pub fn effective_power_3d(gate: Gate, power: f64, bounds: Bounds, q: DVec3, q_tau: f64) -> f64 {
    let (d_min, d_max) = distances(q, bounds);
    if d_min == d_max {
        return if in_gate(gate, d_min + q_tau) { power } else { 0.0 };
    }
    let overlap = d_max.min(gate.hi - q_tau) - d_min.max(gate.lo - q_tau);
    power * (overlap / (d_max - d_min)).clamp(0.0, 1.0)
}

/// Closed interval of bucket b, one of `count` equal parts of a node's travel times (Sec. 5.5.2). The last bucket ends exactly at
/// the node's end.
pub fn bucket_interval(tau: [f64; 2], count: usize, b: usize) -> [f64; 2] {
    let edge = |i: usize| tau[0] + (tau[1] - tau[0]) * i as f64 / count as f64;
    [edge(b), if b + 1 == count { tau[1] } else { edge(b + 1) }]
}

/// Index of the bucket that contains `v_tau`. The result is 0 if the node has only one time, which makes the index 0/0.
pub fn bucket_index(tau: [f64; 2], count: usize, v_tau: f64) -> usize {
    let width = tau[1] - tau[0];
    if width <= 0.0 {
        return 0;
    }
    (((v_tau - tau[0]) / width * count as f64) as usize).min(count - 1)
}

/// Whether bucket b can contain a valid vertex (Eq. 23, with a half-open gate).
pub fn bucket_valid(gate: Gate, node: Extent, count: usize, b: usize, q: DVec3, q_tau: f64) -> bool {
    let bucket = Extent { tau: bucket_interval(node.tau, count, b), ..node };
    !pruned(gate, bucket, q, q_tau)
}

/// Effective power of a node of the 4D tree: the sum of its valid buckets (Eq. 24).
pub fn effective_power_4d(gate: Gate, node: Extent, buckets: &[f64], q: DVec3, q_tau: f64) -> f64 {
    let valid = |b: &usize| bucket_valid(gate, node, buckets.len(), *b, q, q_tau);
    (0..buckets.len()).filter(valid).map(|b| buckets[b]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use taugate::internals::generate::numbers::Pcg;

    const UNIT: Bounds = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
    const GATE: Gate = Gate { lo: 10.0, hi: 12.0 };
    const EMPTY: Gate = Gate { lo: 10.0, hi: 10.0 };

    fn point(p: DVec3) -> Bounds {
        Bounds { min: p, max: p }
    }

    #[test]
    fn connections_by_hand() {
        let (v, q) = (DVec3::new(3.0, 4.0, 0.0), DVec3::ZERO);
        assert_eq!(connection_tau(v, 4.0, q, 2.0), 11.0);
        assert!(in_shell(GATE, v, 4.0, q, 2.0));
        assert!(in_shell(GATE, v, 3.0, q, 2.0));
        assert!(!in_shell(GATE, v, 5.0, q, 2.0));
        assert!(!in_shell(EMPTY, v, 3.0, q, 2.0));
        assert_eq!(shell_radii(GATE, 4.0, 2.0), (4.0, 6.0));
        assert_eq!(shell_radii(GATE, 9.0, 2.0), (0.0, 1.0));
        assert!(shell_radii(GATE, 9.0, 4.0).1 < 0.0);
        assert_eq!(cone_v_tau(11.0, v, q, 2.0), 4.0);
    }

    #[test]
    fn distances_by_hand() {
        assert_eq!(distances(DVec3::splat(0.5), UNIT), (0.0, 0.75f64.sqrt()));
        assert_eq!(distances(DVec3::new(3.0, 0.5, 0.5), UNIT), (2.0, 9.5f64.sqrt()));
        assert_eq!(distances(DVec3::new(-3.0, -4.0, 0.0), UNIT), (5.0, (16.0 + 25.0 + 1.0f64).sqrt()));
        assert_eq!(distances(DVec3::new(3.0, 4.0, 0.0), point(DVec3::ZERO)), (5.0, 5.0));
        assert_eq!(distances(DVec3::ONE, point(DVec3::ONE)), (0.0, 0.0));
    }

    #[test]
    fn pruning_by_hand() {
        let node = |lo, hi| Extent { bounds: point(DVec3::new(0.0, 0.0, 5.0)), tau: [lo, hi] };
        let at = |lo, hi| pruned(GATE, node(lo, hi), DVec3::ZERO, 1.0);
        assert_eq!(tau_range(node(2.0, 3.0), DVec3::ZERO, 1.0), (8.0, 9.0));
        assert!(at(2.0, 3.0));
        // The node reaches lo exactly, so one time is valid.
        assert!(!at(2.0, 4.0));
        assert!(!at(5.0, 8.0));
        // The node starts at hi exactly, so no time is valid in a half-open gate.
        assert!(at(6.0, 8.0));
        assert!(pruned(EMPTY, node(0.0, 100.0), DVec3::ZERO, 1.0));
    }

    #[test]
    fn a_pruned_node_holds_no_valid_vertex() {
        let mut pcg = Pcg::new(5);
        let mut vector = |scale: f64| DVec3::new(pcg.uniform(), pcg.uniform(), pcg.uniform()) * scale;
        let (mut valid, mut dead) = (0, 0);
        for _ in 0..20_000 {
            let (corner, size, q, inside, times) = (vector(4.0), vector(1.0), vector(4.0), vector(1.0), vector(4.0));
            let node = Extent { bounds: Bounds { min: corner, max: corner + size }, tau: [times.x, times.x + times.y] };
            let (v, v_tau) = (corner + inside * size, times.x + inside.y * times.y);
            let gate = Gate { lo: 5.0 + times.z, hi: 5.2 + times.z };
            let is_valid = in_shell(gate, v, v_tau, q, 1.0);
            let mut buckets = [0.0; 8];
            buckets[bucket_index(node.tau, 8, v_tau)] = 3.0;
            if is_valid {
                valid += 1;
                assert!(!pruned(gate, node, q, 1.0));
                assert_eq!(effective_power_4d(gate, node, &buckets, q, 1.0), 3.0);
            }
            dead += usize::from(pruned(gate, node, q, 1.0));
        }
        assert!(valid > 200 && dead > 2_000, "{valid} {dead}");
    }

    #[test]
    fn power_3d_by_hand() {
        // Along the x axis the box spans distances 9 to sqrt(102).
        let (q, far) = (DVec3::new(10.0, 0.0, 0.0), 102f64.sqrt());
        let expected = 4.0 * (far - 10.0) / (far - 9.0);
        assert!((effective_power_3d(GATE, 4.0, UNIT, q, 0.0) - expected).abs() < 1e-12);
        assert_eq!(effective_power_3d(GATE, 4.0, UNIT, q, 1.0), 4.0);
        assert_eq!(effective_power_3d(GATE, 4.0, UNIT, q, 5.0), 0.0);
        assert_eq!(effective_power_3d(EMPTY, 4.0, UNIT, q, 1.0), 0.0);
        // All vertices are at one point, so the equation is 0/0.
        let one = point(DVec3::ZERO);
        assert_eq!(effective_power_3d(GATE, 4.0, one, q, 0.0), 4.0);
        assert_eq!(effective_power_3d(GATE, 4.0, one, q, 2.0), 0.0);
        assert_eq!(effective_power_3d(EMPTY, 4.0, one, q, 0.0), 0.0);
        // q is inside the box.
        let inside = effective_power_3d(Gate { lo: 0.0, hi: 0.5 }, 4.0, UNIT, DVec3::splat(0.5), 0.0);
        assert!((inside - 4.0 * 0.5 / 0.75f64.sqrt()).abs() < 1e-12);
        // With an open gate, the effective power is the whole power.
        assert_eq!(effective_power_3d(Gate::OPEN, 4.0, UNIT, q, 1.0), 4.0);
    }

    #[test]
    fn buckets_by_hand() {
        assert_eq!(bucket_interval([2.0, 6.0], 4, 1), [3.0, 4.0]);
        assert_eq!(bucket_interval([2.0, 6.0], 4, 3), [5.0, 6.0]);
        assert_eq!(bucket_interval([2.0, 2.0], 4, 3), [2.0, 2.0]);
        assert_eq!(bucket_index([2.0, 6.0], 4, 2.0), 0);
        assert_eq!(bucket_index([2.0, 6.0], 4, 3.0), 1);
        assert_eq!(bucket_index([2.0, 6.0], 4, 6.0), 3);
        assert_eq!(bucket_index([2.0, 2.0], 4, 2.0), 0);

        let node = Extent { bounds: point(DVec3::new(0.0, 0.0, 5.0)), tau: [2.0, 10.0] };
        // The buckets have total times [7.5, 9.5), [9.5, 11.5), [11.5, 13.5), [13.5, 15.5). The gate overlaps the middle two.
        let power = effective_power_4d(GATE, node, &[1.0, 2.0, 4.0, 8.0], DVec3::ZERO, 0.5);
        assert_eq!(power, 6.0);
        assert_eq!(effective_power_4d(GATE, node, &[15.0], DVec3::ZERO, 0.5), 15.0);
        assert_eq!(effective_power_4d(EMPTY, node, &[15.0], DVec3::ZERO, 0.5), 0.0);
        // If all vertices have one time, every bucket is that time, and the first bucket has all the power.
        let one = Extent { tau: [5.0, 5.0], ..node };
        assert_eq!(effective_power_4d(GATE, one, &[3.0, 0.0], DVec3::ZERO, 0.5), 3.0);
    }
}

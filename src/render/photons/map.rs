//! Sorts photons into cubic cells, for `shared/photon.wgsl`.

use rayon::prelude::*;

use crate::render::plan::Plan;
use crate::wgsl::layout::Photon;
use crate::wgsl::layout::constants::VERTEX_IN_MEDIUM;

/// The levels of no cells.
pub const NO_LEVELS: [i32; 2] = [0, -1];
/// A coordinate of a cell has at most this many bits, so that all of them fit into `i32`.
const COORDINATE_BITS: i32 = 28;

/// The photons of an iteration in lists: a list holds the photons of some cells (`photon_list` in `shared/photon.wgsl`).
pub struct PhotonMap {
    pub photons: Vec<Photon>,
    /// Start of each list in `photons`, and the end of the last one.
    pub lists: Vec<u32>,
    /// The lowest and the highest level of the photons.
    pub levels: [i32; 2],
}

impl Default for PhotonMap {
    fn default() -> Self {
        PhotonMap { photons: vec![], lists: vec![], levels: NO_LEVELS }
    }
}

impl PhotonMap {
    /// Sorts photons into cells that suit the radii of shade points in their place.
    pub fn new(mut photons: Vec<Photon>, plan: &Plan, iteration: u32) -> PhotonMap {
        if photons.is_empty() {
            return PhotonMap::default();
        }
        let farthest = photons.par_iter().map(|p| p.position.map(f32::abs).into_iter().fold(0.0, f32::max));
        let finest = level(farthest.reduce(|| 0.0, f32::max)) - COORDINATE_BITS;
        photons.par_iter_mut().for_each(|p| {
            let in_medium = p.flags & VERTEX_IN_MEDIUM != 0;
            p.level = level(plan.straight_merge_radius(iteration, p.position, in_medium)).max(finest);
        });
        let levels = || photons.iter().map(|photon| photon.level);
        let levels = [levels().min().unwrap_or(0), levels().max().unwrap_or(0)];
        let lists = photons.len().next_power_of_two();
        let keys: Vec<u32> = photons.par_iter().map(|photon| photon_list(photon) & (lists as u32 - 1)).collect();
        // Counting sort. The photons of a list stay in their order, so the sum at a shade point has the same bits everywhere.
        let mut starts = vec![0u32; lists + 1];
        keys.iter().for_each(|&key| starts[key as usize + 1] += 1);
        for k in 0..lists {
            starts[k + 1] += starts[k];
        }
        let mut next = starts.clone();
        let mut sorted = vec![bytemuck::Zeroable::zeroed(); photons.len()];
        for (photon, key) in photons.into_iter().zip(keys) {
            let place = &mut next[key as usize];
            sorted[*place as usize] = photon;
            *place += 1;
        }
        PhotonMap { photons: sorted, lists: starts, levels }
    }
}

/// The level of the cells for a radius: see `photon_level` in `shared/photon.wgsl`. Between -100 and 100, so that sides are finite.
fn level(radius: f32) -> i32 {
    ((radius.to_bits() >> 23) as i32 - 127).clamp(-100, 100)
}

/// The hash of the photon's cell: see `photon_list` in `shared/photon.wgsl`.
fn photon_list(photon: &Photon) -> u32 {
    let cells_per_length = f32::from_bits(((126 - photon.level) as u32) << 23);
    let [x, y, z] = photon.position.map(|x| (x * cells_per_length).floor() as i32 as u32);
    let hash = x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791);
    hash ^ (photon.level as u32).wrapping_mul(2_654_435_769)
}

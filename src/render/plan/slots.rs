//! Numbers of candidate slots per shade point.

use super::Plan;
use crate::render::emitters::EmitterSet;
use crate::render::photons::NO_LEVELS;
use crate::render::pool_layout::PoolLayout;
use crate::wgsl::layout::NONE;
use crate::wgsl::layout::constants::DETERMINISTIC_SLOTS;

impl Plan {
    /// Number of candidate slots per shade point for a pool, at least 1.
    pub fn slots(&self, pool: &PoolLayout) -> u32 {
        debug_assert!(pool.longest_path <= self.max_depth);
        let deterministic = pool.deterministic.min(DETERMINISTIC_SLOTS);
        let [strata, cycle] = self.event_strata(&self.responses);
        let drawn = if self.draws_in_gate() { deterministic * strata.div_ceil(cycle) } else { 0 };
        let chosen = (self.estimator.slots)(&pool.shape(self.frame.queries, self.time_groups()));
        (drawn + deterministic + u32::from(self.has_sky) + chosen).max(1)
    }

    /// Maximum number of candidate slots per shade point over all possible pools.
    pub fn max_slots(&self, emitters: &EmitterSet) -> u32 {
        let punctual = emitters.deterministic.len() as u32;
        let queried = self.queries_deterministic(self.max_deterministic);
        let (spatial, all) = match self.single_tree {
            true => (queried, emitters.has_area() || self.traces_light || queried),
            false => (emitters.has_area() || queried, self.traces_light || queried),
        };
        self.slots(&PoolLayout {
            // If thin beams miss everything, only the punctual lights are left. They may be few enough for one slot each.
            deterministic: if self.queries_deterministic(punctual) { 0 } else { self.max_deterministic },
            emitter_vertices: u32::from(emitters.has_area()),
            tree3_root: if spatial { 0 } else { NONE },
            tree4_root: if all { 0 } else { NONE },
            longest_path: self.max_depth,
            vertices: 0,
            photon_list_mask: 0,
            photon_levels: NO_LEVELS,
        })
    }

    /// A number of candidate slots that [`Plan::slots`] never exceeds, whatever the pool is.
    pub fn slot_limit(&self) -> u32 {
        self.slots(&PoolLayout {
            deterministic: if self.max_deterministic > 0 { DETERMINISTIC_SLOTS } else { 0 },
            emitter_vertices: 1,
            tree3_root: 0,
            tree4_root: 0,
            longest_path: self.max_depth,
            vertices: 0,
            photon_list_mask: 0,
            photon_levels: NO_LEVELS,
        })
    }
}

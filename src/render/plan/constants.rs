//! The constants of a render's kernels, and the choices behind them. These values decide which code the kernels contain.

use super::{Observe, Plan};
use crate::estimators::{Ellipsoids, PoolOrder};
use crate::gpu::shader::HARDWARE_RAYS;
use crate::scene::Scene;
use crate::settings::Responses;
use crate::wgsl::layout::constants::{
    DETERMINISTIC_SLOTS, OBSERVE_RESPONSES, OBSERVE_STRATEGIES, OBSERVE_TIMES, SLOTS_PER_MARK,
};

/// Maximum number of events in fog that a sample draws for a histogram on its first segment.
const MAX_EVENTS: u32 = 48;

impl Plan {
    /// Values of the WGSL `override` constants of all kernels.
    pub fn constants(&self) -> Vec<(&'static str, f64)> {
        let observe = match self.observe {
            Observe::Nothing => 0,
            Observe::Times => OBSERVE_TIMES,
            Observe::Strategies => OBSERVE_STRATEGIES,
            Observe::Responses => OBSERVE_RESPONSES,
        };
        let switch = |on: bool| if on { 1.0 } else { 0.0 };
        let queried = self.queries_deterministic(self.max_deterministic);
        let [strata, cycle] = self.event_strata(&self.responses);
        let mut constants = self.features.constants().to_vec();
        constants.extend([
            ("HAS_MANY_SLOTS", switch(self.slot_limit() > SLOTS_PER_MARK)),
            ("WORKGROUP", self.tuning.workgroup.into()),
            ("HAS_PARALLEL", switch(self.has_distant || self.camera_kind.is_orthographic)),
            ("HAS_OWN_LASERS", switch(self.has_own_lasers)),
            ("LASER_RADIUS", self.laser_radius),
            ("HAS_GAP", switch(self.frame.gap_lo < self.frame.gap_hi)),
            ("HAS_DOPPLER", switch(self.records_doppler || self.range_coupling != 0.0)),
            ("RECORDS_DOPPLER", switch(self.records_doppler)),
            ("RANGE_COUPLING", self.range_coupling),
            ("HAS_SKY", switch(self.has_sky)),
            ("MERGES", switch(self.merging.is_some())),
            ("MERGED_ENTRIES", self.merged_entries().into()),
            ("DRAWS_IN_GATE", switch(self.draws_in_gate())),
            ("DRAWS_ON_BEAMS", switch(self.draws_on_beams())),
            ("HAS_ELLIPSOIDS", switch(self.estimator.ellipsoids != Ellipsoids::None)),
            ("RESAMPLES_ELLIPSOIDS", switch(self.estimator.ellipsoids == Ellipsoids::Resampled)),
            ("GUIDES_FLIGHTS", switch(self.guides_flights())),
            ("EVENT_STRATA", strata.into()),
            ("EVENT_CYCLE", cycle.into()),
            ("BUCKET_COUNT", self.buckets.into()),
            ("FRONTIER", self.frontier.into()),
            ("QUERIED_PUNCTUAL", switch(queried)),
            ("BY_CENTRE", switch(self.importance.centre)),
            ("BY_COSINE", switch(self.importance.cosine)),
            ("BY_OVERLAP", switch(self.importance.overlap)),
            ("BY_GLOSS", switch(self.importance.gloss)),
            ("OBSERVE", observe.into()),
            ("TIME_GROUPS", self.time_groups().into()),
        ]);
        constants.extend(self.camera_kind.constants().map(|(name, on)| (name, switch(on))));
        constants.extend(self.media_constants);
        constants.extend(self.hardware_rays.then_some((HARDWARE_RAYS, 1.0)));
        constants.extend(self.estimator.constants.iter().map(|&(name, value)| (name, value.into())));
        constants
    }

    /// Whether queries choose among `count` deterministic vertices. Otherwise each shade point connects to all of them, or to
    /// `DETERMINISTIC_SLOTS` drawn ones if there are more.
    pub fn queries_deterministic(&self, count: u32) -> bool {
        self.estimator.pool_order == PoolOrder::Trees && count > DETERMINISTIC_SLOTS
    }

    /// Whether the estimator uses the gate to choose where paths scatter in media. It cannot do so in scenes with null boundaries, or with
    /// thin glass that delays light, because it does not know which of them lie on segments that it does not trace.
    fn uses_gate_in_media(&self) -> bool {
        self.has_media && self.estimator.draws_in_gate && !self.features.null_boundaries && !self.features.delays
    }

    /// Whether sensor subpaths fly towards the places from which light can arrive inside the gate. The choice of these
    /// places assumes that light is nowhere faster than outside of solids.
    fn guides_flights(&self) -> bool {
        self.uses_gate_in_media() && !self.has_fast_solids
    }

    /// Whether events in media are drawn inside the gate, for connections to deterministic vertices.
    pub fn draws_in_gate(&self) -> bool {
        self.uses_gate_in_media() && self.max_deterministic <= DETERMINISTIC_SLOTS
    }

    /// The values of EVENT_STRATA and EVENT_CYCLE for these responses (`shared/event_strata.wgsl`).
    pub(super) fn event_strata(&self, responses: &Responses) -> [u32; 2] {
        let is_aimed = self.observe == Observe::Responses && self.camera_kind.aims > 0;
        match responses.uniform() {
            // Few scans have iterations of less than 16 samples, so most of them serve all strata.
            Some(gates) if is_aimed && self.draws_in_gate() && responses.support().hi.is_finite() => {
                [gates.count(), gates.count().div_ceil(MAX_EVENTS).next_power_of_two()]
            }
            _ => [1, 1],
        }
    }

    /// Whether events on the lines of beams are also drawn inside the gate, for connections to the sensor (t = 1). Not for
    /// orthographic cameras and apertures: `gate_interval` takes the sensor as a point.
    pub fn draws_on_beams(&self) -> bool {
        let is_point = !self.camera_kind.is_orthographic && !self.camera_kind.has_aperture;
        self.draws_in_gate() && self.splats && self.beam_share > 0.0 && is_point
    }

    /// Number of parts of the gate; a query kernel may choose a vertex for each part.
    pub(super) fn time_groups(&self) -> u32 {
        match self.observe {
            Observe::Responses => self.estimator.time_groups,
            _ => 1,
        }
    }
}

/// Whether light is faster in a transmitting solid than outside, where it travels with `group_index`.
pub fn has_fast_solids(scene: &Scene, group_index: f32) -> bool {
    scene
        .materials
        .iter()
        .any(|material| material.transmits() && material.thin != Some(true) && material.group_index() < group_index)
}

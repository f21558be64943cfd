//! What follows from the gate, the responses and moved lights: the fields of the frame for them, and whether all is dark.

use glam::Vec3;

use super::{OPEN, Plan, bounds};
use crate::estimators::Ellipsoids;
use crate::lightcone::gate::rounding_allowance;
use crate::render::prepared_scene::PreparedScene;
use crate::settings::Responses;
use crate::settings::units::Gate;
use crate::wgsl::layout::constants::MEAN_ARC;

impl Plan {
    /// Follows lights that have moved. `prepared` is the prepared scene that the plan was made for, after
    /// [`PreparedScene::follow`] or [`PreparedScene::follow_nearby`].
    pub fn set_lights(&mut self, prepared: &PreparedScene) {
        (self.frame.emitter_lo, self.frame.emitter_hi) = bounds(&prepared.emitters);
        self.travel_time_bounds = prepared.travel_time_bounds(self.max_depth);
        self.set(self.frame.seed, self.responses.clone());
    }

    /// Sets the seed and the responses. Then sets `dark` and the fields of the frame that depend on the gate and on the camera.
    pub fn set(&mut self, seed: u32, responses: Responses) {
        let gate = responses.support();
        // A gap would have to be narrower where thin glass may still delay the light.
        let gap = responses.gap().filter(|_| !self.features.delays);
        let gap = gap.map_or([OPEN; 2], |gap| [gap.lo, gap.hi].map(|end| self.space.length(end) as f32));
        [self.frame.gap_lo, self.frame.gap_hi] = gap;
        self.responses = responses;
        // The distance to a point or to a convex box, such as `prepared_sensor`, is largest at a corner of the sensor.
        let farthest =
            |distance: &dyn Fn(Vec3) -> f64| self.sensor_corners.map(distance).into_iter().fold(0.0, f64::max);
        let from_origin = farthest(&|corner| corner.as_dvec3().length());
        let moved = farthest(&|corner| self.prepared_sensor.distance_to(corner));
        let travel_time_bounds = self.travel_time_bounds.moved(moved * self.space.unit).without(self.uncounted);
        self.dark = self.cull && !gate.is_open() && !travel_time_bounds.overlaps(&gate);
        let uncounted = self.space.length(self.uncounted * self.group_index);
        let gate = Gate { lo: self.space.length(gate.lo), hi: self.space.length(gate.hi) };
        // If the ways to and from a wall do not count, light that comes straight back has travel time 0 up to rounding. A gate that
        // begins at 0 must keep this light even if rounding makes its travel time negative.
        let gate = if gate.lo == 0.0 && uncounted > 0.0 { Gate { lo: -uncounted, ..gate } } else { gate };
        let closed = gate.hi.is_finite();
        let hi = if closed { gate.hi as f32 } else { OPEN };
        let rounding_allowance = rounding_allowance(gate, from_origin + uncounted);
        self.frame.seed = seed;
        self.frame.undelayed_lo = gate.lo as f32;
        // An ellipsoidal connection has two segments that thin glass may delay.
        let delayed_segments = if self.estimator.ellipsoids == Ellipsoids::None { 1.0 } else { 2.0 };
        let max_delay = delayed_segments * self.max_delay;
        self.frame.gate_lo = (gate.lo - max_delay) as f32;
        self.frame.gate_hi = hi;
        self.frame.rounding_allowance = rounding_allowance;
        self.frame.merge_slot = if closed { ((gate.hi - gate.lo) / self.responses.len() as f64) as f32 } else { OPEN };
        let width = gate.hi - gate.lo + max_delay;
        // A detour is at least as long as the gate is wide. If the path with the detour is inside the gate, the straight connection
        // is too short for the gate. So no pair of vertices has both kinds of connections. Detours must also be longer than their
        // rounding errors. They lie outside of solids, so their travel time per length is `group_index`.
        let detour = width.max(rounding_allowance.into()) / self.group_index;
        self.frame.min_detour = if closed { detour as f32 } else { OPEN };
        self.frame.auxiliary_density = (f64::from(self.estimator.ellipsoid_sample_count) * self.group_index
            / (width * f64::from(MEAN_ARC))) as f32;
        self.frame.cull_hi = if self.cull && closed { hi + rounding_allowance } else { OPEN };
        self.uncounted_time = uncounted as f32;
    }

    /// Whether a render with these kernels can begin again with `responses`.
    pub fn can_have(&self, responses: &Responses) -> bool {
        let kind = |responses: &Responses| {
            let strata = self.event_strata(responses);
            (
                responses.is_single_box(),
                responses.chirp(),
                responses.gap().is_some(),
                self.choice.is_histogram(responses),
                strata,
            )
        };
        kind(&self.responses) == kind(responses)
    }

    /// Whether the render then has the same bits as a new render with `responses`.
    pub fn has_bits_of(&self, responses: &Responses) -> bool {
        self.can_have(responses) && std::ptr::eq(self.estimator, self.choice.record(responses))
    }
}

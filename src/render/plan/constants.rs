//! The constants of a render's kernels. These values decide which code the kernels contain.

use super::{Observe, Plan};
use crate::estimators::Ellipsoids;
use crate::wgsl::layout::constants::{OBSERVE_RESPONSES, OBSERVE_STRATEGIES, OBSERVE_TIMES};

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
        let mut constants = self.features.constants().to_vec();
        constants.extend([
            ("WORKGROUP", self.tuning.workgroup.into()),
            ("HAS_PARALLEL", switch(self.has_distant || self.is_orthographic)),
            ("HAS_ORTHOGRAPHIC", switch(self.is_orthographic)),
            ("HAS_AIMS", switch(self.aims > 0)),
            ("HAS_HOLE", switch(self.frame.hole_lo < self.frame.hole_hi)),
            ("HAS_SKY", switch(self.has_sky)),
            ("DRAWS_IN_GATE", switch(self.draws_in_gate())),
            ("HAS_ELLIPSOIDS", switch(self.estimator.ellipsoids != Ellipsoids::None)),
            ("RESAMPLES_ELLIPSOIDS", switch(self.estimator.ellipsoids == Ellipsoids::Resampled)),
            ("GUIDES_FLIGHTS", switch(self.moves_events())),
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
        constants.extend(self.media_constants);
        constants.extend(self.estimator.constants.iter().map(|&(name, value)| (name, value.into())));
        constants
    }
}

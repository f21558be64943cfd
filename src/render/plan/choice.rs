//! Which record of an estimator a render uses.

use crate::error::{Error, Result};
use crate::estimators::Record;
use crate::render::prepared_scene::PreparedScene;
use crate::scene::Scene;
use crate::settings::units::Gate;
use crate::settings::{Estimator, Responses, Settings, Strategies, UseEllipsoids};

/// With several responses, the estimator's record for histograms is used if their support is longer than this fraction of the
/// scene's diagonal. A shorter support misses most light vertices; queries find the rest.
const HISTOGRAM_WIDTH: f64 = 0.1;

/// Gates that are narrower than this fraction of the scene's diagonal, and of their own end, have ellipsoidal connections, if the estimator has a record for
/// thin gates (docs/notebook/ellipsoids-by-importance.md).
const THIN_GATE: f64 = 0.0004;

/// The conditions, besides the responses, that decide which record of an estimator a render uses.
pub struct Choice {
    estimator: Estimator,
    /// Diagonal of the scene in metres.
    diagonal: f64,
    /// Whether the gate has ellipsoidal connections. `None`: only if the gate is thin.
    ellipsoids: Option<bool>,
}

impl Choice {
    /// Fails if ellipsoidal connections are wanted in a scene that cannot have them.
    pub fn new(scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Result<Choice> {
        let has_media = !prepared.media.list.is_empty();
        let ellipsoids = match settings.ellipsoids() {
            UseEllipsoids::Auto if has_media || settings.strategies() == Strategies::Paper => Some(false),
            UseEllipsoids::Auto => None,
            UseEllipsoids::On if has_media => {
                return Err(Error::Settings(
                    "--ellipsoids on is not possible in a scene with participating media; leave it out, or use --estimator epc"
                        .into(),
                ));
            }
            wanted => Some(wanted == UseEllipsoids::On),
        };
        let choice = Choice { estimator: settings.estimator(), diagonal: scene.diagonal(), ellipsoids };
        if ellipsoids == Some(true) && choice.is_histogram(settings.responses()) {
            return Err(Error::Settings(
                "--ellipsoids on is not possible with gates that cover a tenth of the scene's diagonal or more; leave it out, or \
                 render thin gates one by one"
                    .into(),
            ));
        }
        Ok(choice)
    }

    /// The record for these responses.
    pub fn record(&self, responses: &Responses) -> &'static Record {
        let record = self.estimator.record();
        // Travel times of ellipsoidal connections are drawn from the whole support, also from its hole.
        let is_thin = self.ellipsoids.unwrap_or(is_thin(responses.support(), self.diagonal));
        let special = match self.is_histogram(responses) {
            true => record.for_histograms,
            false => record.for_thin_gates.filter(|_| is_thin),
        };
        special.unwrap_or(record)
    }

    /// Whether nearly every light vertex meets some of these responses, and the estimator has a record for that.
    pub fn is_histogram(&self, responses: &Responses) -> bool {
        let has_record = self.estimator.record().for_histograms.is_some();
        has_record && !responses.is_single_box() && lit_length(responses) > HISTOGRAM_WIDTH * self.diagonal
    }
}

/// Total length in metres of the intervals of travel time that count for some response.
fn lit_length(responses: &Responses) -> f64 {
    length(responses.support()) - responses.hole().map_or(0.0, length)
}

/// Whether a gate is thin in a scene of this diagonal. Light that ends in the gate has travelled no further than its end, except in
/// scans that leave out the first or last way. So objects beyond that, such as a distant backdrop, make no gate thin.
fn is_thin(gate: Gate, diagonal: f64) -> bool {
    length(gate) < THIN_GATE * diagonal.min(gate.hi)
}

fn length(gate: Gate) -> f64 {
    gate.hi - gate.lo
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distant_backdrop_makes_no_gate_thin() {
        let gate = |lo: f64, width: f64| Gate { lo, hi: lo + width };
        assert!(is_thin(gate(6.0, 0.001), 4.0));
        assert!(!is_thin(gate(6.0, 0.01), 4.0));
        assert!(!is_thin(gate(6.0, 0.01), 14_000.0));
        assert!(is_thin(gate(6.0, 0.001), 14_000.0));
        assert!(!is_thin(Gate { lo: 6.0, hi: f64::INFINITY }, 14_000.0));
    }
}

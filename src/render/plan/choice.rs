//! Which record of an estimator a render uses.

use crate::error::{Error, Result};
use crate::estimators::{Ellipsoids, Record};
use crate::gpu::Quirks;
use crate::render::prepared_scene::PreparedScene;
use crate::render::velocities;
use crate::scene::Scene;
use crate::settings::units::Gate;
use crate::settings::{Estimator, Responses, Settings, Strategies, UseEllipsoids};

/// The estimator's record for histograms is used if the support, without its gap, is longer than this fraction of the scene's
/// diagonal. A single box ([`Responses::is_single_box`]) never uses this record. Most light vertices miss a shorter support; queries
/// find the others.
const HISTOGRAM_WIDTH: f64 = 0.1;

/// With `--ellipsoids auto`, a gate has ellipsoidal connections if it is narrower than this fraction of the scene's diagonal, and of
/// its own end. The estimator must have a record for thin gates (docs/notebook/ellipsoids-by-importance.md).
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
    /// Fails if `--ellipsoids on` meets participating media, or responses that need the record for histograms.
    pub fn new(scene: &Scene, settings: &Settings, prepared: &PreparedScene, quirks: Quirks) -> Result<Choice> {
        let has_media = !prepared.media.list.is_empty();
        let has_doppler = velocities::are_needed(settings);
        let ellipsoids = match settings.ellipsoids() {
            UseEllipsoids::Auto
                if has_media || has_doppler || settings.strategies() == Strategies::Paper || quirks.slow_ellipsoids =>
            {
                Some(false)
            }
            UseEllipsoids::Auto => None,
            UseEllipsoids::On if has_media => {
                return Err(Error::advice(
                    "--ellipsoids on is not possible in a scene with participating media; ",
                    "leave it out, or use --estimator epc",
                ));
            }
            UseEllipsoids::On if has_doppler => {
                return Err(Error::advice(
                    "--ellipsoids on is not possible with --doppler or --fmcw: ",
                    "leave out one of them",
                ));
            }
            wanted => Some(wanted == UseEllipsoids::On),
        };
        if has_doppler && settings.estimator().record().ellipsoids == Ellipsoids::Enumerated {
            return Err(Error::advice(
                "--estimator epc is not possible with --doppler or --fmcw; ",
                "use lcs, bdpt or pt",
            ));
        }
        let choice = Choice { estimator: settings.estimator(), diagonal: scene.diagonal(), ellipsoids };
        if ellipsoids == Some(true) && choice.is_histogram(settings.responses()) {
            return Err(Error::advice(
                "--ellipsoids on is not possible with gates that cover a tenth of the scene's diagonal or more; ",
                "leave it out, or render thin gates one by one",
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

    /// Whether the estimator has a record for histograms, and these responses are wide enough for it (see `HISTOGRAM_WIDTH`).
    pub fn is_histogram(&self, responses: &Responses) -> bool {
        let has_record = self.estimator.record().for_histograms.is_some();
        has_record && !responses.is_single_box() && lit_length(responses) > HISTOGRAM_WIDTH * self.diagonal
    }
}

/// Length in metres of the support without its gap ([`Responses::gap`]).
fn lit_length(responses: &Responses) -> f64 {
    length(responses.support()) - responses.gap().map_or(0.0, length)
}

/// Whether a gate is thin in a scene of this diagonal. Light in the gate has travelled at most `gate.hi`, except in scans whose travel
/// times leave out the first or last segment. So objects beyond `gate.hi`, such as a distant backdrop, do not make a gate thin.
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

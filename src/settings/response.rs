//! One response of the sensor: the weight that it gives to light as a function of its travel time.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::settings::units::Gate;

/// Maximum length of a gate with its edges, in periods of a pulsed laser. Each arrival takes one step per period of the gate.
pub(super) const MAX_PERIODS: f64 = 1000.0;

/// Standard deviations at which a Gaussian edge is cut off.
const GAUSS_CUT: f64 = 4.0;
/// Part of a Gaussian beyond the cut, on each side.
static BEYOND_CUT: LazyLock<f64> = LazyLock::new(|| gaussian_before(-GAUSS_CUT));

/// Part of a Gaussian before `x` standard deviations.
fn gaussian_before(x: f64) -> f64 {
    0.5 * libm::erfc(-x / std::f64::consts::SQRT_2)
}

/// How the weight rises and falls at the ends of a gate. Where two gates with the same edges abut, their weights add up to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Edge {
    /// From 0 to 1 at once.
    Sharp,
    /// A straight line of this length in metres, half of it inside the gate: the gate convolved with a box.
    Ramp(f64),
    /// The gate convolved with a Gaussian of this standard deviation in metres, which is cut off at 4 standard deviations.
    Gauss(f64),
}

impl Edge {
    /// How far the edge extends outside of the gate, in metres.
    fn reach(self) -> f64 {
        match self {
            Edge::Sharp => 0.0,
            Edge::Ramp(length) => 0.5 * length,
            Edge::Gauss(sigma) => GAUSS_CUT * sigma,
        }
    }

    /// Weight at `x` metres after the begin of a gate without an end.
    fn rise(self, x: f64) -> f64 {
        match self {
            Edge::Sharp => f64::from(x >= 0.0),
            Edge::Ramp(length) => (x / length + 0.5).clamp(0.0, 1.0),
            Edge::Gauss(sigma) => {
                let cut = *BEYOND_CUT;
                ((gaussian_before(x / sigma) - cut) / (1.0 - 2.0 * cut)).clamp(0.0, 1.0)
            }
        }
    }
}

/// A measured response: travel times in metres, in ascending order, and weights, which are linear between them. Before the first
/// and after the last time the weight is 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Table {
    rows: Vec<[f64; 2]>,
    file: Option<PathBuf>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Weight {
    Gate {
        gate: Gate,
        edge: Edge,
    },
    Table(Table),
    /// (1 + cos(2 pi (tau / period + quarter / 4))) / 2. `quarter`: phase offset in quarter turns, 0 to 3.
    Wave {
        period: f64,
        quarter: u32,
    },
}

/// A response of the sensor: a name, and a weight for every travel time. The image of a response is the light of each travel time
/// times its weight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Response {
    name: String,
    weight: Weight,
    /// Period of a pulsed laser: travel time after which the weight repeats, in metres of optical path; `None` for a single pulse.
    /// A wave keeps its period in [`Weight::Wave`].
    period: Option<f64>,
}

impl Response {
    /// Weight 1 inside `gate` and 0 outside. `edge` shapes the weight near the ends. [`Responses::new`](super::Responses::new) and
    /// [`SettingsBuilder::build`](super::SettingsBuilder::build) check name, gate and edge.
    pub fn new(name: impl Into<String>, gate: Gate, edge: Edge) -> Response {
        Response { name: name.into(), weight: Weight::Gate { gate, edge }, period: None }
    }

    /// Weights that are linear between `rows` of travel time in metres and weight, and 0 before and after. Two rows with the same
    /// time make a step. Fails if there are fewer than two rows, if the times are negative or descend, if a number is not finite, or
    /// if a weight is negative or all are 0. `file`: where the rows come from.
    pub fn table(name: impl Into<String>, rows: Vec<[f64; 2]>, file: Option<&Path>) -> Result<Response> {
        let fail = |message: &str| Err(Error::settings(message));
        if rows.len() < 2 {
            return fail("a response needs at least two rows of travel time and weight");
        }
        if rows.iter().flatten().any(|x| !x.is_finite() || *x < 0.0) {
            return fail(
                "a response has a number that is negative or not finite; travel times and weights are at least 0",
            );
        }
        if !rows.is_sorted_by(|a, b| a[0] <= b[0]) {
            return fail("the travel times of a response are not in ascending order; sort its rows");
        }
        if rows.iter().all(|row| row[1] == 0.0) {
            return fail("all weights of a response are 0, so no light would count");
        }
        Gate::new(rows[0][0], rows[rows.len() - 1][0])?;
        let table = Table { rows, file: file.map(Path::to_path_buf) };
        Ok(Response { name: name.into(), weight: Weight::Table(table), period: None })
    }

    /// The weight (1 + cos(2 pi (tau / `period` + `quarter` / 4))) / 2 for light of every travel time tau. `period` is in metres of
    /// optical path. `quarter`: phase offset in quarter turns, 0 to 3.
    pub(super) fn wave(name: String, period: f64, quarter: u32) -> Response {
        Response { name, weight: Weight::Wave { period, quarter }, period: None }
    }

    /// The response to a pulsed laser with this period, in metres of optical path, > 0. Light of an earlier or a later pulse falls
    /// into the same gate, so the weights of all travel times tau + k `period` count: range folding. The gate with its edges may be at
    /// most 1000 periods long.
    pub fn repeated(self, period: f64) -> Response {
        Response { period: Some(period), ..self }
    }

    /// The period of a wave in metres of optical path; `None` for other responses.
    pub(crate) fn wave_period(&self) -> Option<f64> {
        match self.weight {
            Weight::Wave { period, .. } => Some(period),
            Weight::Gate { .. } | Weight::Table(_) => None,
        }
    }

    /// The period of a pulsed laser in metres of optical path; `None` for a single pulse or a wave.
    pub fn period(&self) -> Option<f64> {
        self.period
    }

    /// Name of the response.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The gate of the first pulse, without its edges. For a table: its first and last time. [`Gate::OPEN`] if all light may count.
    pub fn gate(&self) -> Gate {
        match &self.weight {
            Weight::Gate { gate, .. } => *gate,
            Weight::Table(table) => Gate { lo: table.rows[0][0], hi: table.rows[table.rows.len() - 1][0] },
            Weight::Wave { .. } => Gate::OPEN,
        }
    }

    /// The edges of the gate; `None` for a table or a wave.
    pub fn edge(&self) -> Option<Edge> {
        match &self.weight {
            Weight::Gate { edge, .. } => Some(*edge),
            Weight::Table(_) | Weight::Wave { .. } => None,
        }
    }

    /// The file of a table, if it comes from one.
    pub fn file(&self) -> Option<&Path> {
        match &self.weight {
            Weight::Gate { .. } | Weight::Wave { .. } => None,
            Weight::Table(table) => table.file.as_deref(),
        }
    }

    /// The rows of a table: travel times in metres, and weights.
    pub(crate) fn rows(&self) -> Option<&[[f64; 2]]> {
        match &self.weight {
            Weight::Gate { .. } | Weight::Wave { .. } => None,
            Weight::Table(table) => Some(&table.rows),
        }
    }

    /// A gate outside of which the weight is 0.
    pub fn support(&self) -> Gate {
        let Gate { lo, hi } = self.support_of_pulse();
        match self.period {
            None => Gate { lo: lo.max(0.0), hi },
            Some(period) => {
                // The earliest light belongs to the first pulse whose support begins or ends after time 0.
                let begin = lo.rem_euclid(period);
                let reaches_zero = begin + (hi - lo) > period;
                Gate { lo: if reaches_zero { 0.0 } else { begin }, hi: f64::INFINITY }
            }
        }
    }

    /// The support of one pulse, which may begin before time 0.
    pub(crate) fn support_of_pulse(&self) -> Gate {
        let reach = self.edge().map_or(0.0, Edge::reach);
        let gate = self.gate();
        Gate { lo: gate.lo - reach, hi: gate.hi + reach }
    }

    /// Whether the weight is 1 inside the gate and 0 outside.
    pub fn is_box(&self) -> bool {
        self.edge() == Some(Edge::Sharp) && self.period.is_none()
    }

    /// The weight of light with travel time `tau` in metres, at least 0. It has no meaning if a render refuses the response.
    pub fn weight(&self, tau: f64) -> f64 {
        let Some(period) = self.period else { return self.weight_of_pulse(tau) };
        let Gate { lo, hi } = self.support_of_pulse();
        let pulses = ((lo - tau) / period).ceil() as i64..=((hi - tau) / period).floor() as i64;
        // A period near 0 would give nearly endless pulses.
        let pulses = pulses.take(MAX_PERIODS as usize + 1);
        pulses.map(|k| self.weight_of_pulse(tau + k as f64 * period)).sum()
    }

    /// The weight without repetition.
    fn weight_of_pulse(&self, tau: f64) -> f64 {
        match &self.weight {
            Weight::Gate { gate, edge } => {
                let falls = if gate.hi.is_finite() { edge.rise(tau - gate.hi) } else { 0.0 };
                // A gate that begins at 0 has no edge there, because no light is earlier, except the light of an earlier pulse.
                let begins_at_zero = gate.lo == 0.0 && self.period.is_none();
                let rises = if begins_at_zero { 1.0 } else { edge.rise(tau - gate.lo) };
                (rises - falls).max(0.0)
            }
            Weight::Table(Table { rows, .. }) => {
                let after = rows.partition_point(|row| row[0] <= tau);
                if after == 0 || after == rows.len() {
                    return 0.0;
                }
                let [[t0, w0], [t1, w1]] = [rows[after - 1], rows[after]];
                w0 + (w1 - w0) * (tau - t0) / (t1 - t0)
            }
            Weight::Wave { period, quarter } => {
                let turns = tau / period + 0.25 * f64::from(*quarter);
                0.5 * (1.0 + (std::f64::consts::TAU * turns.fract()).cos())
            }
        }
    }

    /// Integral of the weight of one pulse over travel time, in metres. For a gate with any edges it is the length of the gate; it is
    /// infinite for a wave and for a gate without an end. Each response collects daylight for the time that light takes to travel
    /// this distance.
    pub fn integral(&self) -> f64 {
        match &self.weight {
            Weight::Gate { gate, .. } => gate.hi - gate.lo,
            Weight::Table(Table { rows, .. }) => {
                rows.windows(2).map(|pair| 0.5 * (pair[0][1] + pair[1][1]) * (pair[1][0] - pair[0][0])).sum()
            }
            Weight::Wave { .. } => f64::INFINITY,
        }
    }

    /// The response as text. Gate: its ends in optical path, time and depth, its period and its edges. Table: also its name. Wave: its
    /// name alone.
    pub fn describe(&self) -> String {
        let gate = self.gate().describe();
        let gate = self.period.map_or(gate.clone(), |period| format!("{gate}, repeated every {period} m"));
        match &self.weight {
            Weight::Gate { edge: Edge::Sharp, .. } => gate,
            Weight::Gate { edge: Edge::Ramp(length), .. } => format!("{gate} with ramps of {length} m"),
            Weight::Gate { edge: Edge::Gauss(sigma), .. } => format!("{gate} with Gaussian edges of {sigma} m"),
            Weight::Table(_) => format!("response {} in the {gate}", self.name),
            Weight::Wave { .. } => self.name.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GATE: Gate = Gate { lo: 2.0, hi: 3.0 };

    #[test]
    fn weights_are_those_drawn_by_hand() {
        let of = |edge| move |tau: f64| Response::new("a", GATE, edge).weight(tau);
        let sharp = of(Edge::Sharp);
        assert_eq!([1.9, 2.0, 2.9, 3.0].map(sharp), [0.0, 1.0, 1.0, 0.0]);
        let ramp = of(Edge::Ramp(0.4));
        for (tau, weight) in [(1.8, 0.0), (1.9, 0.25), (2.0, 0.5), (2.2, 1.0), (2.9, 0.75), (3.2, 0.0)] {
            assert!((ramp(tau) - weight).abs() < 1e-12, "{tau}");
        }
        let gauss = of(Edge::Gauss(0.1));
        // Tabulated values of the standard normal distribution at 0, 1 and -2. The cut at 4 changes them by 3e-5.
        for (tau, weight) in [(2.0, 0.5), (2.1, 0.841345), (1.8, 0.022750), (2.5, 1.0), (1.59, 0.0), (3.41, 0.0)] {
            assert!((gauss(tau) - weight).abs() < 4e-5, "{tau}: {}", gauss(tau));
        }
        assert_eq!(Response::new("a", GATE, Edge::Gauss(0.1)).support(), Gate { lo: 1.6, hi: 3.4 });
    }

    #[test]
    fn abutting_gates_add_up_to_one_at_every_time() {
        for edge in [Edge::Sharp, Edge::Ramp(0.7), Edge::Ramp(3.0), Edge::Gauss(0.2)] {
            let gates: Vec<Response> =
                (0..20).map(|k| Response::new("a", Gate { lo: k.into(), hi: f64::from(k) + 1.0 }, edge)).collect();
            for i in 0..1000 {
                let tau = 0.0178 * f64::from(i);
                let sum: f64 = gates.iter().map(|gate| gate.weight(tau)).sum();
                assert!((sum - 1.0).abs() < 1e-12, "{edge:?} at {tau}: {sum}");
            }
            // The gates of a pulsed laser that fill its period abut at its ends too.
            let pulsed: Vec<Response> = gates[..5].iter().map(|gate| gate.clone().repeated(5.0)).collect();
            for i in 0..1000 {
                let tau = 0.0178 * f64::from(i);
                let sum: f64 = pulsed.iter().map(|gate| gate.weight(tau)).sum();
                assert!((sum - 1.0).abs() < 1e-9, "{edge:?}, repeated, at {tau}: {sum}");
            }
        }
    }

    #[test]
    fn tables_are_linear_with_steps() {
        let rows = vec![[1.0, 0.0], [2.0, 4.0], [2.0, 1.0], [4.0, 3.0]];
        let table = Response::table("a", rows, None).unwrap();
        for (tau, weight) in [(0.9, 0.0), (1.5, 2.0), (2.0, 1.0), (3.0, 2.0), (4.0, 0.0), (9.0, 0.0)] {
            assert_eq!(table.weight(tau), weight, "{tau}");
        }
        assert_eq!((table.support(), table.is_box()), (Gate { lo: 1.0, hi: 4.0 }, false));
        for (rows, part) in [
            (vec![[1.0, 1.0]], "two rows"),
            (vec![[1.0, 1.0], [0.5, 1.0]], "ascending"),
            (vec![[1.0, 1.0], [2.0, -1.0]], "negative"),
            (vec![[1.0, 1.0], [f64::NAN, 1.0]], "not finite"),
            (vec![[1.0, 0.0], [2.0, 0.0]], "all weights"),
            (vec![[1.0, 1.0], [1.0, 1.0]], "empty"),
        ] {
            let error = Response::table("a", rows, None).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn the_integral_is_the_sum_of_the_weights() {
        let steps = Response::table("a", vec![[1.0, 0.0], [2.0, 4.0], [2.0, 1.0], [4.0, 3.0]], None).unwrap();
        let gates = [Edge::Sharp, Edge::Ramp(0.4), Edge::Gauss(0.1)].map(|edge| Response::new("a", GATE, edge));
        for response in gates.into_iter().chain([steps]) {
            let sum: f64 = (0..5000).map(|i| 1e-3 * response.weight(1e-3 * (f64::from(i) + 0.5))).sum();
            assert!((sum - response.integral()).abs() < 1e-5, "{response:?}: {sum}");
        }
    }

    #[test]
    fn a_pulsed_laser_folds_the_range() {
        let pulsed = Response::new("a", Gate { lo: 12.0, hi: 13.0 }, Edge::Ramp(0.4)).repeated(5.0);
        let support = pulsed.support();
        assert!((support.lo - 1.8).abs() < 1e-12 && support.hi == f64::INFINITY, "{support:?}");
        for (tau, weight) in [(2.0, 0.5), (12.0, 0.5), (7.5, 1.0), (502.5, 1.0), (4.0, 0.0), (8.3, 0.0), (1.9, 0.25)] {
            assert!((pulsed.weight(tau) - weight).abs() < 1e-9, "{tau}: {}", pulsed.weight(tau));
        }
        // The end of one pulse's gate is after time 0, so light from time 0 on counts. Gates longer than the period overlap.
        let around_zero = Response::new("a", Gate { lo: 4.5, hi: 5.5 }, Edge::Sharp).repeated(5.0);
        assert_eq!((around_zero.support().lo, around_zero.weight(0.2), around_zero.weight(0.5)), (0.0, 1.0, 0.0));
        let long = Response::new("a", Gate { lo: 1.0, hi: 8.0 }, Edge::Sharp).repeated(5.0);
        assert_eq!([0.5, 1.5, 2.9, 3.5].map(|tau| long.weight(tau)), [1.0, 2.0, 2.0, 1.0]);
        assert!(!long.is_box());
    }

    /// No render accepts these periods, but the weight is public.
    #[test]
    fn a_weight_takes_little_time_with_any_period() {
        for period in [0.0, -0.0, 1e-300, -1.0, f64::NAN, f64::INFINITY] {
            for tau in [0.0, 2.5, 1e30] {
                Response::new("a", GATE, Edge::Sharp).repeated(period).weight(tau);
            }
        }
    }
}

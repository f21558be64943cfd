//! The list of responses that a render measures.

use std::collections::HashSet;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::settings::aov::Aov;
use crate::settings::chirp::Chirp;
use crate::settings::frequencies::{Frequencies, Heterodyne};
use crate::settings::gates::{Gates, MAX_GATES};
use crate::settings::optical_path::OpticalPath;
use crate::settings::response::{Edge, MAX_PERIODS, Response};
use crate::settings::response_specs::{ResponseSpec, ResponseSpecs, check_name};
use crate::settings::table::GateTable;
use crate::settings::units::{Gate, MAX_TRAVEL_TIME, number};

/// Name of the channels of the variance in image files.
const VARIANCE: &str = "Variance";

/// The responses that a render measures, at least one. A plain gate is a list of one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Responses {
    list: Vec<Response>,
    /// The gates that the list was made from, if they all have the same width and abut.
    uniform: Option<Gates>,
    /// The frequencies that the list was made from.
    frequencies: Option<Frequencies>,
    /// By how much the modulation of the sensor is faster, in Hz.
    #[serde(default)]
    heterodyne: Option<f64>,
    /// See [`Responses::with_chirp`].
    #[serde(default)]
    chirp: Option<Chirp>,
}

impl Responses {
    /// A list of responses. Fails unless
    ///
    /// * there are 1 to 4096;
    /// * each has a name of its own, not empty and without a dot, an equals sign or a slash;
    /// * no name is that of other channels in image files: Variance, depth, normal, albedo, object, arrival;
    /// * every gate is valid ([`Gate::new`]), and at most 1000 periods of a pulsed laser long;
    /// * the length of an edge is above 0, and at most 1e30 m.
    pub fn new(list: Vec<Response>) -> Result<Responses> {
        let is_reserved = |name: &str| name == VARIANCE || Aov::ALL.names().any(|layer| layer == name);
        if let Some(response) = list.iter().find(|response| is_reserved(response.name())) {
            return Err(Error::settings(format!(
                "a response cannot be called '{0}', because image files have other channels of this name; write like my-{0}=...",
                response.name()
            )));
        }
        let mut names = HashSet::new();
        if let Some(twice) = list.iter().find(|response| !names.insert(response.name())) {
            return Err(Error::advice(
                format!("two responses are called '{}'; ", twice.name()),
                "give each a name of its own, like near=gauss:10m..11m,0.1m",
            ));
        }
        let responses = Responses { list, uniform: None, frequencies: None, heterodyne: None, chirp: None };
        responses.check()?;
        Ok(responses)
    }

    /// One response per gate, with these edges.
    pub fn uniform_with(gates: Gates, edge: Edge) -> Responses {
        let digits = (gates.count() - 1).to_string().len();
        let response = |k| Response::new(format!("bin{k:0digits$}"), gates.gate(k), edge);
        let list = (0..gates.count()).map(response).collect();
        Responses { list, uniform: Some(gates), frequencies: None, heterodyne: None, chirp: None }
    }

    /// The responses to a pulsed laser, see [`Response::repeated`].
    pub fn repeated(self, period: f64) -> Responses {
        let list = self.list.into_iter().map(|response| response.repeated(period)).collect();
        Responses { list, ..self }
    }

    /// All responses, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &Response> {
        self.list.iter()
    }

    /// Number of responses, at least 1.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// The frequencies of a continuous-wave sensor, if the list was made from them.
    pub fn frequencies(&self) -> Option<&Frequencies> {
        self.frequencies.as_ref()
    }

    /// The waves of a sensor whose modulation is `hertz` faster than that of the light. Their phases turn while the shutter is open.
    pub(crate) fn with_heterodyne(self, hertz: f64) -> Responses {
        Responses { heterodyne: Some(hertz), ..self }
    }

    /// See [`Responses::with_heterodyne`].
    pub(crate) fn heterodyne(&self) -> Option<f64> {
        self.heterodyne
    }

    /// The responses to beat frequencies of an FMCW sensor: gates are lengths of paths at rest that have these frequencies.
    pub(crate) fn with_chirp(self, chirp: Chirp) -> Responses {
        Responses { chirp: Some(chirp), ..self }
    }

    /// See [`Responses::with_chirp`].
    pub(crate) fn chirp(&self) -> Option<Chirp> {
        self.chirp
    }

    /// Whether the phases of a continuous-wave sensor are those of travel times, so that it measures depths.
    #[doc(hidden)]
    pub fn have_depths(&self) -> bool {
        self.frequencies.is_some() && self.heterodyne.is_none()
    }

    /// Whether there is one response to travel times, whose weight is 1 inside its gate and 0 outside.
    pub fn is_single_box(&self) -> bool {
        self.list.len() == 1 && self.list[0].is_box() && self.chirp.is_none()
    }

    /// The gates, if they all have the same width and each begins where the one before it ends.
    pub fn uniform(&self) -> Option<Gates> {
        self.uniform
    }

    /// The smallest gate that contains the supports of all responses. Light outside this gate counts for no response. The beat frequencies of an
    /// FMCW sensor say nothing about travel times.
    pub fn support(&self) -> Gate {
        if self.chirp.is_some() {
            return Gate::OPEN;
        }
        let around = |a: Gate, b: Gate| Gate { lo: a.lo.min(b.lo), hi: a.hi.max(b.hi) };
        self.iter().map(Response::support).reduce(around).expect("there is a response")
    }

    /// The longest interval in which light counts for no response, between the supports of two responses. `None` if it is shorter than
    /// a quarter of [`Responses::support`].
    pub fn gap(&self) -> Option<Gate> {
        if self.chirp.is_some() {
            return None;
        }
        let mut supports: Vec<Gate> = self.iter().map(Response::support).collect();
        supports.sort_by(|a, b| a.lo.total_cmp(&b.lo));
        let mut end = supports[0].hi;
        let mut longest = Gate { lo: end, hi: end };
        for support in supports {
            if support.lo - end > longest.hi - longest.lo {
                longest = Gate { lo: end, hi: support.lo };
            }
            end = end.max(support.hi);
        }
        let whole = self.support();
        (longest.hi > longest.lo && longest.hi - longest.lo >= 0.25 * (whole.hi - whole.lo)).then_some(longest)
    }

    /// The gate with the fewest steps of 32-bit travel times. Rounding is most visible in this gate. Gates of a pulsed laser also count
    /// light of late travel times, so the shortest of them has the fewest steps.
    #[doc(hidden)]
    pub fn narrowest(&self) -> Gate {
        let is_repeated = self.is_repeated();
        let relative_width = |gate: &Gate| (gate.hi - gate.lo) / if is_repeated { 1.0 } else { gate.hi };
        let gates = self.iter().map(Response::support_of_pulse);
        gates.min_by(|a, b| relative_width(a).total_cmp(&relative_width(b))).expect("there is a response")
    }

    /// Whether the gates contain light of every pulse of a laser, see [`Response::repeated`].
    pub fn is_repeated(&self) -> bool {
        self.iter().any(|response| response.period().is_some())
    }

    /// The longest gate, with its edges.
    pub fn widest(&self) -> Gate {
        if self.chirp.is_some() {
            return Gate::OPEN;
        }
        let gates = self.iter().map(Response::support_of_pulse);
        gates.max_by(|a, b| (a.hi - a.lo).total_cmp(&(b.hi - b.lo))).expect("there is a response")
    }

    /// Fails if there is no response or too many, or if a name, an edge, a period or a gate is invalid; see [`Responses::new`].
    pub(crate) fn check(&self) -> Result<()> {
        if self.list.is_empty() || self.list.len() > MAX_GATES as usize {
            let count = self.list.len();
            return Err(Error::advice(
                format!("{count} responses are not possible: "),
                format!("give 1 to {MAX_GATES}"),
            ));
        }
        for response in self.iter() {
            check_name(response.name())?;
            if let Some(Edge::Ramp(length) | Edge::Gauss(length)) = response.edge()
                && !(length > 0.0 && length <= MAX_TRAVEL_TIME)
            {
                return Err(Error::advice(
                    format!("the response '{}' has edges of {length} m; ", response.name()),
                    format!("give a length above 0, at most {MAX_TRAVEL_TIME:e} m"),
                ));
            }
            let Some(period) = response.period() else { continue };
            let Gate { lo, hi } = response.support_of_pulse();
            // Also refuses a period that is not a number.
            let is_possible = period > 0.0 && period.is_finite() && (hi - lo) / period <= MAX_PERIODS;
            if !is_possible {
                return Err(Error::settings(format!(
                    "--repeat {} is too short for the gate of {} m: give at least {}",
                    OpticalPath(period),
                    number(hi - lo),
                    OpticalPath((hi - lo) / MAX_PERIODS),
                )));
            }
        }
        let gates = self.iter().flat_map(|response| [response.gate(), response.support()]);
        gates.into_iter().try_for_each(|gate| Gate::new(gate.lo, gate.hi).map(drop))
    }

    /// Whether light of every travel time counts fully in every response: the steady state.
    pub fn are_steady(&self) -> bool {
        self.chirp.is_none() && self.iter().all(|response| response.is_box() && response.gate().is_open())
    }

    /// The table of an experiment that gives these responses. A table without a file has no text; its response is left out.
    pub(super) fn to_table(&self) -> GateTable {
        if let Some(chirp) = self.chirp {
            let of_travel_times = Responses { chirp: None, ..self.clone() };
            return GateTable { fmcw: Some(chirp), ..of_travel_times.to_table() };
        }
        let edge = self.list[0].edge();
        let repeat = self.list[0].period().map(OpticalPath);
        if let Some(gates) = self.uniform {
            let response =
                edge.filter(|edge| *edge != Edge::Sharp).map(|edge| ResponseSpecs(vec![ResponseSpec::around(edge)]));
            return GateTable { gates: Some(gates), response, repeat, ..GateTable::default() };
        }
        if self.frequencies.is_some() {
            let heterodyne = self.heterodyne.map(Heterodyne);
            return GateTable { cw: self.frequencies.clone(), heterodyne, ..GateTable::default() };
        }
        // A gate without a response has a default name. Any other name needs a response.
        if self.is_single_box() && self.list[0].name() == default_name(self.list[0].gate()) {
            let gate = (!self.are_steady()).then(|| self.support());
            return GateTable { gate, ..GateTable::default() };
        }
        let specs = self.iter().filter_map(ResponseSpec::of).collect();
        GateTable { response: Some(ResponseSpecs(specs)), repeat, ..GateTable::default() }
    }

    /// The gates as text; see [`Gate::describe`].
    pub fn describe(&self) -> String {
        if let Some(chirp) = self.chirp {
            let of_travel_times = Responses { chirp: None, ..self.clone() };
            return format!("beat frequencies of {} (FMCW {chirp})", of_travel_times.describe());
        }
        match (self.uniform, &self.frequencies) {
            (Some(gates), _) => match self.list[0].period() {
                None => gates.describe(),
                Some(period) => format!("{}, repeated every {period} m", gates.describe()),
            },
            (_, Some(frequencies)) => match self.heterodyne {
                None => format!("continuous wave of {frequencies} MHz"),
                Some(hertz) => format!("continuous wave of {frequencies} MHz, heterodyne by {hertz} Hz"),
            },
            (None, None) => self.iter().map(Response::describe).collect::<Vec<_>>().join("; "),
        }
    }
}

/// The name of the only response, if the user gives only its gate.
fn default_name(gate: Gate) -> &'static str {
    if gate.is_open() { "steady" } else { "gate" }
}

impl Default for Responses {
    /// One response, the steady state.
    fn default() -> Responses {
        Gate::OPEN.into()
    }
}

impl From<Gate> for Responses {
    fn from(gate: Gate) -> Responses {
        let list = vec![Response::new(default_name(gate), gate, Edge::Sharp)];
        Responses { list, uniform: None, frequencies: None, heterodyne: None, chirp: None }
    }
}

impl From<Frequencies> for Responses {
    /// Four responses per frequency, with phases of k quarter turns: `cw20MHz-0` to `cw20MHz-3`.
    fn from(frequencies: Frequencies) -> Responses {
        let four = |&f: &f64| {
            (0..4).map(move |k| Response::wave(format!("{}-{k}", Frequencies::name(f)), Frequencies::period(f), k))
        };
        let list = frequencies.megahertz().iter().flat_map(four).collect();
        Responses { list, uniform: None, frequencies: Some(frequencies), heterodyne: None, chirp: None }
    }
}

impl From<Gates> for Responses {
    /// One response per gate. The names are `bin0`, `bin1`, ..., with zeros in front so that all have the same length.
    fn from(gates: Gates) -> Responses {
        Responses::uniform_with(gates, Edge::Sharp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gate_is_a_list_of_one() {
        let gate = Gate { lo: 1.0, hi: 2.0 };
        let one = Responses::from(gate);
        assert_eq!((one.iter().count(), one.support(), one.are_steady()), (1, gate, false));
        assert_eq!((one.iter().next().unwrap().name(), one.describe()), ("gate", gate.describe()));
        let steady = Responses::default();
        assert_eq!((steady.support(), steady.are_steady()), (Gate::OPEN, true));
        assert_eq!(steady.describe(), "no gate (steady state)");
    }

    #[test]
    fn the_support_holds_all_responses() {
        let response = |name, lo, hi| Response::new(name, Gate { lo, hi }, Edge::Sharp);
        let bins = [response("a", 3.0, 4.0), response("b", 1.0, 2.0), response("c", 1.5, 3.5)];
        let twice = Responses::new(vec![bins[0].clone(), bins[0].clone()]).unwrap_err().to_string();
        assert!(twice.contains("called 'a'"), "{twice}");
        let reserved = Responses::new(vec![response("albedo", 1.0, 2.0)]).unwrap_err().to_string();
        assert!(reserved.contains("cannot be called 'albedo'"), "{reserved}");
        let bins = Responses::new(bins.into()).unwrap();
        assert_eq!((bins.support(), bins.are_steady()), (Gate { lo: 1.0, hi: 4.0 }, false));
    }

    #[test]
    fn uniform_gates_become_responses_of_equal_width() {
        let bins = Responses::from("1m..2m/11".parse::<Gates>().unwrap());
        let names: Vec<&str> = bins.iter().map(Response::name).collect();
        assert_eq!((names.len(), names[0], names[10]), (11, "bin00", "bin10"));
        assert_eq!((bins.support(), bins.are_steady()), (Gate { lo: 1.0, hi: 2.0 }, false));
        assert!(bins.describe().starts_with("11 gates in 1-2 m"), "{}", bins.describe());
    }
}

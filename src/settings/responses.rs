//! Responses: the weight that a sensor gives to light as a function of its travel time.

use crate::error::Result;
use crate::settings::gates::Gates;
use crate::settings::table::GateTable;
use crate::settings::units::Gate;

/// A response of the sensor. Light whose travel time is inside the gate has weight 1, all other light has weight 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    name: String,
    gate: Gate,
}

impl Response {
    /// Name of the response.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The travel times that count; [`Gate::OPEN`] is the steady state.
    pub fn gate(&self) -> Gate {
        self.gate
    }
}

/// The responses that a render measures, at least one. A plain gate is a list of one.
#[derive(Debug, Clone, PartialEq)]
pub struct Responses {
    list: Vec<Response>,
    /// The gates that the list was made from, if they all have the same width and abut.
    uniform: Option<Gates>,
}

impl Responses {
    /// All responses, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &Response> {
        self.list.iter()
    }

    /// Number of responses, at least 1.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// The gates, if they all have the same width and each begins where the one before it ends.
    pub fn uniform(&self) -> Option<Gates> {
        self.uniform
    }

    /// The smallest gate that contains the gates of all responses. Light outside this gate counts for no response.
    pub fn support(&self) -> Gate {
        let around = |a: Gate, b: Gate| Gate { lo: a.lo.min(b.lo), hi: a.hi.max(b.hi) };
        self.iter().map(Response::gate).reduce(around).expect("there is a response")
    }

    /// The gate of the fewest steps of 32-bit travel times, the one where rounding is most visible.
    #[doc(hidden)]
    pub fn narrowest(&self) -> Gate {
        let relative_width = |gate: &Gate| (gate.hi - gate.lo) / gate.hi;
        let gates = self.iter().map(Response::gate);
        gates.min_by(|a, b| relative_width(a).total_cmp(&relative_width(b))).expect("there is a response")
    }

    /// Fails if a gate is invalid, with the message of [`Gate::new`].
    pub(crate) fn check(&self) -> Result<()> {
        self.iter().try_for_each(|response| Gate::new(response.gate.lo, response.gate.hi).map(drop))
    }

    /// Whether light of every travel time counts fully in every response: the steady state.
    pub fn are_steady(&self) -> bool {
        self.iter().all(|response| response.gate.is_open())
    }

    /// The table of an experiment that gives these responses.
    pub(super) fn to_table(&self) -> GateTable {
        let gate = (self.uniform.is_none() && !self.are_steady()).then(|| self.support());
        GateTable { gate, gates: self.uniform, ..GateTable::default() }
    }

    /// The gates as text; see [`Gate::describe`].
    pub fn describe(&self) -> String {
        match self.uniform {
            Some(gates) => gates.describe(),
            None => self.iter().map(|response| response.gate.describe()).collect::<Vec<_>>().join("; "),
        }
    }
}

impl Default for Responses {
    /// One response, the steady state.
    fn default() -> Responses {
        Gate::OPEN.into()
    }
}

impl From<Gate> for Responses {
    fn from(gate: Gate) -> Responses {
        let name = if gate.is_open() { "steady" } else { "gate" };
        Responses { list: vec![Response { name: name.into(), gate }], uniform: None }
    }
}

impl From<Gates> for Responses {
    /// One response per gate. The names are `bin0`, `bin1`, ..., with zeros in front so that all have the same length.
    fn from(gates: Gates) -> Responses {
        let digits = (gates.count() - 1).to_string().len();
        let response = |k| Response { name: format!("bin{k:0digits$}"), gate: gates.gate(k) };
        Responses { list: (0..gates.count()).map(response).collect(), uniform: Some(gates) }
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
        let response = |lo, hi| Response { name: "bin".into(), gate: Gate { lo, hi } };
        let bins = Responses { list: vec![response(3.0, 4.0), response(1.0, 2.0), response(1.5, 3.5)], uniform: None };
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

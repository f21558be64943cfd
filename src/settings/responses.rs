//! Responses: the weight that a sensor gives to light as a function of its travel time.

use crate::error::Result;
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
pub struct Responses(Vec<Response>);

impl Responses {
    /// All responses, in order.
    pub fn iter(&self) -> impl Iterator<Item = &Response> {
        self.0.iter()
    }

    /// The smallest gate that contains the gates of all responses. Light outside this gate counts for no response.
    pub fn support(&self) -> Gate {
        let around = |a: Gate, b: Gate| Gate { lo: a.lo.min(b.lo), hi: a.hi.max(b.hi) };
        self.iter().map(Response::gate).reduce(around).expect("there is a response")
    }

    /// Fails if a gate is invalid, with the message of [`Gate::new`].
    pub(crate) fn check(&self) -> Result<()> {
        self.iter().try_for_each(|response| Gate::new(response.gate.lo, response.gate.hi).map(drop))
    }

    /// Whether light of every travel time counts fully in every response: the steady state.
    pub fn are_steady(&self) -> bool {
        self.iter().all(|response| response.gate.is_open())
    }

    /// All gates as text, separated by semicolons; see [`Gate::describe`].
    pub fn describe(&self) -> String {
        self.iter().map(|response| response.gate.describe()).collect::<Vec<_>>().join("; ")
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
        Responses(vec![Response { name: name.into(), gate }])
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
        let bins = Responses(vec![response(3.0, 4.0), response(1.0, 2.0), response(1.5, 3.5)]);
        assert_eq!((bins.support(), bins.are_steady()), (Gate { lo: 1.0, hi: 4.0 }, false));
    }
}

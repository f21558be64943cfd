//! The weights of responses, and which responses see a travel time.

use crate::render::space::RenderSpace;
use crate::settings::{Response, Responses};

/// The weights of all responses.
pub struct Weights {
    /// If all responses are boxes: begin and end of each gate as f32 in render space, the same as in a render with this gate alone.
    boxes: Vec<[f32; 2]>,
    /// Finds the box of a travel time. `None` if some box begins before the previous box ends: then all boxes are tried.
    lookup: Option<BoxLookup>,
    /// All responses, boxes included, if some are not boxes. Otherwise empty.
    general: Vec<Response>,
    /// Which of the `general` responses a travel time may meet.
    supports: Supports,
    /// Metres per unit of the render space.
    unit: f64,
    /// For each of the `general` responses, the length in metres that its phase is ahead of travel times; 0 unless it is a wave.
    ahead: Vec<f64>,
}

impl Weights {
    pub fn new(responses: &Responses, space: &RenderSpace) -> Weights {
        let are_boxes = responses.iter().all(Response::is_box);
        let edge = |metres: f64| space.length(metres) as f32;
        let boxes: Vec<[f32; 2]> = match are_boxes {
            true => responses.iter().map(|r| [edge(r.gate().lo), edge(r.gate().hi)]).collect(),
            false => vec![],
        };
        let lookup = boxes.is_sorted_by(|a, b| a[1] <= b[0]).then(|| BoxLookup::new(&boxes));
        let general = if are_boxes { vec![] } else { responses.iter().cloned().collect() };
        let supports = Supports::new(&general);
        let ahead = vec![0.0; general.len()];
        Weights { boxes, lookup, general, supports, unit: space.unit, ahead }
    }

    /// Begin and end of each gate in render space, if all responses are boxes, and none begins before the previous one ends.
    pub fn ascending_boxes(&self) -> Option<&[[f32; 2]]> {
        self.lookup.is_some().then_some(&self.boxes[..]).filter(|boxes| !boxes.is_empty())
    }

    /// Puts the phases of all waves ahead by this number of turns.
    pub fn turn_waves(&mut self, turns: f64) {
        for (ahead, response) in self.ahead.iter_mut().zip(&self.general) {
            *ahead = response.wave_period().map_or(0.0, |period| turns.fract() * period);
        }
    }

    /// Number of responses.
    pub fn count(&self) -> usize {
        self.boxes.len() + self.general.len()
    }

    /// Calls `visit` with the index and the weight of every response that sees light of travel time `tau`.
    #[inline]
    pub fn visit(&self, tau: f32, mut visit: impl FnMut(u32, f64)) {
        // If travel times omit the ways to a wall, rounding or the field of view of a pixel may make them slightly negative.
        let tau = tau.max(0.0);
        if !self.general.is_empty() {
            return self.visit_general(f64::from(tau) * self.unit, visit);
        }
        let contains = |[lo, hi]: [f32; 2]| lo <= tau && tau < hi;
        let Some(lookup) = &self.lookup else {
            let inside = self.boxes.iter().enumerate().filter(|(_, gate)| contains(**gate));
            return inside.for_each(|(k, _)| visit(k as u32, 1.0));
        };
        let begun = lookup.count_begun(&self.boxes, tau);
        if begun > 0 && contains(self.boxes[begun - 1]) {
            visit(begun as u32 - 1, 1.0);
        }
    }

    fn visit_general(&self, metres: f64, mut visit: impl FnMut(u32, f64)) {
        self.supports.visit(metres, |k| {
            let weight = self.general[k].weight(metres + self.ahead[k]);
            if weight > 0.0 {
                visit(k as u32, weight);
            }
        });
    }
}

/// Counts the boxes that begin at or before a travel time. It divides the times into cells of equal width. A binary search in the cell of
/// the travel time visits few boxes, or one if all boxes are equally wide.
struct BoxLookup {
    /// Begin of the first box.
    first: f32,
    cells_per_unit: f32,
    /// For each cell, the number of boxes that begin in earlier cells. The last element is the number of all boxes.
    earlier: Vec<u32>,
}

impl BoxLookup {
    /// `boxes` ascend.
    fn new(boxes: &[[f32; 2]]) -> BoxLookup {
        let (first, last) = (boxes.first().map_or(0.0, |gate| gate[0]), boxes.last().map_or(0.0, |gate| gate[0]));
        let cells_per_unit = boxes.len() as f32 / (last - first).max(f32::MIN_POSITIVE);
        let mut lookup = BoxLookup { first, cells_per_unit, earlier: vec![0; boxes.len() + 2] };
        for cell in 0..boxes.len() + 2 {
            let is_earlier = |gate: &[f32; 2]| lookup.cell(gate[0]) < cell;
            lookup.earlier[cell] = boxes.partition_point(is_earlier) as u32;
        }
        lookup
    }

    /// The cell of a travel time. Rounding keeps the order: of two times, the earlier one never has the later cell.
    #[inline]
    fn cell(&self, tau: f32) -> usize {
        (((tau - self.first) * self.cells_per_unit) as usize).min(self.earlier.len() - 2)
    }

    /// Number of `boxes` that begin at or before `tau`.
    #[inline]
    fn count_begun(&self, boxes: &[[f32; 2]], tau: f32) -> usize {
        let cell = self.cell(tau);
        let [begin, end] = [self.earlier[cell] as usize, self.earlier[cell + 1] as usize];
        match &boxes[begin..end] {
            [] => begin,
            [gate] => begin + usize::from(gate[0] <= tau),
            gates => begin + gates.partition_point(|gate| gate[0] <= tau),
        }
    }
}

/// Relative rounding error of travel times and of the ends of supports, with a margin.
const ROUNDING: f64 = 1e-12;

/// The supports of responses, to find those that may see a travel time.
struct Supports {
    /// Begin and end of the support of one pulse in metres.
    ends: Vec<[f64; 2]>,
    /// Travel time in metres after which all weights repeat, if `are_sorted`.
    period: Option<f64>,
    /// Whether begins and ends ascend and all responses have the same period. If not, `visit` visits all responses.
    are_sorted: bool,
    /// Greatest finite distance of an end from time 0, in metres.
    reach: f64,
}

impl Supports {
    fn new(responses: &[Response]) -> Supports {
        let ends: Vec<[f64; 2]> =
            responses.iter().map(Response::support_of_pulse).map(|support| [support.lo, support.hi]).collect();
        let period = responses.first().and_then(Response::period);
        let ascend = ends.is_sorted_by(|a, b| a[0] <= b[0] && a[1] <= b[1]);
        let are_sorted = ascend && responses.iter().all(|response| response.period() == period);
        let reach = ends.iter().flatten().map(|end| end.abs()).filter(|end| end.is_finite()).fold(0.0, f64::max);
        Supports { ends, period, are_sorted, reach }
    }

    /// Calls `visit` in ascending order with the index of each response that may see the travel time `tau` in metres. If `are_sorted`,
    /// these are the responses whose support contains `tau` for at least one pulse. The rounding margin may add a response that begins or
    /// ends at `tau`.
    fn visit(&self, tau: f64, mut visit: impl FnMut(usize)) {
        if !self.are_sorted {
            return (0..self.ends.len()).for_each(visit);
        }
        let margin = ROUNDING * (tau + self.reach);
        let [Some([first, _]), Some([_, last])] = [self.ends.first(), self.ends.last()] else { return };
        let pulses = match self.period {
            None => 0..=0,
            Some(period) => {
                ((first - margin - tau) / period).ceil() as i64..=((last + margin - tau) / period).floor() as i64
            }
        };
        let mut next = 0;
        for pulse in pulses {
            let time = tau + self.period.map_or(0.0, |period| pulse as f64 * period);
            let begin = self.ends.partition_point(|[_, end]| *end < time - margin);
            let end = self.ends.partition_point(|[begin, _]| *begin <= time + margin);
            (next.max(begin)..end).for_each(&mut visit);
            next = next.max(end);
        }
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::settings::Edge;
    use crate::settings::units::Gate;

    pub fn gates(count: u32, width: f64, edge: Edge) -> Vec<Response> {
        let gate = |k: u32| Gate { lo: 4.0 + width * f64::from(k), hi: 4.0 + width * f64::from(k + 1) };
        (0..count).map(|k| Response::new(k.to_string(), gate(k), edge)).collect()
    }

    #[test]
    fn every_response_that_sees_a_time_is_visited() {
        let edges = [Edge::Sharp, Edge::Ramp(0.07), Edge::Gauss(0.05)];
        let mut cases: Vec<Vec<Response>> = edges.map(|edge| gates(60, 0.1, edge)).into();
        for period in [0.35, 1.0, 3.3, 6.0, 25.0] {
            cases.extend(edges.map(|edge| gates(60, 0.1, edge).into_iter().map(|r| r.repeated(period)).collect()));
        }
        // An open gate, and gates in descending order.
        cases.push(vec![
            Response::new("a", Gate::OPEN, Edge::Sharp),
            Response::new("b", Gate { lo: 1.0, hi: 2.0 }, edges[1]),
        ]);
        cases.push(gates(5, 0.5, edges[2]).into_iter().rev().collect());
        for responses in cases {
            let supports = Supports::new(&responses);
            let (mut visits, mut seen) = (0, 0);
            // Among the times are the ends of gates.
            for tau in (0..4000).map(|i| 0.0025 * f64::from(i)) {
                let mut visited = vec![];
                supports.visit(tau, |k| visited.push(k));
                assert!(visited.is_sorted_by(|a, b| a < b), "{visited:?}");
                let sees = |k: usize| responses[k].weight(tau) > 0.0;
                let missed = (0..responses.len()).find(|k| sees(*k) && !visited.contains(k));
                assert_eq!(missed, None, "{tau} {:?}", responses[0]);
                (visits, seen) = (visits + visited.len(), seen + visited.iter().filter(|k| sees(**k)).count());
            }
            assert!(!supports.are_sorted || visits < seen + 4000, "{visits} visits, {seen} of them useful");
        }
    }

    #[test]
    fn cells_find_the_same_box_as_a_search_of_all() {
        let widths = [1.0, 1e-6, 3.0, 0.0, 1e-3, 1e30, 0.1];
        let uneven = (0..70).scan(0.2f32, |end, i| {
            let begin = *end;
            *end += widths[i % 7] * 0.7;
            Some([begin, *end])
        });
        let even = |count: u32| (0..count).map(|k| [4.0 + 0.04 * k as f32, 4.04 + 0.04 * k as f32]).collect();
        let all: [Vec<[f32; 2]>; 6] =
            [uneven.collect(), even(300), even(1), vec![], vec![[1.0, 1.0]; 9], vec![[0.0, f32::INFINITY]]];
        for boxes in all {
            let lookup = BoxLookup::new(&boxes);
            let ends = boxes.iter().flatten().flat_map(|x| [x.next_down(), *x, x.next_up()]);
            for tau in ends.chain((0..2000).map(|i| 0.01 * i as f32)).chain([f32::MAX, f32::INFINITY]) {
                let wanted = boxes.partition_point(|gate| gate[0] <= tau);
                assert_eq!(lookup.count_begun(&boxes, tau), wanted, "{tau} in {} boxes", boxes.len());
            }
        }
    }
}

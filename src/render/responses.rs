//! Several responses from one render: assigns each contribution to the responses by its travel time.

use rayon::prelude::*;

use super::plan::Plan;
use super::space::RenderSpace;
use crate::image::response_film::ResponseFilm;
use crate::settings::{Response, Responses};

/// Light that reaches the sensor.
#[derive(Debug, Clone, Copy)]
pub struct Arrival {
    /// Row-major index in the crop.
    pub pixel: u32,
    /// Travel time in units of the render space.
    pub tau: f32,
    /// Contribution to the mean of the pixel in the present iteration.
    pub rgb: [f32; 3],
}

/// The weights of all responses.
struct Weights {
    /// If all responses are boxes: begin and end of each gate as f32 in render space, the same as in a render with this gate alone.
    boxes: Vec<[f32; 2]>,
    /// Whether no box begins before the previous box ends, so that a binary search finds the box of a travel time.
    are_sorted: bool,
    /// If some responses are not boxes: all responses.
    others: Vec<Response>,
    /// Which of the `others` a travel time may meet.
    supports: Supports,
    /// Metres per unit of the render space.
    unit: f64,
}

impl Weights {
    fn new(responses: &Responses, space: &RenderSpace) -> Weights {
        let are_boxes = responses.iter().all(Response::is_box);
        let edge = |metres: f64| space.length(metres) as f32;
        let boxes: Vec<[f32; 2]> = match are_boxes {
            true => responses.iter().map(|r| [edge(r.gate().lo), edge(r.gate().hi)]).collect(),
            false => vec![],
        };
        let are_sorted = boxes.is_sorted_by(|a, b| a[1] <= b[0]);
        let others = if are_boxes { vec![] } else { responses.iter().cloned().collect() };
        let supports = Supports::new(&others);
        Weights { boxes, are_sorted, others, supports, unit: space.unit }
    }

    /// Number of responses.
    fn count(&self) -> usize {
        self.boxes.len() + self.others.len()
    }

    /// Calls `visit` with the index and the weight of every response that sees light of travel time `tau`.
    fn visit(&self, tau: f32, mut visit: impl FnMut(u32, f64)) {
        // If travel times omit the ways to a wall, rounding or a field of view may put light slightly before time 0.
        let tau = tau.max(0.0);
        let metres = f64::from(tau) * self.unit;
        self.supports.visit(metres, |k| {
            let weight = self.others[k].weight(metres);
            if weight > 0.0 {
                visit(k as u32, weight);
            }
        });
        let contains = |[lo, hi]: [f32; 2]| lo <= tau && tau < hi;
        if !self.are_sorted {
            let inside = self.boxes.iter().enumerate().filter(|(_, gate)| contains(**gate));
            return inside.for_each(|(k, _)| visit(k as u32, 1.0));
        }
        let after = self.boxes.partition_point(|gate| gate[0] <= tau);
        if let Some(k) = after.checked_sub(1).filter(|&k| contains(self.boxes[k])) {
            visit(k as u32, 1.0);
        }
    }
}

/// Relative rounding error of travel times and of the ends of supports, with a margin.
const ROUNDING: f64 = 1e-12;

/// The supports of responses, to find those that may see a travel time.
struct Supports {
    /// Begin and end of the support of one pulse in metres.
    ends: Vec<[f64; 2]>,
    /// Travel time in metres after which all weights repeat.
    period: Option<f64>,
    /// Whether begins and ends ascend and all responses have the same period. If not, every response may see every time.
    are_sorted: bool,
    /// Greatest finite distance of an end from time 0.
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

    /// Calls `visit` in ascending order with the index of each response whose support contains the travel time `tau` in metres, of any
    /// pulse. Rounding may add a response that begins or ends at `tau`.
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

/// The images of several responses, and the arrivals of the present iteration that are not in them yet.
pub struct ResponseSums {
    film: ResponseFilm,
    weights: Weights,
    /// The sum over all responses in the present iteration: R, G, B per pixel.
    total: Vec<f32>,
    /// The splats (t = 1) of the iteration, ordered by pixel.
    splats: Vec<Arrival>,
    /// Samples per pixel of the iteration, on average.
    samples: u32,
    /// Whether a part of the iteration is in the images.
    has_part: bool,
    replaced: Replaced,
}

impl ResponseSums {
    pub fn new(plan: &Plan, has_variance: bool) -> ResponseSums {
        let film = ResponseFilm::new(plan.crop_pixels as usize, plan.responses.len(), has_variance);
        let weights = Weights::new(&plan.responses, &plan.space);
        let replaced = Replaced::default();
        ResponseSums { film, weights, total: vec![], splats: vec![], samples: 0, has_part: false, replaced }
    }

    pub fn film(&self) -> &ResponseFilm {
        &self.film
    }

    /// Ends an iteration that is not complete: the images become those before it. Returns false if too much was replaced in them; they
    /// cannot be used then.
    pub fn restore(&mut self) -> bool {
        let can_restore = !self.has_part || self.replaced.put_back(&mut self.film);
        self.has_part = !can_restore;
        can_restore
    }

    /// Goes on from the images of earlier iterations.
    pub fn resume(&mut self, film: ResponseFilm) {
        self.film = film;
    }

    /// Begins an iteration with `samples` samples per pixel on average, with the splats of its light subpaths.
    pub fn begin(&mut self, mut splats: Vec<Arrival>, samples: u32) {
        splats.par_sort_by_key(|splat| splat.pixel);
        (self.splats, self.samples) = (splats, samples);
        self.replaced.clear();
        self.total.clear();
        self.total.resize(3 * self.film.pixels(), 0.0);
    }

    /// Adds all light of `pixels`, none of which has been added in this iteration: their splats, and `arrivals` from sensor
    /// subpaths. The order of the arrivals of a pixel decides the last bits of its sums.
    pub fn add(&mut self, pixels: &[u32], arrivals: Vec<Arrival>) {
        self.has_part = true;
        let mut all: Vec<Arrival> = pixels.iter().flat_map(|&pixel| self.splats_of(pixel)).copied().collect();
        all.extend(arrivals);
        // The sort is stable: the splats of each pixel stay in front.
        all.par_sort_by_key(|arrival| arrival.pixel);
        let of_pixels: Vec<&[Arrival]> = all.chunk_by(|a, b| a.pixel == b.pixel).collect();
        let weights = &self.weights;
        // Many soft gates may see each arrival, so the sums of few pixels exist at a time.
        for of_pixels in of_pixels.chunks((MAX_SUMS / self.film.responses()).max(64)) {
            let sums: Vec<Vec<(u32, [f64; 3])>> =
                of_pixels.par_iter().with_min_len(64).map(|arrivals| sums(weights, arrivals)).collect();
            for (arrivals, sums) in of_pixels.iter().zip(sums) {
                let pixel = arrivals[0].pixel;
                for k in 0..3 {
                    self.total[3 * pixel as usize + k] = sums.iter().map(|(_, rgb)| rgb[k]).sum::<f64>() as f32;
                }
                for (response, rgb) in sums {
                    self.replaced.note(&self.film, pixel, response);
                    self.film.add(pixel, response, rgb, self.samples);
                }
            }
        }
    }

    /// The sum over all responses of the images of the present iteration: R, G, B per pixel.
    pub fn total(&self) -> &[f32] {
        &self.total
    }

    /// Ends the iteration.
    pub fn end(&mut self) {
        self.splats.clear();
        self.film.end_iteration(self.samples);
        self.has_part = false;
    }

    fn splats_of(&self, pixel: u32) -> &[Arrival] {
        let begin = self.splats.partition_point(|splat| splat.pixel < pixel);
        let count = self.splats[begin..].iter().take_while(|splat| splat.pixel == pixel).count();
        &self.splats[begin..begin + count]
    }
}

/// What the present iteration has replaced in the images.
#[derive(Default)]
struct Replaced {
    /// Pixel, response, and the sums of w x before.
    sums: Vec<(u32, u32, [f64; 3])>,
    /// The sums of w x^2 before, in the same order; empty without variances.
    squares: Vec<[f64; 3]>,
    /// Whether there was more than [`MAX_REPLACED`].
    is_too_much: bool,
}

/// Most pixels and responses for which an iteration keeps what it replaces. They take 128 MiB, or 224 MiB with variances.
const MAX_REPLACED: usize = 1 << 22;

impl Replaced {
    fn clear(&mut self) {
        self.sums.clear();
        self.squares.clear();
        self.is_too_much = false;
    }

    /// Notes what `film` has for a pixel and a response.
    fn note(&mut self, film: &ResponseFilm, pixel: u32, response: u32) {
        if self.is_too_much {
            return;
        }
        if self.sums.len() >= MAX_REPLACED {
            *self = Replaced { is_too_much: true, ..Replaced::default() };
            return;
        }
        let (sums, squares) = film.sums_of(pixel, response);
        self.sums.push((pixel, response, sums));
        self.squares.extend(squares);
    }

    /// Undoes all changes of `film` that were noted. Returns false, and changes nothing, if some were not.
    fn put_back(&mut self, film: &mut ResponseFilm) -> bool {
        if self.is_too_much {
            return false;
        }
        let squares = self.squares.iter().copied().map(Some).chain(std::iter::repeat(None));
        for (&(pixel, response, sums), squares) in self.sums.iter().zip(squares) {
            film.set(pixel, response, sums, squares);
        }
        self.clear();
        true
    }
}

/// Upper bound on the number of sums, of 32 bytes each, that wait for their place in the images. At least 64 pixels wait.
const MAX_SUMS: usize = 1 << 21;

/// The light of a pixel per response, for the responses that see light.
fn sums(weights: &Weights, arrivals: &[Arrival]) -> Vec<(u32, [f64; 3])> {
    // At the limit, the sums so far take the places of their terms. This changes no bit: terms are added in the order of the arrivals.
    let limit = 2 * weights.count() + 1024;
    let mut seen = vec![];
    for arrival in arrivals {
        weights
            .visit(arrival.tau, |response, weight| seen.push((response, arrival.rgb.map(|x| f64::from(x) * weight))));
        if seen.len() > limit {
            seen = merged(seen);
        }
    }
    merged(seen)
}

/// Adds up the terms of each response, in their order. Returns the sums by ascending response.
fn merged(mut seen: Vec<(u32, [f64; 3])>) -> Vec<(u32, [f64; 3])> {
    seen.sort_by_key(|&(response, _)| response);
    seen.dedup_by(|next, sum| {
        let is_same = next.0 == sum.0;
        if is_same {
            (0..3).for_each(|k| sum.1[k] += next.1[k]);
        }
        is_same
    });
    seen
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::scene::Scene;
    use crate::settings::units::Gate;
    use crate::settings::{Edge, Emitters};

    fn gates(count: u32, width: f64, edge: Edge) -> Vec<Response> {
        let gate = |k: u32| Gate { lo: 4.0 + width * f64::from(k), hi: 4.0 + width * f64::from(k + 1) };
        (0..count).map(|k| Response::new(k.to_string(), gate(k), edge)).collect()
    }

    #[test]
    fn many_gates_that_see_all_light_take_little_memory() {
        let responses = Responses::new(gates(512, 0.01, Edge::Gauss(5.0))).unwrap();
        let space = RenderSpace::new(&Scene::default(), DVec3::ZERO, &Emitters::Scene);
        let weights = Weights::new(&responses, &space);
        let arrival = |i: u32| Arrival { pixel: 0, tau: 4.0 + 1e-3 * i as f32, rgb: [1.0, 0.1 * i as f32, 1e-7] };
        let arrivals: Vec<Arrival> = (0..1000).map(arrival).collect();
        let found = sums(&weights, &arrivals);
        assert!(found.len() == 512 && found.capacity() < 10_000, "{} places", found.capacity());
        for (response, sum) in found {
            let term = |a: &Arrival| {
                a.rgb.map(|x| f64::from(x) * responses.iter().nth(response as usize).unwrap().weight(a.tau.into()))
            };
            let wanted = arrivals.iter().map(term).reduce(|a, b| [0, 1, 2].map(|k| a[k] + b[k]));
            assert_eq!(Some(sum), wanted, "response {response}");
        }
    }

    #[test]
    fn an_incomplete_iteration_is_undone() {
        for has_variance in [false, true] {
            let mut film = ResponseFilm::new(2, 3, has_variance);
            film.add(0, 1, [0.1, 1e9, 1e-9], 3);
            film.end_iteration(3);
            let sums = |film: &ResponseFilm| [0, 1, 2, 3, 4, 5].map(|i| film.sums_of(i / 3, i % 3));
            let before = sums(&film);
            let mut replaced = Replaced::default();
            for (pixel, response) in [(0, 1), (1, 2)] {
                replaced.note(&film, pixel, response);
                film.add(pixel, response, [1e12, 0.3, 0.7], 8);
            }
            assert_ne!(sums(&film), before);
            assert!(replaced.put_back(&mut film));
            assert_eq!(sums(&film), before);
            replaced.is_too_much = true;
            assert!(!replaced.put_back(&mut film));
        }
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
}

//! The light of one pixel, summed per response.

use super::Arrival;
use super::weights::Weights;

/// Sums of the arrivals of a pixel, for each response that sees one of them.
pub struct PixelSums {
    /// R, G, B per response. Only the sums in `seen` have a meaning.
    sums: Vec<[f64; 3]>,
    /// One bit per response: whether it sees light.
    seen: Vec<u64>,
}

impl PixelSums {
    pub fn new(responses: usize) -> PixelSums {
        PixelSums { sums: vec![[0.0; 3]; responses], seen: vec![0; responses.div_ceil(64)] }
    }

    pub fn clear(&mut self) {
        self.seen.fill(0);
    }

    /// Adds an arrival to all responses that see it. The order of the arrivals decides the last bits of the sums.
    #[inline]
    pub fn add<Pixel>(&mut self, weights: &Weights, arrival: &Arrival<Pixel>) {
        let [red, green, blue] = arrival.rgb;
        weights.visit(arrival.tau, |response, weight| {
            let term = [f64::from(red) * weight, f64::from(green) * weight, f64::from(blue) * weight];
            let (sum, seen) = (&mut self.sums[response as usize], &mut self.seen[response as usize / 64]);
            let bit = 1 << (response % 64);
            match *seen & bit == 0 {
                true => *sum = term,
                false => *sum = [sum[0] + term[0], sum[1] + term[1], sum[2] + term[2]],
            }
            *seen |= bit;
        });
    }

    /// Calls `visit` with each response that sees light, in ascending order, and its sum.
    #[inline]
    pub fn visit(&self, mut visit: impl FnMut(u32, [f64; 3])) {
        let mut first = 0;
        for &word in &self.seen {
            let mut rest = word;
            while rest != 0 {
                let response = first + rest.trailing_zeros();
                visit(response, self.sums[response as usize]);
                rest &= rest - 1;
            }
            first += 64;
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::weights::tests::gates;
    use super::*;
    use crate::render::space::RenderSpace;
    use crate::scene::Scene;
    use crate::settings::{Edge, Emitters, Responses};

    #[test]
    fn each_of_many_gates_sums_the_light_that_it_sees() {
        let responses = Responses::new(gates(512, 0.01, Edge::Gauss(5.0))).unwrap();
        let space = RenderSpace::new(&Scene::default(), DVec3::ZERO, &Emitters::Scene);
        let weights = Weights::new(&responses, &space);
        let arrival = |i: u32| Arrival { pixel: 0, tau: 4.0 + 1e-3 * i as f32, rgb: [1.0, 0.1 * i as f32, 1e-7] };
        let arrivals: Vec<Arrival> = (0..1000).map(arrival).collect();
        let mut sums = PixelSums::new(512);
        // Light that was cleared does not count.
        sums.add(&weights, &arrival(7));
        sums.clear();
        sums.visit(|response, _| panic!("response {response} was cleared"));
        arrivals.iter().for_each(|arrival| sums.add(&weights, arrival));
        let mut found = vec![];
        sums.visit(|response, sum| found.push((response, sum)));
        assert_eq!(found.len(), 512);
        for (response, sum) in found {
            let term = |a: &Arrival| {
                a.rgb.map(|x| f64::from(x) * responses.iter().nth(response as usize).unwrap().weight(a.tau.into()))
            };
            let wanted = arrivals.iter().map(term).reduce(|a, b| [0, 1, 2].map(|k| a[k] + b[k]));
            assert_eq!(Some(sum), wanted, "response {response}");
        }
    }
}

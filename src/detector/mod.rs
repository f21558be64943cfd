//! A photon-counting detector: counts of photons from the radiance of gates.
//!
//! The light of a pulse is a Poisson process in travel time. A detector that counts all photons has independent Poisson counts per
//! gate. A detector with a dead time misses photons after each count, so that early light hides late light (pile-up).

#![warn(missing_docs)]

mod jitter;
pub mod light;

use rand_distr::{Binomial, Distribution, Exp1, Normal, Poisson, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::SeedableRng;

use crate::error::{Error, Result};
use crate::settings::units::METRES_PER_NS;

/// Maximum number of counts per pulse of a detector with a dead time, because they are drawn one by one.
const MAX_COUNTS: f64 = 1e6;

/// Maximum number of counts and pulses of all pixels of a detector with a dead time.
const MAX_DRAWS: f64 = 1e12;

/// When a detector is blind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Blind {
    /// Never: it counts all photons.
    Never,
    /// After its first count, until the next pulse.
    UntilNextPulse,
    /// For this optical path in metres after each count, at the longest until the next pulse. Photons that it misses do not
    /// extend this time.
    For(f64),
}

/// A photon-counting detector, and the light source that illuminates the scene in pulses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detector {
    /// Photons per pulse that reach a pixel of radiance 1, in the unit of the image.
    pub photons: f64,
    /// Number of pulses.
    pub pulses: u64,
    /// Probability that a photon is counted (quantum efficiency), 0 to 1.
    pub efficiency: f64,
    /// Counts per second without light.
    pub dark_rate: f64,
    /// Standard deviation in metres of optical path of the Gaussian error of the measured time.
    pub jitter: f64,
    /// When the detector is blind.
    pub blind: Blind,
}

/// Maximum number of parts of a gate in which first photons are taken to be spread evenly.
const MAX_PARTS: f64 = 64.0;

/// The gates of a detector.
#[derive(Debug, Clone, PartialEq)]
pub struct Bins {
    gates: Vec<[f64; 2]>,
    /// Period of a pulsed laser in metres: a photon that is measured too late falls into the time of the next pulse.
    period: Option<f64>,
    /// The integral of the weights of each gate over travel time, in metres.
    integrals: Vec<f64>,
}

impl Bins {
    /// Begin and end of each gate in metres of optical path; the end may be infinite. The weight is 1 inside a gate. Fails if there is
    /// none, or if a gate is empty.
    pub fn new(gates: Vec<[f64; 2]>) -> Result<Bins> {
        match !gates.is_empty() && gates.iter().all(|[lo, hi]| 0.0 <= *lo && lo < hi) {
            true => Ok(Bins { integrals: gates.iter().map(|[lo, hi]| hi - lo).collect(), gates, period: None }),
            false => Err(Error::advice("a detector needs gates that end after they begin; ", "render the light again")),
        }
    }

    /// Whether every gate ends before the next one begins.
    fn are_in_order(&self) -> bool {
        let ends = self.gates.iter().all(|[_, hi]| hi.is_finite());
        ends && self.gates.is_sorted_by(|a, b| a[1] <= b[0])
    }

    /// The gates with weights that have these integrals over travel time, in metres. Fails if one is negative or not a number.
    pub fn weighted(self, integrals: Vec<f64>) -> Result<Bins> {
        match integrals.iter().all(|&integral| 0.0 <= integral) {
            true => Ok(Bins { integrals, ..self }),
            false => Err(Error::advice(
                "the integral of the weights of a gate is negative or not a number; ",
                "render the light again",
            )),
        }
    }

    /// The gates of a laser with this period in metres, see [`crate::settings::Response::repeated`]. If the gates are together longer than
    /// the period, some light belongs to two gates. A photon that is measured too late is then lost.
    pub fn repeated(self, period: Option<f64>) -> Bins {
        let length = self.gates[self.gates.len() - 1][1] - self.gates[0][0];
        Bins { period: period.filter(|period| length <= period * (1.0 + 1e-9)), ..self }
    }

    /// For each gate, the integral of its weight over time in seconds: the duration of a box. Infinite for a gate without an end.
    pub fn seconds(&self) -> impl Iterator<Item = f64> {
        self.integrals.iter().map(|integral| integral / METRES_PER_NS * 1e-9)
    }
}

impl Detector {
    /// Fails if a number is out of range. The message names the flag of `taugate detect`.
    pub fn check_numbers(&self) -> Result<()> {
        let numbers = [
            ("photons", self.photons, f64::MAX),
            ("efficiency", self.efficiency, 1.0),
            ("dark-counts", self.dark_rate, f64::MAX),
        ];
        match numbers.into_iter().find(|(_, x, max)| !(0.0..=*max).contains(x)) {
            None => Ok(()),
            Some((name, x, max)) if max < 1e9 => {
                Err(Error::advice(format!("--{name} is {x}; "), format!("it must be from 0 to {max}")))
            }
            Some((name, x, _)) => {
                Err(Error::advice(format!("--{name} is {x}; "), "it must be a finite number, 0 or more"))
            }
        }
    }

    /// Fails if these gates do not suit the detector. Without jitter and dead time, each gate is an exposure of its own, so gates may
    /// overlap. `has_background`: whether the scene is in daylight.
    pub fn check_gates(&self, bins: &Bins, has_background: bool) -> Result<()> {
        let flags = [
            ("--jitter", self.jitter > 0.0),
            ("--first-photon", self.blind == Blind::UntilNextPulse),
            ("--dead-time", matches!(self.blind, Blind::For(_))),
        ];
        let flags: Vec<&str> = flags.iter().filter(|(_, given)| *given).map(|(flag, _)| *flag).collect();
        if !flags.is_empty() && !bins.are_in_order() {
            return Err(Error::settings(format!(
                "a detector with {0} needs gates that end and do not overlap, in ascending order; leave out {0}, or render with --gates \
                 A..B/N",
                flags.join(" and ")
            )));
        }
        if (has_background || self.dark_rate > 0.0) && bins.integrals.iter().any(|integral| integral.is_infinite()) {
            return Err(Error::advice(
                "a gate without an end collects daylight and dark counts for an unknown time; ",
                "leave out --background and --dark-counts, or render gates that end",
            ));
        }
        Ok(())
    }

    /// The mean number of photons and dark counts per pulse in each gate, before dead time and jitter. `light` is the radiance per
    /// gate in the unit of the image, `background` a radiance per second in the same unit.
    pub fn means(&self, light: impl Iterator<Item = f64>, background: f64, bins: &Bins) -> Vec<f64> {
        // The duration of a gate without an end is infinite.
        let collected = |rate: f64, seconds: f64| if rate == 0.0 { 0.0 } else { rate * seconds };
        let mean = |(light, seconds): (f64, f64)| {
            let radiance = light + collected(background, seconds);
            self.efficiency * self.photons * radiance.max(0.0) + collected(self.dark_rate, seconds)
        };
        light.zip(bins.seconds()).map(mean).collect()
    }

    /// The part of [`Detector::means`] that does not come in pulses: background and dark counts.
    pub fn steady_means(&self, background: f64, bins: &Bins) -> Vec<f64> {
        self.means(std::iter::repeat(0.0), background, bins)
    }

    /// Fails if no counts can be drawn for these `means`. Either a mean is not finite, or a dead time leaves too many counts per pulse.
    /// With a dead time, counts are drawn one by one.
    pub fn check(&self, means: &[f64], bins: &Bins) -> Result<()> {
        let fail = |message: String| Err(Error::settings(message));
        let total: f64 = means.iter().sum();
        if !total.is_finite() {
            return fail(
                "the mean number of photons per pulse exceeds the largest number, 2e308; lower --photons".into(),
            );
        }
        let counts = self.max_counts(means, bins);
        match counts <= MAX_COUNTS {
            true => Ok(()),
            false => fail(format!(
                "a pixel would count up to {counts:.1e} photons per pulse, but with a dead time at most {MAX_COUNTS:e} can be drawn; \
                 raise --dead-time or lower --photons"
            )),
        }
    }

    /// An upper bound of the counts per pulse that a detector with a dead time draws one by one; 0 for other detectors.
    fn max_counts(&self, means: &[f64], bins: &Bins) -> f64 {
        let Blind::For(dead) = self.blind else { return 0.0 };
        let span: f64 = bins.gates.iter().map(|[lo, hi]| hi - lo).sum();
        means.iter().sum::<f64>().min(span / dead + bins.gates.len() as f64)
    }

    /// About how many random numbers [`Detector::counts`] draws one by one: with a dead time one per pulse and one per count.
    pub fn draws(&self, means: &[f64], bins: &Bins) -> f64 {
        match self.blind {
            Blind::For(_) => self.pulses as f64 * (1.0 + self.max_counts(means, bins)),
            _ => 0.0,
        }
    }

    /// Fails if all pixels together need so many `draws`, see [`Detector::draws`], that they would take days.
    pub fn check_draws(draws: f64) -> Result<()> {
        match draws <= MAX_DRAWS {
            true => Ok(()),
            false => Err(Error::advice(
                format!(
                    "the counts with a dead time need {draws:.1e} random numbers, and the maximum is {MAX_DRAWS:e}; "
                ),
                "lower --pulses, or use --first-photon instead of --dead-time",
            )),
        }
    }

    /// Random counts per gate over all pulses, for `means` per pulse and gate, of which `steady` are background and dark counts. The same
    /// `seed` gives the same counts. A count is not finite if the mean over all pulses is not. The means must pass [`Detector::check`].
    ///
    /// A detector without dead time is always on. Jitter moves as many background and dark counts into a gate as
    /// out of it, so only the light is spread. Light from outside of all gates is not known. A detector with a dead time is on only in its gates.
    pub fn counts(&self, means: &[f64], steady: &[f64], bins: &Bins, seed: u64) -> Vec<f64> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        match self.blind {
            Blind::Never => {
                let mut count = |mean: f64| poisson(self.pulses as f64 * mean, &mut random);
                if self.jitter == 0.0 {
                    return means.iter().map(|&mean| count(mean)).collect();
                }
                let light =
                    bins.gates.iter().zip(means.iter().zip(steady)).map(|(&gate, (mean, rest))| (gate, mean - rest));
                let light = jitter::spread(light, bins, self.jitter);
                light.iter().zip(steady).map(|(light, rest)| count(light + rest)).collect()
            }
            // Each pulse gives at most one count, so the counts are multinomial, also after the jitter.
            Blind::UntilNextPulse => {
                let first = match self.jitter == 0.0 {
                    true => first_photon(means),
                    false => jitter::spread(first_photon_in_parts(means, &bins.gates), bins, self.jitter),
                };
                let (mut pulses, mut rest) = (self.pulses, 1.0);
                let mut counts = vec![];
                for probability in first {
                    let here = Binomial::new(pulses, (probability / rest).clamp(0.0, 1.0));
                    let count = here.map_or(0, |here| here.sample(&mut random));
                    counts.push(count as f64);
                    pulses -= count;
                    rest = f64::max(rest - probability, f64::MIN_POSITIVE);
                }
                counts
            }
            Blind::For(dead) => self.pulse_by_pulse(means, bins, dead, &mut random),
        }
    }

    /// Simulates every pulse photon by photon. After a count, the next photon is drawn from the end of the dead time on.
    fn pulse_by_pulse(
        &self,
        means: &[f64],
        Bins { gates, period, .. }: &Bins,
        dead: f64,
        random: &mut Pcg64Mcg,
    ) -> Vec<f64> {
        let mut counts = vec![0.0; means.len()];
        let error = Normal::new(0.0, self.jitter).expect("the jitter is finite");
        // Mean number of photons before each gate.
        let before: Vec<f64> = means
            .iter()
            .scan(0.0, |sum, mean| {
                let before = *sum;
                *sum += mean;
                Some(before)
            })
            .collect();
        for _ in 0..self.pulses {
            let mut seen: f64 = 0.0;
            loop {
                let step: f64 = Exp1.sample(random);
                seen += step;
                let gate = before.partition_point(|before| *before <= seen) - 1;
                let inside = (seen - before[gate]) / means[gate];
                if inside.is_nan() || inside >= 1.0 {
                    break;
                }
                let [lo, hi] = gates[gate];
                let time = lo + inside * (hi - lo);
                let measured: f64 = time + error.sample(random);
                let begin = gates[0][0];
                let measured = period.map_or(measured, |period| begin + (measured - begin).rem_euclid(period));
                if let Some(recorded) = gate_of(gates, measured) {
                    counts[recorded] += 1.0;
                }
                let blind_until = time + dead;
                let next = gates.partition_point(|[_, hi]| *hi <= blind_until);
                let Some([lo, hi]) = gates.get(next) else { break };
                seen = before[next] + means[next] * ((blind_until - lo) / (hi - lo)).max(0.0);
            }
        }
        counts
    }
}

/// A random count of a Poisson distribution. It is not finite if the mean is not.
fn poisson(mean: f64, random: &mut Pcg64Mcg) -> f64 {
    match Poisson::new(mean) {
        Ok(poisson) => poisson.sample(random),
        Err(_) if mean <= 0.0 => 0.0,
        // Above about 2e19, `Poisson` refuses the mean. A normal distribution has the same shape there.
        Err(_) => {
            let deviations: f64 = StandardNormal.sample(random);
            (mean + mean.sqrt() * deviations).round()
        }
    }
}

/// The gate that contains a travel time.
fn gate_of(gates: &[[f64; 2]], time: f64) -> Option<usize> {
    let at = gates.partition_point(|[lo, _]| *lo <= time).checked_sub(1)?;
    (time < gates[at][1]).then_some(at)
}

/// The probability that the first photon of a pulse falls into each gate: (1 - exp(-N)) exp(-sum of earlier N) for N `means`.
fn first_photon(means: &[f64]) -> Vec<f64> {
    let mut earlier = 0.0;
    let probability = |mean: &f64| {
        let first = -(-mean).exp_m1() * f64::exp(-earlier);
        earlier += mean;
        first
    };
    means.iter().map(probability).collect()
}

/// The probabilities of [`first_photon`] in parts of the gates. Within a bright gate, the first photon is likely to be early.
fn first_photon_in_parts(means: &[f64], gates: &[[f64; 2]]) -> Vec<([f64; 2], f64)> {
    let mut parts = vec![];
    for (&mean, [lo, hi]) in means.iter().zip(gates) {
        let count = (16.0 * mean).ceil().clamp(1.0, MAX_PARTS);
        let edge = |k: f64| lo + (hi - lo) * k / count;
        parts.extend((0..count as usize).map(|k| ([edge(k as f64), edge(k as f64 + 1.0)], mean / count)));
    }
    let probabilities = first_photon(&parts.iter().map(|part| part.1).collect::<Vec<_>>());
    parts.into_iter().zip(probabilities).map(|((part, _), probability)| (part, probability)).collect()
}

#[cfg(test)]
mod tests;

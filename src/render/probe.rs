//! The distribution of travel times: the fraction of the light that has reached the sensor by a given time.

use std::collections::BTreeMap;

use super::Renderer;
use super::emitters::luminance;
use super::missing_light::merged_light;
use super::plan::{Observe, Plan};
use super::prepared_scene::PreparedScene;
use super::samples::MAX_SAMPLES_PER_PIXEL;
use crate::error::Result;
use crate::gpu::Device;
use crate::scene::Scene;
use crate::settings::units::Gate;
use crate::settings::{Crop, Estimator, Sampling, Settings, SettingsBuilder, Strategies};

/// Size of the probe: maximum number of rows, light subpaths per iteration, and iterations.
const ROWS: u32 = 64;
const LIGHT_PATHS: u32 = 20_000;
const ITERATIONS: u32 = 4;
/// Samples per iteration over all pixels, if the limits on the samples of a pixel allow it.
const SAMPLES: u32 = 8192;
const MIN_PIXEL_SAMPLES: u32 = 2;
/// Iterations for a crop of few pixels.
const MAX_ITERATIONS: u32 = 32;

/// Histogram of travel times in metres of optical path, weighted by luminance. The relative width of a bin is at most 2^-16.
#[derive(Debug, Clone, Default)]
pub struct TravelTimes {
    /// Sums of weight and of weight times travel time per bin. The key is the leading bits of the travel time.
    bins: BTreeMap<u32, (f64, f64)>,
    total: f64,
    range: Option<(f32, f32)>,
}

impl TravelTimes {
    /// Adds light of `weight` at travel time `tau`. Ignores it if `weight` is not positive, `tau` is negative, or either is
    /// not finite.
    pub fn add(&mut self, tau: f32, weight: f64) {
        if !(weight > 0.0 && weight.is_finite() && tau >= 0.0 && tau.is_finite()) {
            return;
        }
        let bin = self.bins.entry(tau.to_bits() >> 7).or_default();
        bin.0 += weight;
        bin.1 += weight * f64::from(tau);
        self.total += weight;
        self.range = Some(self.range.map_or((tau, tau), |(lo, hi)| (lo.min(tau), hi.max(tau))));
    }

    /// Minimum and maximum travel time; `None` if no light arrived.
    pub fn range(&self) -> Option<(f64, f64)> {
        self.range.map(|(lo, hi)| (lo.into(), hi.into()))
    }

    /// Minimum travel time by which `percent` (0 to 100) of the light has arrived; `None` if no light arrived.
    pub fn percentile(&self, percent: f64) -> Option<f64> {
        let (lo, hi) = self.range()?;
        // The sum over the bins may be smaller than `total` by rounding, because it adds in another order.
        let wanted = self.total * (percent / 100.0).clamp(0.0, 1.0) * (1.0 - 1e-12);
        let mut sum = 0.0;
        let reached = self.bins.values().find(|(weight, _)| {
            sum += weight;
            sum >= wanted
        });
        Some(reached.map_or(hi, |(weight, moment)| (moment / weight).clamp(lo, hi)))
    }

    /// Fraction of the light that arrives inside `gate`; `None` if no light arrived.
    pub fn share(&self, gate: &Gate) -> Option<f64> {
        let (first, last) = self.range()?;
        let inside = self.bins.values().filter(|(weight, moment)| {
            let time = (moment / weight).clamp(first, last);
            gate.lo <= time && time < gate.hi
        });
        Some(inside.map(|(weight, _)| weight).sum::<f64>() / self.total)
    }

    /// Divides the travel times from the first arrival to `end` (metres) into `count` bins of equal width. Returns the bins, each
    /// with the fraction of the light that arrives in it; the last one contains `end`. Empty if no light arrived until `end`. If all
    /// light arrives at one time, the bins reach a thousandth of it to both sides.
    pub fn histogram(&self, end: f64, count: usize) -> Vec<([f64; 2], f64)> {
        let Some((first, last)) = self.range().filter(|(first, _)| *first <= end) else { return vec![] };
        let reach = if end - first > 1e-5 * end { 0.0 } else { 1e-3 * end.max(1e-3) };
        let (begin, before, end) = ((first - reach).max(0.0), end, end + reach);
        let width = (end - begin) / count as f64;
        let mut parts: Vec<([f64; 2], f64)> =
            (0..count).map(|k| ([k, k + 1].map(|edge| begin + width * edge as f64), 0.0)).collect();
        for (weight, moment) in self.bins.values() {
            let time = (moment / weight).clamp(first, last);
            if time <= before {
                let k = ((time - begin) / width).max(0.0) as usize;
                parts[k.min(count - 1)].1 += weight / self.total;
            }
        }
        parts
    }

    /// A gate of `width` metres around the time at which `percent` of the light has arrived, with ends rounded to a few digits. `None`
    /// if no light arrived.
    pub fn gate_at(&self, percent: f64, width: f64) -> Option<Gate> {
        let middle = self.percentile(percent)?;
        let step = step(width);
        let round = |x: f64| multiple((x / step).round(), step);
        Gate::new(round((middle - 0.5 * width).max(0.0)), round(middle + 0.5 * width)).ok()
    }

    /// A gate from the first light to the time by which 95 % of the light has arrived, with ends rounded outwards to a few digits. `None`
    /// if no light arrived.
    pub fn whole_gate(&self) -> Option<Gate> {
        let (first, _) = self.range()?;
        let last = self.percentile(95.0)?;
        let step = step((last - first).max(1e-3 * last));
        Gate::new(multiple((first / step).floor(), step), multiple((last / step).floor() + 1.0, step)).ok()
    }
}

/// The power of ten that is at most a quarter of `width`.
fn step(width: f64) -> f64 {
    10f64.powf((width / 4.0).log10().floor())
}

/// `count` times `step`, a power of ten, without the rounding error of the product.
fn multiple(count: f64, step: f64) -> f64 {
    let digits = (-step.log10()).max(0.0).round() as usize;
    let product = count * step;
    format!("{product:.digits$}").parse::<f64>().unwrap_or(product)
}

/// Renders a small image of the same crop as `settings`, without a gate and with all strategies, and returns its travel times.
pub fn probe(device: &Device, scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Result<TravelTimes> {
    let merged = merged_light(scene, settings, prepared);
    let settings = small(settings);
    let mut renderer = observer(device, scene, &settings, prepared)?;
    let mut times = TravelTimes::default();
    let unit = prepared.space.unit as f32;
    let pixels = settings.crop().width() * settings.crop().height();
    // A crop of a few pixels gets as many samples as the pixels of a whole image together.
    let samples = (SAMPLES / pixels).clamp(MIN_PIXEL_SAMPLES, MAX_SAMPLES_PER_PIXEL);
    let iterations = (ITERATIONS * SAMPLES / (samples * pixels)).clamp(ITERATIONS, MAX_ITERATIONS);
    for _ in 0..iterations {
        renderer.observe(samples, &mut |seen| times.add(unit * seen.tau, luminance(seen.rgb)))?;
    }
    // The device observes connections only. Contributions are parts of the mean of a pixel.
    for (tau, light) in merged {
        times.add(tau as f32, light * f64::from(iterations) * f64::from(pixels));
    }
    Ok(times)
}

/// A renderer whose contributions come with their travel times. `settings` have no gate and uniform sampling.
pub(super) fn observer(
    device: &Device,
    scene: &Scene,
    settings: &Settings,
    prepared: &PreparedScene,
) -> Result<Renderer> {
    let mut plan = Plan::new(scene, settings, prepared, device.info().quirks)?;
    plan.observe(Observe::Times);
    Renderer::from_plan(device, plan, [1, 1], scene, prepared)
}

/// The same view without a gate, with all strategies.
pub(super) fn without_gate(settings: &Settings) -> SettingsBuilder {
    let open = settings.change().estimator(Estimator::UNGATED).strategies(Strategies::All).gate(Gate::OPEN);
    let open = open.sampling(Sampling::Uniform).splat_paths(None);
    open.light_paths(settings.light_paths().min(LIGHT_PATHS))
}

/// The settings of the probe: the same crop with few pixels, without a gate.
pub(super) fn small(settings: &Settings) -> Settings {
    let [width, height] = settings.resolution();
    let scale = (f64::from(ROWS) / f64::from(settings.crop().height())).min(1.0);
    let resolution = [width, height].map(|side| ((f64::from(side) * scale).round() as u32).max(1));
    let begin = |x: u32, max: u32| ((f64::from(x) * scale).floor() as u32).min(max - 1);
    let end = |x: u32, begin: u32, max: u32| ((f64::from(x) * scale).ceil() as u32).clamp(begin + 1, max);
    let (x0, y0) = (begin(settings.crop().x0, resolution[0]), begin(settings.crop().y0, resolution[1]));
    let (x1, y1) = (end(settings.crop().x1, x0, resolution[0]), end(settings.crop().y1, y0, resolution[1]));
    let small = without_gate(settings).resolution(resolution).crop(Crop { x0, x1, y0, y1 });
    small.build().expect("settings of a smaller image are within the limits")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(samples: &[(f32, f64)]) -> TravelTimes {
        let mut times = TravelTimes::default();
        samples.iter().for_each(|&(tau, weight)| times.add(tau, weight));
        times
    }

    #[test]
    fn percentiles_are_those_counted_by_hand() {
        // Weights 1, 2, 3, 4 at 4, 3, 2, 1 m: 40 % has arrived by 1 m, 70 % by 2 m, 90 % by 3 m, all by 4 m.
        let t = times(&[(4.0, 1.0), (3.0, 2.0), (2.0, 3.0), (1.0, 4.0)]);
        assert_eq!(t.range(), Some((1.0, 4.0)));
        for (percent, tau) in [
            (0.0, 1.0),
            (1.0, 1.0),
            (40.0, 1.0),
            (40.1, 2.0),
            (70.0, 2.0),
            (75.0, 3.0),
            (90.0, 3.0),
            (91.0, 4.0),
            (100.0, 4.0),
        ] {
            assert_eq!(t.percentile(percent), Some(tau), "{percent} %");
        }
    }

    #[test]
    fn a_gate_has_a_share_of_the_light() {
        let t = times(&[(4.0, 1.0), (3.0, 2.0), (2.0, 3.0), (1.0, 4.0)]);
        assert_eq!(t.share(&Gate { lo: 1.0, hi: 3.0 }), Some(0.7));
        assert_eq!((t.share(&Gate { lo: 5.0, hi: 6.0 }), times(&[]).share(&Gate::OPEN)), (Some(0.0), None));
    }

    #[test]
    fn a_histogram_holds_the_light_before_its_end() {
        let t = times(&[(4.0, 1.0), (3.0, 2.0), (2.0, 3.0), (1.0, 4.0)]);
        assert_eq!(t.histogram(3.5, 2), [([1.0, 2.25], 0.7), ([2.25, 3.5], 0.2)]);
        assert!(t.histogram(0.5, 2).is_empty() && times(&[]).histogram(1.0, 2).is_empty());
        // The last bin contains its end.
        assert_eq!(t.histogram(t.percentile(90.0).unwrap(), 2), [([1.0, 2.0], 0.4), ([2.0, 3.0], 0.5)]);
    }

    #[test]
    fn light_of_one_time_has_a_histogram() {
        for tau in [0.0, 7.3] {
            let t = times(&[(tau, 2.0), (tau, 1.0)]);
            let bins = t.histogram(t.percentile(99.0).unwrap(), 4);
            let widths_are_positive = bins.iter().all(|([lo, hi], _)| lo < hi);
            assert!(widths_are_positive && bins.iter().map(|(_, light)| light).sum::<f64>() == 1.0, "{bins:?}");
        }
    }

    #[test]
    fn close_times_share_a_step_and_keep_their_mean() {
        let t = times(&[(1.0, 1.0), (1.0 + f32::EPSILON, 3.0)]);
        let mean = 1.0 + 0.75 * f64::from(f32::EPSILON);
        assert!((t.percentile(50.0).unwrap() - mean).abs() < 1e-12);
        assert_eq!(t.percentile(1.0), t.percentile(99.0));
    }

    #[test]
    fn light_without_a_finite_positive_weight_does_not_count() {
        let t = times(&[(f32::NAN, 1.0), (1.0, 0.0), (1.0, f64::NAN), (-1.0, 1.0), (f32::INFINITY, 1.0), (1.0, -1.0)]);
        assert_eq!((t.range(), t.percentile(50.0), t.gate_at(50.0, 1.0)), (None, None, None));
        assert_eq!(t.whole_gate(), None);
    }

    #[test]
    fn a_suggestion_is_short_and_about_the_median() {
        let t = times(&[(12.4567, 1.0)]);
        assert_eq!(t.gate_at(50.0, 0.3).unwrap(), Gate { lo: 12.31, hi: 12.61 });
        assert_eq!(t.gate_at(50.0, 0.3).unwrap().to_string(), "12.31m..12.61m");
        assert_eq!(t.gate_at(50.0, 14.0).unwrap(), Gate { lo: 5.0, hi: 19.0 });
        assert_eq!(t.gate_at(50.0, 100.0).unwrap().lo, 0.0);
    }

    #[test]
    fn the_whole_gate_holds_the_first_light_and_most_of_the_rest() {
        let t = times(&[(4.3456, 1.0), (9.8765, 18.5), (16.3, 0.5)]);
        assert_eq!(t.whole_gate().unwrap(), Gate { lo: 4.0, hi: 10.0 });
        let t = times(&[(12.4567, 1.0)]);
        assert_eq!(t.whole_gate().unwrap().to_string(), "12.456m..12.457m");
    }
}

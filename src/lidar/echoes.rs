//! Echoes in a waveform: the surfaces and the fog that one shot of a LiDAR meets.

use std::str::FromStr;

/// Maximum number of echoes of a shot.
pub const MAX_ECHOES: usize = 8;
/// Two peaks are two echoes if the light between them falls below this share of the lower peak.
const VALLEY: f64 = 0.5;
/// The share of the peak at which a constant-fraction discriminator measures the time.
const FRACTION: f64 = 0.5;

/// The point of an echo that gives its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detection {
    /// The rising edge at the threshold.
    Threshold,
    /// The rising edge at half of the peak.
    ConstantFraction,
    /// The top of a parabola through the highest bin and its neighbours.
    Peak,
}

impl FromStr for Detection {
    type Err = String;

    fn from_str(text: &str) -> Result<Detection, String> {
        match text {
            "threshold" => Ok(Detection::Threshold),
            "constant-fraction" => Ok(Detection::ConstantFraction),
            "peak" => Ok(Detection::Peak),
            _ => Err("choose one of threshold, constant-fraction, peak".into()),
        }
    }
}

/// How echoes are found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finder {
    /// The point of an echo that gives its time.
    pub detection: Detection,
    /// Height of the threshold as a share of the highest bin of the waveform, from 0 to 1.
    pub threshold: f64,
    /// Least height of the threshold, in the unit of the waveform.
    pub floor: f64,
    /// Least distance between the peaks of two echoes, in bins.
    pub separation: f64,
    /// Maximum number of echoes, at most [`MAX_ECHOES`]. The earliest ones are kept.
    pub max: usize,
}

/// An echo in a waveform. Positions are in bins: 0 is the begin of the first bin.
#[derive(Debug, Clone, PartialEq)]
pub struct Echo {
    /// The time of the echo.
    pub position: f64,
    /// The sum of its bins.
    pub light: f64,
    /// Its first bin.
    pub begin: usize,
    /// The bin after its last one.
    pub end: usize,
}

impl Finder {
    /// The echoes of a waveform, the earliest first. `waveform`: the light of each bin, finite and 0 or more. Echoes are searched in the
    /// light that is averaged over a separation, so that the noise of a slanted surface is one echo.
    pub fn echoes(&self, waveform: &[f64]) -> Vec<Echo> {
        let highest = |light: &[f64]| light.iter().copied().fold(0.0, f64::max);
        let threshold = (self.threshold * highest(waveform)).max(self.floor);
        let radius = ((0.5 * self.separation) as usize).min(waveform.len());
        let near = averaged(waveform, radius);
        let dark = self.threshold * highest(&near);
        let found =
            peaks(&near, dark, self.separation).into_iter().map(|peak| trimmed(peak, waveform, &near, dark, radius));
        let is_seen = |peak: &Peak| waveform[peak.top] > threshold;
        found.filter(is_seen).take(self.max).map(|peak| self.echo(waveform, threshold, peak)).collect()
    }

    fn echo(&self, waveform: &[f64], threshold: f64, Peak { top, begin, end }: Peak) -> Echo {
        let position = match self.detection {
            Detection::Threshold => rising_edge(waveform, top, threshold),
            Detection::ConstantFraction => rising_edge(waveform, top, FRACTION * waveform[top]),
            Detection::Peak => top_of_parabola(waveform, top),
        };
        Echo { position, light: waveform[begin..end].iter().sum(), begin, end }
    }
}

/// The mean over each bin and `radius` bins on each side. Bins beyond the ends are dark.
fn averaged(waveform: &[f64], radius: usize) -> Vec<f64> {
    let mean = |bin: usize| {
        let near = &waveform[bin.saturating_sub(radius)..(bin + radius + 1).min(waveform.len())];
        near.iter().sum::<f64>() / (2 * radius + 1) as f64
    };
    (0..waveform.len()).map(mean).collect()
}

/// The peak of the averaged light `near` without its dark ends, and with the highest bin of the waveform.
fn trimmed(Peak { top, begin, end }: Peak, waveform: &[f64], near: &[f64], dark: f64, radius: usize) -> Peak {
    let is_dark = |&bin: &usize| near[bin] <= dark;
    let begin = (begin..top).rev().find(is_dark).map_or(begin, |bin| bin + 1);
    let end = (top..end).find(is_dark).unwrap_or(end);
    let around = top.saturating_sub(radius).max(begin)..(top + radius + 1).min(end);
    let top = around.max_by(|&a, &b| waveform[a].total_cmp(&waveform[b])).unwrap_or(top);
    Peak { top, begin, end }
}

/// The highest bin of an echo, and the bins between the valleys on its sides.
struct Peak {
    top: usize,
    begin: usize,
    end: usize,
}

/// Peaks above the threshold with deep valleys between them.
fn peaks(waveform: &[f64], threshold: f64, separation: f64) -> Vec<Peak> {
    let mut found: Vec<Peak> = vec![];
    // Lowest bin since the last top.
    let mut valley = 0;
    for (bin, &light) in waveform.iter().enumerate() {
        if light < waveform[valley] {
            valley = bin;
        }
        if light <= threshold {
            continue;
        }
        match found.last_mut() {
            None => {
                found.push(Peak { top: bin, begin: 0, end: waveform.len() });
                valley = bin;
            }
            Some(last) => {
                let (top, is_apart) = (waveform[last.top], (bin - last.top) as f64 >= separation);
                if is_apart && waveform[valley] < VALLEY * top.min(light) {
                    last.end = valley;
                    found.push(Peak { top: bin, begin: valley, end: waveform.len() });
                    valley = bin;
                } else if light > top {
                    last.top = bin;
                    valley = bin;
                }
            }
        }
    }
    found
}

/// Where the light rises to `level` for the last time before bin `top`, by straight lines between the centres of the bins. The light is 0
/// before the first bin.
fn rising_edge(waveform: &[f64], top: usize, level: f64) -> f64 {
    let below = (0..top).rev().find(|&bin| waveform[bin] < level);
    let (low, high) = (below.map_or(0.0, |bin| waveform[bin]), waveform[below.map_or(0, |bin| bin + 1)]);
    below.map_or(-0.5, |bin| bin as f64 + 0.5) + (level - low) / (high - low)
}

/// The top of the parabola through the centres of bin `top` and its neighbours. Bins beyond the ends are dark.
fn top_of_parabola(waveform: &[f64], top: usize) -> f64 {
    let at = |bin: Option<usize>| bin.and_then(|bin| waveform.get(bin)).copied().unwrap_or(0.0);
    let [before, here, after] = [at(top.checked_sub(1)), waveform[top], at(Some(top + 1))];
    let curvature = before - 2.0 * here + after;
    let offset = if curvature < 0.0 { 0.5 * (before - after) / curvature } else { 0.0 };
    top as f64 + 0.5 + offset.clamp(-0.5, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FINDER: Finder =
        Finder { detection: Detection::Peak, threshold: 0.1, floor: 0.0, separation: 1.0, max: MAX_ECHOES };

    /// A pulse with this centre and standard deviation in bins, sampled at the centres of the bins.
    fn pulse(centre: f64, deviation: f64, height: f64) -> Vec<f64> {
        (0..100).map(|bin| height * (-0.5 * ((bin as f64 + 0.5 - centre) / deviation).powi(2)).exp()).collect()
    }

    fn sum(a: &[f64], b: &[f64]) -> Vec<f64> {
        a.iter().zip(b).map(|(a, b)| a + b).collect()
    }

    #[test]
    fn each_detection_finds_its_point_of_a_pulse() {
        for centre in [30.0, 30.2, 30.5, 30.9] {
            let waveform = pulse(centre, 4.0, 7.0);
            for (detection, level) in
                [(Detection::Peak, 1.0f64), (Detection::ConstantFraction, 0.5), (Detection::Threshold, 0.1)]
            {
                let found = Finder { detection, ..FINDER }.echoes(&waveform);
                // A Gaussian rises to a level at this distance before its centre.
                let expected = centre - 4.0 * (-2.0 * level.ln()).sqrt();
                assert_eq!(found.len(), 1);
                let error = (found[0].position - expected).abs();
                assert!(error < 0.08, "{detection:?} {centre}: {error}");
                // An estimate without interpolation, the edge of a bin, is farther away for some of the centres.
                assert!(centre != 30.2 || (found[0].position.round() - expected).abs() > 0.08);
            }
            let light: f64 = waveform.iter().filter(|&&light| light > 0.7).sum();
            assert!((FINDER.echoes(&waveform)[0].light / light - 1.0).abs() < 0.05);
        }
    }

    #[test]
    fn deep_valleys_separate_echoes() {
        let two = |gap: f64| FINDER.echoes(&sum(&pulse(20.0, 2.0, 4.0), &pulse(20.0 + gap, 2.0, 1.0))).len();
        assert_eq!([two(3.0), two(12.0)], [1, 2]);
        let far = sum(&pulse(20.0, 2.0, 4.0), &pulse(60.0, 2.0, 1.0));
        let count = |finder: Finder| finder.echoes(&far).len();
        assert_eq!(count(Finder { threshold: 0.3, ..FINDER }), 1);
        assert_eq!(count(Finder { floor: 1.5, ..FINDER }), 1);
        assert_eq!(count(Finder { separation: f64::MAX, ..FINDER }), 1);
        assert_eq!(count(Finder { separation: 50.0, ..FINDER }), 1);
        assert_eq!(count(Finder { max: 1, ..FINDER }), 1);
        let found = FINDER.echoes(&far);
        assert!((found[1].position - 60.0).abs() < 0.03 && (found[0].light / found[1].light - 4.0).abs() < 1.0);
        assert!(found[0].end <= found[1].begin);
    }

    /// Alternate bins of a slanted surface have little light. Without a separation, they are many echoes.
    #[test]
    fn a_noisy_surface_is_one_echo() {
        let mut waveform = pulse(40.0, 8.0, 1.0);
        waveform.iter_mut().step_by(2).for_each(|light| *light *= 0.2);
        let count = |separation: f64| Finder { separation, ..FINDER }.echoes(&waveform).len();
        assert!(count(6.0) == 1 && count(1.0) > 3);
    }

    #[test]
    fn degenerate_waveforms_are_no_surprise() {
        assert!(FINDER.echoes(&[]).is_empty() && FINDER.echoes(&[0.0; 5]).is_empty());
        for detection in [Detection::Peak, Detection::ConstantFraction, Detection::Threshold] {
            for waveform in [&[3.0][..], &[3.0, 0.0], &[0.0, 3.0], &[3.0, 3.0, 3.0]] {
                let found = Finder { detection, ..FINDER }.echoes(waveform);
                assert!(found.len() == 1 && found[0].position.is_finite(), "{detection:?} {waveform:?} {found:?}");
            }
        }
    }
}

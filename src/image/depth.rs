//! Phase, amplitude and depth from the four images of a continuous-wave sensor.

use crate::image::response_film::ResponseFilm;
use crate::settings::Responses;
use crate::settings::frequencies::Frequencies;

/// The measurement of one frequency in one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Echo {
    /// Phase of the modulation in radians, 0 to 2 pi.
    pub phase: f32,
    /// Amplitude of the modulation, as radiance. It is the radiance of all light that arrives if this light has one travel time, and
    /// less otherwise.
    pub amplitude: f32,
    /// One-way distance in metres, 0 to half a period. Farther surfaces seem nearer by multiples of half a period. NaN if the
    /// amplitude is 0, for example because no light arrives.
    pub depth: f32,
}

/// The echo of four images I_k. The weight of image k is (1 + cos(2 pi tau / `period` + k pi / 2)) / 2. The travel time tau and
/// `period` are in metres of optical path.
pub fn echo(images: [f64; 4], period: f64) -> Echo {
    let [i0, i1, i2, i3] = images;
    let (sine, cosine) = (i3 - i1, i0 - i2);
    let amplitude = sine.hypot(cosine);
    if amplitude.is_nan() || amplitude == 0.0 {
        return Echo { phase: 0.0, amplitude: 0.0, depth: f32::NAN };
    }
    let turn = std::f64::consts::TAU;
    let phase = sine.atan2(cosine).rem_euclid(turn);
    Echo { phase: phase as f32, amplitude: amplitude as f32, depth: (0.5 * period * phase / turn) as f32 }
}

/// The depth that two frequencies agree on. Each frequency allows several depths, up to the distance at which both phases repeat
/// together. This function takes the pair with the smallest difference and returns its mean. The weights are the squared
/// frequencies, because an error of the phase changes the depth less at the higher frequency. Depths are compared modulo the common
/// distance, because noise may move one phase past 0 and not the other. NaN if a depth is NaN.
pub fn unwrapped(depths: [f32; 2], megahertz: [f64; 2]) -> f32 {
    if depths.iter().any(|depth| depth.is_nan()) {
        return f32::NAN;
    }
    let half = megahertz.map(|f| 0.5 * Frequencies::period(f));
    let turns = common_turns(megahertz);
    let at = |i: usize, n: i64| f64::from(depths[i]) + n as f64 * half[i];
    let mut best = (f64::INFINITY, 0.0f64);
    for n in 0..i64::from(turns[0]) {
        // The nearest depth that the other frequency allows, from one turn before 0 to one turn after the common distance.
        let near = ((at(0, n) - at(1, 0)) / half[1]).round().clamp(-1.0, f64::from(turns[1])) as i64;
        let difference = (at(0, n) - at(1, near)).abs();
        if difference < best.0 {
            let [a, b] = megahertz.map(|f| f * f);
            best = (difference, (a * at(0, n) + b * at(1, near)) / (a + b));
        }
    }
    // A common distance of `MAX_TURNS` turns or more counts as unknown, so the depth is not reduced modulo this distance.
    let is_common = turns.iter().all(|&n| f64::from(n) < MAX_TURNS);
    let depth = if is_common { best.1.rem_euclid(half[0] * f64::from(turns[0])) } else { best.1.max(0.0) };
    depth as f32
}

/// Maximum number of turns that are tried.
const MAX_TURNS: f64 = 1000.0;

/// Numbers of turns of the two phases until both are at 0 again: the frequencies over their greatest common divisor.
fn common_turns([a, b]: [f64; 2]) -> [u32; 2] {
    let (mut x, mut y) = (a.max(b), a.min(b));
    while y > 1e-6 * a {
        (x, y) = (y, x % y);
    }
    [a, b].map(|f| (f / x).round().clamp(1.0, MAX_TURNS) as u32)
}

/// Echoes of all pixels for frequency `index` of a film with four responses per frequency. The images are the sums of R, G and B,
/// weighted as luminance.
pub fn echoes(film: &ResponseFilm, frequencies: &Frequencies, index: usize) -> Vec<Echo> {
    let period = Frequencies::period(frequencies.megahertz()[index]);
    (0..film.pixels())
        .map(|pixel| {
            let means: Vec<f32> = film.means_of(pixel).skip(12 * index).take(12).collect();
            let luminance = |k: usize| {
                let [r, g, b] = [0, 1, 2].map(|c| f64::from(means[3 * k + c]));
                0.2126 * r + 0.7152 * g + 0.0722 * b
            };
            echo([0, 1, 2, 3].map(luminance), period)
        })
        .collect()
}

/// Phase and amplitude of each frequency of a continuous-wave sensor. If it has depths, also these and, for two frequencies, the unwrapped
/// depth. Each plane has a name and one value per pixel. The last plane is the best depth: `write_depths` relies on this order.
pub fn planes(film: &ResponseFilm, responses: &Responses) -> Vec<(String, Vec<f32>)> {
    let Some(frequencies) = responses.frequencies() else { return vec![] };
    let all: Vec<Vec<Echo>> = (0..frequencies.megahertz().len()).map(|i| echoes(film, frequencies, i)).collect();
    let mut planes = vec![];
    for (echoes, &f) in all.iter().zip(frequencies.megahertz()) {
        let mut plane = |what: &str, of: fn(&Echo) -> f32| {
            planes.push((format!("{}.{what}", Frequencies::name(f)), echoes.iter().map(of).collect()));
        };
        plane("phase", |echo| echo.phase);
        plane("amplitude", |echo| echo.amplitude);
        if responses.have_depths() {
            plane("depth", |echo| echo.depth);
        }
    }
    if responses.have_depths()
        && let ([a, b], &[f, g]) = (&all[..], frequencies.megahertz())
    {
        let pairs = a.iter().zip(b).map(|(a, b)| unwrapped([a.depth, b.depth], [f, g]));
        planes.push(("cw.depth".into(), pairs.collect()));
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The four images of light with these travel times and strengths.
    fn images(light: &[(f64, f64)], megahertz: f64) -> [f64; 4] {
        let responses = Responses::from(Frequencies::new(vec![megahertz]).unwrap());
        let sums: Vec<f64> = responses.iter().map(|r| light.iter().map(|&(tau, x)| x * r.weight(tau)).sum()).collect();
        sums.try_into().unwrap()
    }

    #[test]
    fn one_return_has_its_depth_and_strength() {
        let period = Frequencies::period(20.0);
        for tau in [0.1, 3.0, 7.4, 14.9] {
            let echo = echo(images(&[(tau, 2.5)], 20.0), period);
            assert!((f64::from(echo.depth) - 0.5 * tau).abs() < 1e-6, "{tau}: {echo:?}");
            assert!((echo.amplitude - 2.5).abs() < 1e-6);
        }
        // Beyond half a period the depth is ambiguous; two returns give a depth between them, and a weaker modulation.
        let far = echo(images(&[(period + 1.0, 1.0)], 20.0), period);
        assert!((far.depth - 0.5).abs() < 1e-6);
        let two = echo(images(&[(4.0, 1.0), (5.0, 1.0)], 20.0), period);
        assert!((two.depth - 2.25).abs() < 1e-6 && two.amplitude < 1.99);
        assert!(echo([1.0; 4], period).depth.is_nan());
    }

    #[test]
    fn two_frequencies_reach_farther() {
        let [f, g] = [80.0, 60.0];
        assert_eq!(common_turns([f, g]), [4, 3]);
        assert_eq!(common_turns([100.0, 99.5]), [200, 199]);
        for depth in [0.5, 2.0, 3.0, 5.5, 7.4] {
            let of = |f: f64| echo(images(&[(2.0 * depth, 1.0)], f), Frequencies::period(f)).depth;
            assert!((f64::from(unwrapped([of(f), of(g)], [f, g])) - depth).abs() < 1e-5, "{depth}");
        }
        assert!(unwrapped([f32::NAN, 1.0], [f, g]).is_nan());
        assert!(unwrapped([f32::NAN, 1.0], [1.0, 1.0 + 1e-5]).is_nan());
    }

    /// Noise may move one phase below 0, where it begins anew.
    #[test]
    fn depths_near_the_ends_of_the_range_are_near_them() {
        let range = 7.4948;
        for depths in [[0.005, 2.493], [1.869, 0.005], [1.873, 2.497], [0.001, 0.003]] {
            let depth = f64::from(unwrapped(depths, [80.0, 60.0]));
            assert!((0.0..=range).contains(&depth), "{depths:?}: {depth}");
            assert!(depth < 0.02 || depth > range - 0.02, "{depths:?}: {depth}");
        }
    }
}

//! An exposure: while the shutter is open, each iteration of a render shows the scene at another moment.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::iterations::Iterate;
use super::ready::Ready;
use super::{Job, read};
use crate::error::{Error, Result};
use crate::input::experiment::Experiment;
use crate::render::Renderer;
use crate::render::schedule::{Following, Lengths};
use crate::render::space::RenderSpace;
use crate::render::split_mix::{STEP, mix};
use crate::scene::{Scene, gltf};
use crate::settings::moment::Moment;
use crate::settings::shutter::LineTime;
use crate::settings::table::InputTable;
use crate::settings::{Budget, Settings};

/// The moments that a render shows. The moment of each iteration is its number times the golden ratio, modulo the duration of the exposure:
/// any run of iterations, and those of any shard, are spread evenly. With a rolling shutter this holds for each row.
pub struct Exposure {
    /// The experiment of a single moment, whose waves do not turn.
    experiment: Experiment,
    /// When the exposure of the first row of the whole image begins, in seconds of the animations.
    begin: f64,
    /// How long each row is exposed, and how much later than the row above, in seconds.
    duration: f64,
    line_time: f64,
    /// By how much the modulation of the sensor is faster than that of the light, in Hz. They are in phase at `begin`.
    heterodyne: f64,
    /// The rows to render, counted in the whole image.
    rows: Range<u32>,
    /// The render space of the scene in the middle of the exposure.
    home: RenderSpace,
    /// Place in the exposure of the first iteration, as a fraction of 2^32. It depends on the seed.
    shift: u32,
}

/// The rows of an iteration that show the same moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Rows {
    /// Seconds of the animations.
    pub at: f64,
    /// Counted from the first row to render.
    pub rows: Range<u32>,
}

/// The golden ratio modulo 1, as a fraction of 2^32.
const GOLDEN: u32 = (STEP >> 32) as u32;

impl Exposure {
    /// The exposure of an experiment with all defaults; `None` if the shutter opens for an instant. `scene`: that in the middle of the
    /// exposure. Fails if nothing in the scene moves, or if the shutter is open before or after the animations.
    pub fn new(config: &Experiment, settings: &Settings, scene: &Scene) -> Result<Option<Exposure>> {
        let InputTable { at, shutter, rolling, .. } = config.input;
        check(config, settings.crop().y0..settings.crop().y1)?;
        let Some(shutter) = shutter else { return Ok(None) };
        let home = RenderSpace::of_camera(scene, &scene.cameras[settings.camera()], settings.emitters());
        let mut experiment = config.clone();
        (experiment.input.shutter, experiment.input.rolling, experiment.gate.heterodyne) = (None, None, None);
        Ok(Some(Exposure {
            experiment,
            begin: at.map_or(0.0, |Moment(at)| at) + shutter.open,
            duration: shutter.duration(),
            heterodyne: settings.responses().heterodyne().unwrap_or(0.0),
            line_time: rolling.map_or(0.0, |LineTime(time)| time),
            rows: settings.crop().y0..settings.crop().y1,
            home,
            shift: shift_of(settings.seed()),
        }))
    }

    /// A warning if a budget of samples shows so few moments that they can be told apart, or too few for the turns of a heterodyne sensor.
    /// Of a budget of time, nobody knows before the render; see [`Exposure::warning_after`].
    pub fn warning(&self, budget: Budget) -> Option<String> {
        match budget {
            Budget::Spp(spp) => self.too_few(spp, Lengths::OfMoments.iterations_of(spp)),
            Budget::Seconds(_) => None,
        }
    }

    /// As [`Exposure::warning`], for a render of `samples` samples per pixel in so many iterations.
    pub fn warning_after(&self, samples: u64, iterations: u32) -> Option<String> {
        self.too_few(samples.try_into().unwrap_or(u32::MAX), iterations.max(1))
    }

    fn too_few(&self, spp: u32, moments: u32) -> Option<String> {
        let shown = if moments == 1 { "1 moment".into() } else { format!("{moments} moments") };
        let turns = (self.heterodyne * self.duration).abs();
        let needed = MOMENTS_PER_TURN * turns;
        if f64::from(moments) < needed {
            return Some(format!(
                "the phase of the heterodyne sensor turns {} times while the shutter is open, but {spp} samples per pixel show {shown}; \
                 use at least --spp {}, or a shorter --shutter",
                (turns * 10.0).round() / 10.0,
                (needed * f64::from(spp.div_ceil(moments))).ceil()
            ));
        }
        (moments < FEW_MOMENTS).then(|| {
            format!(
                "with {spp} samples per pixel, the exposure shows {shown}, which may look like separate images; use at least \
                 --spp {}",
                FEW_MOMENTS * spp.div_ceil(moments)
            )
        })
    }

    /// Which rows of an iteration show which moment, from top to bottom. At least one entry.
    pub fn moments(&self, iteration: u32) -> Vec<Rows> {
        let phase = f64::from(GOLDEN.wrapping_mul(iteration).wrapping_add(self.shift)) / 2f64.powi(32);
        // The row begins later than the first row of the image by `delay`. Its moment is one of `phase`, `phase + 1`, ... in durations of
        // the exposure: the one inside its own exposure.
        let turn_of = |row: u32| {
            let delay = f64::from(row) * self.line_time / self.duration;
            (delay - phase).ceil()
        };
        let mut all: Vec<Rows> = vec![];
        let mut last = f64::NAN;
        for row in self.rows.clone() {
            let (turn, index) = (turn_of(row), row - self.rows.start);
            if turn == last {
                all.last_mut().expect("there is a row").rows.end = index + 1;
            } else {
                all.push(Rows { at: self.begin + (phase + turn) * self.duration, rows: index..index + 1 });
                last = turn;
            }
        }
        all
    }

    /// The scene at a moment, and the settings of the render there.
    fn load(&self, at: f64) -> Result<(Scene, Settings)> {
        let mut experiment = self.experiment.clone();
        experiment.input.at = Some(Moment(at));
        let scene = read::scene(&experiment)?;
        let job = Job::new(experiment, scene)?;
        Ok((job.scene, job.resolved.settings))
    }
}

/// See [`Exposure`].
fn shift_of(seed: u32) -> u32 {
    mix(u64::from(seed).wrapping_mul(STEP)) as u32
}

/// Fewer moments than this may be told apart.
const FEW_MOMENTS: u32 = 16;
/// With fewer moments, the mean over a turn of a heterodyne sensor is far from 0.
const MOMENTS_PER_TURN: f64 = 4.0;

/// Fails if the settings have a rolling shutter or a heterodyne sensor without an exposure, or if nothing in the scene moves. Also fails if
/// one of `rows` of the image is exposed before or after the animations.
pub fn check(experiment: &Experiment, rows: Range<u32>) -> Result<()> {
    let InputTable { at, shutter, rolling, .. } = experiment.input;
    let Some(shutter) = shutter else {
        return match (rolling, experiment.gate.heterodyne) {
            (Some(_), _) => Err(Error::advice("a rolling shutter needs an exposure: ", "add --shutter 0..20ms")),
            (None, Some(_)) => {
                let message = "the phases of a heterodyne sensor turn during an exposure: ";
                Err(Error::advice(message, "add --shutter 0..20ms"))
            }
            (None, None) => Ok(()),
        };
    };
    let end = match &experiment.scene {
        Some(_) => read::end_of_animations(experiment)?,
        None => None,
    };
    let Some(end) = end else {
        let message = "no node of the scene is animated, so nothing moves while the shutter is open; ";
        return Err(Error::advice(message, "leave out --shutter"));
    };
    let (frame, line_time) = (at.map_or(0.0, |Moment(at)| at), rolling.map_or(0.0, |LineTime(time)| time));
    let first = frame + shutter.open + f64::from(rows.start) * line_time;
    let last = frame + shutter.close + f64::from(rows.end - 1) * line_time;
    if first >= 0.0 && last <= end * (1.0 + gltf::ROUNDING) {
        return Ok(());
    }
    Err(Error::advice(
        format!(
            "the shutter is open from {} s to {} s, but the animations last from 0 s to {} s; ",
            rounded(first),
            rounded(last),
            rounded(end)
        ),
        format!("change --shutter, --rolling, or the time of the frame, which is {} s", rounded(frame)),
    ))
}

fn rounded(seconds: f64) -> f64 {
    (seconds * 1e6).round() / 1e6
}

/// The lengths of the iterations of a render with this input.
pub fn lengths(input: &InputTable) -> Lengths {
    if input.shutter.is_some() { Lengths::OfMoments } else { Lengths::Growing }
}

/// A render whose shutter is open.
pub struct Exposed<'a> {
    pub exposure: &'a Exposure,
    pub ready: &'a mut Ready,
}

impl Iterate for Exposed<'_> {
    fn renderer(&mut self) -> &mut Renderer {
        &mut self.ready.renderer
    }

    fn iterate(&mut self, samples: u32, stop: &Arc<AtomicBool>) -> Result<bool> {
        // The next iteration shows another scene, so its light cannot be traced yet.
        self.ready.renderer.announce(Following::Unknown);
        let home = self.exposure.home;
        for Rows { at, rows } in self.exposure.moments(self.ready.renderer.rendered().end) {
            let start = Instant::now();
            let shown = self.exposure.load(at).and_then(|(scene, settings)| self.ready.show(scene, &settings, home));
            self.ready.renderer.add_time("follow what moves", start.elapsed());
            if let Err(error) = shown {
                self.ready.renderer.abandon();
                return Err(match error {
                    Error::Settings(mistake) => {
                        Error::Settings(mistake.after(&format!("at {} s of the animations: ", rounded(at))))
                    }
                    other => other,
                });
            }
            self.ready.renderer.turn_waves(self.exposure.heterodyne * (at - self.exposure.begin));
            if !self.ready.renderer.iterate_rows(samples, rows, stop)? {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// An exposure of 20 ms that begins at 1 s, of the rows 3 to 99 of an image.
    fn exposure(line_time: f64) -> Exposure {
        let (experiment, home) = (Experiment::default(), RenderSpace::metres(DVec3::ZERO));
        let (begin, duration, heterodyne, shift) = (1.0, 0.02, 0.0, 0x1234_5678);
        Exposure { experiment, begin, duration, line_time, heterodyne, rows: 3..100, home, shift }
    }

    #[test]
    fn each_row_shows_moments_inside_its_exposure_evenly() {
        for line_time in [0.0, 3e-6, 2e-4, 0.019, 0.07] {
            let exposure = exposure(line_time);
            let (count, mut phases) = (64, vec![vec![]; 97]);
            for iteration in 5..5 + count {
                let moments = exposure.moments(iteration);
                assert_eq!((moments[0].rows.start, moments.last().unwrap().rows.end), (0, 97));
                assert!(
                    moments.windows(2).all(|pair| pair[0].rows.end == pair[1].rows.start && pair[0].at < pair[1].at)
                );
                let bands = 97.0 * line_time / 0.02 + 2.0;
                assert!(moments.len() as f64 <= bands, "{} parts", moments.len());
                for Rows { at, rows } in moments {
                    for row in rows {
                        let phase = (at - 1.0 - f64::from(row + 3) * line_time) / 0.02;
                        assert!((-1e-9..1.0 + 1e-9).contains(&phase), "row {row} at {at}");
                        phases[row as usize].push(phase);
                    }
                }
            }
            for of_row in &mut phases {
                assert_eq!(of_row.len(), count as usize);
                of_row.sort_by(f64::total_cmp);
                // The largest gap is at most the square of the golden ratio, 2.62, in mean distances.
                let gaps = of_row.windows(2).map(|pair| pair[1] - pair[0]).chain([of_row[0] + 1.0 - of_row[63]]);
                assert!(gaps.fold(0.0, f64::max) < 2.7 / f64::from(count));
                let mean = of_row.iter().sum::<f64>() / f64::from(count);
                assert!((mean - 0.5).abs() < 0.02, "{mean}");
            }
        }
    }

    #[test]
    fn too_few_moments_are_named() {
        let warning =
            |heterodyne, spp| Exposure { heterodyne, ..exposure(0.0) }.warning(Budget::Spp(spp)).unwrap_or_default();
        assert_eq!(warning(0.0, 32), "");
        assert!(warning(0.0, 16).ends_with("use at least --spp 32"), "{}", warning(0.0, 16));
        assert_eq!(warning(-200.0, 32), "");
        let many = warning(-1e3, 64);
        assert!(many.contains("turns 20 times") && many.contains("show 32 moments; use at least --spp 160,"), "{many}");
        assert_eq!(warning(-1e3, 160), "");
        let after = Exposure { heterodyne: -1e3, ..exposure(0.0) }.warning_after(128, 64).unwrap();
        assert!(after.contains("128 samples per pixel show 64 moments; use at least --spp 160,"), "{after}");
        assert_eq!(exposure(0.0).warning_after(32, 16), None);
        assert!(exposure(0.0).warning_after(10, 5).is_some());
    }

    #[test]
    fn seeds_show_other_moments() {
        let [a, b] = [1, 2].map(|seed| Exposure { shift: shift_of(seed), ..exposure(0.0) }.moments(0)[0].at);
        assert!((a - b).abs() > 1e-4, "{a} and {b}");
    }
}

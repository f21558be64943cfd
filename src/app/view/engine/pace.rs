//! How long previews take, and which of them come.

use std::collections::BTreeMap;

/// While the camera or the gate moves, the picture is to change this often, in seconds. The rest is for sending and showing it.
const FRAME: f64 = 0.025;
/// A preview of the whole size comes only if it will take at most so many seconds.
const LONGEST_OF_WHOLE_SIZE: f64 = 2.0 * FRAME;
/// If the full image will take less than this many seconds, no finer preview comes first, unless it takes at most a frame.
const SOON: f64 = 0.3;
/// Samples per pixel of a preview, and of one of the whole size.
const SAMPLES: u32 = 2;
const SAMPLES_OF_WHOLE_SIZE: u32 = 1;

/// The size of a preview in pixels, and its samples per pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Preview {
    pub size: [u32; 2],
    pub samples: u32,
}

impl Preview {
    /// `whole`: the size of the image.
    pub fn new(size: [u32; 2], whole: [u32; 2]) -> Preview {
        Preview { size, samples: if size == whole { SAMPLES_OF_WHOLE_SIZE } else { SAMPLES } }
    }

    fn work(self) -> f64 {
        self.size.into_iter().chain([self.samples]).map(f64::from).product()
    }
}

/// Seconds that previews take. On a graphics card, a fine one may take little longer than a coarse one.
#[derive(Default)]
pub struct Pace(BTreeMap<Preview, f64>);

impl Pace {
    /// Notes how long a preview took. One that took longer than the one before counts half: the size of pictures should change rarely.
    pub fn note(&mut self, preview: Preview, seconds: f64) {
        let before = self.0.get(&preview).copied().unwrap_or(seconds);
        self.0.insert(preview, seconds.min(0.5 * (before + seconds)));
    }

    /// Index of the first preview of a series: the finest one that takes at most a frame, and so do all coarser ones. `previews`: the
    /// coarsest first.
    pub fn first(&self, previews: &[Preview]) -> usize {
        let is_fast = |preview: &&Preview| self.0.get(*preview).is_some_and(|&seconds| seconds <= FRAME);
        previews.iter().take_while(is_fast).count().saturating_sub(1)
    }

    /// Whether a preview follows after `previews[last]`. `whole`: the size of the image; `None` if the full image will not come soon,
    /// because the camera moves.
    pub fn goes_on(&self, previews: &[Preview], last: usize, whole: Option<[u32; 2]>) -> bool {
        let Some(&next) = previews.get(last + 1) else { return false };
        let seconds = |preview: Preview| self.predict(&previews[..=last], preview);
        let is_soon = whole.is_some_and(|size| seconds(Preview { size, samples: SAMPLES }) < SOON);
        match next.samples {
            _ if is_soon => seconds(next) <= FRAME,
            SAMPLES_OF_WHOLE_SIZE => seconds(next) <= LONGEST_OF_WHOLE_SIZE,
            _ => true,
        }
    }

    /// The time of a preview, from the last one and two of `done`: a constant and a time per sample.
    fn predict(&self, done: &[Preview], preview: Preview) -> f64 {
        let known = |preview: &Preview| self.0.get(preview).map(|&seconds| (preview.work(), seconds));
        let mut known = done.iter().rev().filter_map(known);
        let Some((work, seconds)) = known.next() else { return f64::INFINITY };
        let per_work = known.next().map_or(seconds / work, |(less, before)| (seconds - before) / (work - less));
        seconds + per_work.max(0.0) * (preview.work() - work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: [u32; 2] = [640, 360];

    fn previews() -> [Preview; 4] {
        [[80, 45], [160, 90], [320, 180], WHOLE].map(|size| Preview::new(size, WHOLE))
    }

    fn pace(seconds: &[f64]) -> Pace {
        let mut pace = Pace::default();
        previews().into_iter().zip(seconds).for_each(|(preview, &seconds)| pace.note(preview, seconds));
        pace
    }

    #[test]
    fn the_finest_preview_within_a_frame_comes_first() {
        let first = |seconds: &[f64]| pace(seconds).first(&previews());
        assert_eq!(first(&[]), 0);
        assert_eq!(first(&[0.1]), 0);
        assert_eq!(first(&[0.004]), 0);
        assert_eq!(first(&[0.004, 0.005, 0.03]), 1);
        assert_eq!(first(&[0.004, 0.005, 0.009, 0.02]), 3);
        // The coarsest one was slow, so the others are not known to be fast any more.
        assert_eq!(first(&[0.1, 0.005, 0.009, 0.02]), 0);
        assert_eq!(pace(&[0.01]).first(&[]), 0);
        // One late preview does not change the size, two do.
        let mut pace = pace(&[0.01, 0.01]);
        for (seconds, first) in [(0.035, 1), (0.035, 0), (0.01, 1)] {
            pace.note(previews()[1], seconds);
            assert_eq!(pace.first(&previews()), first, "{seconds} s");
        }
    }

    #[test]
    fn slow_devices_leave_out_what_the_full_image_shows_soon() {
        let goes_on = |seconds: &[f64], whole| pace(seconds).goes_on(&previews(), seconds.len() - 1, whole);
        // Two cores, with the camera at rest and in motion: no preview of the whole size.
        for whole in [None, Some(WHOLE)] {
            assert!(goes_on(&[0.05], whole) && goes_on(&[0.05, 0.2], whole));
            assert!(!goes_on(&[0.05, 0.2, 0.8], whole));
        }
        // A fast scene: the full image will take 0.26 s.
        assert!(!goes_on(&[0.01, 0.022], Some(WHOLE)) && goes_on(&[0.01, 0.022], None));
        // A card: 10 ms, and 38 ns per sample. A gate that moves gets as far as a camera that moves.
        for whole in [None, Some(WHOLE)] {
            let on_card: Vec<f64> = previews().map(|preview| 0.01 + 38e-9 * preview.work()).into();
            assert!((1..4).all(|count| goes_on(&on_card[..count], whole)), "{whole:?}");
            assert!(!goes_on(&on_card, whole));
        }
    }
}

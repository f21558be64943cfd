//! How long previews take, and with which of them a series of previews begins.

use std::collections::BTreeMap;

/// While the camera or the gate moves, the picture is to change this often, in seconds. The rest is for sending and showing it.
const FRAME: f64 = 0.025;
/// A preview of the whole size comes only if it will take at most so many seconds.
const LONGEST_OF_WHOLE_SIZE: f64 = 2.0 * FRAME;

/// Seconds that a preview of each size takes. On a graphics card, a fine preview may take little longer than a coarse one.
#[derive(Default)]
pub struct Pace(BTreeMap<[u32; 2], f64>);

impl Pace {
    /// Notes how long a preview took. One that took longer than the one before counts half: the size of pictures should change rarely.
    pub fn note(&mut self, size: [u32; 2], seconds: f64) {
        let before = self.0.get(&size).copied().unwrap_or(seconds);
        self.0.insert(size, seconds.min(0.5 * (before + seconds)));
    }

    /// Index of the first preview of a series: the finest one that takes at most a frame, and so do all coarser ones. `sizes`: those of
    /// the previews, the coarsest first.
    pub fn first(&self, sizes: &[[u32; 2]]) -> usize {
        let is_fast = |size: &&[u32; 2]| self.0.get(*size).is_some_and(|&seconds| seconds <= FRAME);
        sizes.iter().take_while(is_fast).count().saturating_sub(1)
    }

    /// Whether the preview `next` comes after the preview of the size `last`. `whole`: the size of the image.
    pub fn goes_on(&self, last: [u32; 2], next: [u32; 2], whole: [u32; 2]) -> bool {
        let pixels = |[width, height]: [u32; 2]| f64::from(width) * f64::from(height);
        let predicted = self.0.get(&last).map(|seconds| seconds * pixels(next) / pixels(last));
        next != whole || predicted.is_some_and(|seconds| seconds <= LONGEST_OF_WHOLE_SIZE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZES: [[u32; 2]; 4] = [[80, 45], [160, 90], [320, 180], [640, 360]];

    fn pace(seconds: &[f64]) -> Pace {
        let mut pace = Pace::default();
        SIZES.into_iter().zip(seconds).for_each(|(size, &seconds)| pace.note(size, seconds));
        pace
    }

    #[test]
    fn the_finest_preview_within_a_frame_comes_first() {
        let first = |seconds: &[f64]| pace(seconds).first(&SIZES);
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
            pace.note(SIZES[1], seconds);
            assert_eq!(pace.first(&SIZES), first, "{seconds} s");
        }
    }

    #[test]
    fn a_preview_of_the_whole_size_comes_on_fast_devices_alone() {
        let whole = SIZES[3];
        let goes_on = |seconds: &[f64], last: usize| pace(seconds).goes_on(SIZES[last], SIZES[last + 1], whole);
        assert!(goes_on(&[0.05], 0) && goes_on(&[0.05, 0.2], 1));
        assert!(!goes_on(&[0.05, 0.2, 0.8], 2));
        assert!(goes_on(&[0.004, 0.005, 0.009], 2));
        assert!(!pace(&[]).goes_on(SIZES[2], whole, whole));
    }
}

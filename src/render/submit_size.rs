//! Adapts the amount of work in one submit to the time that earlier submits took, so that no submit takes long. Graphics drivers end a
//! submit after a few seconds (2 s on Windows, 10 s with amdgpu), and the device is then lost.

/// Target time of a submit. Some submits take longer; with this target the longest stay under 0.1 s.
const TARGET_SECONDS: f64 = 0.035;
/// Maximum time of a submit if its paths are as slow as the slowest ones seen.
const MAX_SECONDS: f64 = 0.3;
/// Minimum number of paths in a tile.
const MIN_TILE: usize = 1024;
/// Maximum number of paths in a tile before one iteration is complete. The first tiles may see only the sky, and later ones foliage or
/// fog, whose paths take a hundred times as long.
const MAX_FIRST_TILE: usize = 1 << 16;
/// Smaller tiles count as tiles of this size for the time per path, because their time is mostly that of the submit itself.
const FULL_TILE: usize = 1 << 13;

/// The number of paths in a tile of sensor subpaths. The image does not depend on it.
pub struct TileSize {
    size: usize,
    /// Maximum that the buffers allow.
    capacity: usize,
    /// Whether the size stays as it is.
    is_fixed: bool,
    /// The largest time per path of the previous iteration and of the present one, in seconds. `None` before the first iteration.
    slowest: [Option<f64>; 2],
}

impl TileSize {
    /// The first tile has `size` paths at most. `is_fixed`: so have all others.
    pub fn new(size: usize, capacity: usize, is_fixed: bool) -> TileSize {
        TileSize { size: size.min(capacity), capacity, is_fixed, slowest: [None; 2] }
    }

    /// Maximum number of paths in the next tile.
    pub fn get(&self) -> usize {
        self.size
    }

    /// Begins an iteration. `is_next`: the iteration before it is complete.
    pub fn begin(&mut self, is_next: bool) {
        if is_next && self.slowest[1].is_some() {
            self.slowest = [self.slowest[1], None];
        }
    }

    /// Chooses the size of the next tile, so that its longest submit takes about the target time. The previous tile had `count` paths,
    /// and its longest submit took `longest` seconds. `is_last`: it was the last tile of an image and may have been cut short.
    pub fn adapt(&mut self, count: usize, is_last: bool, longest: f64) {
        if self.is_fixed {
            return;
        }
        let per_path = longest / count.max(FULL_TILE) as f64;
        self.slowest[1] = Some(self.slowest[1].unwrap_or(0.0).max(per_path));
        let factor = size_factor(longest);
        // A fast last tile says nothing about a full tile, because it may have been cut short.
        let wanted = if factor >= 1.0 && is_last { self.size } else { (count as f64 * factor) as usize };
        let slowest = self.slowest.iter().flatten().copied().fold(0.0, f64::max);
        let safe = match self.slowest[0] {
            Some(_) => self.capacity,
            None => self.capacity.min(MAX_FIRST_TILE),
        };
        // A float that is too large becomes the largest number.
        let safe = safe.min((MAX_SECONDS / slowest) as usize);
        self.size = wanted.min(safe).clamp(MIN_TILE.min(self.capacity), self.capacity);
    }
}

/// Factor for the amount of work in the next submit, after a submit that took `seconds`; 1/64 to 2.
pub fn size_factor(seconds: f64) -> f64 {
    (TARGET_SECONDS / seconds.max(1e-6)).clamp(1.0 / 64.0, 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The size after a tile of `size` paths at most, with `count` paths, in the second iteration.
    fn next(size: usize, count: usize, is_last: bool, longest: f64) -> usize {
        let mut tile = TileSize { slowest: [Some(0.0), None], ..TileSize::new(size, 1 << 16, false) };
        tile.adapt(count, is_last, longest);
        tile.get()
    }

    #[test]
    fn tiles_follow_the_time_that_their_submits_take() {
        let fast = TARGET_SECONDS / 8.0;
        // With three samples per pixel, 8,190 is the maximum number of paths in a tile of 8,192.
        assert_eq!(next(8192, 8190, false, fast), 2 * 8190);
        assert_eq!(next(8192, 8192, false, fast), 2 * 8192);
        assert_eq!(next(1 << 16, 1 << 16, false, fast), 1 << 16);
        // The last tile of an image says nothing about a full tile, unless it took too long.
        assert_eq!(next(8192, 2250, true, fast), 8192);
        assert_eq!(next(8192, 8190, true, 2.0 * TARGET_SECONDS), 4095);
        assert_eq!(next(1024, 1024, false, 2.0 * TARGET_SECONDS), MIN_TILE);
        // After one submit that took far too long, the next is short.
        assert_eq!(next(1 << 16, 1 << 16, false, 3.5), 1024);
        let mut fixed = TileSize::new(100, 1 << 16, true);
        fixed.adapt(100, false, fast);
        assert_eq!(fixed.get(), 100);
    }

    /// Renders the iterations of an image on a fast card. The first million samples see the sky, and the last 200,000 are a hundred times
    /// as slow. Returns the seconds of the longest submit in each iteration.
    fn longest_submits(iterations: usize) -> Vec<f64> {
        let (sky, foliage) = (2e-8, 2e-6);
        let mut tile = TileSize::new(1 << 13, 1 << 20, false);
        let iteration = |number| {
            tile.begin(number > 0);
            let (mut done, mut longest) = (0, 0.0f64);
            while done < 1_200_000 {
                let count = tile.get().min(1_200_000 - done);
                let slow = (done + count).saturating_sub(1_000_000).min(count);
                let seconds = 1e-3 + (count - slow) as f64 * sky + slow as f64 * foliage;
                done += count;
                tile.adapt(count, done == 1_200_000, seconds);
                longest = longest.max(seconds);
            }
            longest
        };
        (0..iterations).map(iteration).collect()
    }

    #[test]
    fn slow_paths_after_fast_ones_do_not_make_a_submit_long() {
        let longest = longest_submits(4);
        assert!(longest.iter().all(|&seconds| seconds < 0.35), "{longest:?}");
        // The limits are at work, and they are no lower than necessary. Without them, a tile of a million paths would take 0.4 s.
        assert!(longest.iter().any(|&seconds| seconds > 0.2), "{longest:?}");
    }

    #[test]
    fn one_slow_submit_does_not_make_tiles_small_for_ever() {
        let mut tile = TileSize::new(1 << 13, 1 << 20, false);
        let mut after = |iteration: usize, seconds: f64| {
            tile.begin(iteration > 0);
            for _ in 0..40 {
                tile.adapt(tile.get(), false, seconds);
            }
            tile.get()
        };
        assert_eq!(after(0, 1e-3), MAX_FIRST_TILE, "in the first iteration");
        assert_eq!(after(1, 1e-3), 1 << 20);
        assert!(after(2, 3.0) <= 8192);
        after(3, 1e-3);
        assert_eq!(after(4, 1e-3), 1 << 20);
    }
}

//! Adapts the amount of work in one submit to the time that earlier submits took, so that no submit takes long.

/// Target time of a submit. Some submits take longer; with this target the longest stay under 0.1 s.
const TARGET_SECONDS: f64 = 0.035;
/// Minimum number of paths in a tile.
const MIN_TILE: usize = 1024;

/// Number of paths for the next tile, so that its longest submit takes about the target time. The previous tile had `count`
/// paths (at most `tile` were allowed), and its longest submit took `longest` seconds. `is_last`: the previous tile was the
/// last of an image and may have been cut short. The image does not depend on the result.
pub fn next_tile_size(tile: usize, count: usize, is_last: bool, longest: f64, capacity: usize) -> usize {
    let factor = size_factor(longest);
    // A fast last tile says nothing about a full tile, because it may have been cut short.
    if factor >= 1.0 && is_last {
        return tile;
    }
    ((count as f64 * factor) as usize).clamp(MIN_TILE.min(capacity), capacity)
}

/// Factor for the amount of work in the next submit, after a submit that took `seconds`; 0.5 to 2.
pub fn size_factor(seconds: f64) -> f64 {
    (TARGET_SECONDS / seconds.max(1e-6)).clamp(0.5, 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_follow_the_time_that_their_submits_take() {
        let fast = TARGET_SECONDS / 8.0;
        // With three samples per pixel, 8,190 is the maximum number of paths in a tile of 8,192.
        assert_eq!(next_tile_size(8192, 8190, false, fast, 1 << 16), 2 * 8190);
        assert_eq!(next_tile_size(8192, 8192, false, fast, 1 << 16), 2 * 8192);
        assert_eq!(next_tile_size(1 << 16, 1 << 16, false, fast, 1 << 16), 1 << 16);
        // The last tile of an image says nothing about a full tile, unless it took too long.
        assert_eq!(next_tile_size(8192, 2250, true, fast, 1 << 16), 8192);
        assert_eq!(next_tile_size(8192, 8190, true, 2.0 * TARGET_SECONDS, 1 << 16), 4095);
        assert_eq!(next_tile_size(1024, 1024, false, 2.0 * TARGET_SECONDS, 1 << 16), MIN_TILE);
    }
}

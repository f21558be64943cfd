//! How much one submit does, so that none takes long.

/// A submit is kept under this on average, so that the worst stays under 0.1 s.
const TARGET_SECONDS: f64 = 0.035;
/// Paths a tile at least.
const MIN_TILE: usize = 1024;

/// Paths of the next tile, so that its longest submit comes near the target. The tile before had `count` paths of the `tile` that
/// were allowed, and its longest submit took `longest` seconds. `is_last`: it was the last of an image and may have been cut short. The
/// image does not depend on the result.
pub fn next_tile_size(tile: usize, count: usize, is_last: bool, longest: f64, capacity: usize) -> usize {
    let factor = size_factor(longest);
    // The last may hold less than fits.
    if factor >= 1.0 && is_last {
        return tile;
    }
    ((count as f64 * factor) as usize).clamp(MIN_TILE.min(capacity), capacity)
}

/// By how much to change what one submit does, after one that took `seconds`.
pub fn size_factor(seconds: f64) -> f64 {
    (TARGET_SECONDS / seconds.max(1e-6)).clamp(0.5, 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_follow_the_time_that_their_submits_take() {
        let fast = TARGET_SECONDS / 8.0;
        // 8,190 paths are all that fit into 8,192 with three samples a pixel.
        assert_eq!(next_tile_size(8192, 8190, false, fast, 1 << 16), 2 * 8190);
        assert_eq!(next_tile_size(8192, 8192, false, fast, 1 << 16), 2 * 8192);
        assert_eq!(next_tile_size(1 << 16, 1 << 16, false, fast, 1 << 16), 1 << 16);
        // The rest of an image says nothing about a full tile, unless it took too long.
        assert_eq!(next_tile_size(8192, 2250, true, fast, 1 << 16), 8192);
        assert_eq!(next_tile_size(8192, 8190, true, 2.0 * TARGET_SECONDS, 1 << 16), 4095);
        assert_eq!(next_tile_size(1024, 1024, false, 2.0 * TARGET_SECONDS, 1 << 16), MIN_TILE);
    }
}

//! A fast hash, by which triangles in one place are found: they get equal numbers and meet when the numbers are sorted.

/// The hash of Firefox (FxHash): the same in every run. Different words may have the same hash, so callers compare the words too, or
/// do not mind.
pub fn hash(words: impl IntoIterator<Item = u64>) -> u64 {
    words.into_iter().fold(0, |hash: u64, word| (hash.rotate_left(5) ^ word).wrapping_mul(0x517c_c1b7_2722_0a95))
}

//! A fast hash. Triangles in one place get equal hashes, so sorting by hash brings them together.

/// FxHash, the hash of Firefox: the same in every run. Different words may have equal hashes. Callers must compare the words as
/// well, or tolerate such collisions.
pub fn hash(words: impl IntoIterator<Item = u64>) -> u64 {
    words.into_iter().fold(0, |hash: u64, word| (hash.rotate_left(5) ^ word).wrapping_mul(0x517c_c1b7_2722_0a95))
}

//! What an iteration replaces in the images, so that an incomplete iteration can be undone.

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::image::response_film::{FilmRow, ResponseFilm};

/// Most pixels and responses for which an iteration keeps what it replaces. They take 128 MiB, or 224 MiB with variances; with the
/// memory that [`Replaced::admit`] leaves unused, at most twice as much.
pub const MAX_REPLACED: usize = 1 << 22;

/// What the present iteration has replaced in the images.
pub struct Replaced {
    /// Most sums that are kept.
    limit: usize,
    notes: Vec<Notes>,
    /// Empty notes of earlier iterations. Their memory is used again.
    spare: Vec<Notes>,
    /// Number of sums that were noted. If they are more than the limit, some of them or all are not kept.
    count: AtomicUsize,
}

/// What a block of pixels has replaced in the images.
#[derive(Default)]
pub struct Notes {
    /// Pixel, response, and the sums of w x before.
    sums: Vec<(u32, u32, [f64; 3])>,
    /// The sums of w x^2 before, in the same order; empty without variances.
    squares: Vec<[f64; 3]>,
}

impl Notes {
    /// Notes the sums of a response, in the `row` of a pixel.
    #[inline]
    pub fn add(&mut self, pixel: u32, response: u32, row: &FilmRow) {
        let (sums, squares) = row.sums_of(response);
        self.sums.push((pixel, response, sums));
        if let Some(squares) = squares {
            self.squares.push(squares);
        }
    }
}

impl Replaced {
    pub fn new(limit: usize) -> Replaced {
        Replaced { limit, notes: vec![], spare: vec![], count: AtomicUsize::new(0) }
    }

    pub fn clear(&mut self) {
        for mut notes in self.notes.drain(..) {
            notes.sums.clear();
            notes.squares.clear();
            self.spare.push(notes);
        }
        self.count = AtomicUsize::new(0);
    }

    /// Empty notes for `count` blocks of pixels.
    pub fn take_spare(&mut self, count: usize) -> Vec<Notes> {
        let mut spare = self.spare.split_off(self.spare.len().saturating_sub(count));
        spare.resize_with(count, Notes::default);
        spare
    }

    /// Whether notes are of no use, because there are too many.
    pub fn is_too_much(&self) -> bool {
        self.count.load(Ordering::Relaxed) > self.limit
    }

    /// Counts `notes`, and returns them if they are to be kept. Unused memory stays with them for the next iteration, unless it is
    /// more than they use.
    pub fn admit(&self, mut notes: Notes) -> Notes {
        let before = self.count.fetch_add(notes.sums.len(), Ordering::Relaxed);
        if before + notes.sums.len() > self.limit {
            return Notes::default();
        }
        if notes.sums.capacity() > 2 * notes.sums.len() {
            notes.sums.shrink_to_fit();
            notes.squares.shrink_to_fit();
        }
        notes
    }

    /// Keeps notes that [`Replaced::admit`] has returned.
    pub fn keep(&mut self, notes: Vec<Notes>) {
        match self.is_too_much() {
            true => (self.notes, self.spare) = (vec![], vec![]),
            false => self.notes.extend(notes),
        }
    }

    /// Undoes all changes of `film` that were noted. Returns false, and changes nothing, if some were not.
    pub fn put_back(&mut self, film: &mut ResponseFilm) -> bool {
        if self.is_too_much() {
            return false;
        }
        for notes in &self.notes {
            let squares = notes.squares.iter().copied().map(Some).chain(std::iter::repeat(None));
            for (&(pixel, response, sums), squares) in notes.sums.iter().zip(squares) {
                film.row_mut(pixel).set(response, sums, squares);
            }
        }
        self.clear();
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_incomplete_iteration_is_undone() {
        for has_variance in [false, true] {
            let mut film = ResponseFilm::new(2, 3, has_variance);
            film.row_mut(0).add(1, [0.1, 1e9, 1e-9], 3);
            film.end_iteration(3);
            let sums = |film: &mut ResponseFilm| [0, 1, 2, 3, 4, 5].map(|i| film.row_mut(i / 3).sums_of(i % 3));
            // The iteration notes three sums, in two blocks.
            for (limit, is_undone) in [(3, true), (2, false), (0, false)] {
                let mut replaced = Replaced::new(limit);
                // The second iteration uses the memory of the first again.
                for _ in 0..2 {
                    replaced.clear();
                    let before = sums(&mut film);
                    for block in [&[(0, 1), (1, 2)][..], &[(1, 0)]] {
                        let mut notes = replaced.take_spare(1).remove(0);
                        for &(pixel, response) in block {
                            notes.add(pixel, response, &film.row_mut(pixel));
                            film.row_mut(pixel).add(response, [1e12, 0.3, 0.7], 8);
                        }
                        let notes = replaced.admit(notes);
                        replaced.keep(vec![notes]);
                    }
                    let after = sums(&mut film);
                    // Notes that are of no use take no memory.
                    let is_empty = replaced.notes.is_empty() && replaced.spare.is_empty();
                    assert_eq!(is_empty, !is_undone, "limit {limit}");
                    assert_ne!(after, before);
                    assert_eq!(replaced.put_back(&mut film), is_undone, "limit {limit}");
                    assert_eq!(sums(&mut film), if is_undone { before } else { after }, "limit {limit}");
                }
            }
        }
    }

    #[test]
    fn notes_keep_memory_if_they_use_half_of_it() {
        let mut film = ResponseFilm::new(1, 1, true);
        for (used, is_kept) in [(50, true), (49, false)] {
            let mut notes = Notes::default();
            notes.sums.reserve_exact(100);
            (0..used).for_each(|_| notes.add(0, 0, &film.row_mut(0)));
            let notes = Replaced::new(100).admit(notes);
            assert_eq!((notes.sums.len(), notes.squares.len()), (used, used));
            assert_eq!(notes.sums.capacity() >= 100, is_kept, "{used} sums");
        }
    }
}

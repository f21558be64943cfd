//! The film and what adaptive sampling has measured. The image of the last iteration may be added to them later, beside the next
//! iteration.

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use rayon::prelude::*;

use super::samples::{Allocation, SampleCounts};
use crate::image::film::Film;

/// Number of pixels that a thread takes at a time.
const PART: usize = 1 << 12;

/// The sums over whole iterations.
#[derive(Clone)]
pub struct Added {
    pub film: Film,
    /// `None` if every pixel has the same number of samples.
    pub allocation: Option<Allocation>,
}

/// The image of an iteration.
pub struct Image {
    /// RGB per pixel of the light of t = 1.
    pub splats: Vec<f32>,
    /// Per pixel, the mean RGB of its camera samples, and in w the sum of their squared luminances.
    pub seen: Vec<[f32; 4]>,
    /// RGB per pixel of the sum over all responses; `None` if there is one.
    pub total: Option<Vec<f32>>,
    pub counts: SampleCounts,
    /// Samples per pixel, averaged over the pixels.
    pub samples: u32,
}

impl Added {
    fn add(&mut self, image: Image) {
        let Image { splats: mut rgb, seen, total, counts, samples } = image;
        rgb.par_chunks_mut(3 * PART).zip(seen.par_chunks(PART)).for_each(|(rgb, seen)| {
            for (to, from) in rgb.chunks_exact_mut(3).zip(seen) {
                (0..3).for_each(|k| to[k] += from[k]);
            }
        });
        if let Some(allocation) = &mut self.allocation {
            allocation.add(&seen, &rgb, &counts, samples);
        }
        self.film.add(total.as_deref().unwrap_or(&rgb), samples);
    }
}

/// The sums of a render, and the image of its last iteration until somebody looks at them.
pub struct Sums {
    /// Empty while `last` has an image.
    added: OnceLock<Added>,
    last: Mutex<Option<Box<(Added, Image)>>>,
}

impl Sums {
    pub fn new(film: Film, allocation: Option<Allocation>) -> Sums {
        Sums { added: Added { film, allocation }.into(), last: Mutex::default() }
    }

    /// Gives the image of the next iteration, which is not added yet.
    pub fn put(&mut self, image: Image) {
        self.get();
        let added = self.added.take().expect("the images before are added");
        *self.locked() = Some(Box::new((added, image)));
    }

    /// The sums over all iterations. Adds the last one if nobody has done it, or waits for the thread that adds it.
    pub fn get(&self) -> &Added {
        self.added.get_or_init(|| {
            let last = self.locked().take();
            let (mut added, image) = *last.expect("there are sums or an image");
            added.add(image);
            added
        })
    }

    /// As [`Sums::get`].
    pub fn get_mut(&mut self) -> &mut Added {
        self.get();
        self.added.get_mut().expect("all images are added")
    }

    /// Waits until another thread has added the last iteration.
    pub fn wait(&self) {
        self.added.wait();
    }

    /// Whether the last iteration is added.
    #[cfg(test)]
    pub fn has_all(&self) -> bool {
        self.added.get().is_some()
    }

    /// Number of iterations, and of samples per pixel, without adding the last iteration.
    pub fn length(&self) -> (u32, u64) {
        let last = self.locked();
        if let Some((added, image)) = last.as_deref() {
            return (added.film.iterations() + 1, added.film.samples() + u64::from(image.samples));
        }
        drop(last);
        let film = &self.get().film;
        (film.iterations(), film.samples())
    }

    fn locked(&self) -> MutexGuard<'_, Option<Box<(Added, Image)>>> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An iteration of 4 x 3 pixels.
    fn image(number: u32) -> Image {
        let x = |i: usize| 0.37 * (number as f32 + 1.0) + 0.1 * i as f32;
        Image {
            splats: (0..36).map(x).collect(),
            seen: (0..12).map(|i| [x(i), 2.0 * x(i), 0.5, 9.0 * x(i)]).collect(),
            total: number.is_multiple_of(2).then(|| (0..36).map(|i| 3.0 * x(i)).collect()),
            counts: SampleCounts::PerPixel((0..12).map(|i| 1 + (i + number as u8) % 4).collect()),
            samples: 2 + number,
        }
    }

    #[test]
    fn it_does_not_matter_when_images_are_added() {
        let new = || Sums::new(Film::new(4, 3), Some(Allocation::new(4, 12)));
        let (mut looked_at, mut in_threads, mut at_last) = (new(), new(), new());
        for number in 0..5 {
            looked_at.put(image(number));
            looked_at.get();
            in_threads.put(image(number));
            at_last.put(image(number));
            let expected = (number + 1, (0..=number).map(|number| u64::from(2 + number)).sum());
            for sums in [&looked_at, &in_threads, &at_last] {
                assert_eq!(sums.length(), expected);
            }
            let sums = &in_threads;
            std::thread::scope(|scope| {
                scope.spawn(|| sums.get().film.samples());
                sums.wait();
            });
        }
        let result = |sums: &Sums| {
            let Added { film, allocation } = sums.get();
            let allocation = allocation.as_ref().unwrap();
            (film.mean(), film.variance_of_mean(), allocation.state(), allocation.counts(7))
        };
        assert!(result(&looked_at) == result(&at_last) && result(&looked_at) == result(&in_threads));
    }

    #[test]
    fn the_film_has_the_total_of_the_responses() {
        let film = |total: Option<Vec<f32>>| {
            let mut sums = Sums::new(Film::new(4, 3), None);
            sums.put(Image { total, ..image(1) });
            sums.get().film.mean()
        };
        let both = |i: usize| image(1).splats[i] + image(1).seen[i / 3][i % 3];
        assert_eq!(film(None), (0..36).map(both).collect::<Vec<f32>>());
        assert_eq!(film(image(2).total), image(2).total.unwrap());
    }
}

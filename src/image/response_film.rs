//! The images of several responses: mean and variance per pixel and response over iterations.

#![warn(missing_docs)]

/// Accumulated images of `responses` responses, each with R, G and B. Unlike [`Film`](crate::Film) it adds one pixel and
/// response at a time. So a histogram of many gates takes little time if few gates of a pixel receive light.
#[derive(Debug, Clone)]
pub struct ResponseFilm {
    pixels: usize,
    responses: usize,
    /// Sums of w x over the iterations, where x is the value of one iteration with w samples per pixel. Indexed by pixel, response
    /// and channel, the channel fastest.
    sums: Vec<f64>,
    /// Sums of w x^2, in the same order; empty if the variance is not wanted.
    squares: Vec<f64>,
    samples: u64,
    iterations: u32,
}

impl ResponseFilm {
    /// A film without samples. It estimates variances only if `has_variance`.
    pub fn new(pixels: usize, responses: usize, has_variance: bool) -> ResponseFilm {
        let values = 3 * pixels * responses;
        let squares = vec![0.0; if has_variance { values } else { 0 }];
        ResponseFilm { pixels, responses, sums: vec![0.0; values], squares, samples: 0, iterations: 0 }
    }

    /// Bytes of host memory that a film takes.
    pub fn bytes(pixels: u64, responses: u64, has_variance: bool) -> u64 {
        let sums = if has_variance { 2 } else { 1 };
        pixels.saturating_mul(responses).saturating_mul(3 * size_of::<f64>() as u64 * sums)
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.pixels
    }

    /// Number of responses.
    pub fn responses(&self) -> usize {
        self.responses
    }

    /// Whether the film estimates variances.
    pub fn has_variance(&self) -> bool {
        !self.squares.is_empty()
    }

    /// The sums of a pixel.
    pub(crate) fn row_mut(&mut self, pixel: u32) -> FilmRow<'_> {
        let row = self.row(pixel as usize);
        FilmRow { sums: &mut self.sums[row.clone()], squares: self.squares.get_mut(row).unwrap_or_default() }
    }

    /// The sums of each of the `pixels`, which strictly ascend (no pixel twice). Threads may change different pixels at the same time.
    pub(crate) fn rows_mut(&mut self, pixels: impl Iterator<Item = u32> + Clone) -> impl Iterator<Item = FilmRow<'_>> {
        let length = 3 * self.responses;
        let of_squares = if self.has_variance() { length } else { 0 };
        let rows = rows(&mut self.sums, length, pixels.clone()).zip(rows(&mut self.squares, of_squares, pixels));
        rows.map(|(sums, squares)| FilmRow { sums, squares })
    }

    /// Ends an iteration. Pixels and responses without light in it count as black.
    pub(crate) fn end_iteration(&mut self, samples: u32) {
        self.samples += u64::from(samples);
        self.iterations += 1;
    }

    /// Adds the iterations of `other`, a part of the same render. The order of the parts changes the last bits of the sums. If one of
    /// the two does not estimate variances, the result does not.
    ///
    /// # Panics
    /// If the films have different sizes.
    pub(crate) fn merge(&mut self, other: &ResponseFilm) {
        assert_eq!((self.pixels, self.responses), (other.pixels, other.responses), "the films have different sizes");
        let add = |(sum, other): (&mut f64, &f64)| *sum += other;
        self.sums.iter_mut().zip(&other.sums).for_each(add);
        match other.has_variance() {
            true => self.squares.iter_mut().zip(&other.squares).for_each(add),
            false => self.squares.clear(),
        }
        self.samples += other.samples;
        self.iterations += other.iterations;
    }

    /// The sums of w x and of w x^2, indexed by pixel, response and channel. Without variances, the sums of w x^2 are empty.
    pub(crate) fn sums(&self) -> [&[f64]; 2] {
        [&self.sums, &self.squares]
    }

    /// Samples per pixel, and number of iterations.
    pub(crate) fn length(&self) -> (u64, u32) {
        (self.samples, self.iterations)
    }

    /// The sums of [`ResponseFilm::sums`], which the caller replaces by those of a film of this length.
    pub(crate) fn replace(&mut self, (samples, iterations): (u64, u32)) -> [&mut [f64]; 2] {
        (self.samples, self.iterations) = (samples, iterations);
        [&mut self.sums, &mut self.squares]
    }

    /// The film with the sums of [`ResponseFilm::sums`], of `iterations` iterations with `samples` samples per pixel together.
    pub(super) fn from_sums(
        [sums, squares]: [Vec<f64>; 2],
        pixels: usize,
        samples: u64,
        iterations: u32,
    ) -> ResponseFilm {
        let responses = sums.len() / (3 * pixels);
        ResponseFilm { pixels, responses, sums, squares, samples, iterations }
    }

    /// Means over all samples of the channels of a pixel, response by response; 0 before the first iteration. Pixels are numbered row by
    /// row, row 0 at the top.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn means_of(&self, pixel: usize) -> impl ExactSizeIterator<Item = f32> {
        self.row(pixel).map(self.mean_at())
    }

    /// Estimated variances of [`ResponseFilm::means_of`], as in [`Film::variance_of_mean`](crate::Film::variance_of_mean). All 0
    /// with fewer than two iterations, or if the film does not estimate variances.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn variances_of(&self, pixel: usize) -> impl ExactSizeIterator<Item = f32> {
        self.row(pixel).map(self.variance_at())
    }

    /// The image of a response, counted from 0: R, G, B interleaved, row 0 at the top.
    ///
    /// # Panics
    /// If there is no such response.
    pub fn mean(&self, response: usize) -> Vec<f32> {
        self.image(response, self.mean_at())
    }

    /// The variance of [`ResponseFilm::mean`].
    ///
    /// # Panics
    /// If there is no such response.
    pub fn variance_of_mean(&self, response: usize) -> Vec<f32> {
        self.image(response, self.variance_at())
    }

    fn image(&self, response: usize, value: impl Fn(usize) -> f32) -> Vec<f32> {
        assert!(
            response < self.responses,
            "the film has {} responses, and none with number {response}",
            self.responses
        );
        let starts = (0..self.pixels).map(|pixel| 3 * (pixel * self.responses + response));
        starts.flat_map(|at| at..at + 3).map(value).collect()
    }

    /// The mean of the value with an index.
    fn mean_at(&self) -> impl Fn(usize) -> f32 {
        let weights = self.samples.max(1) as f64;
        move |at| (self.sums[at] / weights) as f32
    }

    /// The variance of the mean of the value with an index.
    fn variance_at(&self) -> impl Fn(usize) -> f32 {
        let weights = self.samples.max(1) as f64;
        let per_spread = 1.0 / (f64::from(self.iterations.max(2) - 1) * weights);
        let is_known = self.has_variance() && self.iterations >= 2;
        move |at| {
            if !is_known {
                return 0.0;
            }
            // Rounding may make a spread of 0 negative.
            let spread = (self.squares[at] - self.sums[at] * self.sums[at] / weights).max(0.0);
            (spread * per_spread).min(f64::from(f32::MAX)) as f32
        }
    }

    /// The indices of a pixel's values.
    fn row(&self, pixel: usize) -> std::ops::Range<usize> {
        assert!(pixel < self.pixels, "the film has {} pixels, and none with number {pixel}", self.pixels);
        let length = 3 * self.responses;
        pixel * length..(pixel + 1) * length
    }
}

/// The sums of a pixel in a [`ResponseFilm`], response by response.
pub(crate) struct FilmRow<'a> {
    sums: &'a mut [f64],
    squares: &'a mut [f64],
}

impl FilmRow<'_> {
    /// Adds the light of a response in the present iteration. `rgb` is the mean over the samples of the pixel; `samples` is the
    /// average number of samples per pixel. Call it at most once per iteration for the same response.
    #[inline]
    pub(crate) fn add(&mut self, response: u32, rgb: [f64; 3], samples: u32) {
        let at = 3 * response as usize;
        let weight = f64::from(samples);
        for (sum, x) in self.sums[at..at + 3].iter_mut().zip(rgb) {
            *sum += weight * x;
        }
        for (square, x) in self.squares.get_mut(at..at + 3).unwrap_or_default().iter_mut().zip(rgb) {
            *square += weight * x * x;
        }
    }

    /// The sums of w x and of w x^2 of a response; without variances, `None` in place of the sums of w x^2.
    #[inline]
    pub(crate) fn sums_of(&self, response: u32) -> ([f64; 3], Option<[f64; 3]>) {
        let at = 3 * response as usize;
        let three = |values: &[f64]| [values[at], values[at + 1], values[at + 2]];
        (three(self.sums), if self.squares.is_empty() { None } else { Some(three(self.squares)) })
    }

    /// Replaces the sums of a response with those of [`FilmRow::sums_of`].
    pub(crate) fn set(&mut self, response: u32, sums: [f64; 3], squares: Option<[f64; 3]>) {
        let at = 3 * response as usize;
        self.sums[at..at + 3].copy_from_slice(&sums);
        if let Some(squares) = squares {
            self.squares[at..at + 3].copy_from_slice(&squares);
        }
    }
}

/// The `length` values of each of the `pixels`, which strictly ascend (no pixel twice).
pub(crate) fn rows<T>(
    values: &mut [T],
    length: usize,
    pixels: impl Iterator<Item = u32>,
) -> impl Iterator<Item = &mut [T]> {
    let (mut rest, mut next) = (values, 0);
    pixels.map(move |pixel| {
        let skipped = (pixel - next) as usize * length;
        let (row, after) = std::mem::take(&mut rest).split_at_mut(skipped).1.split_at_mut(length);
        (rest, next) = (after, pixel + 1);
        row
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::film::Film;

    #[test]
    fn mean_and_variance_are_those_of_a_film() {
        // Two pixels and three responses; the light of iteration i in pixel p and response r. Some iterations are black.
        let value = |i: u32, p: u32, r: u32| match (i * 7 + p * 3 + r * 5) % 4 {
            0 => 0.0,
            n => f64::from(n * (i + 1)) * 0.25,
        };
        let (mut film, mut films) = (ResponseFilm::new(2, 3, true), [(); 3].map(|()| Film::new(2, 1)));
        for (i, samples) in [4, 8, 8, 2].into_iter().enumerate() {
            let value = |p, r| value(i as u32, p, r);
            for r in 0..3 {
                let mut image = vec![];
                for p in 0..2 {
                    let rgb = [1.0, 2.0, 3.0].map(|k| k * value(p, r));
                    image.extend(rgb.map(|x| x as f32));
                    if value(p, r) > 0.0 {
                        film.row_mut(p).add(r, rgb, samples);
                    }
                }
                films[r as usize].add(&image, samples);
            }
            film.end_iteration(samples);
        }
        let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * b.abs());
        for (r, one) in films.iter().enumerate() {
            assert!(close(&film.mean(r), &one.mean()), "{r}: {:?} {:?}", film.mean(r), one.mean());
            assert!(close(&film.variance_of_mean(r), &one.variance_of_mean()), "{r}");
        }
        assert!(film.mean(0) != film.mean(1) && film.variance_of_mean(1).iter().any(|&v| v > 0.0));
    }

    /// Otherwise it would return values of the next pixel.
    #[test]
    #[should_panic(expected = "2 responses, and none with number 2")]
    fn a_response_that_is_not_there_has_no_image() {
        ResponseFilm::new(3, 2, false).mean(2);
    }

    #[test]
    fn a_film_without_variance_takes_half_the_memory() {
        let mut film = ResponseFilm::new(1, 2, false);
        film.row_mut(0).add(1, [1.0; 3], 3);
        film.end_iteration(3);
        film.end_iteration(1);
        assert_eq!((film.mean(1), film.variance_of_mean(1)), (vec![0.75; 3], vec![0.0; 3]));
        assert_eq!((ResponseFilm::bytes(512 * 512, 300, false), ResponseFilm::bytes(1, 2, true)), (1_887_436_800, 96));
    }
}

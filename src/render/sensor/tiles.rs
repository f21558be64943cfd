//! Divides the samples of an iteration into tiles.

use crate::render::samples::SampleCounts;
use crate::settings::Crop;

/// Side of a block in pixels. Samples run block by block, so that the paths of a tile stay near each other.
const BLOCK: u32 = 8;

/// A sample of a tile, in the layout of `samples.wgsl`. Word 0: its pixel in the whole film (see [`film_pixel`]). Word 1: its
/// index among the samples of the pixel (low 16 bits) and their number (high 16 bits).
pub type TileSample = [u32; 2];

/// Lists the samples of an iteration, tile by tile. All samples of a pixel are in the same tile.
pub struct Tiles<'a> {
    crop: Crop,
    counts: &'a SampleCounts,
    /// Position of the next pixel in the order of [`pixel_at`].
    position: u32,
    samples: Vec<TileSample>,
}

impl<'a> Tiles<'a> {
    pub fn new(crop: Crop, counts: &'a SampleCounts) -> Tiles<'a> {
        Tiles { crop, counts, position: 0, samples: vec![] }
    }

    fn is_empty(&self) -> bool {
        self.position == self.crop.width() * self.crop.height()
    }

    /// The samples of the next tile, and whether it is the last one; `None` after the last. A tile holds at most `max`
    /// samples, but always at least one pixel.
    pub fn next(&mut self, max: usize) -> Option<(&[TileSample], bool)> {
        self.samples.clear();
        while !self.is_empty() {
            let pixel = pixel_at(self.crop, self.position);
            let count = self.counts.of(pixel);
            if !self.samples.is_empty() && self.samples.len() + count as usize > max {
                break;
            }
            let film_pixel = film_pixel(self.crop, pixel);
            self.samples.extend((0..count).map(|number| [film_pixel, count << 16 | number]));
            self.position += 1;
        }
        (!self.samples.is_empty()).then_some((&self.samples[..], self.is_empty()))
    }
}

/// Row-major index in the crop of the pixel at `position` in sample order: strips of blocks from top to bottom, blocks of a
/// strip from left to right, pixels of a block row by row.
fn pixel_at(crop: Crop, position: u32) -> u32 {
    let (width, height) = (crop.width(), crop.height());
    let (strip, in_strip) = (position / (BLOCK * width), position % (BLOCK * width));
    let rows = BLOCK.min(height - strip * BLOCK);
    let (block, in_block) = (in_strip / (BLOCK * rows), in_strip % (BLOCK * rows));
    let columns = BLOCK.min(width - block * BLOCK);
    (strip * BLOCK + in_block / columns) * width + block * BLOCK + in_block % columns
}

/// Pixel of the whole film for a pixel of the crop: column in the low 16 bits, row in the high 16 bits.
fn film_pixel(crop: Crop, pixel: u32) -> u32 {
    let (x, y) = (pixel % crop.width(), pixel / crop.width());
    (y + crop.y0) << 16 | (x + crop.x0)
}

/// The pixels of a tile, as row-major indices in the crop.
pub fn pixels(crop: Crop, tile: &[TileSample]) -> Vec<u32> {
    let is_first = |sample: &&TileSample| sample[1] & 0xffff == 0;
    tile.iter().filter(is_first).map(|&[film_pixel, _]| crop_pixel(crop, film_pixel)).collect()
}

/// The inverse of [`film_pixel`].
pub fn crop_pixel(crop: Crop, film_pixel: u32) -> u32 {
    let (x, y) = (film_pixel & 0xffff, film_pixel >> 16);
    (y - crop.y0) * crop.width() + x - crop.x0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_of_a_crop_has_its_samples_in_one_tile() {
        let sizes =
            [(1, 1), (1, 9), (9, 1), (7, 7), (8, 8), (9, 9), (16, 8), (17, 23), (8, 15), (100, 3), (3, 100), (63, 65)];
        for (width, height) in sizes {
            let crop = Crop { x0: 5, y0: 11, x1: 5 + width, y1: 11 + height };
            let each = SampleCounts::PerPixel((0..width * height).map(|i| 1 + (i * i % 7) as u8).collect());
            for (counts, max) in [(SampleCounts::Uniform(3), 100), (each.clone(), 64), (each, 1)] {
                let mut tiles = Tiles::new(crop, &counts);
                let mut seen = vec![0; (width * height) as usize];
                let mut ended = false;
                while let Some((tile, is_last)) = tiles.next(max) {
                    assert!(tile.len() <= max.max(7) && !ended, "{width} x {height}");
                    ended = is_last;
                    let mut here = vec![0; seen.len()];
                    for &[film_pixel, number_and_count] in tile {
                        let (number, count) = (number_and_count & 0xffff, number_and_count >> 16);
                        let [x, y] = [film_pixel & 0xffff, film_pixel >> 16];
                        assert!((crop.x0..crop.x1).contains(&x) && (crop.y0..crop.y1).contains(&y));
                        let pixel = crop_pixel(crop, film_pixel);
                        assert_eq!(pixel, (y - crop.y0) * width + x - crop.x0);
                        assert_eq!(number, here[pixel as usize], "numbers run from 0");
                        assert_eq!(count, counts.of(pixel));
                        here[pixel as usize] += 1;
                    }
                    for (pixel, &n) in here.iter().enumerate().filter(|(_, n)| **n > 0) {
                        assert_eq!(n, counts.of(pixel as u32), "a pixel is in one tile");
                        seen[pixel] += 1;
                    }
                }
                assert!(ended && seen.iter().all(|&n| n == 1), "{width} x {height}");
            }
        }
    }
}

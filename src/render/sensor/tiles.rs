//! Divides the samples of an iteration into tiles.

use rayon::prelude::*;

use crate::settings::Crop;

/// Side of a block in pixels. Samples run block by block, so that the paths of a tile stay near each other.
const BLOCK: u32 = 8;

/// A pixel of a tile, in the layout of `list_samples.wgsl`. Word 0: its place in the whole film (see [`film_pixel`]). Word 1: the index
/// of its first sample in the tile.
pub type TilePixel = [u32; 2];

/// A sample of a tile, in the layout of `samples.wgsl`. Word 0: its pixel in the whole film (see [`film_pixel`]). Word 1: its
/// index among the samples of the pixel (low 16 bits) and their number (high 16 bits).
pub type TileSample = [u32; 2];

/// The samples of a tile, pixel by pixel.
#[derive(Default)]
pub struct Tile {
    /// The pixels; the last entry stands for the end of the samples.
    pixels: Vec<TilePixel>,
}

impl Tile {
    /// The pixels, and one more entry for the end of the samples.
    pub fn pixels(&self) -> &[TilePixel] {
        &self.pixels
    }

    /// Number of pixels.
    pub fn pixel_count(&self) -> usize {
        self.pixels.len().saturating_sub(1)
    }

    /// Number of samples.
    pub fn sample_count(&self) -> usize {
        self.pixels.last().map_or(0, |end| end[1] as usize)
    }

    /// The pixels as row-major indices in the crop.
    pub fn crop_pixels(&self, crop: Crop) -> Vec<u32> {
        self.pixels[..self.pixel_count()].iter().map(|&[film_pixel, _]| crop_pixel(crop, film_pixel)).collect()
    }

    /// For each sample, the index of its pixel in the tile.
    pub fn pixel_indices(&self) -> Vec<u32> {
        let of_pixel =
            |(index, pair): (u32, &[TilePixel])| std::iter::repeat_n(index, (pair[1][1] - pair[0][1]) as usize);
        (0..).zip(self.pixels.windows(2)).flat_map(of_pixel).collect()
    }

    /// The list of the samples, as the device makes it.
    #[cfg(test)]
    pub fn samples(&self) -> Vec<TileSample> {
        let of_pixel = |pair: &[TilePixel]| {
            let (film_pixel, count) = (pair[0][0], pair[1][1] - pair[0][1]);
            (0..count).map(move |number| [film_pixel, count << 16 | number])
        };
        self.pixels.windows(2).flat_map(of_pixel).collect()
    }
}

/// The pixels of a crop in sample order. It is the same in all iterations.
pub struct PixelOrder {
    pub crop: Crop,
    /// Of each pixel, the row-major index in the crop, and the place in the whole film.
    pixels: Vec<[u32; 2]>,
}

impl PixelOrder {
    pub fn new(crop: Crop) -> PixelOrder {
        let at = |position: u32| {
            let pixel = pixel_at(crop, position);
            [pixel, film_pixel(crop, pixel)]
        };
        let pixels = (0..crop.width() * crop.height()).into_par_iter().with_min_len(1 << 12).map(at).collect();
        PixelOrder { crop, pixels }
    }
}

/// Divides the samples of an iteration into tiles. All samples of a pixel are in the same tile.
pub struct Tiles<'a, Count> {
    /// The pixels of later tiles, see [`PixelOrder`].
    left: &'a [[u32; 2]],
    /// Number of samples of a pixel, a row-major index in the crop.
    count: Count,
    tile: Tile,
}

impl<Count: Fn(u32) -> u32> Tiles<'_, Count> {
    pub fn new(order: &PixelOrder, count: Count) -> Tiles<'_, Count> {
        Tiles { left: &order.pixels, count, tile: Tile::default() }
    }

    /// The next tile, and whether it is the last one; `None` after the last. A tile holds at most `max` samples, but always at least
    /// one pixel.
    pub fn next(&mut self, max: usize) -> Option<(&Tile, bool)> {
        let listed = &mut self.tile.pixels;
        listed.clear();
        let mut samples = 0;
        for &[pixel, film_pixel] in self.left {
            let count = (self.count)(pixel);
            if samples > 0 && samples as usize + count as usize > max {
                break;
            }
            listed.push([film_pixel, samples]);
            samples += count;
        }
        self.left = &self.left[listed.len()..];
        if listed.is_empty() {
            return None;
        }
        listed.push([0, samples]);
        Some((&self.tile, self.left.is_empty()))
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

/// The inverse of [`film_pixel`].
pub fn crop_pixel(crop: Crop, film_pixel: u32) -> u32 {
    let (x, y) = (film_pixel & 0xffff, film_pixel >> 16);
    (y - crop.y0) * crop.width() + x - crop.x0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{Buffer, Device, Kernel, Recorder};
    use crate::render::samples::SampleCounts;
    use crate::wgsl::layout::Dispatch;

    /// The samples of a tile as the kernel lists them.
    fn listed_by_device(device: &Device, kernel: &Kernel, tile: &Tile) -> Vec<TileSample> {
        let count = tile.sample_count();
        let pixels = Buffer::from_slice(device, "pixels", tile.pixels(), "").unwrap();
        let samples = Buffer::from_slice(device, "samples", &vec![[u32::MAX; 2]; count], "").unwrap();
        let bound = kernel.bind(&[("tile_pixels", &pixels), ("tile_samples", &samples)]).unwrap();
        let over_pixels = Dispatch { count: tile.pixel_count() as u32, ..bytemuck::Zeroable::zeroed() };
        let mut recorder = Recorder::new(device).unwrap();
        recorder.dispatch("test", kernel, &bound, &over_pixels, kernel.groups(tile.pixel_count())).unwrap();
        recorder.submit().unwrap();
        samples.to_vec(count).unwrap()
    }

    #[test]
    fn the_device_lists_the_samples_of_a_tile() {
        let device = Device::open(None).expect("this test needs a Vulkan device: run ./setup.sh");
        let kernel = Kernel::new(&device, "list_samples", "list_samples", &[]).unwrap();
        let crop = Crop { x0: 5, y0: 11, x1: 28, y1: 28 };
        let each = SampleCounts::PerPixel((0..23 * 17).map(|i| 1 + (i * i % 7) as u8).collect());
        for (counts, max) in [(SampleCounts::Uniform(1024), 1), (SampleCounts::Uniform(3), 1 << 20), (each, 100)] {
            let order = PixelOrder::new(crop);
            let mut tiles = Tiles::new(&order, |pixel| counts.of(pixel));
            for _ in 0..3 {
                let Some((tile, _)) = tiles.next(max) else { break };
                assert_eq!(listed_by_device(&device, &kernel, tile), tile.samples(), "{max}");
            }
        }
    }

    #[test]
    fn every_pixel_of_a_crop_has_its_samples_in_one_tile() {
        let sizes =
            [(1, 1), (1, 9), (9, 1), (7, 7), (8, 8), (9, 9), (16, 8), (17, 23), (8, 15), (100, 3), (3, 100), (63, 65)];
        for (width, height) in sizes {
            let crop = Crop { x0: 5, y0: 11, x1: 5 + width, y1: 11 + height };
            let each = SampleCounts::PerPixel((0..width * height).map(|i| 1 + (i * i % 7) as u8).collect());
            let order = PixelOrder::new(crop);
            for (counts, max) in [(SampleCounts::Uniform(3), 100), (each.clone(), 64), (each, 1)] {
                let mut tiles = Tiles::new(&order, |pixel| counts.of(pixel));
                let mut seen = vec![0; (width * height) as usize];
                let mut ended = false;
                while let Some((tile, is_last)) = tiles.next(max) {
                    let samples = tile.samples();
                    assert_eq!(samples.len(), tile.sample_count());
                    assert!(samples.len() <= max.max(7) && !ended, "{width} x {height}");
                    ended = is_last;
                    let mut here = vec![0; seen.len()];
                    let (listed, indices) = (tile.crop_pixels(crop), tile.pixel_indices());
                    for (&[film_pixel, number_and_count], index) in samples.iter().zip(indices) {
                        let (number, count) = (number_and_count & 0xffff, number_and_count >> 16);
                        let [x, y] = [film_pixel & 0xffff, film_pixel >> 16];
                        assert!((crop.x0..crop.x1).contains(&x) && (crop.y0..crop.y1).contains(&y));
                        let pixel = crop_pixel(crop, film_pixel);
                        assert_eq!(pixel, (y - crop.y0) * width + x - crop.x0);
                        assert_eq!(listed[index as usize], pixel);
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

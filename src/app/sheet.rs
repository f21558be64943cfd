//! Images side by side in one picture.

use taugate::Result;

/// Maximum width and height of the picture, in pixels. Larger images are reduced.
const MAX_SIDE: usize = 4096;

/// An image in linear colours.
pub struct Linear {
    pub width: usize,
    pub height: usize,
    pub rgb: Vec<f32>,
}

/// `count` images of one size in rows. Only one of them at a time is in memory; `read` returns it.
pub fn sheet(count: usize, read: impl Fn(usize) -> Result<Linear>) -> Result<Linear> {
    let columns = columns(count);
    let rows = count.div_ceil(columns);
    let Linear { width, height, .. } = read(0)?;
    let factor = (columns * width).max(rows * height).div_ceil(MAX_SIDE);
    let [width, height] = [(width / factor).max(1), (height / factor).max(1)];
    let mut sheet = vec![0.0; 3 * columns * width * rows * height];
    for number in 0..count {
        let image = read(number)?;
        let [left, top] = [number % columns * width, number / columns * height];
        for y in 0..height {
            for x in 0..width {
                let at = 3 * ((top + y) * columns * width + left + x);
                sheet[at..at + 3].copy_from_slice(&image.mean(factor * x, factor * y, factor));
            }
        }
    }
    Ok(Linear { width: columns * width, height: rows * height, rgb: sheet })
}

/// Number of images per row: the smallest from sqrt(count) to 2 sqrt(count) with which all rows are full. Without one, sqrt(count),
/// rounded up.
fn columns(count: usize) -> usize {
    let side = (count as f64).sqrt();
    let full = (side.ceil() as usize..=(2.0 * side) as usize).find(|columns| count.is_multiple_of(*columns));
    full.unwrap_or(side.ceil() as usize)
}

impl Linear {
    /// The mean over the pixels of a square, as far as they are inside the image.
    fn mean(&self, x: usize, y: usize, side: usize) -> [f32; 3] {
        let (columns, rows) = (x..(x + side).min(self.width), y..(y + side).min(self.height));
        let count = (columns.len() * rows.len()).max(1) as f32;
        let mut sum = [0.0; 3];
        for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
            (0..3).for_each(|k| sum[k] += self.rgb[3 * (y * self.width + x) + k]);
        }
        sum.map(|sum| sum / count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_full_if_that_is_near_a_square() {
        assert_eq!([1, 2, 3, 7, 8, 16, 24, 25].map(columns), [1, 2, 3, 3, 4, 4, 6, 5]);
    }

    #[test]
    fn images_lie_in_rows() {
        let image = |k: usize| Ok(Linear { width: 1, height: 1, rgb: vec![k as f32; 3] });
        let Linear { width, height, rgb } = sheet(4, image).unwrap();
        assert_eq!((width, height), (2, 2));
        assert_eq!(rgb, [0.0, 1.0, 2.0, 3.0].map(|x| [x; 3]).as_flattened());
    }
}

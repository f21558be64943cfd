//! Small procedural images for textures.

use std::f64::consts::TAU;

use super::numbers::{Pcg, sin_cos};
use crate::scene::Image;

/// Four tiles, two by two, with thin joints; sRGB bytes.
pub fn tiles(size: u32, light: [u8; 3], dark: [u8; 3]) -> Image {
    let mut pcg = Pcg::new(11);
    fill(size, size, |x, y| {
        let field = if (x * 2 / size + y * 2 / size).is_multiple_of(2) { light } else { dark };
        let half = size / 2;
        let joint = x % half == 0 || y % half == 0;
        let noise = pcg.range(-5.0, 5.0);
        field.map(|c| f64::from(c) * if joint { 0.6 } else { 1.0 } + noise)
    })
}

/// Wooden boards with their grain along v; sRGB bytes.
pub fn wood(size: u32, tone: [u8; 3]) -> Image {
    let mut pcg = Pcg::new(23);
    let boards: Vec<(f64, f64)> = (0..4).map(|_| (pcg.range(0.0, 60.0), pcg.range(0.85, 1.1))).collect();
    fill(size, size, |x, y| {
        let (u, v) = (f64::from(x) / f64::from(size), f64::from(y) / f64::from(size));
        let board = (x * 4 / size) as usize;
        let (phase, shade) = boards[board];
        let bend = sin_cos(v * TAU + phase).0 * 0.012;
        let ring = sin_cos((u + bend) * 170.0 + phase).0 * 0.5 + sin_cos((u + 2.0 * bend) * 53.0 + phase).0 * 0.5;
        let gap = if x % (size / 4) == 0 { 0.55 } else { 1.0 };
        let noise = pcg.range(0.97, 1.03);
        tone.map(|c| f64::from(c) * shade * gap * noise * (1.0 + 0.1 * ring))
    })
}

/// Hills under an evening sky; sRGB bytes.
pub fn landscape(width: u32, height: u32) -> Image {
    let hills = [(0.50, 0.05, 5.0, 0.3, [122.0, 118.0, 150.0]), (0.62, 0.07, 7.5, 1.9, [78.0, 96.0, 104.0])];
    let meadow = (0.78, 0.05, 4.0, 4.1, [62.0, 86.0, 48.0]);
    fill(width, height, |x, y| {
        let (u, v) = (f64::from(x) / f64::from(width), f64::from(y) / f64::from(height));
        let sky = [235.0 - 60.0 * v, 150.0 + 130.0 * v, 110.0 + 90.0 * (0.5 - v).abs()];
        let (du, dv) = ((u - 0.68) * 1.5, v - 0.36);
        let mut colour = if du * du + dv * dv < 0.006 { [255.0, 236.0, 190.0] } else { sky };
        for (level, height, wave, phase, tone) in hills.into_iter().chain([meadow]) {
            if v > level - height * sin_cos(u * wave + phase).0 - 0.3 * height * sin_cos(u * wave * 3.7).0 {
                colour = tone;
            }
        }
        colour
    })
}

fn fill(width: u32, height: u32, mut colour: impl FnMut(u32, u32) -> [f64; 3]) -> Image {
    let rgba = (0..width * height)
        .map(|i| {
            let [r, g, b] = colour(i % width, i / width).map(|c| c.round().clamp(0.0, 255.0) as u8);
            [r, g, b, 255]
        })
        .collect();
    Image { width, height, rgba }
}

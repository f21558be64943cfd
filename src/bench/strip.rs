//! Crops side by side: the reference and every variant in the upper row, the errors in the lower row.

use std::fmt::Write;
use std::io;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;

use crate::compare::flip;
use crate::image::exr_file::Picture;
use crate::image::png_file;

/// Maximum width and height of a crop in pixels.
const CROP: [u32; 2] = [160, 120];
/// Minimum width in pixels of a crop in the strip.
const TILE: u32 = 240;
/// White pixels between tiles.
const GAP: u32 = 4;
/// Height of the labels above the crops, in pixels.
const LABELS: u32 = 20;
/// Steps between the candidate positions of the crop, along each side.
const STEPS: u32 = 8;

/// An image of sRGB bytes.
pub struct Strip {
    width: u32,
    height: u32,
    rgb: Vec<[u8; 3]>,
}

/// The upper row shows the reference and `images`, all of the same size, with the exposure of the reference. The lower row shows
/// the FLIP error of each image, from black (no error) to white. Large images are cropped where the reference has the highest
/// contrast.
pub fn strip(reference: &Picture, images: &[Picture]) -> Strip {
    let size = [reference.width.min(CROP[0]), reference.height.min(CROP[1])];
    let at = place(reference, size);
    let zoom = TILE.div_ceil(size[0]).max(1);
    let tile = [size[0] * zoom, size[1] * zoom];
    let columns = 1 + images.len() as u32;
    let (width, height) = (columns * (tile[0] + GAP) - GAP, 2 * tile[1] + GAP);
    let mut rgb = vec![[255; 3]; (width * height) as usize];

    let exposure = png_file::exposure(&reference.rgb);
    let mut put = |column: u32, row: u32, bytes: &[u8]| {
        let (left, top) = (column * (tile[0] + GAP), row * (tile[1] + GAP));
        for (x, y) in (0..tile[1]).flat_map(|y| (0..tile[0]).map(move |x| (x, y))) {
            let from = 3 * ((at[1] + y / zoom) * reference.width + at[0] + x / zoom) as usize;
            rgb[((top + y) * width + left + x) as usize] = [bytes[from], bytes[from + 1], bytes[from + 2]];
        }
    };
    put(0, 0, &png_file::expose(&reference.rgb, exposure));
    for (i, image) in images.iter().enumerate() {
        put(1 + i as u32, 0, &png_file::expose(&image.rgb, exposure));
        let error = flip::hdr(&image.rgb, &reference.rgb, reference.width as usize).map;
        put(1 + i as u32, 1, &error.iter().flat_map(|&e| heat(e)).collect::<Vec<u8>>());
    }
    Strip { width, height, rgb }
}

/// A strip as PNG, and as SVG with the name of each image above its crop.
pub fn files(strip: &Strip, names: &[&str]) -> io::Result<(Vec<u8>, String)> {
    let mut png = vec![];
    png_file::encode_bytes(&mut png, strip.width, strip.height, strip.rgb.as_flattened())?;
    let columns = 1 + names.len() as u32;
    let (width, height) = (strip.width, strip.height + LABELS);
    let (tile, row) = ((width + GAP) / columns - GAP, (strip.height + GAP) / 2);
    let mut svg = format!(
        "<svg xmlns='http://www.w3.org/2000/svg' width='{width}' height='{height}' font-family='sans-serif' font-size='13'>\n\
         <rect width='{width}' height='{height}' fill='white'/>\n\
         <image y='{LABELS}' width='{width}' height='{}' href='data:image/png;base64,{}'/>\n",
        strip.height,
        BASE64_STANDARD.encode(&png)
    );
    // Each label has a box of its own, so that a long name does not run into the next one.
    let mut label = |left: u32, top: u32, text: &str| {
        let text = text.replace('&', "&amp;").replace('<', "&lt;");
        let _ = writeln!(
            svg,
            "<svg x='{left}' y='{top}' width='{tile}' height='{LABELS}'><text x='50%' y='14' text-anchor='middle'>{text}</text></svg>"
        );
    };
    for (column, name) in (0..).zip(["reference"].iter().chain(names)) {
        label(column * (tile + GAP), 0, name);
    }
    label(0, LABELS + row + row / 2 - LABELS / 2, "FLIP error, black for none");
    Ok((png, svg + "</svg>\n"))
}

/// Colour of an error from 0 to 1: black, violet, orange, white, with growing brightness.
fn heat(error: f32) -> [u8; 3] {
    const STOPS: [[f32; 3]; 5] =
        [[0.0, 0.0, 0.0], [60.0, 15.0, 110.0], [180.0, 50.0, 120.0], [250.0, 150.0, 90.0], [255.0, 255.0, 240.0]];
    let at = error.clamp(0.0, 1.0) * (STOPS.len() - 1) as f32;
    let from = (at as usize).min(STOPS.len() - 2);
    let part = at - from as f32;
    [0, 1, 2].map(|c| (STOPS[from][c] + part * (STOPS[from + 1][c] - STOPS[from][c])) as u8)
}

/// Corner of the window of this size with the highest contrast. Contrast is the sum of the differences between neighbouring pixels,
/// in the cube root of their brightness.
fn place(picture: &Picture, [w, h]: [u32; 2]) -> [u32; 2] {
    let steps = |all: u32, part: u32| (0..=STEPS).map(move |i| (all - part) * i / STEPS);
    let candidates = steps(picture.height, h).flat_map(|y| steps(picture.width, w).map(move |x| [x, y]));
    let value = |x: u32, y: u32| {
        let p = &picture.rgb[3 * (y * picture.width + x) as usize..][..3];
        (p[0] + p[1] + p[2]).max(0.0).cbrt()
    };
    let contrast = |[x0, y0]: &[u32; 2]| -> f32 {
        let pairs = (*y0..y0 + h).flat_map(|y| (*x0 + 1..x0 + w).map(move |x| (x, y)));
        pairs.map(|(x, y)| (value(x, y) - value(x - 1, y)).abs()).sum()
    };
    candidates.max_by(|a, b| contrast(a).total_cmp(&contrast(b))).unwrap_or([0, 0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_crop_has_the_name_of_its_image() {
        // The reference and two images, 240 pixels wide, with gaps of 4 pixels.
        let strip = Strip { width: 728, height: 364, rgb: vec![[0; 3]; 728 * 364] };
        let (png, svg) = files(&strip, &["lcs", "bdpt <2 & more>"]).unwrap();
        assert!(png.starts_with(b"\x89PNG"));
        let texts: Vec<&str> = svg.lines().filter(|line| line.contains("<text")).collect();
        let wanted =
            [("x='0' y='0'", "reference"), ("x='244' y='0'", "lcs"), ("x='488' y='0'", "bdpt &lt;2 &amp; more>")];
        for ((place, name), line) in wanted.into_iter().zip(&texts) {
            assert!(line.contains(place) && line.contains(&format!(">{name}</text>")), "{line}");
        }
        assert!(texts.len() == 4 && texts[3].contains("FLIP"), "{texts:?}");
    }
}

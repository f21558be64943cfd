//! FLIP, the perceptual difference of two images: Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images".
//! HDR images are compared under several exposures, and each pixel keeps its largest error (HDR-FLIP: Andersson et al. 2021,
//! "Visualizing Errors in Rendered High Dynamic Range Images"). Section numbers are those of the 2020 paper unless HDR-FLIP is
//! named.
//!
//! Viewing conditions are the published defaults: 67 pixels per degree, the ACES tone mapper.

mod colour;
mod filter;

use rayon::prelude::*;

use colour::{Pixel, from_opponent, hunt_lab, hyab, to_opponent, tone_map};
use filter::{Features, Filters};

/// Exponents of colour and feature differences (Secs. 4.1.3 and 4.3).
const COLOUR_EXPONENT: f32 = 0.7;
const FEATURE_EXPONENT: f32 = 0.5;
/// Colour differences up to this fraction of the largest possible difference map to [0, `PERCEIVED`], larger ones to the rest of
/// [0, 1].
const LARGE: f32 = 0.4;
const PERCEIVED: f32 = 0.95;
/// log2 of the linear value that the tone mapper maps to 0.85 of white: a root of the ACES rational polynomial.
const LOG2_OF_85_PERCENT: f64 = 1.083_296_658_451_098_8;

/// Error per pixel, and the exposures that it was computed with.
#[derive(Debug, Clone)]
pub struct Flip {
    /// One value per pixel, from 0 (no difference) to 1, row 0 at the top.
    pub map: Vec<f32>,
    /// First and last exposure compensation in stops, and the number of exposures.
    pub exposures: (f64, f64, usize),
}

impl Flip {
    /// Mean over the pixels, 0 to 1: the number that papers report.
    pub fn mean(&self) -> f64 {
        self.map.iter().map(|&x| f64::from(x)).sum::<f64>() / self.map.len() as f64
    }
}

/// HDR-FLIP of linear R, G, B images (interleaved, finite, of the same size, at least one pixel). Negative values count as 0.
///
/// The exposures depend only on the reference. The first maps its largest luminance to 0.85 of white, the last its median. A median
/// below 2^-23 of the largest luminance is raised to that value, because gated images may have any brightness; the published
/// program uses 2^-23 itself.
pub fn hdr(image: &[f32], reference: &[f32], width: usize) -> Flip {
    assert_eq!(image.len(), reference.len(), "images are compared at the same size");
    let exposures = exposures(reference);
    let (first, last, count) = exposures;
    let filters = Filters::new();
    let step = (last - first) / (count - 1) as f64;
    let maps = (0..count).into_par_iter().map(|i| {
        let factor = (first + step * i as f64).exp2() as f32;
        let exposed = |rgb: &[f32]| -> Vec<Pixel> {
            rgb.chunks_exact(3).map(|p| tone_map([p[0], p[1], p[2]].map(|v| v * factor))).collect()
        };
        ldr(&exposed(image), &exposed(reference), width, &filters)
    });
    let max = |a: Vec<f32>, b: Vec<f32>| a.iter().zip(&b).map(|(x, y)| x.max(*y)).collect();
    let map = maps.reduce(|| vec![0.0; image.len() / 3], max);
    Flip { map, exposures }
}

/// First and last exposure and their number, Sec. 4 of HDR-FLIP.
fn exposures(reference: &[f32]) -> (f64, f64, usize) {
    let luminance = |p: &[f32]| {
        0.2126 * f64::from(p[0].max(0.0)) + 0.7152 * f64::from(p[1].max(0.0)) + 0.0722 * f64::from(p[2].max(0.0))
    };
    let mut all: Vec<f64> = reference.chunks_exact(3).map(luminance).collect();
    let middle = all.len() / 2;
    let (_, &mut median, _) = all.select_nth_unstable_by(middle, f64::total_cmp);
    let brightest = all.iter().copied().fold(0.0, f64::max);
    if brightest == 0.0 {
        return (0.0, 0.0, 2);
    }
    let median = median.max(f64::from(f32::EPSILON) * brightest);
    let (first, last) = (LOG2_OF_85_PERCENT - brightest.log2(), LOG2_OF_85_PERCENT - median.log2());
    (first, last, ((last - first).ceil() as usize).max(2))
}

/// FLIP of linear R, G, B in [0, 1], one value per pixel.
fn ldr(image: &[Pixel], reference: &[Pixel], width: usize, filters: &Filters) -> Vec<f32> {
    let [image, reference] =
        [image, reference].map(|pixels| pixels.iter().copied().map(to_opponent).collect::<Vec<_>>());

    // Colour (Sec. 4.1): blur away details that the eye cannot resolve, then measure the distance in a uniform space.
    let seen = |pixels: &[Pixel]| -> Vec<Pixel> {
        let mut filtered = filters.contrast_sensitivity(pixels, width);
        filtered.iter_mut().for_each(|p| *p = hunt_lab(from_opponent(*p).map(|v| v.clamp(0.0, 1.0))));
        filtered
    };
    let greatest = hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(COLOUR_EXPONENT);
    let (a, b) = (seen(&image), seen(&reference));

    // Features (Sec. 4.2): edges and points of the achromatic channel, normalised to [0, 1].
    let features = |pixels: &[Pixel]| -> Vec<Features> {
        let achromatic: Vec<f32> = pixels.iter().map(|p| (p[0] + 16.0) / 116.0).collect();
        filters.features(&achromatic, width)
    };
    let (fa, fb) = (features(&image), features(&reference));

    (0..image.len())
        .map(|i| {
            let colour = redistribute(hyab(a[i], b[i]).powf(COLOUR_EXPONENT), greatest);
            let difference = (fa[i].edge - fb[i].edge).abs().max((fa[i].point - fb[i].point).abs());
            let feature = (std::f32::consts::FRAC_1_SQRT_2 * difference).powf(FEATURE_EXPONENT);
            colour.powf(1.0 - feature).clamp(0.0, 1.0)
        })
        .collect()
}

/// Compresses large colour differences, Sec. 4.1.3.
fn redistribute(difference: f32, greatest: f32) -> f32 {
    let bend = LARGE * greatest;
    match difference < bend {
        true => PERCEIVED / bend * difference,
        false => PERCEIVED + (difference - bend) / (greatest - bend) * (1.0 - PERCEIVED),
    }
}

#[cfg(test)]
mod tests;

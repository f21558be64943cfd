//! The filters of FLIP. Each is a sum of products of a horizontal and a vertical filter, which are applied one after the other.
//! Beyond its edges an image continues with its edge pixels.

use std::f64::consts::PI;

use super::colour::Pixel;

/// Pixels per degree of the visual field, for a screen of 3,840 pixels and 0.7 m width at a distance of 0.7 m.
const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;
/// Spatial contrast sensitivity (Sec. 4.1.1): sums of Gaussians a sqrt(pi / b) exp(-pi^2 x^2 / b), given as (a, b), with x in
/// degrees.
const ACHROMATIC: [(f64, f64); 1] = [(1.0, 0.0047)];
const RED_GREEN: [(f64, f64); 1] = [(1.0, 0.0053)];
const BLUE_YELLOW: [(f64, f64); 2] = [(34.1, 0.04), (13.5, 0.025)];
/// The largest b, which determines the radius of all three filters.
const WIDEST: f64 = 0.04;
/// Width of the eye's edge detector in degrees, from peak to trough (Sec. 4.2).
const DETECTOR: f64 = 0.082;

/// A product of a horizontal and a vertical filter.
struct Separable {
    across: Vec<f32>,
    down: Vec<f32>,
}

/// Strength of edge and point features at a pixel.
#[derive(Clone, Copy)]
pub struct Features {
    pub edge: f32,
    pub point: f32,
}

pub struct Filters {
    /// Terms of the sum for each channel of the opponent space.
    contrast: [Vec<Separable>; 3],
    /// Horizontal and vertical derivative.
    edge: [Separable; 2],
    point: [Separable; 2],
}

impl Filters {
    pub fn new() -> Filters {
        let (edge, point) = detectors();
        let contrast = [sensitivity(&ACHROMATIC), sensitivity(&RED_GREEN), sensitivity(&BLUE_YELLOW)];
        Filters { contrast, edge, point }
    }

    /// Filters an image in the opponent space to the details that the eye resolves.
    pub fn contrast_sensitivity(&self, pixels: &[Pixel], width: usize) -> Vec<Pixel> {
        let mut out = vec![[0.0; 3]; pixels.len()];
        for (c, terms) in self.contrast.iter().enumerate() {
            let plane: Vec<f32> = pixels.iter().map(|p| p[c]).collect();
            for term in terms {
                term.apply(&plane, width).iter().zip(&mut out).for_each(|(x, p)| p[c] += x);
            }
        }
        out
    }

    /// Magnitude per pixel of the horizontal and vertical responses, for edges and points.
    pub fn features(&self, plane: &[f32], width: usize) -> Vec<Features> {
        let length = |[across, down]: &[Separable; 2]| -> Vec<f32> {
            let (x, y) = (across.apply(plane, width), down.apply(plane, width));
            x.iter().zip(&y).map(|(x, y)| x.hypot(*y)).collect()
        };
        length(&self.edge).into_iter().zip(length(&self.point)).map(|(edge, point)| Features { edge, point }).collect()
    }
}

/// The terms of one channel's filter; their weights sum to 1.
fn sensitivity(gaussians: &[(f64, f64)]) -> Vec<Separable> {
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let shape = |b: f64| samples(radius, |x| (-PI * PI * (x / PIXELS_PER_DEGREE).powi(2) / b).exp());
    let weight = |a: f64, b: f64| a * (PI / b).sqrt();
    let total: f64 = gaussians.iter().map(|&(a, b)| weight(a, b) * shape(b).iter().sum::<f64>().powi(2)).sum();
    gaussians
        .iter()
        .map(|&(a, b)| Separable { across: scaled(&shape(b), weight(a, b) / total), down: scaled(&shape(b), 1.0) })
        .collect()
}

/// Edge and point detectors: first and second derivative of a Gaussian, horizontal and vertical. Their positive weights sum to 1,
/// their negative weights to -1.
fn detectors() -> ([Separable; 2], [Separable; 2]) {
    let deviation = 0.5 * DETECTOR * PIXELS_PER_DEGREE;
    let radius = (3.0 * deviation).ceil() as i32;
    let gaussian = |x: f64| (-x * x / (2.0 * deviation * deviation)).exp();
    let smooth = samples(radius, gaussian);
    let smooth = scaled(&smooth, 1.0 / smooth.iter().sum::<f64>());
    let pair = |response: Vec<f64>| {
        let sum = |sign: f64| response.iter().map(|x| (sign * x).max(0.0)).sum::<f64>();
        let (positive, negative) = (sum(1.0), sum(-1.0));
        let weights: Vec<f32> =
            response.iter().map(|&x| (if x > 0.0 { x / positive } else { x / negative }) as f32).collect();
        [
            Separable { across: weights.clone(), down: smooth.clone() },
            Separable { across: smooth.clone(), down: weights },
        ]
    };
    let edge = pair(samples(radius, |x| -x * gaussian(x)));
    let point = pair(samples(radius, |x| ((x / deviation).powi(2) - 1.0) * gaussian(x)));
    (edge, point)
}

/// Values of `f` at -radius to radius in steps of 1.
fn samples(radius: i32, f: impl Fn(f64) -> f64) -> Vec<f64> {
    (-radius..=radius).map(|x| f(f64::from(x))).collect()
}

fn scaled(values: &[f64], factor: f64) -> Vec<f32> {
    values.iter().map(|x| (x * factor) as f32).collect()
}

impl Separable {
    fn apply(&self, plane: &[f32], width: usize) -> Vec<f32> {
        let height = plane.len() / width;
        let mut rows = vec![0.0; plane.len()];
        let radius = self.across.len() / 2;
        let mut padded = vec![0.0; width + 2 * radius];
        for (row, out) in plane.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
            padded[..radius].fill(row[0]);
            padded[radius..radius + width].copy_from_slice(row);
            padded[radius + width..].fill(row[width - 1]);
            for (x, out) in out.iter_mut().enumerate() {
                *out = self.across.iter().zip(&padded[x..]).map(|(w, v)| w * v).sum();
            }
        }
        let radius = self.down.len() / 2;
        let mut out = vec![0.0; plane.len()];
        for (y, sums) in out.chunks_exact_mut(width).enumerate() {
            for (i, w) in self.down.iter().enumerate() {
                let from = (y + i).saturating_sub(radius).min(height - 1) * width;
                sums.iter_mut().zip(&rows[from..from + width]).for_each(|(sum, v)| *sum += w * v);
            }
        }
        out
    }
}

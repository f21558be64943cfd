//! Edge cases of BSDF sampling: directions against their density by chi-square, in coordinates that suit every lobe.
//!
//! The cells are in x = ln(1 + m^2) and in azimuth, where m = tan(theta_h) / alpha is the slope of the half vector over
//! alpha. In x, GGX of any width falls off as exp(-x), and a diffuse lobe is smooth too.

use std::f64::consts::TAU;

use glam::DVec3;
use rayon::prelude::*;

use crate::bsdf_edges::{Got, View, edges, kernel, sample, views};
use crate::bsdf_sample::random;
use crate::materials::Reference;
use crate::statistics::{chi_square, level};
use crate::values::dvec;

const RINGS: usize = 28;
const SECTORS: usize = 16;
/// Steps of the quadrature across a cell, per dimension.
const STEPS: usize = 32;
/// Steps from the centre to the edge of the innermost ring. At grazing angles, only half vectors within a few degrees of the normal
/// reflect light in the sectors on the far side.
const INNER_STEPS: usize = 512;
const CELLS: usize = RINGS * SECTORS;

/// The cells of a view: first the reflections, then the refractions, then one cell for everything else.
struct Grid<'a> {
    view: View,
    reference: Reference<'a>,
    w: DVec3,
    alpha: f64,
    /// Maximum of ln(1 + m^2) over all cells.
    end: f64,
}

/// Normalizes `d`. Near the horizon it keeps z unchanged: there the half vector is sensitive to z, and dividing by a rounded
/// length would change z.
fn unit(d: DVec3) -> DVec3 {
    if d.z.abs() > 0.5 {
        return d.normalize();
    }
    let across = (1.0 - d.z * d.z).max(0.0).sqrt() / d.truncate().length().max(1e-30);
    DVec3::new(d.x * across, d.y * across, d.z)
}

impl<'a> Grid<'a> {
    fn new(view: View) -> Grid<'a> {
        let reference = edges().at(view.material, [1.0; 3]);
        let w = unit(view.w());
        // The largest slope of a half vector between two directions above the surface.
        let is_retroreflector = edges().kinds[view.material].retroreflector.is_some();
        let alpha = if is_retroreflector { reference.retro_alpha } else { reference.alpha };
        let reflected = (1.0 + (2.0 / (w.z * alpha)).powi(2)).ln();
        let end = if edges().kinds[view.material].transmission > 0.0 { reflected.max(16.0) } else { reflected };
        Grid { view, reference, w, alpha, end }
    }

    /// The half vector of the known direction and `d`, on the upper side.
    fn half(&self, d: DVec3) -> DVec3 {
        let h = if d.z > 0.0 {
            self.w + self.reference.facing_lobe(d)
        } else {
            self.reference.index(self.w, self.view.front) * self.w + self.reference.index(d, self.view.front) * d
        };
        let h = h.normalize();
        if h.z < 0.0 { -h } else { h }
    }

    fn cell(&self, s: &Got) -> usize {
        if s.valid == 0 {
            return 2 * CELLS;
        }
        let d = unit(dvec(&s.direction));
        let h = self.half(d);
        let slope2 = (h.x * h.x + h.y * h.y) / (h.z * self.alpha).powi(2);
        let ring = (slope2.ln_1p() / self.end * RINGS as f64) as usize;
        let turn = h.y.atan2(h.x) / TAU;
        let sector = (((turn - turn.floor()) * SECTORS as f64) as usize).min(SECTORS - 1);
        if ring >= RINGS { 2 * CELLS } else { usize::from(d.z < 0.0) * CELLS + ring * SECTORS + sector }
    }

    /// Densities of the reflection and of the refraction at the facet with normal `h`, per solid angle of `h`.
    fn density(&self, h: DVec3) -> [f64; 2] {
        let (w, front) = (self.w, self.view.front);
        let c = w.dot(h);
        if c <= 0.0 {
            return [0.0; 2];
        }
        let up = 2.0 * c * h - w;
        let reflected =
            if up.z > 0.0 { self.reference.pdf(w, self.reference.facing_lobe(up), front) * 4.0 * c } else { 0.0 };
        if edges().kinds[self.view.material].transmission == 0.0 {
            return [reflected, 0.0];
        }
        let (here, there) = (self.reference.index(w, front), self.reference.index(-w, front));
        let eta = here / there;
        let sine2 = eta * eta * (1.0 - c * c);
        if sine2 >= 1.0 {
            return [reflected, 0.0];
        }
        let cosine = (1.0 - sine2).sqrt();
        let down = -eta * w + (eta * c - cosine) * h;
        if down.z >= 0.0 {
            return [reflected, 0.0];
        }
        let spread = (here * c - there * cosine).powi(2) / (there * there * cosine);
        [reflected, self.reference.pdf(w, down, front) * spread]
    }

    /// Probability of every cell. The last cell gets the rest.
    fn expected(&self) -> Vec<f64> {
        let mut cells = vec![0.0; 2 * CELLS + 1];
        let dphi = TAU / (SECTORS * STEPS) as f64;
        let steps = |ring| if ring == 0 { INNER_STEPS } else { STEPS };
        for (ring, i) in (0..RINGS).flat_map(|ring| (0..steps(ring)).map(move |i| (ring, i))) {
            let dx = self.end / (RINGS * steps(ring)) as f64;
            let grown = (ring as f64 * self.end / RINGS as f64 + (i as f64 + 0.5) * dx).exp();
            let tan = self.alpha * (grown - 1.0).sqrt();
            let cosine = 1.0 / (1.0 + tan * tan).sqrt();
            // d omega = cos^3 d(tan x) d(tan y), and m^2 = exp(x) - 1.
            let area = cosine.powi(3) * self.alpha * self.alpha * 0.5 * grown * dx * dphi;
            for j in 0..SECTORS * STEPS {
                let (sin, cos) = ((j as f64 + 0.5) * dphi).sin_cos();
                let found = self.density(DVec3::new(tan * cosine * cos, tan * cosine * sin, cosine));
                let cell = ring * SECTORS + j / STEPS;
                cells[cell] += found[0] * area;
                cells[CELLS + cell] += found[1] * area;
            }
        }
        cells[2 * CELLS] = (1.0 - cells.iter().sum::<f64>()).max(0.0);
        cells
    }
}

/// Two p-values: of the right density, and of a density that is alternately 6 % too large and 6 % too small.
fn p_values(view: View, samples: &[Got]) -> [f64; 2] {
    let grid = Grid::new(view);
    let mut observed = vec![0.0; 2 * CELLS + 1];
    samples.iter().for_each(|s| observed[grid.cell(s)] += 1.0);
    let n = samples.len() as f64;
    let expected = grid.expected();
    let tilted = expected.iter().enumerate().map(|(i, p)| p * if i % 2 == 0 { 1.06 } else { 0.94 });
    let mut tilted: Vec<f64> = tilted.collect();
    tilted[2 * CELLS] = expected[2 * CELLS];
    let total: f64 = tilted.iter().sum();
    [expected, tilted.iter().map(|p| p / total).collect()]
        .map(|cells| chi_square(&observed, &cells.iter().map(|p| p * n).collect::<Vec<_>>()))
}

/// Asserts that `n` samples of each view agree with their density, and disagree with the wrong density.
fn agree(views: &[View], n: usize) {
    let (kernel, level) = (kernel(), level(views.len()));
    let uniforms: Vec<[f32; 4]> = random(171, n).collect();
    let mut wrong = vec![];
    for views in views.chunks(8) {
        let found = sample(&kernel, views, &uniforms);
        let p: Vec<[f64; 2]> = views.par_iter().zip(&found).map(|(view, samples)| p_values(*view, samples)).collect();
        for (view, [right, tilted]) in views.iter().zip(p) {
            if right < level {
                wrong.push(format!("{}: p = {right:e}, level {level:e}", view.name()));
            }
            if tilted > level {
                wrong.push(format!("{}: the wrong density passes with p = {tilted:e}", view.name()));
            }
        }
    }
    assert!(wrong.is_empty(), "{} of {}\n{}", wrong.len(), views.len(), wrong.join("\n"));
}

/// Views of rough and diffuse surfaces. The front is sampled towards the light, the back of glass towards the sensor.
fn rough_views() -> Vec<View> {
    let rough =
        |view: &View| edges().kinds[view.material].roughness > 0.0 || edges().kinds[view.material].specular == 0.0;
    // The cells do not suit a clear coat whose lobe is much narrower than what lies under it.
    let suits = |view: &View| {
        let m = &edges().kinds[view.material];
        m.clearcoat == 0.0 || m.clearcoat_roughness >= 0.5
    };
    views().into_iter().filter(|v| rough(v) && suits(v) && (v.to_light == v.front)).collect()
}

#[test]
fn directions_have_their_density_at_the_edges() {
    let some: Vec<View> = rough_views().into_iter().filter(|v| [0.0, 85.0, 89.9].contains(&v.angle)).collect();
    agree(&some, 120_000);
}

/// `cargo test --release --test parity -- --ignored all_directions`
#[test]
#[ignore = "takes a minute"]
fn all_directions_have_their_density_at_the_edges() {
    agree(&rough_views(), 200_000);
}

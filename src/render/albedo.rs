//! Directional albedo of the GGX lobe with Schlick's Fresnel term: what the diffuse base of a coated material does not get.

use std::f64::consts::PI;

use crate::gpu::layout::constants::{ALBEDO_COLUMNS, ALBEDO_ROWS};

/// Below this GGX alpha a lobe is a delta (DELTA_ALPHA in `shared/scene.wgsl`).
pub const DELTA_ALPHA: f32 = 0.001;

/// `COLUMNS` x `ROWS` pairs (a, b) over (root of the cosine, roughness) in [0, 1], cosine fastest: albedo = a f0 + b f90. The root
/// puts the columns where the albedo changes: narrow lobes lose light within an angle of about alpha from grazing.
pub struct AlbedoTable {
    pub values: Vec<[f32; 2]>,
}

const COLUMNS: usize = ALBEDO_COLUMNS as usize;
const ROWS: usize = ALBEDO_ROWS as usize;

impl AlbedoTable {
    /// Integrates the lobe by stratified sampling of its visible normals (Heitz 2018), in f64.
    pub fn new() -> AlbedoTable {
        use rayon::prelude::*;
        let square = |i: usize, count: usize| (i as f64 / (count - 1) as f64).powi(2);
        let values = (0..COLUMNS * ROWS)
            .into_par_iter()
            .map(|i| lobe_albedo(square(i % COLUMNS, COLUMNS), square(i / COLUMNS, ROWS)))
            .collect();
        AlbedoTable { values }
    }

    /// Albedo at `cosine` for GGX `alpha`, reflectance `f0` along the normal and `f90` at grazing angles, by the interpolation
    /// of `coat_albedo`.
    pub fn at(&self, cosine: f64, alpha: f64, f0: f64, f90: f64) -> f64 {
        let at = |v: f64, count: usize| v.clamp(0.0, 1.0).sqrt() * (count - 1) as f64;
        let (x, y) = (at(cosine, COLUMNS), at(alpha, ROWS));
        let (i, j) = ((x as usize).min(COLUMNS - 2), (y as usize).min(ROWS - 2));
        let (fx, fy) = (x - i as f64, y - j as f64);
        let value = |i: usize, j: usize| {
            let [a, b] = self.values[j * COLUMNS + i];
            f64::from(a) * f0 + f64::from(b) * f90
        };
        let row = |j: usize| value(i, j) * (1.0 - fx) + value(i + 1, j) * fx;
        (row(j) * (1.0 - fy) + row(j + 1) * fy).clamp(0.0, 1.0)
    }

    /// Mean albedo over the hemisphere: 2 times the integral of albedo(mu) mu.
    pub fn mean(&self, alpha: f64, f0: f64, f90: f64) -> f64 {
        const STEPS: usize = 256;
        let mu = |k: usize| (k as f64 + 0.5) / STEPS as f64;
        (0..STEPS).map(|k| 2.0 * self.at(mu(k), alpha, f0, f90) * mu(k)).sum::<f64>() / STEPS as f64
    }
}

impl Default for AlbedoTable {
    fn default() -> Self {
        AlbedoTable::new()
    }
}

fn lobe_albedo(cosine: f64, alpha: f64) -> [f32; 2] {
    let schlick = |c: f64| (1.0 - c).clamp(0.0, 1.0).powi(5);
    if alpha < f64::from(DELTA_ALPHA) {
        return [(1.0 - schlick(cosine)) as f32, schlick(cosine) as f32];
    }
    const STRATA: usize = 32;
    let cosine = cosine.max(1e-6);
    let w = [(1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine];
    let (mut a, mut b) = (0.0, 0.0);
    for k in 0..STRATA * STRATA {
        let u = [(k % STRATA) as f64 + 0.5, (k / STRATA) as f64 + 0.5].map(|x| x / STRATA as f64);
        let h = visible_normal(w, alpha, u);
        let w_h = w[0] * h[0] + w[1] * h[1] + w[2] * h[2];
        let out_z = 2.0 * w_h * h[2] - w[2];
        if out_z <= 0.0 {
            continue;
        }
        let ratio = (1.0 + lambda(w[2], alpha)) / (1.0 + lambda(w[2], alpha) + lambda(out_z, alpha));
        a += ratio * (1.0 - schlick(w_h));
        b += ratio * schlick(w_h);
    }
    let n = (STRATA * STRATA) as f64;
    [(a / n) as f32, (b / n) as f32]
}

/// Smith's Lambda for GGX (Heitz 2014, Eq. 72).
fn lambda(cosine: f64, alpha: f64) -> f64 {
    let tan2 = (1.0 - cosine * cosine).max(0.0) / (cosine * cosine);
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

/// Dupuy and Benyoub 2023.
fn visible_normal(w: [f64; 3], alpha: f64, u: [f64; 2]) -> [f64; 3] {
    let normalise = |v: [f64; 3]| {
        let l = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        v.map(|x| x / l)
    };
    let s = normalise([w[0] * alpha, w[1] * alpha, w[2]]);
    let z = (1.0 - u[1]) * (1.0 + s[2]) - s[2];
    let r = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
    let (sin, cos) = (2.0 * PI * u[0]).sin_cos();
    normalise([(r * cos + s[0]) * alpha, (r * sin + s[1]) * alpha, z + s[2]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_right() {
        let table = AlbedoTable::new();
        // Smooth: Schlick's term itself.
        assert!((table.at(1.0, 0.0, 0.04, 1.0) - 0.04).abs() < 1e-6);
        assert!((table.at(0.5, 0.0, 0.04, 1.0) - (0.04 + 0.96 / 32.0)).abs() < 1e-3);
        // No coat, no albedo; a perfect one loses only what single scattering loses.
        assert_eq!(table.at(0.3, 0.2, 0.0, 0.0), 0.0);
        assert!(table.at(1.0, 0.04, 1.0, 1.0) > 0.98);
        assert!((0.3..0.7).contains(&table.at(1.0, 1.0, 1.0, 1.0)), "{}", table.at(1.0, 1.0, 1.0, 1.0));
        // Mean of Schlick's term at normal reflectance f0: f0 + (1 - f0) / 21.
        assert!((table.mean(0.0, 0.04, 1.0) - (0.04 + 0.96 / 21.0)).abs() < 1e-3);
    }
}

//! Directional albedo of the GGX lobe with Schlick's Fresnel term: the fraction of the light that the coat reflects, so that
//! it does not reach the diffuse base.

use std::f64::consts::PI;

use super::material::DELTA_ALPHA;
use crate::wgsl::layout::constants::{ALBEDO_COLUMNS, ALBEDO_ROWS};

/// Table of `COLUMNS` x `ROWS` pairs (a, b) with albedo = a f0 + b f90. Columns are uniform in sqrt(cosine), rows in
/// roughness = sqrt(alpha), both over [0, 1]; the column varies fastest. The square root gives more columns to small cosines:
/// the albedo of a narrow lobe changes within an angle of about alpha from grazing.
///
/// Then come `ROWS` pairs, one per row: the cosine-weighted mean over the hemisphere, see [`AlbedoTable::mean`].
pub struct AlbedoTable {
    pub values: Vec<[f32; 2]>,
    /// The same for the device: texel k holds the pairs k and k + 1. The last one holds the last pair twice.
    pub texels: Vec<[f32; 4]>,
}

const COLUMNS: usize = ALBEDO_COLUMNS as usize;
const ROWS: usize = ALBEDO_ROWS as usize;
/// Number of strata of the height, and of the azimuth. Half of the azimuths mirror the other half and are skipped.
const STRATA: usize = 32;

impl AlbedoTable {
    /// Integrates the lobe in f64, by stratified sampling of its visible normals (Heitz 2018).
    pub fn new() -> AlbedoTable {
        use rayon::prelude::*;
        let azimuths: Vec<f64> = (0..STRATA / 2).map(|k| (2.0 * PI * (k as f64 + 0.5) / STRATA as f64).cos()).collect();
        let square = |i: usize, count: usize| (i as f64 / (count - 1) as f64).powi(2);
        let values = (0..COLUMNS * ROWS)
            .into_par_iter()
            .map(|i| lobe_albedo(square(i % COLUMNS, COLUMNS), square(i / COLUMNS, ROWS), &azimuths))
            .collect();
        let mut table = AlbedoTable { values, texels: vec![] };
        let means = (0..ROWS).map(|row| {
            let mean = |f0: f64, f90: f64| table.mean(square(row, ROWS), f0, f90) as f32;
            [mean(1.0, 0.0), mean(0.0, 1.0)]
        });
        let means: Vec<_> = means.collect();
        table.values.extend(means);
        let next = table.values[1..].iter().chain(table.values.last());
        table.texels = table.values.iter().zip(next).map(|(a, b)| [a[0], a[1], b[0], b[1]]).collect();
        table
    }

    /// The table, computed once per process.
    pub fn shared() -> &'static AlbedoTable {
        static TABLE: std::sync::OnceLock<AlbedoTable> = std::sync::OnceLock::new();
        TABLE.get_or_init(AlbedoTable::new)
    }

    /// Directional albedo, in [0, 1], for the cosine between the direction and the normal, GGX `alpha`, and reflectance `f0`
    /// along the normal and `f90` at grazing angles. Interpolates bilinearly, as `coat_albedo` does in WGSL.
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

    /// Cosine-weighted mean albedo over the hemisphere: 2 times the integral of albedo(mu) mu over mu from 0 to 1.
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

fn lobe_albedo(cosine: f64, alpha: f64, azimuths: &[f64]) -> [f32; 2] {
    let schlick = |c: f64| (1.0 - c).clamp(0.0, 1.0).powi(5);
    if alpha < f64::from(DELTA_ALPHA) {
        return [(1.0 - schlick(cosine)) as f32, schlick(cosine) as f32];
    }
    let cosine = cosine.max(1e-6);
    let w = [(1.0 - cosine * cosine).max(0.0).sqrt(), cosine];
    // A visible normal is a point on a spherical cap plus the stretched direction w (Dupuy and Benyoub 2023). The cap is
    // symmetric about the plane of incidence.
    let length = (w[0] * alpha).hypot(w[1]);
    let stretched = [w[0] * alpha / length, w[1] / length];
    let own = 1.0 + lambda(w[1], alpha);
    let (mut a, mut b) = (0.0, 0.0);
    for k in 0..STRATA {
        let u = (k as f64 + 0.5) / STRATA as f64;
        let z = (1.0 - u) * (1.0 + stretched[1]) - stretched[1];
        let r2 = (1.0 - z * z).clamp(0.0, 1.0);
        let r = r2.sqrt();
        for cos in azimuths {
            let (x, y2, z) = (r * cos + stretched[0], r2 * (1.0 - cos * cos), z + stretched[1]);
            let scale = 1.0 / ((x * x + y2) * alpha * alpha + z * z).sqrt();
            let h = [x * alpha * scale, z * scale];
            let w_h = w[0] * h[0] + w[1] * h[1];
            let out_z = 2.0 * w_h * h[1] - w[1];
            if out_z > 0.0 {
                let ratio = own / (own + lambda(out_z, alpha));
                let grazing = schlick(w_h);
                a += ratio * (1.0 - grazing);
                b += ratio * grazing;
            }
        }
    }
    let n = (STRATA * azimuths.len()) as f64;
    [(a / n) as f32, (b / n) as f32]
}

/// Smith's Lambda for GGX (Heitz 2014, Eq. 72).
fn lambda(cosine: f64, alpha: f64) -> f64 {
    let tan2 = (1.0 - cosine * cosine).max(0.0) / (cosine * cosine);
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_right() {
        let table = AlbedoTable::new();
        // The albedo of a smooth coat is Schlick's term.
        assert!((table.at(1.0, 0.0, 0.04, 1.0) - 0.04).abs() < 1e-6);
        assert!((table.at(0.5, 0.0, 0.04, 1.0) - (0.04 + 0.96 / 32.0)).abs() < 1e-3);
        // Without a coat the albedo is 0. A perfect reflector loses only the light that would scatter more than once.
        assert_eq!(table.at(0.3, 0.2, 0.0, 0.0), 0.0);
        assert!(table.at(1.0, 0.04, 1.0, 1.0) > 0.98);
        assert!((0.3..0.7).contains(&table.at(1.0, 1.0, 1.0, 1.0)), "{}", table.at(1.0, 1.0, 1.0, 1.0));
        // The mean of Schlick's term is f0 + (1 - f0) / 21.
        assert!((table.mean(0.0, 0.04, 1.0) - (0.04 + 0.96 / 21.0)).abs() < 1e-3);
    }
}

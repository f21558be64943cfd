//! Directional albedo of a GGX lobe with Schlick's Fresnel factor: the fraction of light that a coat reflects, so that it does not
//! reach the layer below.
//!
//! Schlick's factor is linear in the reflectances f0 (along the normal) and f90 (at grazing angles), and so is the albedo.

use glam::DVec3;

use super::super::ggx;
use super::MIRROR_ALPHA;

const ENTRIES: usize = 64;

/// Number of tables for a coat whose roughness varies. They are spread evenly over the roughness.
const LEVELS: usize = 25;

/// The albedo of a coat, for f0 and f90 of any size, and for one or several values of the roughness.
#[derive(Debug, Clone)]
pub struct CoatTables {
    /// GGX alpha of the roughness factor.
    alpha: f64,
    /// One table. If the roughness varies: `LEVELS` tables, from roughness 0 to the roughness factor.
    levels: Vec<Table>,
}

/// The albedo for one GGX alpha, as pairs (a, b): the albedo is a f0 + b f90.
#[derive(Debug, Clone)]
struct Table {
    /// Entry i is for the cosine (i / 63)^2. The entries are densest at grazing angles, where the albedo changes fast.
    albedo: [[f64; 2]; ENTRIES],
    mean: [f64; 2],
}

/// A coat at a point.
#[derive(Debug, Clone, Copy)]
pub struct Coat<'a> {
    /// GGX alpha.
    pub alpha: f64,
    f0: f64,
    f90: f64,
    /// The two tables with the nearest roughness, and the weight of the second.
    tables: [&'a Table; 2],
    fraction: f64,
}

impl CoatTables {
    /// `varies`: a texture multiplies the roughness.
    pub fn new(roughness: f32, varies: bool) -> CoatTables {
        let alpha = f64::from(roughness).powi(2);
        let levels = match varies {
            false => vec![Table::new(alpha)],
            true => (0..LEVELS).map(|i| Table::new(alpha * (i as f64 / (LEVELS - 1) as f64).powi(2))).collect(),
        };
        CoatTables { alpha, levels }
    }

    /// The coat where a texture multiplies the roughness factor by `roughness`, in [0, 1], and where the reflectances are `f0`
    /// and `f90`.
    pub fn at(&self, roughness: f64, f0: f64, f90: f64) -> Coat<'_> {
        let level = roughness * (self.levels.len() - 1) as f64;
        let low = (level as usize).min(self.levels.len().saturating_sub(2));
        let tables = [&self.levels[low], &self.levels[(low + 1).min(self.levels.len() - 1)]];
        Coat { alpha: self.alpha * roughness.powi(2), f0, f90, tables, fraction: level - low as f64 }
    }
}

impl Coat<'_> {
    /// Whether the lobe counts as a perfect mirror.
    pub fn is_mirror(&self) -> bool {
        self.alpha < MIRROR_ALPHA
    }

    /// The albedo at a cosine in [0, 1].
    pub fn albedo(&self, mu: f64) -> f64 {
        self.between(|table| table.at(mu))
    }

    /// The cosine-weighted mean of the albedo over the hemisphere.
    pub fn mean(&self) -> f64 {
        self.between(|table| table.mean)
    }

    fn between(&self, of: impl Fn(&Table) -> [f64; 2]) -> f64 {
        let [a, b] = self.tables.map(|table| of(table)[0] * self.f0 + of(table)[1] * self.f90);
        a + self.fraction * (b - a)
    }
}

impl Table {
    fn new(alpha: f64) -> Table {
        let mut table = Table { albedo: [[0.0; 2]; ENTRIES], mean: [0.0; 2] };
        for (i, entry) in table.albedo.iter_mut().enumerate() {
            let mu = (i as f64 / (ENTRIES - 1) as f64).powi(2).max(1e-6);
            *entry = integrate_albedo(alpha, mu);
        }
        table.mean = table.integrate_mean();
        table
    }

    /// Interpolates at a cosine in [0, 1].
    fn at(&self, mu: f64) -> [f64; 2] {
        let x = mu.clamp(0.0, 1.0).sqrt() * (ENTRIES - 1) as f64;
        let i = (x as usize).min(ENTRIES - 2);
        let f = x - i as f64;
        let between = |k: usize| self.albedo[i][k] * (1.0 - f) + self.albedo[i + 1][k] * f;
        [between(0), between(1)]
    }

    /// 2 * integral of E mu over [0, 1]. With mu = t^2 this is 4 * integral of E t^3. Gauss quadrature is exact in each cell of
    /// the table, where E is linear in t.
    fn integrate_mean(&self) -> [f64; 2] {
        let cell = 1.0 / (ENTRIES - 1) as f64;
        let gauss = [(-(0.6f64.sqrt()), 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.6f64.sqrt(), 5.0 / 18.0)];
        let mut sum = [0.0; 2];
        for i in 0..ENTRIES - 1 {
            for (x, weight) in gauss {
                let t = (i as f64 + 0.5 + 0.5 * x) * cell;
                let at = self.at(t * t);
                (0..2).for_each(|k| sum[k] += 4.0 * weight * cell * at[k] * t.powi(3));
            }
        }
        sum
    }
}

/// Fraction of the light from a direction with cosine `mu` that the lobe reflects, as a pair of [`Table`]: the mean of
/// F G2 / G1 over visible normals.
fn integrate_albedo(alpha: f64, mu: f64) -> [f64; 2] {
    let fresnel = |c: f64| {
        let grazing = (1.0 - c).clamp(0.0, 1.0).powi(5);
        [1.0 - grazing, grazing]
    };
    if alpha < MIRROR_ALPHA {
        return fresnel(mu);
    }
    const STEPS: usize = 64;
    let wo = DVec3::new((1.0 - mu * mu).sqrt(), 0.0, mu);
    let mut sum = [0.0; 2];
    for i in 0..STEPS * STEPS {
        let (u1, u2) = ((i / STEPS) as f64 + 0.5, (i % STEPS) as f64 + 0.5);
        let h = ggx::sample_normal(alpha, wo, u1 / STEPS as f64, u2 / STEPS as f64);
        let wi = 2.0 * wo.dot(h) * h - wo;
        if wi.z > 0.0 {
            let (own, other) = (ggx::lambda(alpha, wo), ggx::lambda(alpha, wi));
            let [a, b] = fresnel(wo.dot(h)).map(|f| f * (1.0 + own) / (1.0 + own + other));
            sum = [sum[0] + a, sum[1] + b];
        }
    }
    sum.map(|x| x / (STEPS * STEPS) as f64)
}

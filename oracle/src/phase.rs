//! Phase functions: value and sampling. The density of [`Phase::sample`] is the value itself.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use taugate::PhaseFunction;
use taugate::internals::generate::numbers::Pcg;

/// A phase function, with the cumulative distribution of its table if it has one.
pub struct Phase<'a> {
    function: &'a PhaseFunction,
    table: Option<Table>,
}

/// A density over the cosine that is linear between its nodes, and integrates to 1.
struct Table {
    cosines: Vec<f64>,
    density: Vec<f64>,
    /// The integral of the density up to each node.
    cumulative: Vec<f64>,
}

impl<'a> Phase<'a> {
    pub fn new(function: &'a PhaseFunction) -> Phase<'a> {
        let table = match function {
            PhaseFunction::Table { cosines, values } => Some(Table::new(cosines, values)),
            _ => None,
        };
        Phase { function, table }
    }

    /// Density per steradian of light that is scattered by an angle with this cosine, 1 for straight on. Also the density of
    /// [`Phase::sample`].
    pub fn density(&self, cos: f64) -> f64 {
        match *self.function {
            PhaseFunction::Isotropic => 1.0 / (4.0 * PI),
            PhaseFunction::Rayleigh => draine(0.0, 1.0, cos),
            PhaseFunction::HenyeyGreenstein { g } => draine(g, 0.0, cos),
            PhaseFunction::DoubleHenyeyGreenstein { g, weight } => {
                weight * draine(g[0], 0.0, cos) + (1.0 - weight) * draine(g[1], 0.0, cos)
            }
            PhaseFunction::HenyeyGreensteinDraine { g, g_draine, alpha, weight_draine } => {
                (1.0 - weight_draine) * draine(g, 0.0, cos) + weight_draine * draine(g_draine, alpha, cos)
            }
            PhaseFunction::Table { .. } => self.table.as_ref().map_or(0.0, |table| table.density(cos) / TAU),
        }
    }

    /// Samples the direction of travel after scattering. `direction` is the unit direction of travel before it. The function is
    /// symmetric, so both may also be reversed, as on sensor paths.
    pub fn sample(&self, direction: DVec3, pcg: &mut Pcg) -> DVec3 {
        let cos = self.sample_cosine(pcg).clamp(-1.0, 1.0);
        let sin = (1.0 - cos * cos).sqrt();
        let angle = TAU * pcg.uniform();
        let x = direction.any_orthonormal_vector();
        (direction * cos + (x * angle.cos() + direction.cross(x) * angle.sin()) * sin).normalize()
    }

    fn sample_cosine(&self, pcg: &mut Pcg) -> f64 {
        match *self.function {
            PhaseFunction::Isotropic => sample_draine(0.0, 0.0, pcg),
            PhaseFunction::Rayleigh => sample_draine(0.0, 1.0, pcg),
            PhaseFunction::HenyeyGreenstein { g } => sample_draine(g, 0.0, pcg),
            PhaseFunction::DoubleHenyeyGreenstein { g, weight } => {
                let lobe = usize::from(pcg.uniform() >= weight);
                sample_draine(g[lobe], 0.0, pcg)
            }
            PhaseFunction::HenyeyGreensteinDraine { g, g_draine, alpha, weight_draine } => {
                let (g, alpha) = if pcg.uniform() < weight_draine { (g_draine, alpha) } else { (g, 0.0) };
                sample_draine(g, alpha, pcg)
            }
            PhaseFunction::Table { .. } => self.table.as_ref().map_or(1.0, |table| table.sample(pcg.uniform())),
        }
    }
}

/// Draine's phase function; Henyey and Greenstein's for alpha = 0, Rayleigh's for g = 0 and alpha = 1.
fn draine(g: f64, alpha: f64, cos: f64) -> f64 {
    let henyey_greenstein = (1.0 - g * g) / (1.0 + g * g - 2.0 * g * cos).powf(1.5);
    let shape = (1.0 + alpha * cos * cos) / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0);
    henyey_greenstein * shape / (4.0 * PI)
}

/// A cosine with the density 2 pi [`draine`], by rejection from Henyey and Greenstein's function. At least a third of the
/// proposals is accepted, whatever alpha is.
fn sample_draine(g: f64, alpha: f64, pcg: &mut Pcg) -> f64 {
    loop {
        let u = 2.0 * pcg.uniform() - 1.0;
        let cos = if g.abs() < 1e-6 {
            u
        } else {
            let quotient = (1.0 - g * g) / (1.0 + g * u);
            (1.0 + g * g - quotient * quotient) / (2.0 * g)
        };
        if alpha == 0.0 || pcg.uniform() * (1.0 + alpha) < 1.0 + alpha * cos * cos {
            return cos;
        }
    }
}

impl Table {
    fn new(cosines: &[f64], values: &[f64]) -> Table {
        let mut cumulative = vec![0.0];
        for i in 1..cosines.len() {
            let area = (cosines[i] - cosines[i - 1]) * (values[i] + values[i - 1]) / 2.0;
            cumulative.push(cumulative[i - 1] + area);
        }
        let total = cumulative[cosines.len() - 1];
        cumulative.iter_mut().for_each(|c| *c /= total);
        Table { cosines: cosines.to_vec(), density: values.iter().map(|v| v / total).collect(), cumulative }
    }

    fn density(&self, cos: f64) -> f64 {
        let i = self.cosines.partition_point(|&c| c <= cos).clamp(1, self.cosines.len() - 1);
        let fraction = (cos - self.cosines[i - 1]) / (self.cosines[i] - self.cosines[i - 1]);
        self.density[i - 1] + fraction * (self.density[i] - self.density[i - 1])
    }

    /// The cosine up to which the density integrates to `u`, in [0, 1).
    fn sample(&self, u: f64) -> f64 {
        let i = self.cumulative.partition_point(|&c| c <= u).clamp(1, self.cosines.len() - 1);
        let (width, rest) = (self.cosines[i] - self.cosines[i - 1], u - self.cumulative[i - 1]);
        let (a, slope) = (self.density[i - 1], (self.density[i] - self.density[i - 1]) / width);
        // Solve a x + slope x^2 / 2 = rest in the form that does not cancel.
        let root = (a * a + 2.0 * slope * rest).max(0.0).sqrt();
        let x = if a + root > 0.0 { 2.0 * rest / (a + root) } else { 0.0 };
        self.cosines[i - 1] + x.min(width)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn functions() -> Vec<PhaseFunction> {
        vec![
            PhaseFunction::Isotropic,
            PhaseFunction::Rayleigh,
            PhaseFunction::HenyeyGreenstein { g: 0.8 },
            PhaseFunction::HenyeyGreenstein { g: -0.3 },
            PhaseFunction::DoubleHenyeyGreenstein { g: [0.9, -0.4], weight: 0.85 },
            PhaseFunction::HenyeyGreensteinDraine { g: 0.95, g_draine: 0.5, alpha: 20.0, weight_draine: 0.4 },
            PhaseFunction::Table { cosines: vec![-1.0, -0.5, 0.7, 1.0], values: vec![0.5, 0.0, 0.2, 6.0] },
        ]
    }

    /// Integral of f over the cosines from `a` to `b`, by Simpson's rule.
    fn integrate(a: f64, b: f64, f: impl Fn(f64) -> f64) -> f64 {
        const STEPS: usize = 20_000;
        let h = (b - a) / STEPS as f64;
        let weight = |i: usize| if i == 0 || i == STEPS { 1.0 } else { 2.0 + 2.0 * (i % 2) as f64 };
        (0..=STEPS).map(|i| weight(i) * f(a + h * i as f64)).sum::<f64>() * h / 3.0
    }

    #[test]
    fn every_function_integrates_to_one() {
        for function in functions() {
            let phase = Phase::new(&function);
            let total = TAU * integrate(-1.0, 1.0, |cos| phase.density(cos));
            assert!((total - 1.0).abs() < 2e-4, "{function:?}: {total}");
        }
    }

    #[test]
    fn mean_cosines_are_those_of_the_papers() {
        // The mean cosine of Draine's function: equation 8 of Jendersie and d'Eon 2023.
        let draine = |g: f64, alpha: f64| {
            g * (1.0 + alpha * (3.0 + 2.0 * g * g) / 5.0) / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0)
        };
        let means = [0.0, 0.0, 0.8, -0.3, 0.85 * 0.9 - 0.15 * 0.4, 0.6 * 0.95 + 0.4 * draine(0.5, 20.0)];
        for (function, mean) in functions().into_iter().zip(means) {
            let phase = Phase::new(&function);
            let found = TAU * integrate(-1.0, 1.0, |cos| cos * phase.density(cos));
            assert!((found - mean).abs() < 2e-4, "{function:?}: {found} and not {mean}");
        }
    }

    #[test]
    fn backscatter_of_known_functions() {
        let at = |function: &PhaseFunction, cos| Phase::new(function).density(cos);
        // By hand: 0.36 / 1.8^3 / (4 pi), and 6 / (16 pi) in both directions.
        assert!((at(&PhaseFunction::HenyeyGreenstein { g: 0.8 }, -1.0) - 0.004_912_2).abs() < 1e-6);
        assert!((at(&PhaseFunction::Rayleigh, -1.0) - 0.375 / PI).abs() < 1e-12);
        assert!((at(&PhaseFunction::Rayleigh, 0.0) - 0.1875 / PI).abs() < 1e-12);
    }

    /// Whether the counts of `samples` in bins of the cosine agree with the integrals of `density`, by chi squared.
    fn agree(cosines: &[f64], density: impl Fn(f64) -> f64) -> bool {
        const BINS: usize = 40;
        let mut counts = [0.0; BINS];
        cosines.iter().for_each(|cos| counts[(((cos + 1.0) / 2.0 * BINS as f64) as usize).min(BINS - 1)] += 1.0);
        let mut chi2 = 0.0;
        for (i, count) in counts.iter().enumerate() {
            let edge = |i: usize| 2.0 * i as f64 / BINS as f64 - 1.0;
            let expected = cosines.len() as f64 * TAU * integrate(edge(i), edge(i + 1), &density);
            chi2 += (count - expected).powi(2) / expected.max(1.0);
        }
        // The probability of a larger value is 1e-6 with 39 degrees of freedom.
        chi2 < 94.0
    }

    #[test]
    fn samples_have_their_density() {
        let mut pcg = Pcg::new(5);
        let direction = DVec3::new(1.0, -2.0, 0.5).normalize();
        for function in functions() {
            let phase = Phase::new(&function);
            let cosines: Vec<f64> = (0..100_000).map(|_| phase.sample(direction, &mut pcg).dot(direction)).collect();
            assert!(agree(&cosines, |cos| phase.density(cos)), "{function:?}");
            // A density that is 4 % too high forwards and 4 % too low backwards is rejected.
            assert!(!agree(&cosines, |cos| phase.density(cos) * (1.0 + 0.04 * cos.signum())), "{function:?}");
        }
    }

    #[test]
    fn directions_are_uniform_around_the_axis() {
        let phase = Phase::new(&PhaseFunction::HenyeyGreenstein { g: 0.5 });
        let mut pcg = Pcg::new(6);
        let sum: DVec3 = (0..100_000).map(|_| phase.sample(DVec3::X, &mut pcg)).sum();
        assert!((sum / 1e5 - DVec3::X * 0.5).length() < 0.01, "{sum}");
    }

    #[test]
    fn a_table_of_a_function_gives_this_function() {
        let hg = PhaseFunction::HenyeyGreenstein { g: 0.5 };
        let cosines: Vec<f64> = (0..=400).map(|i| f64::from(i) / 200.0 - 1.0).collect();
        // The scale of the values has no effect.
        let values = cosines.iter().map(|&cos| 7.0 * Phase::new(&hg).density(cos)).collect();
        let table = PhaseFunction::Table { cosines, values };
        let (exact, table) = (Phase::new(&hg), Phase::new(&table));
        for i in 0..1000 {
            let cos = f64::from(i) / 499.5 - 1.0;
            assert!((table.density(cos) / exact.density(cos) - 1.0).abs() < 1e-3, "cosine {cos}");
        }
        // Its samples invert the cumulative distribution.
        let nodes = table.table.as_ref().expect("a table");
        for i in 0..1000 {
            let u = f64::from(i) / 1000.0;
            let below = TAU * integrate(-1.0, nodes.sample(u), |cos| table.density(cos));
            assert!((below - u).abs() < 1e-5, "u {u}: {below}");
        }
    }
}

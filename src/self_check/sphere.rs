//! The gated integrating sphere in closed form: the radiance at a pinhole in the centre of a diffuse sphere (radius R, albedo
//! rho). A point light of intensity pi R^2 beside the pinhole lights the sphere.
//!
//! Light from any point of a Lambert sphere is distributed uniformly over the sphere. So the chords of a path are independent,
//! with density c / (2 R^2) on [0, 2R], and each reflection multiplies the light by rho. Let S(x) be the radiance that has
//! arrived by travel time 2R + x:
//!
//!   S(x) = sum over n >= 1 of rho^n F_{n-1}(x),   F_0 a step at 0, F_k the k-fold convolution of c / (2 R^2),
//!
//! With lengths in units of R, S solves the renewal equation
//!
//!   S(x) = rho + rho * integral over [0, 2] of S(x - c) c / 2 dc,   S(x) = 0 for x < 0.
//!
//! Differentiating it twice gives
//!
//!   S''(x) = rho / 2 * (S(x) - S(x - 2)) - rho S'(x - 2),
//!
//! Power series solve this equation exactly: first on [0, 2], then on [2, 4], and so on. S jumps by rho at 0 (the direct
//! return), and S' falls by rho^2 at 2 (no chord is longer than the diameter). Everywhere else, both are continuous.

/// Number of coefficients: for |y| <= 2, the last term is below 1e-30.
const TERMS: usize = 48;

/// Radiance that arrives with travel time in [lo, hi), in metres, after any number of reflections. The direct return arrives at
/// exactly 2R, so it counts if lo <= 2R < hi. The relative error is below 1e-9 for gates wider than 1e-4 R.
pub fn gated_radiance(radius: f64, albedo: f64, lo: f64, hi: f64) -> f64 {
    let scaled = |tau: f64| (tau - 2.0 * radius) / radius;
    let (a, b) = (scaled(lo), scaled(hi).max(scaled(lo)));
    if b == f64::INFINITY {
        let all = albedo / (1.0 - albedo);
        return if a <= 0.0 { all } else { all - arrived_before(albedo, a) };
    }
    arrived_before(albedo, b) - arrived_before(albedo, a)
}

/// Limit of S from below x: the radiance that arrives before travel time 2R + xR.
fn arrived_before(albedo: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let interval = (x / 2.0).floor() as usize;
    let mut now = first_interval(albedo);
    for m in 1..=interval {
        let start = value(&now, 2.0);
        let slope = derivative(&now, 2.0) - if m == 1 { albedo * albedo } else { 0.0 };
        now = series(albedo, start, slope, &now);
    }
    value(&now, x - 2.0 * interval as f64)
}

/// Coefficients of S on (0, 2]: S starts at rho with slope 0, and is 0 before.
fn first_interval(albedo: f64) -> [f64; TERMS] {
    series(albedo, albedo, 0.0, &[0.0; TERMS])
}

/// Coefficients a_n of the power series of S in y, the distance from the start of the interval. `b` are the coefficients of the
/// previous interval; `start` and `slope` are S and S' at the start.
fn series(albedo: f64, start: f64, slope: f64, b: &[f64; TERMS]) -> [f64; TERMS] {
    let mut a = [0.0; TERMS];
    a[0] = start;
    a[1] = slope;
    for n in 0..TERMS - 2 {
        let k = n as f64;
        a[n + 2] = albedo * (0.5 * (a[n] - b[n]) - (k + 1.0) * b[n + 1]) / ((k + 1.0) * (k + 2.0));
    }
    a
}

fn value(a: &[f64; TERMS], y: f64) -> f64 {
    a.iter().rev().fold(0.0, |sum, c| sum * y + c)
}

fn derivative(a: &[f64; TERMS], y: f64) -> f64 {
    a.iter().enumerate().skip(1).rev().fold(0.0, |sum, (n, c)| sum * y + n as f64 * c)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// F_k(x) for R = 1, from the binomial expansion of its Laplace transform ((1 - e^{-2s} (1 + 2s)) / (2 s^2))^k / s. It is
    /// exact, but its terms cancel badly for large k.
    fn convolution(k: u32, x: f64) -> f64 {
        let factorial = |n: u32| (1..=n).map(f64::from).product::<f64>();
        let choose = |n: u32, j: u32| factorial(n) / factorial(j) / factorial(n - j);
        let mut sum = 0.0;
        for j in 0..=k {
            let late = x - 2.0 * f64::from(j);
            if late < 0.0 {
                break;
            }
            let sign = if j % 2 == 0 { 1.0 } else { -1.0 };
            for i in 0..=j {
                let power = 2 * k - i;
                let term = late.powi(power as i32) / factorial(power);
                sum += sign * choose(k, j) * choose(j, i) * 2f64.powi(i as i32) * term;
            }
        }
        sum / 2f64.powi(k as i32)
    }

    #[test]
    fn known_values_agree() {
        let table = [
            (0.25, 0.5, 0.011795),
            (0.5, 1.0, 0.048106),
            (1.0, 1.5, 0.083529),
            (1.5, 2.0, 0.124199),
            (2.0, 3.0, 0.068301),
            (3.0, 4.0, 0.067886),
            (4.0, 6.0, 0.057531),
        ];
        for (a, b, expected) in table {
            let got = gated_radiance(1.0, 0.5, 2.0 + a, 2.0 + b);
            assert!((got - expected).abs() < 1e-6, "[{a}, {b}): {got} and not {expected}");
        }
    }

    #[test]
    fn sums_of_convolutions_agree() {
        for albedo in [0.2, 0.5, 0.8] {
            for x in [0.3, 1.0, 1.9, 2.1, 3.7, 4.4, 6.5] {
                let sum: f64 = (0..14).map(|k| f64::powi(albedo, k + 1) * convolution(k as u32, x)).sum();
                let got = gated_radiance(1.0, albedo, 0.0, 2.0 + x);
                assert!((got / sum - 1.0).abs() < 1e-6, "albedo {albedo}, x {x}: {got} {sum}");
            }
        }
    }

    #[test]
    fn edges() {
        // Gates are half-open, so the direct return belongs to the gate that starts at its time.
        assert_eq!(gated_radiance(1.0, 0.5, 1.0, 2.0), 0.0);
        assert!((gated_radiance(1.0, 0.5, 2.0, 2.0 + 1e-9) - 0.5).abs() < 1e-9);
        assert_eq!(gated_radiance(1.0, 0.5, 3.0, 3.0), 0.0);
        assert_eq!(gated_radiance(1.0, 0.5, 4.0, 3.0), 0.0);
        assert!((gated_radiance(1.0, 0.5, 0.0, f64::INFINITY) - 1.0).abs() < 1e-12);
        assert!((gated_radiance(1.0, 0.5, 0.0, 60.0) - 1.0).abs() < 1e-9);
        // The radiance does not depend on the scale.
        let (small, large) = (gated_radiance(1.0, 0.5, 2.5, 3.0), gated_radiance(100.0, 0.5, 250.0, 300.0));
        assert!((small / large - 1.0).abs() < 1e-9);
        // A thin gate measures the density of S, which is rho^2 c / 2 plus higher orders of rho.
        let thin = gated_radiance(1.0, 0.01, 3.0, 3.0 + 1e-4) / 1e-4;
        assert!((thin / (1e-4 * 0.5) - 1.0).abs() < 5e-3, "{thin}");
    }
}

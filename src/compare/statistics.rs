//! Tail probabilities of the normal and Student's t distributions, for tests that tell noise from error.

/// P(Z > z) of the standard normal distribution, z >= 0; relative error below 1e-10 down to 1e-300.
pub fn normal_tail(z: f64) -> f64 {
    let x = 0.5 * z * z;
    if x < 1.5 {
        // Series of the incomplete gamma function P(1/2, x).
        let (mut term, mut sum, mut n) = (2.0, 2.0, 0.5);
        while term > 1e-17 * sum {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        return 0.5 - 0.5 * sum * (-x).exp() * (x / std::f64::consts::PI).sqrt();
    }
    // Continued fraction of Q(1/2, x), by Lentz's method.
    let mut b = x + 0.5;
    let (mut c, mut d) = (1e300, 1.0 / b);
    let mut h = d;
    for i in 1..500 {
        let a = -f64::from(i) * (f64::from(i) - 0.5);
        b += 2.0;
        d = 1.0 / (a * d + b);
        c = b + a / c;
        h *= c * d;
        if (c * d - 1.0).abs() < 1e-15 {
            break;
        }
    }
    0.5 * h * (-x).exp() * (x / std::f64::consts::PI).sqrt()
}

/// The largest result of [`normal_quantile`]; its tail probability is about 1e-300.
pub const MAX_Z: f64 = 37.0;

/// The z >= 0 with P(Z > z) = `tail`, for 0 < tail <= 1/2; at most [`MAX_Z`].
pub fn normal_quantile(tail: f64) -> f64 {
    let (mut lo, mut hi) = (0.0, MAX_Z);
    for _ in 0..60 {
        let mid = 0.5 * (lo + hi);
        if normal_tail(mid) > tail { lo = mid } else { hi = mid }
    }
    0.5 * (lo + hi)
}

/// P(T > t) of Student's t distribution with `nu` > 0 degrees of freedom, t >= 0.
pub fn student_tail(t: f64, nu: f64) -> f64 {
    if t.is_infinite() {
        return 0.0;
    }
    0.5 * incomplete_beta(0.5 * nu, 0.5, nu / (nu + t * t))
}

/// The standard normal value with the same tail probability and sign as `t` with `nu` degrees of freedom.
pub fn normal_score(t: f64, nu: f64) -> f64 {
    normal_quantile(student_tail(t.abs(), nu).max(f64::MIN_POSITIVE)).copysign(t)
}

/// The |z| above which one of `tests` independent standard normal values is significant at `level` (Sidak correction).
pub fn sidak_threshold(level: f64, tests: usize) -> f64 {
    let each = -((1.0 - level).ln() / tests.max(1) as f64).exp_m1();
    normal_quantile(0.5 * each)
}

/// Regularised incomplete beta function I_x(a, b), by its continued fraction (Numerical Recipes 6.4).
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return x.clamp(0.0, 1.0);
    }
    let front = (ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * (-x).ln_1p()).exp();
    if x < (a + 1.0) / (a + b + 2.0) {
        front * beta_fraction(a, b, x) / a
    } else {
        1.0 - front * beta_fraction(b, a, 1.0 - x) / b
    }
}

fn beta_fraction(a: f64, b: f64, x: f64) -> f64 {
    let nonzero = |v: f64| if v.abs() < 1e-300 { 1e-300 } else { v };
    let (mut c, mut d) = (1.0, 1.0 / nonzero(1.0 - (a + b) * x / (a + 1.0)));
    let mut h = d;
    for i in 1..1000 {
        let m = f64::from(i);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        for term in [even, odd] {
            d = 1.0 / nonzero(1.0 + term * d);
            c = nonzero(1.0 + term / c);
            h *= c * d;
        }
        if (c * d - 1.0).abs() < 1e-15 {
            break;
        }
    }
    h
}

/// Logarithm of the gamma function for x > 0, with an error of about 1e-10: Stirling's series after shifting the argument above
/// 10.
pub fn ln_gamma(x: f64) -> f64 {
    let (mut shift, mut z) = (0.0, x);
    while z < 10.0 {
        shift += z.ln();
        z += 1.0;
    }
    let series = 1.0 / (12.0 * z) - 1.0 / (360.0 * z.powi(3)) + 1.0 / (1260.0 * z.powi(5));
    (z - 0.5) * z.ln() - z + 0.5 * (2.0 * std::f64::consts::PI).ln() + series - shift
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_by_table() {
        for (z, p) in [(0.0, 0.5), (1.0, 0.158_655_254), (1.959_964, 0.025), (3.290_527, 5e-4), (6.0, 9.865_876e-10)] {
            assert!((normal_tail(z) / p - 1.0).abs() < 1e-5, "{z}: {}", normal_tail(z));
            assert!(z == 0.0 || (normal_quantile(p) / z - 1.0).abs() < 1e-5);
        }
        // 97.5 % and 99.95 % quantiles of t.
        for (nu, t, p) in
            [(1.0, 12.706_2, 0.025), (10.0, 2.228_139, 0.025), (30.0, 3.645_959, 5e-4), (5.0, 6.868_827, 5e-4)]
        {
            assert!((student_tail(t, nu) / p - 1.0).abs() < 1e-4, "{nu} {t}: {}", student_tail(t, nu));
        }
        assert!((normal_score(-2.228_139, 10.0) + 1.959_964).abs() < 1e-4);
        assert!((sidak_threshold(1e-3, 1) - 3.290_527).abs() < 1e-5);
        assert!(sidak_threshold(1e-3, 100) > 4.3 && sidak_threshold(1e-3, 100) < 4.5);
        assert_eq!((normal_score(1e9, 1e3), student_tail(f64::INFINITY, 3.0)), (MAX_Z, 0.0));
    }
}

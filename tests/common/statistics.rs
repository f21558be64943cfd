//! Chi-square tests with a given significance level, corrected for the number of tests.

use taugate::internals::compare::statistics::ln_gamma;

/// Significance level of a family of statistical tests.
pub const SIGNIFICANCE: f64 = 1e-3;

/// Significance level of each of `tests` tests, such that the whole family has the level [`SIGNIFICANCE`] (Sidak).
pub fn level(tests: usize) -> f64 {
    1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / tests as f64)
}

/// p-value of Pearson's chi-square test of `observed` counts against `expected` counts. Both must have the same sum.
///
/// Cells with an expected count below 5 are pooled into one cell. Returns 0 if the pool expects fewer than 5 counts and
/// observes over 12 more than it expects. Returns 1 if fewer than two cells remain.
pub fn chi_square(observed: &[f64], expected: &[f64]) -> f64 {
    let (mut statistic, mut cells) = (0.0, 0);
    let mut pool = [0.0, 0.0];
    let mut add = |o: f64, e: f64| {
        statistic += (o - e) * (o - e) / e;
        cells += 1;
    };
    for (&o, &e) in observed.iter().zip(expected) {
        if e >= 5.0 {
            add(o, e);
        } else {
            pool[0] += o;
            pool[1] += e;
        }
    }
    if pool[1] >= 5.0 {
        add(pool[0], pool[1]);
    } else if pool[0] > 0.0 && pool[0] > pool[1] + 12.0 {
        // The pool is too small for a cell. An excess of more than 12 has p < 1e-5 (Poisson with a mean below 5).
        return 0.0;
    }
    if cells < 2 { 1.0 } else { upper_gamma(0.5 * f64::from(cells - 1), 0.5 * statistic) }
}

/// Regularised upper incomplete gamma function Q(a, x). A series for x < a + 1, a continued fraction for larger x
/// (Numerical Recipes, section 6.2).
fn upper_gamma(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let scale = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > sum * 1e-15 {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        return 1.0 - scale * sum;
    }
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (1e300, 1.0 / b);
    let mut h = d;
    for i in 1..10_000 {
        let an = -f64::from(i) * (f64::from(i) - a);
        b += 2.0;
        d = 1.0 / (an * d + b);
        c = b + an / c;
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-14 {
            break;
        }
    }
    scale * h
}

#[test]
fn chi_square_by_table() {
    // Quantiles at 95 % and 99.9 %, from a table.
    for (k, x, p) in [(1.0, 3.841, 0.05), (10.0, 18.307, 0.05), (100.0, 124.342, 0.05), (100.0, 149.449, 0.001)] {
        let got = upper_gamma(k / 2.0, x / 2.0);
        assert!((got / p - 1.0).abs() < 1e-3, "{k} {x}: {got}");
    }
    assert!(chi_square(&[100.0, 100.0], &[100.0, 100.0]) > 0.999);
    assert_eq!(chi_square(&[150.0, 50.0, 20.0], &[110.0, 110.0, 1e-9]), 0.0);
}

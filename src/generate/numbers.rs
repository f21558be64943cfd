//! Arithmetic with the same bits on every platform: a random number generator, and trigonometry from additions and
//! multiplications.

use std::f64::consts::FRAC_PI_2;

/// The PCG-XSH-RR 64/32 generator (O'Neill 2014), one stream.
#[derive(Debug, Clone)]
pub struct Pcg {
    state: u64,
}

impl Pcg {
    pub fn new(seed: u64) -> Pcg {
        let mut pcg = Pcg { state: seed.wrapping_add(1_442_695_040_888_963_407) };
        pcg.next_u32();
        pcg
    }

    #[inline]
    pub fn next_u32(&mut self) -> u32 {
        let old = self.state;
        self.state = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let xorshifted = (((old >> 18) ^ old) >> 27) as u32;
        xorshifted.rotate_right((old >> 59) as u32)
    }

    /// Uniform in [0, 1) with 53 random bits.
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        let high = u64::from(self.next_u32()) << 32;
        ((high | u64::from(self.next_u32())) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [lo, hi).
    #[inline]
    pub fn range(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.uniform()
    }

    /// Uniform in 0..n, n >= 1.
    #[inline]
    pub fn below(&mut self, n: usize) -> usize {
        (self.uniform() * n as f64) as usize
    }
}

/// Sine and cosine of an angle in radians, |angle| < 1e6. The error is about 1e-16 times the larger of 1 and |angle|. The functions
/// of the standard library differ between platforms.
pub fn sin_cos(angle: f64) -> (f64, f64) {
    let quarter = (angle / FRAC_PI_2).round();
    let x = angle - quarter * FRAC_PI_2;
    let x2 = x * x;
    // Taylor series, by Horner's rule from the smallest term; |x| <= pi / 4.
    let (mut sin, mut cos) = (1.0, 1.0);
    for n in (1..=9).rev() {
        let n = f64::from(n);
        sin = 1.0 - sin * x2 / (2.0 * n * (2.0 * n + 1.0));
        cos = 1.0 - cos * x2 / (2.0 * n * (2.0 * n - 1.0));
    }
    let sin = sin * x;
    match (quarter as i64).rem_euclid(4) {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sin_cos_agrees_with_the_standard_library() {
        for i in -4000..4000 {
            let angle = f64::from(i) * 0.01;
            let (sin, cos) = sin_cos(angle);
            assert!((sin - angle.sin()).abs() < 1e-14 && (cos - angle.cos()).abs() < 1e-14, "angle {angle}");
        }
    }

    #[test]
    fn pcg_is_uniform_and_repeatable() {
        let mut a = Pcg::new(7);
        let mut b = Pcg::new(7);
        let mean = (0..100_000).map(|_| a.uniform()).sum::<f64>() / 1e5;
        assert!((mean - 0.5).abs() < 0.005, "mean {mean}");
        (0..100_000).for_each(|_| {
            b.uniform();
        });
        assert_eq!(a.next_u32(), b.next_u32());
    }
}

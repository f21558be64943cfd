//! Weighted moments as sums, which merge by addition.
//!
//! Plain f64 sums would lose the variance of channels that hardly vary. A relative deviation of 1e-6 contributes 1e-12 of the sum
//! of squares, and the rounding of 10^5 additions makes about 1e-14 of that sum uncertain. So each sum carries its own rounding
//! errors.

/// A sum that keeps the rounding error of each addition (Sum2 of Ogita, Rump and Oishi 2005, "Accurate Sum and Dot Product").
/// After n additions of values with one sign, the relative error of `high + low` is about (2^-53 n)^2, in any order.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Sum {
    high: f64,
    low: f64,
}

impl Sum {
    fn add(&mut self, x: f64) {
        let sum = self.high + x;
        // Knuth's TwoSum: the exact rounding error of that addition.
        let part = sum - self.high;
        self.low += (self.high - (sum - part)) + (x - part);
        self.high = sum;
    }

    fn merge(&mut self, other: Sum) {
        self.add(other.high);
        self.low += other.low;
    }
}

/// Sums of w x and w x^2 over the iterations, where x_i is the mean over the w_i samples of iteration i. The caller keeps the sum
/// of w, which is the same for all channels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Moments {
    wx: Sum,
    wxx: Sum,
}

impl Moments {
    /// Adds an iteration with mean `x` over `weight` samples. The products are exact for an f32 `x` and a `weight` of at most 5
    /// significant bits.
    pub fn add(&mut self, x: f64, weight: f64) {
        let wx = weight * x;
        self.wx.add(wx);
        self.wxx.add(wx * x);
    }

    /// Adds the sums of other iterations.
    pub fn merge(&mut self, other: &Moments) {
        self.wx.merge(other.wx);
        self.wxx.merge(other.wxx);
    }

    /// The sums of w x and of w x^2, each as its value and its rounding error.
    pub(super) fn to_array(self) -> [f64; 4] {
        [self.wx.high, self.wx.low, self.wxx.high, self.wxx.low]
    }

    /// The moments with the sums of [`Moments::to_array`].
    pub(super) fn from_array([x, x_error, xx, xx_error]: [f64; 4]) -> Moments {
        Moments { wx: Sum { high: x, low: x_error }, wxx: Sum { high: xx, low: xx_error } }
    }

    /// The mean over all samples; `weights` is their number.
    pub fn mean(&self, weights: f64) -> f64 {
        (self.wx.high + self.wx.low) / weights
    }

    /// Sum of w (x - mean)^2, at least 0; `weights` is the number W of samples. Computed as (W sum w x^2 - (sum w x)^2) / W with
    /// products in twice the precision of f64. The rounding error is below 1e-20 of the sum of squares for 10^5 iterations, and 0
    /// if all x are equal.
    pub fn spread(&self, weights: f64) -> f64 {
        let (squares, squares_error) = product(weights, self.wxx.high);
        let (square, square_error) = product(self.wx.high, self.wx.high);
        let squares_low = squares_error + weights * self.wxx.low;
        let square_low = square_error + (2.0 * self.wx.high + self.wx.low) * self.wx.low;
        (((squares - square) + (squares_low - square_low)) / weights).max(0.0)
    }
}

/// The rounded product, and its exact rounding error.
fn product(a: f64, b: f64) -> (f64, f64) {
    let rounded = a * b;
    (rounded, a.mul_add(b, -rounded))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: &[(f64, f64)]) -> (Moments, f64) {
        let mut moments = Moments::default();
        values.iter().for_each(|&(x, weight)| moments.add(x, weight));
        (moments, values.iter().map(|v| v.1).sum())
    }

    #[test]
    fn values_that_are_equal_have_no_spread() {
        for x in [0.1_f32, 1.0 / 3.0, 3.4e38, 1.2e-38, 7e-45] {
            let values: Vec<_> = (0..30_000).map(|i| (f64::from(x), f64::from(1 + i % 16))).collect();
            let (moments, weights) = of(&values);
            assert_eq!((moments.mean(weights), moments.spread(weights)), (x.into(), 0.0), "{x}");
        }
    }

    #[test]
    fn the_last_digit_of_f32_is_spread() {
        // 1 and the next f32, each with half of the weight, have a spread of W (d / 2)^2.
        let d = f64::from(f32::EPSILON);
        let values: Vec<_> = (0..100_000).map(|i| (1.0 + d * f64::from(i % 2), 8.0)).collect();
        let (moments, weights) = of(&values);
        assert!((moments.spread(weights) / (weights * 0.25 * d * d) - 1.0).abs() < 1e-6, "{}", moments.spread(weights));
        // Plain sums must fail this test.
        let plain = values.iter().fold([0.0; 2], |s, &(x, w)| [s[0] + w * x, s[1] + w * x * x]);
        let spread = plain[1] - plain[0] * plain[0] / weights;
        assert!((spread / (weights * 0.25 * d * d) - 1.0).abs() > 0.1, "{spread}");
    }
}

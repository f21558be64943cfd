//! The film: per-pixel mean and variance over iterations, in f64.

pub struct Film {
    pub sum: Vec<f64>,
    pub weight: f64,
}
impl Film {
    pub fn new(w: usize, h: usize) -> Film {
        Film { sum: vec![0.0; w * h * 3], weight: 0.0 }
    }
    pub fn add(&mut self, rgb: &[f32], samples: u32) {
        for (s, x) in self.sum.iter_mut().zip(rgb) {
            *s += f64::from(*x) * f64::from(samples);
        }
        self.weight += f64::from(samples);
    }
    pub fn mean(&self) -> Vec<f32> {
        self.sum.iter().map(|s| (s / self.weight) as f32).collect()
    }
}

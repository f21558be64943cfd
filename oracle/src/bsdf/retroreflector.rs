//! A lobe around the direction that light comes from: a GGX reflection with one of its two directions mirrored about the normal
//! (Portsmouth et al. 2026).

use std::f64::consts::SQRT_2;

use glam::DVec3;

use super::super::ggx;

#[derive(Debug, Clone)]
pub struct Retroreflector {
    pub share: f64,
    alpha: f64,
}

impl Retroreflector {
    pub fn new(source: taugate::Retroreflector) -> Retroreflector {
        // A facet tilted by t turns the light by 2 t. The tails of GGX fall to a half where (1 + (tan t / alpha)^2)^2 = 2.
        let tilt = f64::from(source.angle).to_radians() / 2.0;
        Retroreflector { share: source.share.into(), alpha: tilt.tan() / (SQRT_2 - 1.0).sqrt() }
    }

    /// The lobe per steradian, without the cosine.
    pub fn lobe(&self, wi: DVec3, wo: DVec3) -> f64 {
        ggx::lobe(self.alpha, mirrored(wi), wo)
    }

    /// Density per steradian with which [`Retroreflector::sample`] draws `wi`.
    pub fn pdf(&self, wi: DVec3, wo: DVec3) -> f64 {
        ggx::pdf(self.alpha, mirrored(wi), wo)
    }

    /// Draws a direction from two uniform numbers. It may lie below the surface.
    pub fn sample(&self, wo: DVec3, u1: f64, u2: f64) -> DVec3 {
        let h = ggx::sample_normal(self.alpha, wo, u1, u2);
        mirrored(2.0 * wo.dot(h) * h - wo)
    }
}

fn mirrored(w: DVec3) -> DVec3 {
    DVec3::new(-w.x, -w.y, w.z)
}

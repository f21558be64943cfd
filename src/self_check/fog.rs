//! Light in an infinite homogeneous medium in closed form, or as a smooth integral.
//!
//! Lengths are metres of optical path; the medium has the index of refraction 1. A gate [lo, hi) is an interval of the travel
//! time from the light to the sensor. In all functions sigma_t = sigma_s + sigma_a, per metre.

use std::f64::consts::PI;

use glam::DVec3;

/// Scattering and extinction coefficients of a medium, per metre.
#[derive(Debug, Clone, Copy)]
pub struct Coefficients {
    pub sigma_s: f64,
    pub sigma_t: f64,
}

/// The radiance (W / (m^2 sr)) that a pinhole at the origin receives from the unit direction `w` after one scattering, in the gate
/// [lo, hi). An isotropic point light of intensity `intensity` (W / sr) is at `light`. `phase` is the phase function (1 / sr) of
/// the cosine between the directions of travel before and after scattering.
///
/// With s0 = w . light, h the distance of the light from the line of the ray, and tan(psi) = (tau - s0) / h,
///
///   L = (2 sigma_s I / h) exp(-sigma_t s0) * integral over psi of phase(cos 2 psi) exp(-sigma_t h tan psi).
///
/// For h = 0 the limit is L = sigma_s I phase(-1) * integral of exp(-sigma_t (2 s - s0)) / (s - s0)^2. Here s > s0 is the distance
/// along the ray, and the gate contains 2 s - s0. If the light is on the ray and the gate contains s0, L is infinite. The relative
/// error of the quadrature is below 1e-9 for smooth phase functions and sigma_t (hi - lo) < 10.
///
/// By reciprocity, the same number is the fluence (W / m^2) at the pinhole if a beam of power `intensity` (W) starts at `light`
/// and its direction is -w.
pub fn gated_single_scattering(
    medium: Coefficients,
    phase: impl Fn(f64) -> f64,
    intensity: f64,
    light: DVec3,
    w: DVec3,
    [lo, hi]: [f64; 2],
) -> f64 {
    let Coefficients { sigma_s, sigma_t } = medium;
    let s0 = w.dot(light);
    let h = (light - w * s0).length();
    let (lo, hi) = (lo.max(light.length()), hi);
    if hi <= lo {
        return 0.0;
    }
    if h <= 1e-9 * light.length() {
        if lo <= s0 {
            return f64::INFINITY;
        }
        // In q = 1 / (s - s0), dq = -ds / (s - s0)^2.
        let q = |tau: f64| 2.0 / (tau - s0);
        let decay = |q: f64| (-sigma_t * (2.0 / q + s0)).exp();
        return sigma_s * intensity * phase(-1.0) * integrate(q(hi), q(lo), decay);
    }
    let psi = |tau: f64| ((tau - s0) / h).atan();
    let density = |psi: f64| phase((2.0 * psi).cos()) * (-sigma_t * h * psi.tan()).exp();
    2.0 * sigma_s * intensity / h * (-sigma_t * s0).exp() * integrate(psi(lo), psi(hi), density)
}

/// Henyey and Greenstein's phase function (1 / sr) with the mean cosine `g`, of the cosine `cos` between the directions of travel
/// before and after scattering.
pub fn henyey_greenstein(g: f64, cos: f64) -> f64 {
    (1.0 - g * g) / (1.0 + g * g - 2.0 * g * cos).powf(1.5) / (4.0 * PI)
}

/// Integral of a smooth function from `a` to `b`, by Gauss quadrature in 64 equal parts with 5 points each.
pub fn integrate(a: f64, b: f64, f: impl Fn(f64) -> f64) -> f64 {
    const PARTS: u32 = 64;
    let (p, q) = ((5.0 - 2.0 * (10.0f64 / 7.0).sqrt()).sqrt() / 3.0, (5.0 + 2.0 * (10.0f64 / 7.0).sqrt()).sqrt() / 3.0);
    let (wp, wq) = ((322.0 + 13.0 * 70f64.sqrt()) / 1800.0, (322.0 - 13.0 * 70f64.sqrt()) / 1800.0);
    let nodes = [(0.0, 64.0 / 225.0), (p, wp), (-p, wp), (q, wq), (-q, wq)];
    let part = (b - a) / f64::from(PARTS);
    let sum = |i: u32| -> f64 {
        let middle = a + part * (f64::from(i) + 0.5);
        nodes.iter().map(|(x, weight)| weight * f(middle + 0.5 * part * x)).sum()
    };
    part * (0..PARTS).map(sum).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOG: Coefficients = Coefficients { sigma_s: 0.04, sigma_t: 0.05 };

    fn isotropic(_: f64) -> f64 {
        0.25 / PI
    }

    /// Sum over points of the ray whose travel time is in the gate, without any change of variables.
    fn by_brute_force(phase: impl Fn(f64) -> f64, light: DVec3, w: DVec3, gate: [f64; 2]) -> f64 {
        const STEPS: u32 = 1_000_000;
        let length = gate[1];
        let mut sum = 0.0;
        for i in 0..STEPS {
            let s = (f64::from(i) + 0.5) / f64::from(STEPS) * length;
            let to = w * s - light;
            let r = to.length();
            if (gate[0]..gate[1]).contains(&(s + r)) {
                sum += phase((to / r).dot(-w)) * (-FOG.sigma_t * (s + r)).exp() / (r * r);
            }
        }
        FOG.sigma_s * 3.0 * sum * length / f64::from(STEPS)
    }

    #[test]
    fn single_scattering_is_the_sum_over_the_ray() {
        let phase = |cos| henyey_greenstein(0.6, cos);
        let w = DVec3::new(0.0, 0.6, 0.8);
        for light in [DVec3::new(2.0, 1.0, 3.0), DVec3::new(-1.0, 0.0, -2.0), DVec3::ZERO, w * -2.0, w * 3.0] {
            for gate in [[5.0, 6.0], [8.0, 20.0]] {
                let exact = gated_single_scattering(FOG, phase, 3.0, light, w, gate);
                let sum = by_brute_force(phase, light, w, gate);
                assert!((exact / sum - 1.0).abs() < 1e-4, "light {light}, gate {gate:?}: {exact} {sum}");
                let thicker = Coefficients { sigma_s: 1.03 * FOG.sigma_s, ..FOG };
                let wrong = gated_single_scattering(thicker, phase, 3.0, light, w, gate);
                assert!((wrong / sum - 1.0).abs() > 0.02);
            }
        }
    }

    #[test]
    fn edges_of_single_scattering() {
        let value = |light, gate| gated_single_scattering(FOG, isotropic, 1.0, light, DVec3::Z, gate);
        // Light and sensor at one place: the limit h = 0.
        let collocated = value(DVec3::ZERO, [40.0, 50.0]);
        assert!((collocated / 3.45304e-6 - 1.0).abs() < 2e-6, "{collocated}");
        // Nothing arrives before the time of the straight line, or in an empty gate. The light of adjacent gates adds up.
        assert_eq!(value(DVec3::X * 3.0, [1.0, 3.0]), 0.0);
        assert_eq!(value(DVec3::X, [5.0, 5.0]), 0.0);
        let light = DVec3::new(1.0, 0.0, 2.0);
        let (early, late) = (value(light, [0.0, 4.0]), value(light, [4.0, 9.0]));
        assert!(((early + late) / value(light, [0.0, 9.0]) - 1.0).abs() < 1e-9);
        assert_eq!(value(DVec3::Z * 2.0, [0.0, 3.0]), f64::INFINITY);
        // A light that is nearly on the ray is close to the limit.
        let near = value(DVec3::new(1e-6, 0.0, -2.0), [5.0, 6.0]);
        assert!((near / value(DVec3::Z * -2.0, [5.0, 6.0]) - 1.0).abs() < 1e-5);
    }
}

//! Light that a pulse leaves in an infinite homogeneous medium, in closed form.
//!
//! Lengths are metres of optical path; the medium has the index of refraction 1.

use std::f64::consts::PI;

use taugate::internals::self_check::fog::Coefficients;

/// The fluence (per m^2, and per metre of travel time `tau`) of light that was scattered once, at distance `r` from an isotropic
/// point light that emits a pulse of unit energy at time 0. The phase function is isotropic. 0 for tau <= r.
///
///   sigma_s exp(-sigma_t tau) / (4 pi r tau) ln((tau + r) / (tau - r))
pub fn first_scatter_fluence(medium: Coefficients, r: f64, tau: f64) -> f64 {
    if tau <= r {
        return 0.0;
    }
    medium.sigma_s * (-medium.sigma_t * tau).exp() / (4.0 * PI * r * tau) * ((tau + r) / (tau - r)).ln()
}

/// The mean squared distance (m^2) from the light at time `tau` (m), over all light of a pulse from a point, without absorption.
/// The phase function may be any with the mean cosine `g`.
///
///   (2 / s^2) (s tau - 1 + exp(-s tau)),   s = sigma_s (1 - g)
pub fn second_moment(sigma_s: f64, g: f64, tau: f64) -> f64 {
    let x = sigma_s * (1.0 - g) * tau;
    if x < 1e-3 {
        // The first terms of the series: the closed form would lose digits by cancellation.
        return tau * tau * (1.0 - x / 3.0 + x * x / 12.0);
    }
    2.0 * tau * tau * (x - 1.0 + (-x).exp()) / (x * x)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use taugate::internals::self_check::fog::{gated_single_scattering, integrate};

    use super::*;

    const FOG: Coefficients = Coefficients { sigma_s: 0.04, sigma_t: 0.05 };

    fn isotropic(_: f64) -> f64 {
        0.25 / PI
    }

    #[test]
    fn first_scatter_fluence_is_the_mean_of_single_scattering_over_directions() {
        // Integrate the gated radiance over directions at angle theta to the light: 2 pi sin theta.
        let (r, gate) = (2.0, [3.0, 3.5]);
        let radiance = |cos: f64| {
            let w = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
            gated_single_scattering(FOG, isotropic, 0.25 / PI, DVec3::Z * r, w, gate)
        };
        let fluence = 2.0 * PI * integrate(-1.0, 1.0, radiance);
        let exact = integrate(gate[0], gate[1], |tau| first_scatter_fluence(FOG, r, tau));
        assert!((fluence / exact - 1.0).abs() < 1e-5, "{fluence} {exact}");
        assert_eq!(first_scatter_fluence(FOG, 2.0, 2.0), 0.0);
    }

    #[test]
    fn second_moment_of_few_and_of_many_collisions() {
        // Without collisions light moves straight; with many the result is 6 D tau (diffusion), D = 1 / (3 sigma_s (1 - g)).
        assert!((second_moment(1e-9, 0.0, 5.0) - 25.0).abs() < 1e-6);
        assert!((second_moment(2.0, 0.5, 1e6) / 2e6 - 1.0).abs() < 1e-5);
        let (below, above) = (second_moment(0.999_999e-3, 0.0, 1.0), second_moment(1.000_001e-3, 0.0, 1.0));
        assert!((below / above - 1.0).abs() < 1e-8);
    }
}

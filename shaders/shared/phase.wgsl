// Phase functions: the directions in which a medium scatters. A cosine is that between the directions in which light travels before
// and after scattering, 1 for light that goes straight on.
#import medium

// Two Henyey-Greenstein lobes; Rayleigh scattering.
const PHASE_LOBES: u32 = 0u;
const PHASE_RAYLEIGH: u32 = 1u;

// Density per solid angle of the Henyey-Greenstein lobe with the mean cosine g. `cosine`: between the directions in which light
// travels before and after.
fn henyey_greenstein(g: f32, cosine: f32) -> f32 {
    let x = 1.0 + g * g - 2.0 * g * cosine;
    return (1.0 - g * g) / (4.0 * PI * x * sqrt(x));
}

// Phase function: density per solid angle of scattering by the angle with this cosine. Its integral over the sphere is 1.
fn phase_value(m: Medium, cosine: f32) -> f32 {
    if (m.phase == PHASE_RAYLEIGH) {
        return 3.0 / (16.0 * PI) * (1.0 + cosine * cosine);
    }
    return mix(henyey_greenstein(m.g, cosine), henyey_greenstein(m.g2, cosine), m.share);
}

// Samples the cosine of the scattering angle, with the density of `phase_value`. `u`: one number for the angle, one for the lobe.
fn sample_phase_cosine(m: Medium, u: vec2<f32>) -> f32 {
    if (m.phase == PHASE_RAYLEIGH) {
        // The root of the cubic equation of the cumulative distribution.
        let q = 4.0 * u.x - 2.0;
        let root = pow(abs(q) + sqrt(q * q + 1.0), 1.0 / 3.0);
        return clamp(sign(q) * (root - 1.0 / root), -1.0, 1.0);
    }
    let g = select(m.g, m.g2, u.y < m.share);
    if (abs(g) < 1e-3) {
        // Nearly isotropic: the first terms of the series in g.
        let c = 2.0 * u.x - 1.0;
        return clamp(c + 1.5 * g * (1.0 - c * c), -1.0, 1.0);
    }
    let x = (1.0 - g * g) / (1.0 - g + 2.0 * g * u.x);
    return clamp((1.0 + g * g - x * x) / (2.0 * g), -1.0, 1.0);
}

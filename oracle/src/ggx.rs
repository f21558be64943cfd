//! The GGX microfacet distribution with height-correlated Smith masking, and sampling of its visible normals (Heitz 2018). In the
//! local frame, z is the surface normal. All directions point away from the surface.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

/// The distribution D(h), per steradian of half vectors.
pub fn distribution(alpha: f64, h: DVec3) -> f64 {
    let a2 = alpha * alpha;
    // sin^2 from x and y instead of 1 - cos^2 avoids cancellation at small alpha.
    let t = (h.x * h.x + h.y * h.y) + a2 * h.z * h.z;
    a2 / (PI * t * t)
}

/// Smith's auxiliary function Lambda of a direction with z > 0.
pub fn lambda(alpha: f64, w: DVec3) -> f64 {
    let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z);
    ((1.0 + alpha * alpha * tan2).sqrt() - 1.0) / 2.0
}

/// The lobe D G2 / (4 cos_i cos_o), without Fresnel factor and without cosine; 0 below the horizon.
pub fn lobe(alpha: f64, wi: DVec3, wo: DVec3) -> f64 {
    if wi.z <= 0.0 || wo.z <= 0.0 {
        return 0.0;
    }
    let g2 = 1.0 / (1.0 + lambda(alpha, wi) + lambda(alpha, wo));
    distribution(alpha, (wi + wo).normalize()) * g2 / (4.0 * wi.z * wo.z)
}

/// Samples a half vector that is visible from `wo` (z > 0), with density G1 max(0, wo . h) D / wo.z, from two uniform numbers.
pub fn sample_normal(alpha: f64, wo: DVec3, u1: f64, u2: f64) -> DVec3 {
    let v = DVec3::new(alpha * wo.x, alpha * wo.y, wo.z).normalize();
    let t1 = DVec3::Z.cross(v).try_normalize().unwrap_or(DVec3::X);
    let t2 = v.cross(t1);
    let (radius, angle) = (u1.sqrt(), TAU * u2);
    let (p1, p2) = (radius * angle.cos(), radius * angle.sin());
    let s = 0.5 * (1.0 + v.z);
    let p2 = (1.0 - s) * (1.0 - p1 * p1).sqrt() + s * p2;
    let n = t1 * p1 + t2 * p2 + v * (1.0 - p1 * p1 - p2 * p2).max(0.0).sqrt();
    DVec3::new(alpha * n.x, alpha * n.y, n.z.max(0.0)).normalize()
}

/// Density per steradian of `wi`, the reflection of `wo` at a sampled normal. The density is defined on the whole sphere, where
/// its integral is 1, because some reflections go below the horizon.
pub fn pdf(alpha: f64, wi: DVec3, wo: DVec3) -> f64 {
    let h = (wi + wo).normalize_or_zero();
    if wo.z <= 0.0 || h.z <= 0.0 || h.dot(wo) <= 0.0 {
        return 0.0;
    }
    distribution(alpha, h) / ((1.0 + lambda(alpha, wo)) * 4.0 * wo.z)
}

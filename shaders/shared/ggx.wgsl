// Microfacets with the GGX distribution, and Fresnel terms. Directions are in the local frame of the surface normal (+z), and
// point away from the surface. Densities are per solid angle.
#import math

// Schlick's Fresnel approximation, from f0 at normal incidence to 1 at grazing angles.
fn schlick(f0: vec3<f32>, cosine: f32) -> vec3<f32> {
    let x = clamp(1.0 - cosine, 0.0, 1.0);
    let x2 = x * x;
    return f0 + (1.0 - f0) * (x2 * x2 * x);
}

// Reflectance of a dielectric interface for unpolarised light; 1 for total reflection. `cosine` is on the side with index `eta_i`.
fn fresnel_dielectric(cosine: f32, eta_i: f32, eta_t: f32) -> f32 {
    let sin2_t = square(eta_i / eta_t) * max(0.0, 1.0 - cosine * cosine);
    if (sin2_t >= 1.0) {
        return 1.0;
    }
    let cos_t = sqrt(1.0 - sin2_t);
    let parallel = (eta_t * cosine - eta_i * cos_t) / (eta_t * cosine + eta_i * cos_t);
    let perpendicular = (eta_i * cosine - eta_t * cos_t) / (eta_i * cosine + eta_t * cos_t);
    return 0.5 * (parallel * parallel + perpendicular * perpendicular);
}

// GGX distribution of normals (Walter et al. 2007, Eq. 33). It is computed from sin^2, so that narrow lobes lose no digits.
fn ggx_d(h: vec3<f32>, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    let s = (h.x * h.x + h.y * h.y) / a2 + h.z * h.z;
    return 1.0 / (PI * a2 * s * s);
}

// Smith's Lambda for GGX (Heitz 2014, Eq. 72).
fn ggx_lambda(w: vec3<f32>, alpha: f32) -> f32 {
    let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z);
    return 0.5 * (sqrt(1.0 + alpha * alpha * tan2) - 1.0);
}

// Density of the visible normal h, seen from w with w.z > 0 (Heitz 2018, Eq. 3).
fn ggx_visible_pdf(w: vec3<f32>, h: vec3<f32>, alpha: f32) -> f32 {
    return ggx_d(h, alpha) * max(dot(w, h), 0.0) / (w.z * (1.0 + ggx_lambda(w, alpha)));
}

// Samples a visible normal, seen from w with w.z > 0 (Dupuy and Benyoub 2023, spherical caps).
fn ggx_sample_visible(w: vec3<f32>, alpha: f32, u: vec2<f32>) -> vec3<f32> {
    let stretched = normalize(vec3<f32>(w.xy * alpha, w.z));
    let turn = cosine_and_sine(2.0 * PI * u.x);
    let z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    let r = sqrt(clamp(1.0 - z * z, 0.0, 1.0));
    let cap = vec3<f32>(r * turn.x, r * turn.y, z) + stretched;
    return normalize(vec3<f32>(cap.xy * alpha, cap.z));
}

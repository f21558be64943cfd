// Retroreflection: a lobe around the direction that light comes from. It is a GGX reflection in which one direction is replaced by
// its mirror image about the normal (Portsmouth, Raab, Belcour and Liu, "The Minimal Retroreflective Microfacet Model", JCGT 15(1),
// 2026). It is reciprocal, because GGX is the same for all azimuths. Its albedo is at most 1.
#import ggx

// The mirror image of w about the normal.
fn mirror_about_normal(w: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(-w.xy, w.z);
}

// The lobe, 1 / sr, without any cosine. wl.z > 0 and wc.z > 0.
fn retroreflection(alpha: f32, wl: vec3<f32>, wc: vec3<f32>) -> f32 {
    let h = normalize(mirror_about_normal(wl) + wc);
    let masking = 1.0 / (1.0 + ggx_lambda(wl, alpha) + ggx_lambda(wc, alpha));
    return ggx_d(h, alpha) * masking / (4.0 * wl.z * wc.z);
}

// Density of sampling `other` if `w` is known. w.z > 0 and other.z > 0.
fn retroreflection_pdf(alpha: f32, w: vec3<f32>, other: vec3<f32>) -> f32 {
    let mirrored = mirror_about_normal(w);
    let h = normalize(mirrored + other);
    return ggx_visible_pdf(mirrored, h, alpha) / max(4.0 * dot(mirrored, h), 1e-12);
}

// Samples a direction for the known direction `w`, w.z > 0. The result may lie below the surface; such a sample is lost.
fn sample_retroreflection(alpha: f32, w: vec3<f32>, u: vec2<f32>) -> vec3<f32> {
    let mirrored = mirror_about_normal(w);
    return reflect(-mirrored, ggx_sample_visible(mirrored, alpha, u));
}

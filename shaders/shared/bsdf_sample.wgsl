// Samples directions from the lobes of a BSDF, in the local frame of the shading normal.
#import bsdf

struct BsdfSample {
    direction: vec3<f32>,
    // Smooth lobes: f / pdf, without cosines. Delta lobes: reflectance or transmittance / probability of choosing the lobe. If wl is
    // sampled, the transmittance contains the squared ratio of the indices.
    weight: vec3<f32>,
    // Density of sampling `direction`, and of sampling the known direction if `direction` were known. Both are 1 for delta lobes.
    pdf: f32,
    pdf_reverse: f32,
    delta: bool,
    // False if the sample was lost; the other fields then have no meaning.
    valid: bool,
}

// Samples a direction for the known direction `w`, w.z > 0. `to_light`: `w` is wc and the sample is wl; otherwise `w` is wl
// and the sample is wc. `u.w` picks the lobe, `u.z` reflection or refraction, `u.xy` the direction or the visible normal.
fn bsdf_sample(b: Bsdf, w: vec3<f32>, to_light: bool, u: vec4<f32>) -> BsdfSample {
    var s: BsdfSample;
    s.valid = false;
    if (b.black || w.z <= 0.0) {
        return s;
    }
    let lobes = lobe_probabilities(b, w.z);
    var pick = u.w;
    if (is_retroreflector(b)) {
        // The rest of `u.w` chooses among the other lobes. The weight of a delta stays the same: the share of the light and the
        // probability of choosing the delta fall by the same factor.
        pick = min((u.w - b.retroreflection) / (1.0 - b.retroreflection), 0.99999994);
    }
    if (is_retroreflector(b) && u.w < b.retroreflection) {
        s.direction = sample_retroreflection(b.retroreflector_alpha, w, u.xy);
        if (s.direction.z <= 0.0) {
            return s;
        }
    } else if (pick < lobes.diffuse) {
        s.direction = cosine_hemisphere(u.xy);
    } else {
        let coat = is_coated(b) && pick >= 1.0 - lobes.clearcoat;
        let alpha = select(b.alpha, b.clearcoat_alpha, coat);
        var h = vec3<f32>(0.0, 0.0, 1.0);
        if (alpha >= DELTA_ALPHA) {
            h = ggx_sample_visible(w, alpha, u.xy);
        }
        s.direction = reflect(-w, h);
        var refracted = false;
        if (HAS_TRANSMISSION && !coat && pick >= lobes.diffuse + lobes.gloss) {
            refracted = !passes_straight(b) && u.z >= glass_reflectance(b, max(dot(w, h), 0.0));
            if (refracted && b.thin) {
                s.direction.z = -s.direction.z;
            } else if (refracted) {
                s.direction = refract(-w, h, b.eta_above / b.eta_below);
            }
        }
        // A rough microfacet may reflect below the surface or refract above it. Such a sample is lost.
        if (s.direction.z == 0.0 || (s.direction.z < 0.0) != refracted) {
            return s;
        }
        if (alpha < DELTA_ALPHA) {
            return delta_sample(b, w, s.direction, to_light, lobes, coat);
        }
    }
    let wl = select(w, s.direction, to_light);
    let wc = select(s.direction, w, to_light);
    let value = bsdf_eval(b, wl, wc);
    s.pdf = select(value.pdf_to_sensor, value.pdf_to_light, to_light);
    s.pdf_reverse = select(value.pdf_to_light, value.pdf_to_sensor, to_light);
    s.valid = s.pdf > 0.0;
    s.weight = value.f / max(s.pdf, 1e-30);
    s.delta = false;
    return s;
}

// The sample of a delta lobe in `direction`: a mirror reflection if z > 0, else a smooth refraction. Its weight is the
// reflectance, or transmittance, over the probability of choosing it. `coat`: the clear coat was chosen.
fn delta_sample(b: Bsdf, w: vec3<f32>, direction: vec3<f32>, to_light: bool, lobes: Lobes, coat: bool) -> BsdfSample {
    var s: BsdfSample;
    s.direction = direction;
    s.delta = true;
    s.pdf = 1.0;
    s.pdf_reverse = 1.0;
    s.valid = true;
    if (coat) {
        s.weight = vec3<f32>(clearcoat_fresnel(b, w.z) / max(lobes.clearcoat, 1e-30));
        return s;
    }
    let glass = (1.0 - b.metallic) * b.transmission;
    let reflectance = glass_reflectance(b, w.z);
    if (direction.z > 0.0) {
        let plastic = (1.0 - b.metallic) * (1.0 - b.transmission);
        let albedo = b.metallic * schlick(b.base, w.z) + plastic * coat_fresnel(b, w.z) + glass * reflectance;
        let by_glass = lobes.glass * select(reflectance, 1.0, passes_straight(b));
        s.weight = albedo / max(lobes.gloss + by_glass, 1e-30);
    } else {
        // Radiance is concentrated in the smaller solid angle of the denser side. The flux of light particles is not.
        let squeeze = select(1.0, square(b.eta_above / b.eta_below), to_light);
        s.weight = glass * (1.0 - reflectance) * squeeze * b.base
            / max(lobes.glass * (1.0 - reflectance), 1e-30);
    }
    if (is_coated(b)) {
        s.weight *= clearcoat_passes(b, w, direction);
    }
    return s;
}

// Surface scattering in the local frame of the shading normal (+z).
//
// A material mixes three parts that share one GGX lobe: a conductor (weight metallic) and, for the rest, glass (weight
// transmission) and a dielectric coat over a diffuse base. A clear coat with a GGX lobe of its own may lie over the mix. A
// retroreflector may take a share of the light from all of this. `f` follows the flow of light: `wl` points to where light comes
// from, `wc` to where it goes (towards the sensor). Both point away from the surface. Densities are per solid angle.
#import ggx
#import material
#import point
#import retroreflector

struct Bsdf {
    base: vec3<f32>,
    metallic: f32,
    // GGX alpha of the shared lobe.
    alpha: f32,
    // Reflectance of the coat at normal incidence (the largest channel) and at grazing angles.
    f0: f32,
    f90: f32,
    // Reflectance of the coat at normal incidence, per channel.
    f0_color: vec3<f32>,
    // Strength of the clear coat, and its GGX alpha.
    clearcoat: f32,
    clearcoat_alpha: f32,
    // Share of the light that is reflected back to where it came from, and the GGX alpha of this lobe.
    retroreflection: f32,
    retroreflector_alpha: f32,
    transmission: f32,
    // See `Material.diffuse_scale`.
    diffuse_scale: f32,
    // Refractive indices on the +z and the -z side, relative to the surroundings.
    eta_above: f32,
    eta_below: f32,
    // The back of a one-sided surface, which scatters nothing.
    black: bool,
    // Thin glass (sheet.wgsl).
    thin: bool,
}

struct BsdfValue {
    // Scattered radiance over incident irradiance, 1 / sr, without any cosine.
    f: vec3<f32>,
    // Density of sampling wl if wc is known, and of sampling wc if wl is known.
    pdf_to_light: f32,
    pdf_to_sensor: f32,
}

// Probabilities of sampling the four lobes if the retroreflector is not sampled. They sum to 1.
struct Lobes {
    diffuse: f32,
    gloss: f32,
    glass: f32,
    clearcoat: f32,
}

// The BSDF of a material whose base colour at the point is `base`. `front`: the +z side of the frame is the front of the
// surface, where the surroundings are.
fn make_bsdf(material: u32, base: vec3<f32>, front: bool) -> Bsdf {
    let m = load_material(material);
    var b: Bsdf;
    b.base = base;
    b.metallic = m.metallic;
    b.alpha = m.alpha;
    b.f0 = m.f0;
    b.f90 = m.f90;
    b.f0_color = select(vec3<f32>(m.f0), m.f0_color, HAS_SPECULAR_COLORS);
    b.clearcoat = select(0.0, m.clearcoat, HAS_CLEARCOAT);
    b.clearcoat_alpha = m.clearcoat_alpha;
    b.retroreflection = select(0.0, m.retroreflection, HAS_RETROREFLECTORS);
    b.retroreflector_alpha = m.retroreflector_alpha;
    b.transmission = select(0.0, m.transmission, HAS_TRANSMISSION);
    b.diffuse_scale = m.diffuse_scale;
    b.thin = is_thin(m);
    let is_outside = front || b.thin;
    b.eta_above = select(m.ior, 1.0, is_outside);
    b.eta_below = select(1.0, m.ior, is_outside);
    b.black = !front && (m.flags & MATERIAL_DOUBLE_SIDED) == 0u && b.transmission == 0.0;
    return b;
}

// As `make_bsdf`, for a material whose properties vary over the surface.
fn make_varying_bsdf(material: u32, p: PointProperties, front: bool) -> Bsdf {
    var b = make_bsdf(material, p.base, front);
    b.metallic = p.metallic;
    b.alpha = p.alpha;
    if (HAS_TRANSMISSION_TEXTURES) {
        b.transmission *= p.transmission;
    }
    if (HAS_COAT_TEXTURES) {
        let m = load_material(material);
        b.f0_color = min(b.f0_color * p.coats.specular_color, vec3<f32>(m.f90)) * p.coats.specular;
        b.f0 = max_component(b.f0_color);
        b.f90 = m.f90 * p.coats.specular;
        b.clearcoat *= p.coats.clearcoat;
        b.clearcoat_alpha = clearcoat_alpha(m, p.coats.clearcoat_roughness);
    }
    // A row of the albedo table belongs to one alpha. The mean albedos of the rows are stored after the table. Interpolating these
    // means gives the same scale as in a material with constant alpha.
    let row = sqrt(min(p.alpha, 1.0)) * f32(ALBEDO_ROWS - 1u);
    let i = min(u32(row), ALBEDO_ROWS - 2u);
    let mean = albedo_between(ALBEDO_COLUMNS * ALBEDO_ROWS + i, row - f32(i));
    b.diffuse_scale = 1.0 / (PI * max(1.0 - (b.f0 * mean.x + b.f90 * mean.y), MIN_BELOW_COAT));
    return b;
}

// Schlick's Fresnel term of the coat, from f0 to f90.
fn coat_fresnel(b: Bsdf, cosine: f32) -> vec3<f32> {
    let x = clamp(1.0 - cosine, 0.0, 1.0);
    let x2 = x * x;
    return b.f0_color + (b.f90 - b.f0_color) * (x2 * x2 * x);
}

// Directional albedo of a GGX lobe for a direction at `cosine` from the normal. The albedo is x f0 + y f90.
fn lobe_albedo(alpha: f32, cosine: f32) -> vec2<f32> {
    let size = vec2<u32>(ALBEDO_COLUMNS, ALBEDO_ROWS);
    let p = sqrt(clamp(vec2<f32>(cosine, alpha), vec2<f32>(0.0), vec2<f32>(1.0))) * vec2<f32>(size - 1u);
    let i = min(vec2<u32>(p), size - 2u);
    let f = p - vec2<f32>(i);
    let row = i.y * ALBEDO_COLUMNS + i.x;
    return mix(albedo_between(row, f.x), albedo_between(row + ALBEDO_COLUMNS, f.x), f.y);
}

// Interpolates between the entries `index` and `index` + 1 of the table of albedos.
fn albedo_between(index: u32, t: f32) -> vec2<f32> {
    let entries = bitcast<vec4<f32>>(textureLoad(albedo_table, index, 0));
    return mix(entries.xy, entries.zw, t);
}

// Directional albedo of the coat, in [0, 1], in the channel in which the coat reflects most. The base under the coat gets the
// same share of the light in all channels. Otherwise the base would take the colour complementary to the coat.
fn coat_albedo(b: Bsdf, cosine: f32) -> f32 {
    let ab = lobe_albedo(b.alpha, cosine);
    return clamp(b.f0 * ab.x + b.f90 * ab.y, 0.0, 1.0);
}

// Reflectance of the clear coat at normal incidence: its index of refraction is 1.5.
const CLEARCOAT_F0: f32 = 0.04;

fn is_coated(b: Bsdf) -> bool {
    return HAS_CLEARCOAT && b.clearcoat > 0.0;
}

// Directional albedo of the clear coat, in [0, 1].
fn clearcoat_albedo(b: Bsdf, cosine: f32) -> f32 {
    let ab = lobe_albedo(b.clearcoat_alpha, cosine);
    return b.clearcoat * clamp(CLEARCOAT_F0 * ab.x + ab.y, 0.0, 1.0);
}

// Schlick's Fresnel term of the clear coat.
fn clearcoat_fresnel(b: Bsdf, cosine: f32) -> f32 {
    return b.clearcoat * schlick(vec3<f32>(CLEARCOAT_F0), cosine).x;
}

// Factor on the lobes under the clear coat: the share of light that the coat lets in along one direction and out along the other.
// The product is reciprocal. In a white furnace, the coat and these lobes together reflect at most 1.
fn clearcoat_passes(b: Bsdf, wl: vec3<f32>, wc: vec3<f32>) -> f32 {
    return (1.0 - clearcoat_albedo(b, abs(wl.z))) * (1.0 - clearcoat_albedo(b, abs(wc.z)));
}

// Whether the GGX lobe under the clear coat is so narrow that it counts as a delta.
fn is_delta(b: Bsdf) -> bool {
    return b.alpha < DELTA_ALPHA;
}

// Reflectance of glass: of one face, or of both faces of thin glass with all reflections between them. `cosine`: that of the angle
// to the normal of a facet.
fn glass_reflectance(b: Bsdf, cosine: f32) -> f32 {
    let face = fresnel_dielectric(cosine, b.eta_above, b.eta_below);
    return select(face, 2.0 * face / (1.0 + face), b.thin);
}

// Whether light that passes the glass goes straight on, so that rays pass it without a vertex.
fn passes_straight(b: Bsdf) -> bool {
    return b.thin && is_delta(b);
}

// Probabilities of sampling the lobes if the known direction is at `cosine` from the normal.
fn lobe_probabilities(b: Bsdf, cosine: f32) -> Lobes {
    if (!HAS_GLOSSY) {
        return Lobes(1.0, 0.0, 0.0, 0.0);
    }
    return lobe_probabilities_of(b, cosine, coat_albedo(b, cosine));
}

// As `lobe_probabilities`, if the `coat_albedo` for this cosine is `coat`.
fn lobe_probabilities_of(b: Bsdf, cosine: f32, coat: f32) -> Lobes {
    let plastic = (1.0 - b.metallic) * (1.0 - b.transmission);
    let diffuse = plastic * luminance(b.base) * (1.0 - coat);
    let gloss = plastic * coat + b.metallic * luminance(schlick(b.base, cosine));
    var glass = (1.0 - b.metallic) * b.transmission;
    if (passes_straight(b)) {
        glass *= glass_reflectance(b, cosine);
    }
    let sum = diffuse + gloss + glass;
    if (is_coated(b)) {
        let albedo = clearcoat_albedo(b, cosine);
        let total = albedo + (1.0 - albedo) * sum;
        let under = (1.0 - albedo) / total;
        return Lobes(diffuse * under, gloss * under, glass * under, albedo / total);
    }
    if (sum <= 0.0) {
        return Lobes(1.0, 0.0, 0.0, 0.0);
    }
    return Lobes(diffuse / sum, gloss / sum, glass / sum, 0.0);
}

// Whether a share of the light is reflected back to where it came from.
fn is_retroreflector(b: Bsdf) -> bool {
    return HAS_RETROREFLECTORS && b.retroreflection > 0.0;
}

// Value and densities of the smooth lobes. A delta lobe adds nothing. All are 0 if a direction is tangent to the surface (z = 0),
// or if both directions are below it.
fn bsdf_eval(b: Bsdf, wl: vec3<f32>, wc: vec3<f32>) -> BsdfValue {
    var r = BsdfValue(vec3<f32>(0.0), 0.0, 0.0);
    if (b.black || wl.z == 0.0 || wc.z == 0.0) {
        return r;
    }
    if (wl.z > 0.0 && wc.z > 0.0) {
        r = bsdf_eval_reflection(b, wl, wc);
    } else if (HAS_TRANSMISSION && wl.z * wc.z < 0.0 && b.transmission > 0.0 && !is_delta(b)) {
        if (b.thin) {
            r = bsdf_eval_thin_transmission(b, wl, wc);
        } else {
            r = bsdf_eval_transmission(b, wl, wc);
        }
    }
    if (is_coated(b)) {
        r = add_clearcoat(b, r, wl, wc);
    }
    if (is_retroreflector(b)) {
        return add_retroreflection(b, r, wl, wc);
    }
    return r;
}

// Value and densities with the retroreflector. `others`: value and densities of the other lobes, as if without a retroreflector.
fn add_retroreflection(b: Bsdf, others: BsdfValue, wl: vec3<f32>, wc: vec3<f32>) -> BsdfValue {
    let rest = 1.0 - b.retroreflection;
    var r = BsdfValue(rest * others.f, rest * others.pdf_to_light, rest * others.pdf_to_sensor);
    if (wl.z > 0.0 && wc.z > 0.0) {
        r.f += b.retroreflection * retroreflection(b.retroreflector_alpha, wl, wc) * b.base;
        r.pdf_to_light += b.retroreflection * retroreflection_pdf(b.retroreflector_alpha, wc, wl);
        r.pdf_to_sensor += b.retroreflection * retroreflection_pdf(b.retroreflector_alpha, wl, wc);
    }
    return r;
}

// Value and densities with the clear coat. `under`: value and densities without it. The densities of `under` already include the
// probability of not sampling the coat.
fn add_clearcoat(b: Bsdf, under: BsdfValue, wl: vec3<f32>, wc: vec3<f32>) -> BsdfValue {
    var r = under;
    r.f *= clearcoat_passes(b, wl, wc);
    if (b.clearcoat_alpha < DELTA_ALPHA || wl.z <= 0.0 || wc.z <= 0.0) {
        return r;
    }
    let h = normalize(wl + wc);
    let shape = ggx_d(h, b.clearcoat_alpha) / (4.0 * wl.z * wc.z);
    let masking = 1.0 / (1.0 + ggx_lambda(wl, b.clearcoat_alpha) + ggx_lambda(wc, b.clearcoat_alpha));
    r.f += clearcoat_fresnel(b, max(dot(wl, h), 0.0)) * masking * shape;
    let to_light = ggx_visible_pdf(wc, h, b.clearcoat_alpha) / max(4.0 * dot(wc, h), 1e-12);
    let to_sensor = ggx_visible_pdf(wl, h, b.clearcoat_alpha) / max(4.0 * dot(wl, h), 1e-12);
    r.pdf_to_light += lobe_probabilities(b, wc.z).clearcoat * to_light;
    r.pdf_to_sensor += lobe_probabilities(b, wl.z).clearcoat * to_sensor;
    return r;
}

// `bsdf_eval` for wl and wc on the +z side, without the clear coat and the retroreflector.
fn bsdf_eval_reflection(b: Bsdf, wl: vec3<f32>, wc: vec3<f32>) -> BsdfValue {
    var r: BsdfValue;
    if (!HAS_GLOSSY) {
        r.f = b.base / PI;
        r.pdf_to_light = wl.z / PI;
        r.pdf_to_sensor = wc.z / PI;
        return r;
    }
    let plastic = (1.0 - b.metallic) * (1.0 - b.transmission);
    let coat_c = coat_albedo(b, wc.z);
    let coat_l = coat_albedo(b, wl.z);
    let from_sensor = lobe_probabilities_of(b, wc.z, coat_c);
    let from_light = lobe_probabilities_of(b, wl.z, coat_l);
    // The diffuse base under the coat gets the light that the coat does not reflect. This form is reciprocal.
    let base = (1.0 - coat_l) * (1.0 - coat_c) * b.diffuse_scale;
    r.f = plastic * base * b.base;
    r.pdf_to_light = from_sensor.diffuse * wl.z / PI;
    r.pdf_to_sensor = from_light.diffuse * wc.z / PI;
    if (is_delta(b)) {
        return r;
    }
    let h = normalize(wl + wc);
    let d = ggx_d(h, b.alpha);
    let cosine = max(dot(wl, h), 0.0);
    let masking = 1.0 / (1.0 + ggx_lambda(wl, b.alpha) + ggx_lambda(wc, b.alpha));
    let glass_f = glass_reflectance(b, cosine);
    let fresnel = b.metallic * schlick(b.base, cosine) + plastic * coat_fresnel(b, cosine)
        + (1.0 - b.metallic) * b.transmission * glass_f;
    r.f += fresnel * (d * masking / (4.0 * wl.z * wc.z));
    let to_light = ggx_visible_pdf(wc, h, b.alpha) / max(4.0 * dot(wc, h), 1e-12);
    let to_sensor = ggx_visible_pdf(wl, h, b.alpha) / max(4.0 * dot(wl, h), 1e-12);
    r.pdf_to_light += (from_sensor.gloss + from_sensor.glass * glass_f) * to_light;
    r.pdf_to_sensor += (from_light.gloss + from_light.glass * glass_f) * to_sensor;
    return r;
}

// `bsdf_eval` for wl and wc on opposite sides, without the clear coat and the retroreflector: rough refraction (Walter et al. 2007,
// Eqs. 16, 17 and 21).
fn bsdf_eval_transmission(b: Bsdf, wl: vec3<f32>, wc: vec3<f32>) -> BsdfValue {
    var r = BsdfValue(vec3<f32>(0.0), 0.0, 0.0);
    let eta_l = select(b.eta_below, b.eta_above, wl.z > 0.0);
    let eta_c = select(b.eta_below, b.eta_above, wc.z > 0.0);
    var h = -(eta_l * wl + eta_c * wc);
    let length2 = dot(h, h);
    // With equal indices light goes straight on. That delta is not part of this lobe.
    if (length2 < 1e-14) {
        return r;
    }
    h = h * inverseSqrt(length2);
    h = select(h, -h, h.z < 0.0);
    let l_h = dot(wl, h);
    let c_h = dot(wc, h);
    if (l_h * wl.z <= 0.0 || c_h * wc.z <= 0.0) {
        return r;
    }
    // Always use the cosine on the side with the lower index: computing the other cosine from it loses no digits. The
    // reflectance is the same from both sides.
    let thin = select(c_h, l_h, eta_l < eta_c);
    let reflectance = fresnel_dielectric(abs(thin), min(eta_l, eta_c), max(eta_l, eta_c));
    let d = ggx_d(h, b.alpha);
    let masking = 1.0 / (1.0 + ggx_lambda(wl, b.alpha) + ggx_lambda(wc, b.alpha));
    let glass = (1.0 - b.metallic) * b.transmission;
    let denominator = square(eta_l * l_h + eta_c * c_h);
    let shape = d * masking * (1.0 - reflectance) / denominator;
    r.f = glass * b.base * (abs(l_h * c_h / (wl.z * wc.z)) * eta_c * eta_c * shape);
    let from_sensor = lobe_probabilities(b, abs(wc.z));
    let from_light = lobe_probabilities(b, abs(wl.z));
    // `ggx_visible_pdf` needs w.z > 0. Below the surface, w sees the normal -h. Negating both gives -w and h, with the same density.
    let up_c = select(-wc, wc, wc.z > 0.0);
    let up_l = select(-wl, wl, wl.z > 0.0);
    r.pdf_to_light = from_sensor.glass * (1.0 - reflectance) * ggx_visible_pdf(up_c, h, b.alpha)
        * eta_l * eta_l * abs(l_h) / denominator;
    r.pdf_to_sensor = from_light.glass * (1.0 - reflectance) * ggx_visible_pdf(up_l, h, b.alpha)
        * eta_c * eta_c * abs(c_h) / denominator;
    return r;
}

// `bsdf_eval` for wl and wc on opposite sides of rough thin glass, without the clear coat and the retroreflector. The lobe is that of
// the reflection, mirrored at the surface.
fn bsdf_eval_thin_transmission(b: Bsdf, wl: vec3<f32>, wc: vec3<f32>) -> BsdfValue {
    let l = vec3<f32>(wl.xy, abs(wl.z));
    let c = vec3<f32>(wc.xy, abs(wc.z));
    let h = normalize(l + c);
    let cosine = max(dot(l, h), 0.0);
    let masking = 1.0 / (1.0 + ggx_lambda(l, b.alpha) + ggx_lambda(c, b.alpha));
    let transmitted = 1.0 - glass_reflectance(b, cosine);
    let glass = (1.0 - b.metallic) * b.transmission * transmitted;
    let by_sensor = lobe_probabilities(b, c.z).glass * transmitted;
    let by_light = lobe_probabilities(b, l.z).glass * transmitted;
    var r: BsdfValue;
    r.f = glass * b.base * (ggx_d(h, b.alpha) * masking / (4.0 * l.z * c.z));
    r.pdf_to_light = by_sensor * ggx_visible_pdf(c, h, b.alpha) / max(4.0 * dot(c, h), 1e-12);
    r.pdf_to_sensor = by_light * ggx_visible_pdf(l, h, b.alpha) / max(4.0 * dot(l, h), 1e-12);
    return r;
}

//! Scattering at a surface: Lambert, plastic, GGX metal, mirror, smooth and rough glass, and the mixtures that glTF allows.
//!
//! In the local frame, z is the shading normal on the viewer's side, and directions point away from the surface. With m the
//! metallic factor and t the transmission factor,
//!
//!   f = m conductor + (1 - m) ((1 - t) plastic + t dielectric).
//!
//! Conductor: GGX with Schlick's Fresnel factor from the base colour.
//!
//! Plastic: a GGX coat with F0 = ((n - 1) / (n + 1))^2 over a diffuse base. With the coat's directional albedo E, the base is
//! scaled by (1 - E(i)) (1 - E(o)) / (1 - E_avg). This factor is reciprocal and conserves energy. `specular` scales both Fresnel
//! terms.
//!
//! `specular_color` scales F0 per channel, up to 1; E is the albedo of the channel with the largest F0.
//!
//! A clear coat of strength c lies over f: a GGX lobe with F = c (0.04 + 0.96 (1 - cos)^5) and the albedo C. The light that
//! scatters under it is scaled by (1 - C(i)) (1 - C(o)).
//!
//! A retroreflector of share r turns f into (1 - r) f + r R. R is the base colour times a GGX lobe of perfect mirrors, around the
//! direction that light comes from.
//!
//! Dielectric: GGX microfacets of smooth glass with unpolarised Fresnel reflectance. Each crossing multiplies by the base colour.
//! The dielectric is only sampled, never evaluated: its directions follow from facets, Snell and Fresnel, without Walter's
//! Jacobian.
//!
//! Every GGX lobe with alpha below [`MIRROR_ALPHA`] is a perfect mirror (or smooth glass).

mod coat;
mod retroreflector;

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use taugate::Material;

use super::{ggx, rgb};
use coat::{Coat, CoatTables};
use retroreflector::Retroreflector;

/// A GGX lobe with a smaller alpha counts as a perfect mirror.
pub const MIRROR_ALPHA: f64 = 1e-3;

/// A material with values that are computed once: the directional albedos of its coats.
#[derive(Debug, Clone)]
pub struct PreparedMaterial {
    /// Reflectance at normal incidence without colour.
    uncolored: f64,
    specular_color: [f64; 3],
    specular: f64,
    metallic: f64,
    transmission: f64,
    ior: f64,
    coat: CoatTables,
    /// Strength and albedos of the clear coat.
    clearcoat: Option<(f64, CoatTables)>,
    retroreflector: Option<Retroreflector>,
}

/// Values of a material's textures at a point, which multiply its factors; 1 without a texture. The roughnesses are perceptual.
#[derive(Debug, Clone, Copy)]
pub struct Texels {
    pub roughness: f64,
    pub metallic: f64,
    pub specular: f64,
    pub specular_color: [f64; 3],
    pub clearcoat: f64,
    pub clearcoat_roughness: f64,
    pub transmission: f64,
}

/// A material at a point: a [`PreparedMaterial`] with the base colour and the texels of the point.
#[derive(Debug, Clone, Copy)]
pub struct Bsdf<'a> {
    material: &'a PreparedMaterial,
    base: [f64; 3],
    metallic: f64,
    transmission: f64,
    /// Reflectance of the plastic's coat at normal incidence and at grazing angles.
    f0: [f64; 3],
    f90: f64,
    coat: Coat<'a>,
    clearcoat: Option<Clearcoat<'a>>,
}

/// A clear coat over the whole material.
#[derive(Debug, Clone, Copy)]
struct Clearcoat<'a> {
    strength: f64,
    coat: Coat<'a>,
}

/// A direction drawn by [`Bsdf::sample`].
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    pub wi: DVec3,
    /// f cos / p, where p is the density (or probability) with which `wi` was drawn. For refraction, the weight applies to power.
    /// For radiance, the caller multiplies by the square of the ratio of indices.
    pub weight: [f64; 3],
    /// Density per steradian; 0 for mirrors and glass, whose density is not known.
    pub pdf: f64,
    /// The direction comes from a mirror or from smooth or rough glass. No other strategy can evaluate these lobes.
    pub delta: bool,
    /// The direction goes through the surface.
    pub refracted: bool,
}

impl Texels {
    /// The texels of a material without textures.
    pub const WHITE: Texels = Texels {
        roughness: 1.0,
        metallic: 1.0,
        specular: 1.0,
        specular_color: [1.0; 3],
        clearcoat: 1.0,
        clearcoat_roughness: 1.0,
        transmission: 1.0,
    };
}

impl PreparedMaterial {
    pub fn new(m: &Material) -> PreparedMaterial {
        let ior = f64::from(m.ior);
        let coated = m.clearcoat > 0.0;
        let clearcoat = || CoatTables::new(m.clearcoat_roughness, m.clearcoat_roughness_texture.is_some());
        PreparedMaterial {
            uncolored: ((ior - 1.0) / (ior + 1.0)).powi(2),
            specular_color: m.specular_color.map(f64::from),
            specular: f64::from(m.specular),
            metallic: f64::from(m.metallic),
            transmission: f64::from(m.transmission),
            ior,
            coat: CoatTables::new(m.roughness, m.surface_texture.is_some()),
            clearcoat: coated.then(|| (f64::from(m.clearcoat), clearcoat())),
            retroreflector: m.retroreflector.filter(|r| r.share > 0.0).map(Retroreflector::new),
        }
    }

    /// The material at a point with the base colour `base`. No texture multiplies its other factors.
    pub fn at(&self, base: [f64; 3]) -> Bsdf<'_> {
        self.at_point(base, &Texels::WHITE)
    }

    /// The material at a point with the base colour `base`, where textures multiply its other factors by `texels`.
    pub fn at_point(&self, base: [f64; 3], texels: &Texels) -> Bsdf<'_> {
        let f90 = self.specular * texels.specular;
        let colored = |k: usize| (self.uncolored * self.specular_color[k] * texels.specular_color[k]).min(1.0);
        let f0 = rgb(|k| f90 * colored(k));
        let brightest = f0.into_iter().fold(0.0, f64::max);
        let clearcoat = self.clearcoat.as_ref().map(|(strength, tables)| {
            let strength = strength * texels.clearcoat;
            Clearcoat { strength, coat: tables.at(texels.clearcoat_roughness, 0.04 * strength, strength) }
        });
        let coat = self.coat.at(texels.roughness, brightest, f90);
        let (metallic, transmission) = (self.metallic * texels.metallic, self.transmission * texels.transmission);
        Bsdf { material: self, base, metallic, transmission, f0, f90, coat, clearcoat }
    }
}

/// Schlick's Fresnel factor, from `f0` at normal incidence to `f90` at grazing angles.
fn schlick(f0: f64, f90: f64, c: f64) -> f64 {
    f0 + (f90 - f0) * (1.0 - c).clamp(0.0, 1.0).powi(5)
}

impl Clearcoat<'_> {
    fn is_mirror(&self) -> bool {
        self.coat.is_mirror()
    }

    /// Schlick's Fresnel factor; `c` is the cosine to the half vector.
    fn fresnel(&self, c: f64) -> f64 {
        self.strength * schlick(0.04, 1.0, c)
    }

    /// Factor on light that scatters under the coat, and enters and leaves it in the directions `a` and `b`.
    fn passes(&self, a: DVec3, b: DVec3) -> f64 {
        (1.0 - self.coat.albedo(a.z.abs())) * (1.0 - self.coat.albedo(b.z.abs()))
    }
}

impl Bsdf<'_> {
    fn is_mirror(&self) -> bool {
        self.coat.is_mirror()
    }

    /// Schlick's Fresnel factor of the plastic's coat; `c` is the cosine to the half vector.
    fn coat_fresnel(&self, c: f64) -> [f64; 3] {
        self.f0.map(|f0| schlick(f0, self.f90, c))
    }

    /// Whether the material scatters only as a mirror or glass, so that no connection to this point has a contribution.
    pub fn only_delta(&self) -> bool {
        let m = self.material;
        let (opaque_plastic, metal) = ((1.0 - self.metallic) * (1.0 - self.transmission), self.metallic);
        let rough = !self.is_mirror() && (metal > 0.0 || opaque_plastic * self.f90 > 0.0)
            || self.clearcoat.is_some_and(|top| !top.is_mirror())
            || m.retroreflector.is_some();
        !rough && (opaque_plastic == 0.0 || self.base.iter().all(|&b| b == 0.0))
    }

    /// f(wi, wo) per steradian, without the cosine. Mirrors and glass count as 0. The function is symmetric.
    pub fn eval(&self, wi: DVec3, wo: DVec3) -> [f64; 3] {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return [0.0; 3];
        }
        let others = self.eval_others(wi, wo);
        match &self.material.retroreflector {
            None => others,
            Some(r) => {
                let lobe = r.share * r.lobe(wi, wo);
                rgb(|k| (1.0 - r.share) * others[k] + lobe * self.base[k])
            }
        }
    }

    /// [`Bsdf::eval`] without the retroreflector, for directions above the surface.
    fn eval_others(&self, wi: DVec3, wo: DVec3) -> [f64; 3] {
        let left = (1.0 - self.coat.albedo(wi.z)) * (1.0 - self.coat.albedo(wo.z)) / (1.0 - self.coat.mean());
        let diffuse = (1.0 - self.metallic) * (1.0 - self.transmission) * left / PI;
        let lobe = if self.is_mirror() { 0.0 } else { ggx::lobe(self.coat.alpha, wi, wo) };
        let c = wi.dot((wi + wo).normalize());
        let fresnel = self.fresnel(c);
        let under = rgb(|k| diffuse * self.base[k] + lobe * fresnel[k]);
        match self.clearcoat {
            None => under,
            Some(top) => {
                let lobe = if top.is_mirror() { 0.0 } else { ggx::lobe(top.coat.alpha, wi, wo) };
                under.map(|f| f * top.passes(wi, wo) + lobe * top.fresnel(c))
            }
        }
    }

    /// Factor of the clear coat on light that goes from `a` to `b` or back; 1 without a clear coat.
    fn passes(&self, a: DVec3, b: DVec3) -> f64 {
        self.clearcoat.map_or(1.0, |top| top.passes(a, b))
    }

    /// Fresnel factor of the GGX lobe, for coat and conductor together; `c` is the cosine to the half vector.
    fn fresnel(&self, c: f64) -> [f64; 3] {
        let plastic = (1.0 - self.metallic) * (1.0 - self.transmission);
        let coat = self.coat_fresnel(c);
        rgb(|k| plastic * coat[k] + self.metallic * schlick(self.base[k], 1.0, c))
    }

    /// Probabilities of sampling the GGX (or mirror) lobe, the diffuse base, the dielectric, and the clear coat. All are 0 for a
    /// black material.
    fn choices(&self, wo: DVec3) -> [f64; 4] {
        let brightest = self.base.iter().copied().fold(0.0, f64::max);
        let plastic = (1.0 - self.metallic) * (1.0 - self.transmission);
        let e = self.coat.albedo(wo.z);
        let diffuse = plastic * (1.0 - e) * brightest;
        let dielectric = (1.0 - self.metallic) * self.transmission;
        let mut lobe = plastic * e + self.metallic * brightest.max(0.05);
        if lobe > 0.0 {
            // For light at grazing angles, the lobe is brighter than its albedo at `wo` suggests.
            lobe = lobe.max(0.15 * diffuse);
        }
        // Clear coats, too, are brighter for light at grazing angles.
        let clearcoat = self.clearcoat.map_or(0.0, |top| top.coat.albedo(wo.z).max(0.1 * top.strength));
        let sum = lobe + diffuse + dielectric + clearcoat;
        if sum > 0.0 { [lobe, diffuse, dielectric, clearcoat].map(|p| p / sum) } else { [0.0; 4] }
    }

    /// Density per steradian with which [`Bsdf::sample`] draws `wi`, without mirrors and glass. Its integral over the sphere is
    /// the probability that neither a mirror nor glass is drawn.
    pub fn pdf(&self, wi: DVec3, wo: DVec3) -> f64 {
        if wo.z <= 0.0 {
            return 0.0;
        }
        let others = self.pdf_of_others(wi, wo);
        let retroreflector = self.material.retroreflector.as_ref();
        retroreflector.map_or(others, |r| r.share * r.pdf(wi, wo) + (1.0 - r.share) * others)
    }

    fn pdf_of_others(&self, wi: DVec3, wo: DVec3) -> f64 {
        let [lobe, diffuse, _, clearcoat] = self.choices(wo);
        let rough = if self.is_mirror() { 0.0 } else { ggx::pdf(self.coat.alpha, wi, wo) };
        let top = match self.clearcoat {
            Some(top) if !top.is_mirror() => ggx::pdf(top.coat.alpha, wi, wo),
            _ => 0.0,
        };
        lobe * rough + diffuse * wi.z.max(0.0) / PI + clearcoat * top
    }

    /// Samples a direction from three uniform numbers. `inside`: the viewer is behind the surface, which matters only for glass.
    /// `None`: the path ends.
    pub fn sample(&self, wo: DVec3, inside: bool, u: [f64; 3]) -> Option<Sample> {
        if wo.z <= 0.0 {
            return None;
        }
        match &self.material.retroreflector {
            None => self.sample_others(wo, inside, u),
            Some(r) if u[0] < r.share => self.smooth_sample(r.sample(wo, u[1], u[2]), wo),
            // The weight of a mirror needs no factor 1 - share: it would scale the light and the probability alike.
            Some(r) => self.sample_others(wo, inside, [(u[0] - r.share) / (1.0 - r.share), u[1], u[2]]),
        }
    }

    /// [`Bsdf::sample`] from all lobes but the retroreflector.
    fn sample_others(&self, wo: DVec3, inside: bool, u: [f64; 3]) -> Option<Sample> {
        let [lobe, diffuse, dielectric, clearcoat] = self.choices(wo);
        if u[0] < dielectric {
            return self.sample_glass(wo, inside, u, dielectric);
        }
        let mirrored = DVec3::new(-wo.x, -wo.y, wo.z);
        let mirror = |weight| Some(Sample { wi: mirrored, weight, pdf: 0.0, delta: true, refracted: false });
        let wi = if u[0] < dielectric + lobe {
            if self.is_mirror() {
                return mirror(self.fresnel(wo.z).map(|f| self.passes(wo, mirrored) * f / lobe));
            }
            let h = ggx::sample_normal(self.coat.alpha, wo, u[1], u[2]);
            2.0 * wo.dot(h) * h - wo
        } else if let Some(top) = self.clearcoat.filter(|_| u[0] < dielectric + lobe + clearcoat) {
            if top.is_mirror() {
                return mirror([top.fresnel(wo.z) / clearcoat; 3]);
            }
            let h = ggx::sample_normal(top.coat.alpha, wo, u[1], u[2]);
            2.0 * wo.dot(h) * h - wo
        } else if diffuse > 0.0 {
            let (radius, angle) = (u[1].sqrt(), TAU * u[2]);
            DVec3::new(radius * angle.cos(), radius * angle.sin(), (1.0 - u[1]).sqrt())
        } else {
            return None;
        };
        self.smooth_sample(wi, wo)
    }

    /// The sample `wi` of a lobe that is neither a mirror nor glass. `None` if it lies below the surface.
    fn smooth_sample(&self, wi: DVec3, wo: DVec3) -> Option<Sample> {
        let pdf = self.pdf(wi, wo);
        if wi.z <= 0.0 || pdf <= 0.0 {
            return None;
        }
        let weight = self.eval(wi, wo).map(|f| f * wi.z / pdf);
        Some(Sample { wi, weight, pdf, delta: false, refracted: false })
    }

    /// Samples a visible facet, and reflects or refracts there with the probabilities of Fresnel's equations. The weight includes
    /// G2 / G1, the fraction that other facets do not block. A reflection into the surface, or a refraction back out of it, is
    /// lost.
    fn sample_glass(&self, wo: DVec3, inside: bool, u: [f64; 3], chosen: f64) -> Option<Sample> {
        let m = self.material;
        // Given that glass was chosen, `u[0]` is uniform in [0, chosen). After rescaling, it chooses reflection or refraction.
        let (choice, share) = (u[0] / chosen, (1.0 - self.metallic) * self.transmission / chosen);
        let facet = if self.is_mirror() { DVec3::Z } else { ggx::sample_normal(self.coat.alpha, wo, u[1], u[2]) };
        let relative = if inside { 1.0 / m.ior } else { m.ior };
        let cos = wo.dot(facet);
        let refracted = choice >= fresnel_dielectric(cos, relative);
        let wi = if refracted {
            let along = (wo - cos * facet) / relative;
            -along - (1.0 - along.length_squared()).max(0.0).sqrt() * facet
        } else {
            2.0 * cos * facet - wo
        };
        if wi.z == 0.0 || (wi.z < 0.0) != refracted {
            return None;
        }
        let passed = if self.is_mirror() {
            1.0
        } else {
            let own = 1.0 + ggx::lambda(self.coat.alpha, wo);
            own / (own + ggx::lambda(self.coat.alpha, wi))
        };
        let passed = passed * self.passes(wo, wi);
        let weight = self.base.map(|b| share * passed * if refracted { b } else { 1.0 });
        Some(Sample { wi, weight, pdf: 0.0, delta: true, refracted })
    }
}

/// Fresnel reflectance of a smooth boundary for unpolarised light, in [0, 1]; 1 for total reflection. `relative` is the index
/// beyond the boundary over the index on the side of the light; `cos` is in [0, 1].
pub fn fresnel_dielectric(cos: f64, relative: f64) -> f64 {
    let sin2 = (1.0 - cos * cos) / (relative * relative);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let beyond = (1.0 - sin2).sqrt();
    let perpendicular = (cos - relative * beyond) / (cos + relative * beyond);
    let parallel = (relative * cos - beyond) / (relative * cos + beyond);
    (perpendicular * perpendicular + parallel * parallel) / 2.0
}

#[cfg(test)]
mod tests;

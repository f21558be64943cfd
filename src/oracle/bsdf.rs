//! Scattering at a surface: Lambert, plastic, GGX metal, mirror, glass smooth and rough, and the mixtures glTF can ask for.
//!
//! Local frame: z is the shading normal on the viewer's side; directions point away from the surface. With m metallic and t transmission,
//!
//!   f = m conductor + (1 - m) ((1 - t) plastic + t dielectric).
//!
//! Conductor: GGX with Schlick's Fresnel factor from the base colour. Plastic: GGX with F0 = ((n - 1) / (n + 1))^2 over a
//! diffuse base that gets what the lobe leaves, (1 - E(i)) (1 - E(o)) / (1 - E_avg), which is reciprocal and conserves energy;
//! both Fresnel terms are scaled by `specular`. GGX lobes with alpha below [`MIRROR_ALPHA`] are perfect mirrors.
//! Dielectric: facets of smooth glass, GGX as the rest, unpolarised Fresnel; each crossing is tinted with the base colour. It is only
//! sampled and never evaluated: what it sends where follows from facets, Snell and Fresnel alone, without Walter's Jacobian.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::ggx;
use crate::scene::Material;

/// Below this a GGX lobe is a mirror.
pub const MIRROR_ALPHA: f64 = 1e-3;

const ENTRIES: usize = 64;

/// A material with what is computed once: the directional albedo of its plastic lobe.
#[derive(Debug, Clone)]
pub struct PreparedMaterial {
    alpha: f64,
    f0: f64,
    specular: f64,
    metallic: f64,
    transmission: f64,
    ior: f64,
    /// E at cosine (i / 63)^2: finest at grazing angles, where E changes fast.
    albedo: [f64; ENTRIES],
    mean_albedo: f64,
}

/// A material at a point: [`PreparedMaterial`] with the base colour there.
#[derive(Debug, Clone, Copy)]
pub struct Bsdf<'a> {
    material: &'a PreparedMaterial,
    base: [f64; 3],
}

/// A direction drawn by [`Bsdf::sample`].
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    pub wi: DVec3,
    /// f cos / p, p being the density (or probability) with which `wi` was drawn. Refraction: for power, without the
    /// square of the relative index that radiance gains.
    pub weight: [f64; 3],
    /// Per steradian; 0 for mirrors and glass, where it is not known.
    pub pdf: f64,
    /// Mirror or glass, smooth or rough: no other strategy makes this direction by this lobe.
    pub delta: bool,
    /// Goes through the surface.
    pub refracted: bool,
}

impl PreparedMaterial {
    pub fn new(material: &Material) -> PreparedMaterial {
        let ior = f64::from(material.ior);
        let mut prepared = PreparedMaterial {
            alpha: f64::from(material.roughness).powi(2),
            f0: ((ior - 1.0) / (ior + 1.0)).powi(2),
            specular: f64::from(material.specular),
            metallic: f64::from(material.metallic),
            transmission: f64::from(material.transmission),
            ior,
            albedo: [0.0; ENTRIES],
            mean_albedo: 0.0,
        };
        for i in 0..ENTRIES {
            let mu = (i as f64 / (ENTRIES - 1) as f64).powi(2).max(1e-6);
            prepared.albedo[i] = prepared.integrate_albedo(mu);
        }
        prepared.mean_albedo = prepared.integrate_mean();
        prepared
    }

    pub fn ior(&self) -> f64 {
        self.ior
    }

    pub fn at(&self, base: [f64; 3]) -> Bsdf<'_> {
        Bsdf { material: self, base }
    }

    fn is_mirror(&self) -> bool {
        self.alpha < MIRROR_ALPHA
    }

    /// Schlick's factor of the plastic's coat at cosine `c` to the half vector.
    fn coat(&self, c: f64) -> f64 {
        self.specular * (self.f0 + (1.0 - self.f0) * (1.0 - c).clamp(0.0, 1.0).powi(5))
    }

    /// Part of the light from cosine `mu` that the coat reflects: the mean of F G2 / G1 over visible normals.
    fn integrate_albedo(&self, mu: f64) -> f64 {
        if self.is_mirror() || self.specular == 0.0 {
            return self.coat(mu);
        }
        const STEPS: usize = 64;
        let wo = DVec3::new((1.0 - mu * mu).sqrt(), 0.0, mu);
        let mut sum = 0.0;
        for i in 0..STEPS * STEPS {
            let (u1, u2) = ((i / STEPS) as f64 + 0.5, (i % STEPS) as f64 + 0.5);
            let h = ggx::sample_normal(self.alpha, wo, u1 / STEPS as f64, u2 / STEPS as f64);
            let wi = 2.0 * wo.dot(h) * h - wo;
            if wi.z > 0.0 {
                let (own, other) = (ggx::lambda(self.alpha, wo), ggx::lambda(self.alpha, wi));
                sum += self.coat(wo.dot(h)) * (1.0 + own) / (1.0 + own + other);
            }
        }
        sum / (STEPS * STEPS) as f64
    }

    /// E at a cosine in [0, 1], from the table.
    fn albedo(&self, mu: f64) -> f64 {
        let x = mu.clamp(0.0, 1.0).sqrt() * (ENTRIES - 1) as f64;
        let i = (x as usize).min(ENTRIES - 2);
        let f = x - i as f64;
        self.albedo[i] * (1.0 - f) + self.albedo[i + 1] * f
    }

    /// E_avg = 2 * integral of E mu over [0, 1]; with mu = t^2 that is 4 * integral of E t^3, exact by Gauss in each cell.
    fn integrate_mean(&self) -> f64 {
        let cell = 1.0 / (ENTRIES - 1) as f64;
        let gauss = [(-(0.6f64.sqrt()), 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.6f64.sqrt(), 5.0 / 18.0)];
        let mut sum = 0.0;
        for i in 0..ENTRIES - 1 {
            for (x, weight) in gauss {
                let t = (i as f64 + 0.5 + 0.5 * x) * cell;
                sum += 4.0 * weight * cell * self.albedo(t * t) * t.powi(3);
            }
        }
        sum
    }
}

impl Bsdf<'_> {
    /// Reflects only as a mirror or glass: nothing to connect to.
    pub fn only_delta(&self) -> bool {
        let m = self.material;
        let (opaque_plastic, metal) = ((1.0 - m.metallic) * (1.0 - m.transmission), m.metallic);
        let rough = !m.is_mirror() && (metal > 0.0 || opaque_plastic * m.specular > 0.0);
        !rough && (opaque_plastic == 0.0 || self.base.iter().all(|&b| b == 0.0))
    }

    /// f(wi, wo) per steradian, no cosine; mirrors and glass are 0 here. Symmetric.
    pub fn eval(&self, wi: DVec3, wo: DVec3) -> [f64; 3] {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return [0.0; 3];
        }
        let m = self.material;
        let left = (1.0 - m.albedo(wi.z)) * (1.0 - m.albedo(wo.z)) / (1.0 - m.mean_albedo);
        let diffuse = (1.0 - m.metallic) * (1.0 - m.transmission) * left / PI;
        let lobe = if m.is_mirror() { 0.0 } else { ggx::lobe(m.alpha, wi, wo) };
        let fresnel = self.fresnel(wi.dot((wi + wo).normalize()));
        [0, 1, 2].map(|k| diffuse * self.base[k] + lobe * fresnel[k])
    }

    /// Factor of the GGX lobe at cosine `c` to the half vector: coat and conductor together.
    fn fresnel(&self, c: f64) -> [f64; 3] {
        let m = self.material;
        let coat = (1.0 - m.metallic) * (1.0 - m.transmission) * m.coat(c);
        let grazing = (1.0 - c).clamp(0.0, 1.0).powi(5);
        self.base.map(|b| coat + m.metallic * (b + (1.0 - b) * grazing))
    }

    /// Probabilities of drawing from the GGX (or mirror) lobe, the diffuse base, and the dielectric; all 0 for black.
    fn choices(&self, wo: DVec3) -> [f64; 3] {
        let m = self.material;
        let brightest = self.base.iter().copied().fold(0.0, f64::max);
        let plastic = (1.0 - m.metallic) * (1.0 - m.transmission);
        let e = m.albedo(wo.z);
        let diffuse = plastic * (1.0 - e) * brightest;
        let dielectric = (1.0 - m.metallic) * m.transmission;
        let mut lobe = plastic * e + m.metallic * brightest.max(0.05);
        if lobe > 0.0 {
            // Highlights from grazing light are brighter than their share at `wo`.
            lobe = lobe.max(0.15 * diffuse);
        }
        let sum = lobe + diffuse + dielectric;
        if sum > 0.0 { [lobe, diffuse, dielectric].map(|p| p / sum) } else { [0.0; 3] }
    }

    /// Density per steradian with which [`Bsdf::sample`] draws `wi`, mirrors and glass left out. Integrates over the sphere to
    /// the probability that neither of these is drawn.
    pub fn pdf(&self, wi: DVec3, wo: DVec3) -> f64 {
        if wo.z <= 0.0 {
            return 0.0;
        }
        let [lobe, diffuse, _] = self.choices(wo);
        let rough = if self.material.is_mirror() { 0.0 } else { ggx::pdf(self.material.alpha, wi, wo) };
        lobe * rough + diffuse * wi.z.max(0.0) / PI
    }

    /// Draws a direction; `inside` says that the viewer is behind the surface (only glass cares). `None` is a path that ends.
    pub fn sample(&self, wo: DVec3, inside: bool, u: [f64; 3]) -> Option<Sample> {
        if wo.z <= 0.0 {
            return None;
        }
        let m = self.material;
        let [lobe, diffuse, dielectric] = self.choices(wo);
        if u[0] < dielectric {
            return self.sample_glass(wo, inside, u, dielectric);
        }
        let wi = if u[0] < dielectric + lobe {
            if m.is_mirror() {
                let weight = self.fresnel(wo.z).map(|f| f / lobe);
                let wi = DVec3::new(-wo.x, -wo.y, wo.z);
                return Some(Sample { wi, weight, pdf: 0.0, delta: true, refracted: false });
            }
            let h = ggx::sample_normal(m.alpha, wo, u[1], u[2]);
            2.0 * wo.dot(h) * h - wo
        } else if diffuse > 0.0 {
            let (radius, angle) = (u[1].sqrt(), TAU * u[2]);
            DVec3::new(radius * angle.cos(), radius * angle.sin(), (1.0 - u[1]).sqrt())
        } else {
            return None;
        };
        let pdf = self.pdf(wi, wo);
        if wi.z <= 0.0 || pdf <= 0.0 {
            return None;
        }
        let weight = self.eval(wi, wo).map(|f| f * wi.z / pdf);
        Some(Sample { wi, weight, pdf, delta: false, refracted: false })
    }

    /// Mirrors at a visible facet or refracts there, with the probability of Fresnel's equations. Of what a facet sends on, other
    /// facets let through G2 / G1; what it mirrors into the surface, or refracts back out of it, is lost.
    fn sample_glass(&self, wo: DVec3, inside: bool, u: [f64; 3], chosen: f64) -> Option<Sample> {
        let m = self.material;
        // The numbers that chose glass are uniform below `chosen`: once more uniform, they choose a facet's part.
        let (choice, share) = (u[0] / chosen, (1.0 - m.metallic) * m.transmission / chosen);
        let facet = if m.is_mirror() { DVec3::Z } else { ggx::sample_normal(m.alpha, wo, u[1], u[2]) };
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
        let passed = if m.is_mirror() {
            1.0
        } else {
            let own = 1.0 + ggx::lambda(m.alpha, wo);
            own / (own + ggx::lambda(m.alpha, wi))
        };
        let weight = self.base.map(|b| share * passed * if refracted { b } else { 1.0 });
        Some(Sample { wi, weight, pdf: 0.0, delta: true, refracted })
    }
}

/// Reflectance of unpolarised light at a smooth boundary; `relative` is the index beyond over the index on the side of the light, `cos`
/// in [0, 1]. 1 under total reflection.
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

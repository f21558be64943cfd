//! Rays through the scene on the host: the nearest surface, and the lobes of its material.

use glam::{DVec3, Vec3, Vec3A};
use obvhs::ray::{Ray as BoxRay, RayHit};

use crate::render::emitters::luminance;
use crate::render::geometry::Geometry;
use crate::render::material::MATERIAL_DOUBLE_SIDED;
use crate::wgsl::layout::Triangle;
use crate::wgsl::layout::constants::*;

/// Reflectance of a clear coat at normal incidence.
const CLEARCOAT_F0: f64 = 0.04;

/// A point on a surface, seen along a ray.
pub struct Hit {
    /// Distance along the ray.
    pub distance: f64,
    /// Index in [`Geometry::triangles`].
    pub triangle: usize,
    /// Unit geometric normal on the side of the viewer.
    pub normal: DVec3,
    /// Whether the viewer sees the front of the surface.
    pub is_front: bool,
}

/// Shares of the light that the lobes of a material scatter towards the viewer. Textures count as white, but a texture of the roughness
/// divides the light by the share of its texels that are smooth.
pub struct Lobes {
    /// Diffuse and rough lobes.
    pub rough: f64,
    /// Perfect reflection and refraction.
    pub mirrored: f64,
    pub refracted: f64,
    /// Index of refraction on the viewer's side, over the index behind the surface.
    pub eta: f64,
}

/// What rays do at smooth thin glass.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum AtSheets {
    Pass,
    Stop,
}

/// The nearest surface that the ray hits before `end`; `leaves` is the triangle that it leaves. Surfaces with an alpha below one half,
/// rough thin glass, and boundaries of media that do not bend light, let it pass. `sheets`: smooth thin glass.
pub fn nearest(
    geometry: &Geometry,
    origin: DVec3,
    direction: DVec3,
    end: f64,
    leaves: Option<usize>,
    sheets: AtSheets,
) -> Option<Hit> {
    let triangles = &geometry.triangles;
    let mut best: Option<(f64, usize)> = None;
    let ray = BoxRay::new(Vec3A::from(origin.as_vec3()), Vec3A::from(direction.as_vec3()), 0.0, end as f32);
    let mut hit = RayHit::none();
    geometry.bvh.host.ray_traverse(ray, &mut hit, |_, index| {
        let t = &triangles[index];
        if leaves == Some(index) || passes(geometry, t, sheets) {
            return f32::INFINITY;
        }
        match distance_to(t, origin, direction) {
            Some(distance) if distance < best.map_or(end, |(nearest, _)| nearest) => {
                best = Some((distance, index));
                // The traversal skips boxes that are farther than this, so rounding must not make it smaller.
                (distance * (1.0 + 1e-6)) as f32
            }
            _ => f32::INFINITY,
        }
    });
    best.map(|(distance, triangle)| hit_at(geometry, triangle, distance, direction))
}

/// Triangle number `triangle`, seen along `direction` at this distance.
pub fn hit_at(geometry: &Geometry, triangle: usize, distance: f64, direction: DVec3) -> Hit {
    let front = front_normal(&geometry.triangles[triangle]);
    let is_front = front.dot(direction) <= 0.0;
    Hit { distance, triangle, normal: if is_front { front } else { -front }, is_front }
}

/// The lobes at `hit`, which is seen along the unit vector `direction`. Thin glass refracts the light that passes it straight on.
pub fn lobes(geometry: &Geometry, hit: &Hit, direction: DVec3) -> Lobes {
    let number = (geometry.triangles[hit.triangle].material & TRIANGLE_MATERIAL) as usize;
    let (m, smooth) = (&geometry.materials[number], &geometry.smooth[number]);
    let is_black = !hit.is_front && m.flags & MATERIAL_DOUBLE_SIDED == 0 && m.transmission <= 0.0;
    let eta = if hit.is_front || smooth.is_thin { 1.0 / f64::from(m.ior) } else { f64::from(m.ior) };
    if is_black {
        return Lobes { rough: 0.0, mirrored: 0.0, refracted: 0.0, eta };
    }
    let cosine = -direction.dot(hit.normal);
    let grazing = (1.0 - cosine).clamp(0.0, 1.0).powi(5);
    let schlick = |f0: f64, f90: f64| f0 + (f90 - f0) * grazing;
    let [metallic, transmission] = [m.metallic, m.transmission].map(f64::from);
    let base = luminance(m.base_color);
    let coat = schlick(m.f0.into(), m.f90.into());
    let face = fresnel(cosine, eta);
    let glass = if smooth.is_thin { 2.0 * face / (1.0 + face) } else { face };
    let reflected =
        metallic * schlick(base, 1.0) + (1.0 - metallic) * ((1.0 - transmission) * coat + transmission * glass);
    let through = (1.0 - metallic) * transmission * (1.0 - glass) * base;
    let diffuse = (1.0 - metallic) * (1.0 - transmission) * (1.0 - coat) * base;
    let under = f64::from(m.clearcoat) * schlick(CLEARCOAT_F0, 1.0);
    let (sharp, blurred) = (smooth.base, 1.0 - smooth.base);
    let rough = diffuse + blurred * reflected + blurred * through;
    let below = 1.0 - under;
    Lobes {
        rough: rough * below + (1.0 - smooth.clearcoat) * under,
        mirrored: sharp * reflected * below + smooth.clearcoat * under,
        refracted: sharp * through * below,
        eta,
    }
}

/// The direction behind the surface of a ray along `direction`, by Snell's law; `None` for total reflection.
pub fn refracted(direction: DVec3, normal: DVec3, eta: f64) -> Option<DVec3> {
    let cosine = -direction.dot(normal);
    let inside = 1.0 - eta * eta * (1.0 - cosine * cosine);
    (inside > 0.0).then(|| (eta * direction + (eta * cosine - inside.sqrt()) * normal).normalize())
}

/// Fresnel reflectance of unpolarised light. `eta`: index on the side of the light over the index behind the surface.
fn fresnel(cosine: f64, eta: f64) -> f64 {
    let inside = 1.0 - eta * eta * (1.0 - cosine * cosine);
    if inside <= 0.0 {
        return 1.0;
    }
    let behind = inside.sqrt();
    let s = (eta * cosine - behind) / (eta * cosine + behind);
    let p = (cosine - eta * behind) / (cosine + eta * behind);
    0.5 * (s * s + p * p)
}

fn passes(geometry: &Geometry, t: &Triangle, sheets: AtSheets) -> bool {
    let is_alpha = t.material & TRIANGLE_ALPHA != 0;
    let opacity = || geometry.materials[(t.material & TRIANGLE_MATERIAL) as usize].opacity;
    let is_passed_sheet =
        t.material & TRIANGLE_SHEET != 0 && (sheets == AtSheets::Pass || !geometry.is_smooth_sheet(t));
    t.material & TRIANGLE_NULL != 0 || is_passed_sheet || (is_alpha && opacity() < 0.5)
}

/// Unit geometric normal of the front; 0 for a triangle without area.
fn front_normal(t: &Triangle) -> DVec3 {
    let [a, b, c] = [t.v0, t.v1, t.v2].map(|corner| Vec3::from(corner).as_dvec3());
    let normal = (b - a).cross(c - a).normalize_or_zero();
    if t.material & TRIANGLE_MIRRORED != 0 { -normal } else { normal }
}

/// Distance along the ray to the triangle (Moeller and Trumbore 1997).
fn distance_to(t: &Triangle, origin: DVec3, direction: DVec3) -> Option<f64> {
    let [a, b, c] = [t.v0, t.v1, t.v2].map(|corner| Vec3::from(corner).as_dvec3());
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let determinant = ab.dot(across);
    let from = origin - a;
    let u = from.dot(across) / determinant;
    let beside = from.cross(ab);
    let v = direction.dot(beside) / determinant;
    let distance = ac.dot(beside) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0).then_some(distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Closed forms: normal incidence on glass, Brewster's angle, total reflection.
    #[test]
    fn fresnel_and_snell() {
        assert!((fresnel(1.0, 1.0 / 1.5) - 0.04).abs() < 1e-12 && (fresnel(1.0, 1.5) - 0.04).abs() < 1e-12);
        let brewster = 1.5f64.atan();
        let s = ((brewster.sin().powi(2) - brewster.cos().powi(2)).powi(2)) / 2.0;
        assert!((fresnel(brewster.cos(), 1.0 / 1.5) - s).abs() < 1e-12);
        assert_eq!(fresnel(0.5, 1.5), 1.0);
        let (sine, normal) = (0.6, DVec3::Z);
        let bent = refracted(DVec3::new(sine, 0.0, -0.8), normal, 1.0 / 1.5).unwrap();
        assert!((bent.x - sine / 1.5).abs() < 1e-12 && bent.z < 0.0);
        assert!(refracted(DVec3::new(0.8, 0.0, -0.6), normal, 1.5).is_none());
    }
}

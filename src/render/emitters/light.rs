//! Lights without a surface. A [`LightRecord`] holds all that a render needs to know about a light of any kind.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::{EmitterKind, luminance};
use crate::render::space::RenderSpace;
use crate::scene::{Light, LightKind, SkyImage, cap_height, spot_solid_angle};
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{Emitter, PathVertex};

/// Distance in units of render space from the scene to the light vertex of a sun, if the scene has a radius up to [`USUAL_RADIUS`].
/// The directions to the vertex then differ by about 1e-6, the rounding error of a direction.
const SUN_DISTANCE: f64 = (1 << 20) as f64;

/// In units of render space. A scene has a larger radius if one of its objects is very far away.
const USUAL_RADIUS: f64 = 8.0;

/// Upper bound on the intensity of the light vertex of a sun, in units of render space. The vertex of a stronger sun is nearer.
const MAX_SUN_INTENSITY: f64 = 1e37;

/// A sphere that contains the scene, in render space.
#[derive(Debug, Clone, Copy)]
pub struct Sphere {
    pub centre: Vec3,
    /// > 0.
    pub radius: f32,
}

/// A light as the renderer sees it, in render space.
pub struct LightRecord {
    /// Entry of the device's emitter table.
    pub entry: Emitter,
    /// Luminance-weighted power in render space, see [`RenderSpace::flux`].
    pub flux: f64,
    /// Light subpaths start within `radius` of `position`.
    pub position: Vec3,
    pub radius: f32,
    /// The light as a light vertex, if its position can be connected to shade points. The vertex does not depend on random numbers,
    /// so the pool stores it once. [`super::EmitterSet`] sets `owner`, `select_pdf`, `eta`, and the code of the
    /// glass around the light in `flags`.
    pub vertex: Option<PathVertex>,
    /// All subpaths begin with the same ray, so the vertices on that ray are deterministic too.
    pub is_thin: bool,
}

impl LightRecord {
    /// `around`: a sphere that contains the scene. The light of a sun or a sky starts outside it. `sky`: the image of the sky.
    pub fn new(light: &Light, sky: &SkyImage, space: &RenderSpace, around: &Sphere) -> LightRecord {
        let position = space.point(light.position);
        let placed = Emitter {
            position: position.into(),
            // A point light may have any direction, even 0, but the kernels need a unit vector.
            direction: light.direction.try_normalize().unwrap_or(DVec3::NEG_Z).as_vec3().into(),
            ..bytemuck::Zeroable::zeroed()
        };
        let on_device = |watts: [f32; 3]| watts.map(|x| space.flux(x));
        match light.kind {
            LightKind::Point { intensity } => point(placed, on_device(intensity)),
            LightKind::Spot { intensity, inner, outer } => {
                spot(placed, on_device(intensity), cap_height(inner), cap_height(outer))
            }
            LightKind::Beam { power, radius } => beam(placed, on_device(power), space.length(radius.into()) as f32),
            LightKind::Directional { irradiance } => sun(light.direction, irradiance, around),
            LightKind::Sky { radiance } => self::sky(sky, radiance, around),
        }
    }
}

fn point(placed: Emitter, intensity: [f32; 3]) -> LightRecord {
    let entry = Emitter { kind: EmitterKind::Point as u32, strength: intensity, ..placed };
    punctual(entry, EMIT_POINT, 4.0 * PI * luminance(intensity))
}

/// `inner` and `outer`: 1 - cosine of the half angles.
fn spot(placed: Emitter, intensity: [f32; 3], inner: f64, outer: f64) -> LightRecord {
    let flux = spot_solid_angle(inner, outer) * luminance(intensity);
    let [inner, outer] = [inner, outer].map(|height| height as f32);
    punctual(Emitter { kind: EmitterKind::Spot as u32, strength: intensity, inner, outer, ..placed }, EMIT_SPOT, flux)
}

fn beam(placed: Emitter, power: [f32; 3], radius: f32) -> LightRecord {
    LightRecord {
        entry: Emitter { kind: EmitterKind::Beam as u32, strength: power, outer: radius, ..placed },
        flux: luminance(power),
        position: placed.position.into(),
        radius,
        vertex: None,
        is_thin: radius == 0.0,
    }
}

/// A light at infinity. Its light vertex is a far point, whose intensity gives the scene the right irradiance. Its light subpaths
/// start on a disk that is perpendicular to `direction` and whose shadow covers the scene.
fn sun(direction: DVec3, irradiance: [f32; 3], around: &Sphere) -> LightRecord {
    let (radius, area) = disk(around);
    let from = |distance: f64| (around.centre.as_dvec3() - direction * distance).as_vec3().to_array();
    let times = |factor: f64| irradiance.map(|channel| (f64::from(channel) * factor) as f32);
    let entry = Emitter {
        kind: EmitterKind::Sun as u32,
        position: from(radius),
        direction: direction.as_vec3().to_array(),
        strength: times(area),
        outer: radius as f32,
        ..bytemuck::Zeroable::zeroed()
    };
    let distance = SUN_DISTANCE * (f64::from(around.radius) / USUAL_RADIUS).max(1.0);
    let strongest = f64::from(irradiance.into_iter().fold(0.0, f32::max));
    let distance = distance.min((MAX_SUN_INTENSITY / strongest).sqrt());
    let square = distance * distance;
    let far = Emitter { position: from(distance), strength: times(square), inner: (square / area) as f32, ..entry };
    let flux = luminance(irradiance) * area;
    let LightRecord { vertex, .. } = punctual(far, EMIT_SUN, flux);
    LightRecord { entry, flux, position: entry.position.into(), radius: radius as f32, vertex, is_thin: false }
}

/// A sky. Its light subpaths start on disks beside the scene, one for each direction.
fn sky(image: &SkyImage, radiance: [f32; 3], around: &Sphere) -> LightRecord {
    let (radius, area) = disk(around);
    let position = around.centre.to_array();
    let entry =
        Emitter { kind: EmitterKind::Sky as u32, position, outer: radius as f32, ..bytemuck::Zeroable::zeroed() };
    let integral = image.integral();
    let flux = luminance([0, 1, 2].map(|k| (integral[k] * f64::from(radiance[k])) as f32)) * area;
    LightRecord { entry, flux, position: around.centre, radius: radius as f32, vertex: None, is_thin: false }
}

/// Radius and area of the disks on which light from infinitely far away starts. They are a little larger than the sphere, so that
/// no surface touches them.
fn disk(around: &Sphere) -> (f64, f64) {
    let radius = 1.001 * f64::from(around.radius);
    (radius, PI * radius * radius)
}

/// A punctual light. Its light vertex has depth 0 (s = 1) and the emission profile `profile`.
fn punctual(entry: Emitter, profile: u32, flux: f64) -> LightRecord {
    let vertex = PathVertex {
        position: entry.position,
        throughput: entry.strength,
        material: profile,
        normal: [0.0, 0.0, 1.0],
        geometric: [0.0, 0.0, 1.0],
        to_previous: entry.direction,
        point_words: [entry.outer.to_bits(), entry.inner.to_bits(), 0],
        flags: VERTEX_EMITTER | VERTEX_DETERMINISTIC | VERTEX_VALID,
        ..bytemuck::Zeroable::zeroed()
    };
    LightRecord { entry, flux, position: entry.position.into(), radius: 0.0, vertex: Some(vertex), is_thin: false }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(kind: LightKind) -> LightRecord {
        let light = Light { node: "light".into(), position: DVec3::splat(2.0), direction: DVec3::NEG_Z, kind };
        let around = Sphere { centre: Vec3::X, radius: 0.5 };
        LightRecord::new(&light, &SkyImage::constant(), &RenderSpace { origin: DVec3::ZERO, unit: 2.0 }, &around)
    }

    /// The facts about each kind in `scene::LightKind` agree with the record for the device.
    #[test]
    fn records_agree_with_the_kinds_of_the_scene() {
        let white = [1.0; 3];
        for kind in [
            LightKind::Point { intensity: white },
            LightKind::Spot { intensity: white, inner: 0.1, outer: 0.2 },
            LightKind::Beam { power: white, radius: 0.5 },
            LightKind::Beam { power: white, radius: 0.0 },
        ] {
            let r = record(kind);
            assert_eq!(Some(2.0 * f64::from(r.radius)), kind.radius(), "{kind:?}");
            assert_eq!(r.vertex.is_none(), kind.needs_light_subpaths(), "{kind:?}");
            assert_eq!(r.is_thin, kind == LightKind::Beam { power: white, radius: 0.0 }, "{kind:?}");
            assert_eq!((r.position, Vec3::from(r.entry.position)), (Vec3::ONE, Vec3::ONE));
        }
    }

    #[test]
    fn the_flux_of_a_light_is_its_intensity_over_its_directions() {
        let flux = |kind| record(kind).flux * 4.0;
        let [inner, outer] = [0.3f32, 0.3];
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-6;
        assert!(close(flux(LightKind::Point { intensity: [3.0; 3] }), 12.0 * PI));
        let cap = 2.0 * PI * (1.0 - f64::from(outer).cos());
        assert!(close(flux(LightKind::Spot { intensity: [3.0; 3], inner, outer }), 3.0 * cap));
        assert!(close(flux(LightKind::Beam { power: [3.0; 3], radius: 0.1 }), 3.0));
    }

    /// The far vertex gives the scene the irradiance of the sun. Seen from the scene, its density equals the density on the disk.
    #[test]
    fn the_vertex_of_a_sun_shines_as_its_disk_does() {
        let r = record(LightKind::Directional { irradiance: [3.0; 3] });
        let vertex = r.vertex.expect("a sun can be connected");
        let distance2 = f64::from(Vec3::from(vertex.position).distance_squared(Vec3::X));
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-5, "{a} {b}");
        close(f64::from(vertex.throughput[0]) / distance2, 3.0);
        let area = PI * f64::from(r.entry.outer).powi(2);
        close(f64::from(f32::from_bits(vertex.point_words[1])) / distance2, 1.0 / area);
        close(f64::from(r.entry.strength[0]), 3.0 * area);
        close(r.flux, 3.0 * area);
        // The light shines along -Z, so its disk is on the side of +Z, outside the sphere.
        assert!(r.position.x == 1.0 && r.position.z > 0.5 && r.radius > 0.5 && r.radius < 0.51, "{:?}", r.position);
    }

    /// Integrates the falloff of KHR_lights_punctual numerically over rings of the sphere.
    #[test]
    fn the_flux_of_a_spot_is_the_integral_of_its_falloff() {
        for (inner, outer) in [(0.0f32, 0.01f32), (0.0, 0.5), (0.3, 0.5), (0.2, 1.5), (0.0, 3.1), (1.0, 1.01)] {
            let (full, none) = (f64::from(inner).cos(), f64::from(outer).cos());
            let falloff = |cosine: f64| ((cosine - none) / (full - none)).clamp(0.0, 1.0).powi(2);
            let rings = 20_000;
            let width = f64::from(outer) / f64::from(rings);
            let angles = (0..rings).map(|i| (f64::from(i) + 0.5) * width);
            let solid_angle: f64 = angles.map(|a| falloff(a.cos()) * 2.0 * PI * a.sin() * width).sum();
            let flux = record(LightKind::Spot { intensity: [3.0; 3], inner, outer }).flux * 4.0;
            let error = flux / (3.0 * solid_angle) - 1.0;
            assert!(error.abs() < 1e-5, "{inner} {outer}: {error}");
        }
    }
}

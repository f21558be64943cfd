//! Emitters: emissive triangles, point and spot lights, suns and the sky, to which a path can be connected; and beams, which emit
//! in one direction only.

use std::f64::consts::PI;

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::{Light, LightKind, SkyImage};

use super::flight::{Flight, PathVertex};
use super::geometry::{Hit, Ray};
use super::media::{Channel, Region};
use super::rgb;
use super::world::{Vertex, World};

/// Direct light from one sampled emitter.
pub struct LightSample {
    pub position: DVec3,
    /// Unit vector from the vertex to the emitter.
    pub wi: DVec3,
    pub distance: f64,
    /// Radiance over `pdf`. Without a `pdf`: irradiance on a surface that faces the light, over the probability of choosing the
    /// light. The caller multiplies by f cos at the vertex, and by visibility.
    pub weight: [f64; 3],
    /// Density per steradian, including the probability of choosing the emitter. `None` for lights that no ray can hit.
    pub pdf: Option<f64>,
    /// The emitter is infinitely far away; `position` and `distance` only serve shadow rays.
    pub far: bool,
}

/// All emitters of a scene. [`EmitterSet::sample`] gives the same probability to every punctual light (suns and the sky included)
/// and to the set of all emissive triangles.
pub struct EmitterSet<'a> {
    world: &'a World<'a>,
    punctual: Vec<&'a Light>,
    /// Length in metres of a shadow ray that leaves the scene.
    outside: f64,
    pub beams: Vec<&'a Light>,
    /// Emissive triangles, each with the sum of the areas up to its own.
    luminous: Vec<(u32, f64)>,
}

impl<'a> EmitterSet<'a> {
    pub fn new(world: &'a World<'a>) -> EmitterSet<'a> {
        let shining = || world.scene.lights.iter().filter(|l| world.shines(&l.node));
        let is_beam = |l: &&Light| matches!(l.kind, LightKind::Beam { .. });
        let mut luminous = Vec::new();
        let mut area = 0.0;
        for (i, triangle) in world.geometry.triangles.iter().enumerate() {
            let instance = &world.scene.instances[triangle.instance as usize];
            let material = world.scene.meshes[instance.mesh as usize].material;
            if world.scene.materials[material as usize].emission != [0.0; 3] && world.shines(&instance.node) {
                area += triangle.area();
                luminous.push((i as u32, area));
            }
        }
        let (beams, punctual) = shining().partition(is_beam);
        // Without surfaces, any length will do.
        let outside = Some(2.0 * world.scene.diagonal()).filter(|&length| length > 0.0).unwrap_or(1.0);
        EmitterSet { world, punctual, outside, beams, luminous }
    }

    /// Radiance of the sky in the direction `w` (unit), and the density per steradian with which [`EmitterSet::sample`] draws `w`.
    /// `None` if there is no sky.
    pub fn sky(&self, w: DVec3) -> Option<([f64; 3], f64)> {
        let LightKind::Sky { radiance } = self.punctual.iter().find(|light| light.kind.is_sky())?.kind else {
            return None;
        };
        let texel = self.world.scene.sky.as_ref().map_or([1.0; 3], |image: &SkyImage| image.towards(w));
        let seen = rgb(|k| f64::from(radiance[k]) * f64::from(texel[k]));
        Some((seen, 1.0 / (4.0 * PI * self.choices() as f64)))
    }

    fn choices(&self) -> usize {
        self.punctual.len() + usize::from(!self.luminous.is_empty())
    }

    /// Density per steradian with which [`EmitterSet::sample`] draws the emissive point `vertex`, seen from `vertex.wo` at
    /// `distance`.
    pub fn pdf(&self, vertex: &Vertex, distance: f64) -> f64 {
        let Some(&(_, area)) = self.luminous.last() else { return 0.0 };
        let cos = vertex.normal.dot(vertex.wo).abs();
        distance * distance / (cos * area * self.choices() as f64)
    }

    /// Samples one emitter, as seen from `from`, without a test of visibility. `None` if no light of the sample goes to `from`.
    pub fn sample(&self, from: DVec3, pcg: &mut Pcg) -> Option<LightSample> {
        if self.choices() == 0 {
            return None;
        }
        let chosen = pcg.below(self.choices());
        let choices = self.choices() as f64;
        if let Some(light) = self.punctual.get(chosen) {
            if let LightKind::Directional { irradiance } = light.kind {
                let (wi, distance) = (-light.direction, self.outside);
                let weight = irradiance.map(|e| f64::from(e) * choices);
                return Some(LightSample {
                    position: from + wi * distance,
                    wi,
                    distance,
                    weight,
                    pdf: None,
                    far: true,
                });
            }
            if light.kind.is_sky() {
                // All directions are equally likely, whatever the image of the sky.
                let (height, turn) = (2.0 * pcg.uniform() - 1.0, 2.0 * PI * pcg.uniform());
                let flat = (1.0 - height * height).sqrt();
                let (wi, distance) = (DVec3::new(flat * turn.cos(), height, flat * turn.sin()), self.outside);
                let (radiance, pdf) = self.sky(wi)?;
                let weight = radiance.map(|l| l / pdf);
                return Some(LightSample {
                    position: from + wi * distance,
                    wi,
                    distance,
                    weight,
                    pdf: Some(pdf),
                    far: true,
                });
            }
            let distance = (light.position - from).length();
            let wi = (light.position - from) / distance;
            let weight = intensity(light, -wi)?.map(|i| i * choices / (distance * distance));
            return Some(LightSample { position: light.position, wi, distance, weight, pdf: None, far: false });
        }
        let &(_, area) = self.luminous.last()?;
        let target = pcg.uniform() * area;
        let (triangle, _) = self.luminous[self.luminous.partition_point(|&(_, sum)| sum <= target)];
        let (root, v) = (pcg.uniform().sqrt(), pcg.uniform());
        let hit = Hit { t: 0.0, triangle, u: root * (1.0 - v), v: root * v };
        let surface = self.world.geometry.surface(&hit);
        let distance = (surface.position - from).length();
        let wi = (surface.position - from) / distance;
        let pdf = distance * distance / (surface.geometric.dot(wi).abs() * area * choices);
        let there = self.world.coverage(&surface);
        let weight = self.world.emitted(&surface, -wi).map(|e| e * there / pdf);
        let lit = weight.iter().any(|&w| w > 0.0) && pdf.is_finite();
        lit.then_some(LightSample { position: surface.position, wi, distance, weight, pdf: Some(pdf), far: false })
    }
}

/// Radiant intensity of a point or spot light in direction `away`, a unit vector from the light. `None` if no light goes there.
fn intensity(light: &Light, away: DVec3) -> Option<[f64; 3]> {
    match light.kind {
        LightKind::Point { intensity } => Some(intensity.map(f64::from)),
        LightKind::Spot { intensity, inner, outer } => {
            let (inner, outer) = (f64::from(inner).cos(), f64::from(outer).cos());
            let cos = light.direction.dot(away);
            let fall = ((cos - outer) / (inner - outer).max(1e-12)).clamp(0.0, 1.0).powi(2);
            (fall > 0.0).then(|| intensity.map(|i| f64::from(i) * fall))
        }
        LightKind::Beam { .. } | LightKind::Directional { .. } | LightKind::Sky { .. } => None,
    }
}

/// A spot of a beam: a point in a medium or on a surface where the beam scatters. Mirrors and glass may redirect the beam before
/// the spot. Sensor paths connect to spots as to emitters.
pub struct BeamSpot<'a> {
    /// The vertex, seen from the direction of the incident beam.
    pub vertex: PathVertex<'a>,
    /// Power of the beam times the weights of the mirrors and glass before the spot. On a surface it is the irradiance over the
    /// density per area.
    power: [f64; 3],
    /// Travel time from the origin of the beam to the spot, in metres of optical path.
    pub tau: f64,
    /// Number of segments from the beam's origin to the spot.
    pub segments: u32,
    /// The region into which the spot scatters light.
    pub region: Region,
    /// Density per area of the point. `None` if [`straight`] cannot find the beam from a sensor path that hits this point.
    pub density: Option<f64>,
}

impl BeamSpot<'_> {
    /// Radiance towards the unit vector `w`, times the cosine at the spot, over the density per area. The caller divides by the
    /// squared distance.
    pub fn towards(&self, w: DVec3) -> [f64; 3] {
        let Some(v) = self.vertex.surface() else {
            return (DVec3::from(self.power) * self.vertex.scattered(w)).into();
        };
        // The scattered light has the cosine to the shading normal, but the sampled area has the cosine to the geometric normal.
        let cosines = v.cos(v.wo) / v.normal.dot(v.wo) * v.normal.dot(w).max(0.0);
        let f = v.eval(w);
        rgb(|k| self.power[k] * f[k] * cosines)
    }
}

/// Radius in metres and power of a beam. Panics if `light` is not a beam.
pub fn beam(light: &Light) -> (f64, [f64; 3]) {
    let LightKind::Beam { power, radius } = light.kind else { panic!("not a beam") };
    (f64::from(radius), power.map(f64::from))
}

/// Traces one ray of a beam for at most `max_depth` segments, as long as mirrors reflect it or glass refracts it. Returns a spot
/// for every vertex that is not `only_delta`. The flight of the ray is random in media, so it ends at a point of the medium or at a
/// surface.
pub fn spots<'a>(
    world: &'a World<'a>,
    light: &Light,
    max_depth: u32,
    channel: Channel,
    pcg: &mut Pcg,
) -> Vec<BeamSpot<'a>> {
    let (radius, mut power) = beam(light);
    let x = light.direction.any_orthonormal_vector();
    let (r, angle) = (radius * pcg.uniform().sqrt(), 2.0 * PI * pcg.uniform());
    let offset = x * (r * angle.cos()) + light.direction.cross(x) * (r * angle.sin());
    let mut ray = Ray::new(light.position + offset, light.direction);
    let (mut tau, mut region) = (0.0, world.region(ray));
    let mut found = Vec::new();
    for segments in 1..=max_depth {
        let Flight::Vertex { vertex, distance, region: before } = world.fly(ray, region, channel, pcg) else { break };
        tau += before.group_index * distance;
        region = before;
        let sample = vertex.surface().and_then(|surface| {
            let sample = surface.sample(pcg)?;
            let next = if sample.refracted { world.beyond(surface, sample.wi, region) } else { region };
            sample.delta.then_some((Ray::new(surface.position, sample.wi), sample.weight, next))
        });
        if !vertex.only_delta() {
            let direct = segments == 1 && radius > 0.0;
            let area = PI * radius * radius;
            let density = vertex.surface().filter(|_| direct).map(|surface| surface.normal.dot(surface.wo) / area);
            found.push(BeamSpot { vertex, power, tau, segments, region, density });
        }
        let Some((onwards, weight, next)) = sample else { break };
        (ray, region) = (onwards, next);
        (0..3).for_each(|k| power[k] *= weight[k]);
    }
    found
}

/// Light that arrives at a vertex in `region` straight from a beam. Returns the distance along the beam to its origin, in metres
/// (geometric, not optical), and the irradiance times the BSDF or phase function. `None` if the radius is 0, if the vertex is outside
/// the beam, or if the beam is occluded.
pub fn straight(
    world: &World,
    light: &Light,
    vertex: &PathVertex,
    region: Region,
    channel: Channel,
    pcg: &mut Pcg,
) -> Option<(f64, [f64; 3])> {
    let (radius, power) = beam(light);
    let position = vertex.position();
    let distance = (position - light.position).dot(light.direction);
    let foot = position - light.direction * distance;
    if distance <= 0.0 || radius == 0.0 || (foot - light.position).length() > radius {
        return None;
    }
    let (f, cos) = vertex.factors(-light.direction);
    let irradiance = cos / (PI * radius * radius);
    let value = rgb(|k| f[k] * power[k] * irradiance);
    if value == [0.0; 3] {
        return None;
    }
    let passed = world.transmittance([position, foot], false, region, channel, pcg);
    (passed > 0.0).then_some((distance, value.map(|v| v * passed)))
}

//! Everything that emits, and the probabilities with which light subpaths start there.

use std::collections::BTreeMap;

use glam::Vec3;

use super::geometry::Geometry;
use super::place::Place;
use crate::scene::{LightKind, Scene};
use crate::settings::Emitters;
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{Emitter, PathVertex};

/// Emitters as the kernels read them.
pub struct EmitterSet {
    /// Alias table (Vose 1991) over flux.
    pub table: Vec<Emitter>,
    /// Points and spots as light vertices: connected one by one at every shade point.
    pub deterministic: Vec<PathVertex>,
    /// Box around all points that emit, in device coordinates.
    pub lo: Vec3,
    pub hi: Vec3,
    /// Surfaces that emit: their points go to the 3D tree.
    pub has_area: bool,
    pub has_beam: bool,
    /// Beams of zero radius: the last of the table.
    pub thin_beams: u32,
    /// Node and luminance-weighted power in W of every node that shines.
    pub powers: BTreeMap<String, f64>,
}

/// Flux bounds the choice only; any positive weight is unbiased.
pub(super) fn luminance(c: [f32; 3]) -> f64 {
    0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2])
}

impl EmitterSet {
    /// Collects the emitters that are selected; sets `emission_density` of the materials. Empty if nothing emits.
    pub fn new(scene: &Scene, selected: &Emitters, place: &Place, geometry: &mut Geometry) -> EmitterSet {
        let mut set = EmitterSet {
            table: vec![],
            deterministic: vec![],
            lo: Vec3::INFINITY,
            hi: Vec3::NEG_INFINITY,
            has_area: false,
            has_beam: false,
            thin_beams: 0,
            powers: BTreeMap::new(),
        };
        let mut weights = vec![];
        let densities = set.add_triangles(scene, geometry, &mut weights);
        set.add_lights(scene, selected, place, &mut weights);
        let total: f64 = weights.iter().sum();
        for (entry, weight) in set.table.iter_mut().zip(&weights) {
            entry.select_pdf = (weight / total) as f32;
        }
        for (material, density) in geometry.materials.iter_mut().zip(densities) {
            material.emission_density = (density / total) as f32;
        }
        for vertex in &mut set.deterministic {
            vertex.select_pdf = set.table[vertex.owner as usize].select_pdf;
        }
        fill_alias_table(&mut set.table, &weights, total);
        for power in set.powers.values_mut() {
            *power *= place.unit * place.unit;
        }
        set
    }

    /// Emissive triangles, weighted by flux. Returns the flux an area of each material.
    fn add_triangles(&mut self, scene: &Scene, geometry: &Geometry, weights: &mut Vec<f64>) -> Vec<f64> {
        let exitance: Vec<f64> = geometry
            .materials
            .iter()
            .map(|m| {
                let sides = if m.flags & MATERIAL_DOUBLE_SIDED != 0 { 2.0 } else { 1.0 };
                sides * std::f64::consts::PI * luminance(m.emission) * mean_texel(scene, m.emission_texture)
            })
            .collect();
        let mut by_instance = vec![0.0; geometry.instances.len()];
        let flux_of = |i: usize| exitance[(geometry.triangles[i].material & TRIANGLE_MATERIAL) as usize];
        let mut shining: Vec<usize> = (0..geometry.triangles.len()).filter(|&i| flux_of(i) > 0.0).collect();
        // In the order of the scene: that of the hierarchy follows from rounding, and with it the first draw of every light path.
        shining.sort_unstable_by_key(|&i| geometry.bvh.order[i]);
        for i in shining {
            let (t, flux) = (&geometry.triangles[i], flux_of(i));
            let [a, b, c] = [t.v0, t.v1, t.v2].map(|p| Vec3::from(p).as_dvec3());
            let area = 0.5 * (b - a).cross(c - a).length();
            if area > 0.0 {
                self.table.push(Emitter { triangle: i as u32, ..entry(EMITTER_TRIANGLE) });
                weights.push(flux * area);
                by_instance[t.instance as usize] += flux * area;
                for p in [t.v0, t.v1, t.v2] {
                    self.enclose(p.into(), 0.0);
                }
                self.has_area = true;
            }
        }
        for (instance, power) in scene.instances.iter().zip(by_instance).filter(|(_, power)| *power > 0.0) {
            self.add_power(&instance.node, power);
        }
        exitance
    }

    fn add_power(&mut self, node: &str, power: f64) {
        *self.powers.entry(node.to_string()).or_default() += power;
    }

    fn add_lights(&mut self, scene: &Scene, selected: &Emitters, place: &Place, weights: &mut Vec<f64>) {
        let is_thin = |kind: &LightKind| matches!(kind, LightKind::Beam { radius, .. } if *radius == 0.0);
        let (thin, others): (Vec<_>, Vec<_>) = scene.lights.iter().partition(|light| is_thin(&light.kind));
        for light in others.into_iter().chain(thin) {
            if !selected.include(&light.node) {
                continue;
            }
            let position = place.point(light.position);
            let direction = light.direction.as_vec3();
            let stand = Emitter { position: position.into(), direction: direction.into(), ..entry(EMITTER_POINT) };
            let on_device = |watts: [f32; 3]| watts.map(|x| place.flux(x));
            let (emitter, flux, radius) = match light.kind {
                LightKind::Point { intensity } => {
                    let intensity = on_device(intensity);
                    (Emitter { strength: intensity, ..stand }, 4.0 * std::f64::consts::PI * luminance(intensity), 0.0)
                }
                LightKind::Spot { intensity, inner, outer } => {
                    let (intensity, inner, outer) = (on_device(intensity), cap_height(inner), cap_height(outer));
                    let flux = std::f64::consts::PI * (inner + outer) * luminance(intensity);
                    let [inner, outer] = [inner, outer].map(|height| height as f32);
                    (Emitter { kind: EMITTER_SPOT, strength: intensity, inner, outer, ..stand }, flux, 0.0)
                }
                LightKind::Beam { power, radius } => {
                    self.has_beam = true;
                    let (power, radius) = (on_device(power), place.length(radius.into()) as f32);
                    (Emitter { kind: EMITTER_BEAM, strength: power, outer: radius, ..stand }, luminance(power), radius)
                }
                LightKind::Directional { .. } => continue,
            };
            if flux <= 0.0 {
                continue;
            }
            self.enclose(position, radius);
            self.add_power(&light.node, flux);
            self.thin_beams += u32::from(is_thin(&light.kind));
            if emitter.kind != EMITTER_BEAM {
                self.deterministic.push(punctual_vertex(&emitter, self.table.len() as u32));
            }
            self.table.push(emitter);
            weights.push(flux);
        }
    }

    fn enclose(&mut self, p: Vec3, radius: f32) {
        self.lo = self.lo.min(p - radius);
        self.hi = self.hi.max(p + radius);
    }
}

/// 1 - cosine of an angle in radians; what is left of a small one.
fn cap_height(angle: f32) -> f64 {
    2.0 * (0.5 * f64::from(angle)).sin().powi(2)
}

fn entry(kind: u32) -> Emitter {
    Emitter { kind, ..bytemuck::Zeroable::zeroed() }
}

/// The light itself as a vertex of depth 0 (s = 1).
fn punctual_vertex(e: &Emitter, owner: u32) -> PathVertex {
    let spot = e.kind == EMITTER_SPOT;
    PathVertex {
        position: e.position,
        throughput: e.strength,
        material: if spot { EMIT_SPOT } else { EMIT_POINT },
        normal: [0.0, 0.0, 1.0],
        geometric: [0.0, 0.0, 1.0],
        to_previous: e.direction,
        base_color: [e.outer, e.inner, 0.0],
        flags: VERTEX_EMITTER | VERTEX_DETERMINISTIC | VERTEX_VALID,
        eta: 1.0,
        owner,
        ..bytemuck::Zeroable::zeroed()
    }
}

/// Mean luminance of a texture's texels, 1 without one.
fn mean_texel(scene: &Scene, texture: u32) -> f64 {
    let Some(texture) = scene.textures.get(texture as usize) else { return 1.0 };
    let image = &scene.images[texture.image as usize];
    let linear = |c: u8| {
        let x = f32::from(c) / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    };
    let sum: f64 = image.rgba.iter().map(|c| luminance([linear(c[0]), linear(c[1]), linear(c[2])])).sum();
    sum / image.rgba.len().max(1) as f64
}

fn fill_alias_table(table: &mut [Emitter], weights: &[f64], total: f64) {
    let n = table.len() as f64;
    let mut scaled: Vec<f64> = weights.iter().map(|w| w / total * n).collect();
    let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..table.len()).partition(|&i| scaled[i] < 1.0);
    for (i, e) in table.iter_mut().enumerate() {
        (e.keep, e.other) = (1.0, i as u32);
    }
    while let (Some(&s), Some(&l)) = (small.last(), large.last()) {
        small.pop();
        table[s].keep = scaled[s] as f32;
        table[s].other = l as u32;
        scaled[l] -= 1.0 - scaled[s];
        if scaled[l] < 1.0 {
            large.pop();
            small.push(l);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alias_table_returns_the_weights() {
        let weights = [1.0, 0.0, 3.0, 0.5, 10.0, 1e-3];
        let total: f64 = weights.iter().sum();
        let mut table = vec![entry(EMITTER_POINT); weights.len()];
        fill_alias_table(&mut table, &weights, total);
        let mut got = vec![0.0; weights.len()];
        for (i, e) in table.iter().enumerate() {
            got[i] += f64::from(e.keep) / table.len() as f64;
            got[e.other as usize] += f64::from(1.0 - e.keep) / table.len() as f64;
        }
        for (g, w) in got.iter().zip(weights) {
            assert!((g - w / total).abs() < 1e-6, "{got:?}");
        }
    }
}

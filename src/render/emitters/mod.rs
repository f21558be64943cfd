//! All emitters of the scene, and the probability that a light subpath starts at each of them.

mod alias;
mod kind;
mod light;
mod power;
mod sky;
mod triangle;

use std::collections::{BTreeMap, HashMap};
use std::f64::consts::PI;

use glam::{BVec3, DVec3, Vec3};

use super::geometry::Geometry;
use super::solids::Solids;
use super::space::RenderSpace;
pub use crate::image::luminance;
use crate::scene::{Light, Medium, Scene, SkyImage, surrounding_indices};
use crate::settings::Emitters;
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{Emitter, NONE, PathVertex, Triangle};
pub use kind::EmitterKind;
use light::{LightRecord, Sphere};
use power::Powers;
pub use sky::table as sky_table;

/// The emitters in the layout that the kernels read.
pub struct EmitterSet {
    /// Alias table over flux, in which beams have at least [`MIN_BEAM_SHARE`]. First come triangles, then lights without a surface;
    /// beams of zero radius are last.
    pub table: Vec<Emitter>,
    /// Point lights, spot lights and suns as light vertices. Each shade point connects to all of them, or to a selection if they are
    /// many.
    pub deterministic: Vec<PathVertex>,
    /// Bounding box of all emitting points, in render space.
    pub lo: Vec3,
    pub hi: Vec3,
    /// Indices of the emissive triangles in [`Geometry::triangles`]. Their points go to the 3D tree, or to the single tree.
    pub triangles: Vec<u32>,
    /// Bounding sphere (centre, radius) of the starting points of each light without a surface, in render space.
    pub lights: Vec<(Vec3, f32)>,
    /// Index in [`Scene::lights`] of each light without a surface, in the order of `table`.
    pub sources: Vec<usize>,
    /// Number of beams of zero radius: all subpaths of such a beam begin with the same ray.
    pub thin_beams: u32,
    /// Whether a light is infinitely far away, so that its light has no travel time.
    pub has_distant: bool,
    /// The sky for the kernels (`shaders/shared/sky.wgsl`); empty if there is none.
    pub sky: Vec<[u32; 4]>,
    /// Whether the search for the glass around emitters was stopped, so that some count as being outside of glass.
    pub has_unplaced: bool,
    /// For each of [`Geometry::materials`], the density per area at which light subpaths start on its surfaces; 0 if it does not emit.
    pub densities: Vec<f32>,
    /// Luminance-weighted power in W of every node that emits, by node name. A sun or a sky has none.
    pub powers: BTreeMap<String, f64>,
}

impl EmitterSet {
    /// Collects the selected emitters. The set is empty if nothing emits.
    pub fn new(
        scene: &Scene,
        selected: &Emitters,
        space: &RenderSpace,
        geometry: &Geometry,
        solids: &Solids,
    ) -> EmitterSet {
        let mut set = EmitterSet {
            table: vec![],
            deterministic: vec![],
            lo: Vec3::INFINITY,
            hi: Vec3::NEG_INFINITY,
            triangles: vec![],
            lights: vec![],
            sources: vec![],
            thin_beams: 0,
            has_distant: false,
            sky: vec![],
            has_unplaced: false,
            densities: vec![],
            powers: BTreeMap::new(),
        };
        let mut weights = vec![];
        let exitances = set.add_triangles(scene, geometry, &mut weights);
        set.add_lights(scene, selected, space, geometry, &mut weights);
        favour_beams(&set.table, &mut weights);
        let total: f64 = weights.iter().sum();
        for (entry, weight) in set.table.iter_mut().zip(&weights) {
            entry.select_pdf = (weight / total) as f32;
        }
        set.densities = exitances.into_iter().map(|flux| (flux / total) as f32).collect();
        set.place_in_solids(geometry, solids);
        let [_, surrounding] = surrounding_indices(&scene.media);
        for vertex in &mut set.deterministic {
            let entry = &set.table[vertex.owner as usize];
            let (eta, solid) = geometry.around(entry.solid, surrounding);
            vertex.eta = eta;
            vertex.flags |= solid << VERTEX_SOLID_SHIFT;
            vertex.select_pdf = entry.select_pdf;
        }
        let shines = |light: &&Light| selected.include(&light.node);
        if let Some(entry) = set.table.iter().find(|entry| EmitterKind::of(entry) == EmitterKind::Sky)
            && let Some(light) = scene.lights.iter().filter(shines).find(|light| light.kind.is_sky())
        {
            let disk_pdf = 1.0 / (PI * f64::from(entry.outer).powi(2));
            let constant = SkyImage::constant();
            let image = scene.sky.as_ref().unwrap_or(&constant);
            set.sky = sky::table(image, light.kind.strength(), entry.select_pdf, disk_pdf as f32);
        }
        alias::fill(&mut set.table, &weights, total);
        for power in set.powers.values_mut() {
            *power *= space.unit * space.unit;
        }
        set
    }

    /// Whether any surface emits.
    pub fn has_area(&self) -> bool {
        !self.triangles.is_empty()
    }

    /// Whether at least one emitter can be connected to shade points. Points of beams cannot.
    pub fn has_connectable(&self) -> bool {
        self.table.iter().any(|entry| EmitterKind::of(entry).is_connectable())
    }

    /// Probability that a light subpath starts from a beam.
    pub fn beam_share(&self) -> f64 {
        let beams = self.table.iter().filter(|entry| !EmitterKind::of(entry).is_connectable());
        beams.map(|entry| f64::from(entry.select_pdf)).sum()
    }

    /// Adds the emissive triangles, weighted by flux. Returns the flux per area of each material.
    fn add_triangles(&mut self, scene: &Scene, geometry: &Geometry, weights: &mut Vec<f64>) -> Vec<f64> {
        let exitances = triangle::exitances(scene, geometry);
        let mut by_instance = vec![0.0; geometry.instances.len()];
        let triangles = triangle::emissive_triangles(geometry, &exitances);
        let powers = Powers::new(scene, geometry, triangles.len());
        for t in triangles {
            by_instance[t.instance as usize] += powers.of(&t);
            self.triangles.push(t.entry.triangle);
            self.table.push(t.entry);
            weights.push(t.flux);
            t.corners.into_iter().for_each(|p| self.enclose(p, 0.0));
        }
        for (instance, power) in scene.instances.iter().zip(by_instance).filter(|(_, power)| *power > 0.0) {
            self.add_power(&instance.node, power);
        }
        exitances
    }

    fn add_lights(
        &mut self,
        scene: &Scene,
        selected: &Emitters,
        space: &RenderSpace,
        geometry: &Geometry,
        weights: &mut Vec<f64>,
    ) {
        let lights = || scene.lights.iter().enumerate().filter(|(_, light)| selected.include(&light.node));
        let around = match lights().any(|(_, light)| light.kind.is_distant()) {
            true => sphere_around(geometry, scene, space),
            false => Sphere { centre: Vec3::ZERO, radius: 0.0 },
        };
        let constant = SkyImage::constant();
        let sky = scene.sky.as_ref().unwrap_or(&constant);
        let records = lights().map(|source| (source, LightRecord::new(source.1, sky, space, &around)));
        let emitting = records.filter(|(_, record)| record.flux > 0.0);
        let (thin, others): (Vec<_>, Vec<_>) = emitting.partition(|(_, record)| record.is_thin);
        self.thin_beams = thin.len() as u32;
        for ((index, light), record) in others.into_iter().chain(thin) {
            self.sources.push(index);
            self.enclose(record.position, record.radius);
            self.lights.push((record.position, record.radius));
            match light.kind.is_distant() {
                true => self.has_distant = true,
                false => self.add_power(&light.node, record.flux),
            }
            let owner = self.table.len() as u32;
            self.deterministic.extend(record.vertex.map(|vertex| PathVertex { owner, ..vertex }));
            self.table.push(record.entry);
            weights.push(record.flux);
        }
    }

    /// Sets the glass around each emitter. All triangles of an instance are in the same glass as the front of the first of them.
    fn place_in_solids(&mut self, geometry: &Geometry, solids: &Solids) {
        let mut steps = MAX_STEPS;
        if solids.is_empty() {
            self.table.iter_mut().for_each(|entry| entry.solid = NONE);
            return;
        }
        let mut by_instance = HashMap::new();
        for entry in &mut self.table {
            entry.solid = match EmitterKind::of(entry) {
                EmitterKind::Triangle => {
                    let t = &geometry.triangles[entry.triangle as usize];
                    *by_instance.entry(t.instance).or_insert_with(|| solids.material_within(in_front_of(t), &mut steps))
                }
                kind if kind.is_distant() => NONE,
                _ => solids.material_within(entry.position.into(), &mut steps),
            };
        }
        self.has_unplaced = steps == 0;
    }

    fn add_power(&mut self, node: &str, power: f64) {
        *self.powers.entry(node.to_string()).or_default() += power;
    }

    fn enclose(&mut self, p: Vec3, radius: f32) {
        self.lo = self.lo.min(p - radius);
        self.hi = self.hi.max(p + radius);
    }
}

/// Maximum number of steps of the search for the glass around emitters, see [`Solids::material_within`].
const MAX_STEPS: usize = 1 << 30;

/// A point just in front of a triangle. The triangle itself may belong to glass that shines.
fn in_front_of(t: &Triangle) -> Vec3 {
    let [a, b, c] = [t.v0, t.v1, t.v2].map(Vec3::from);
    let side = if t.material & TRIANGLE_MIRRORED != 0 { -1.0 } else { 1.0 };
    let normal = side * (b - a).cross(c - a).normalize_or_zero();
    // Further away than rounding errors of the coordinates.
    let distance = a.abs().max(b.abs()).max(c.abs()).max_element() / (1 << 16) as f32;
    (a + b + c) / 3.0 + distance * normal
}

/// Smallest share of the light subpaths that start at beams, if there are any. No other strategy finds the light of a beam, so the light
/// of a weak beam beside a strong lamp would rest on very few subpaths.
const MIN_BEAM_SHARE: f64 = 1.0 / 16.0;

/// Scales the weights of all beams so that beams have at least [`MIN_BEAM_SHARE`] of the sum of all weights.
fn favour_beams(table: &[Emitter], weights: &mut [f64]) {
    let is_beam = |entry: &Emitter| !EmitterKind::of(entry).is_connectable();
    let of_beams: f64 = table.iter().zip(&*weights).filter(|(entry, _)| is_beam(entry)).map(|(_, weight)| weight).sum();
    let of_others = weights.iter().sum::<f64>() - of_beams;
    let least = of_others * MIN_BEAM_SHARE / (1.0 - MIN_BEAM_SHARE);
    if of_beams > 0.0 && of_beams < least {
        let beams = table.iter().zip(weights).filter(|(entry, _)| is_beam(entry));
        beams.for_each(|(_, weight)| *weight *= least / of_beams);
    }
}

/// Minimum radius of the sphere around the scene, in units of render space. Its area must not underflow.
const MIN_RADIUS: f32 = 1e-9;

/// A sphere around all triangles and all media with bounds, in render space.
fn sphere_around(geometry: &Geometry, scene: &Scene, space: &RenderSpace) -> Sphere {
    let triangles = geometry.triangles.iter().flat_map(|t| [t.v0, t.v1, t.v2].map(Vec3::from));
    let boxes = scene.media.iter().filter_map(Medium::extent);
    let media = boxes
        .flat_map(|[lo, hi]| (0..8).map(move |k| DVec3::select(BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), hi, lo)));
    let corners: Vec<Vec3> = triangles.chain(media.map(|corner| space.point(corner))).collect();
    let ends = corners.iter().map(|&p| (p, p)).reduce(|(lo, hi), (p, _)| (lo.min(p), hi.max(p)));
    let centre = ends.map_or(Vec3::ZERO, |(lo, hi)| 0.5 * (lo + hi));
    let radius = corners.iter().map(|p| p.distance(centre)).fold(MIN_RADIUS, f32::max);
    Sphere { centre, radius }
}

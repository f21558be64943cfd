//! Where photons start: light of lamps without a surface that first meets a smooth object.

use std::collections::BTreeSet;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::render::emitters::luminance;
use crate::render::geometry::Geometry;
use crate::render::missing_light::walk::Ray;
use crate::render::missing_light::{ON_SQUARE, is_smooth};
use crate::render::prepared_scene::PreparedScene;
use crate::render::split_mix::{STEP, mix};
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{Emitter, NONE, PathState, Triangle};

/// Triangles are divided into at most this many pieces: see [`Aims`].
const MAX_PIECES: usize = 1 << 20;
/// Maximum number of pairs of a lamp and a smooth triangle.
const MAX_PAIRS: usize = 1 << 21;
/// A triangle is divided until its pieces are this small as seen from the lamp: longest edge over distance.
const PIECE_SIZE: f64 = 0.3;
/// Maximum number of times that a triangle is halved.
const MAX_HALVINGS: u32 = 14;
/// Added to factors of a piece's weight that may be 0 at its centre although they are not elsewhere.
const FLOOR: f64 = 0.05;

/// A part of a smooth triangle, lit by one lamp. A beam has one piece of its own, without a triangle.
#[derive(Clone, Copy)]
pub struct Piece {
    emitter: u32,
    triangle: u32,
    corners: [Vec3; 3],
}

impl Piece {
    /// Whether the piece stands for a beam, whose photons all travel in one direction.
    pub fn is_beam(&self) -> bool {
        self.triangle == NONE
    }

    /// The halves on both sides of the middle of the longest edge.
    fn halves(&self) -> [Piece; 2] {
        let k = self.longest_edge().0;
        let [p, q, r] = [0, 1, 2].map(|step| self.corners[(k + step) % 3]);
        let middle = 0.5 * (p + q);
        [[p, middle, r], [middle, q, r]].map(|corners| Piece { corners, ..*self })
    }

    /// The first corner of the longest edge, and its length.
    fn longest_edge(&self) -> (usize, f64) {
        let length = |k: usize| f64::from(self.corners[k].distance(self.corners[(k + 1) % 3]));
        [0, 1, 2].map(|k| (k, length(k))).into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
    }

    fn centre(&self) -> Vec3 {
        (self.corners[0] + self.corners[1] + self.corners[2]) / 3.0
    }
}

/// The first segments of all photons, divided into pieces. Pieces are chosen in proportion to an estimate of the flux that they
/// receive.
#[derive(Default)]
pub struct Aims {
    pub pieces: Vec<Piece>,
    /// The sum of the weights of all pieces up to each.
    weights: Vec<f64>,
}

/// The lamps without a surface, which rays cannot hit.
pub fn lamps(prepared: &PreparedScene) -> impl Iterator<Item = &Emitter> {
    prepared.emitters.table.iter().filter(|entry| entry.kind != EMITTER_TRIANGLE && entry.kind != EMITTER_SKY)
}

/// Whether there are lamps without a surface, and smooth objects that they may shine on, but not more than [`MAX_PAIRS`].
pub fn may_aim(prepared: &PreparedScene) -> bool {
    let lamps = lamps(prepared).count();
    if lamps == 0 || !prepared.geometry.materials.iter().any(is_smooth) {
        return false;
    }
    (1..=MAX_PAIRS / lamps).contains(&smooth_triangles(&prepared.geometry).count())
}

/// The triangles with smooth materials, with their indices. Boundaries of media that do not bend light are left out.
pub fn smooth_triangles(geometry: &Geometry) -> impl Iterator<Item = (u32, &Triangle)> {
    let smooth: BTreeSet<u32> =
        (0..).zip(&geometry.materials).filter(|(_, m)| is_smooth(m)).map(|(number, _)| number).collect();
    (0..)
        .zip(&geometry.triangles)
        .filter(move |(_, t)| t.material & TRIANGLE_NULL == 0 && smooth.contains(&(t.material & TRIANGLE_MATERIAL)))
}

impl Aims {
    /// The segments from all lamps of `source` to all smooth triangles of `geometry`.
    pub fn new(geometry: &Geometry, source: &PhotonSource, with_beams: bool) -> Aims {
        let divided = Aims::of(geometry, source, with_beams, MAX_HALVINGS);
        if divided.pieces.len() > MAX_PIECES { Aims::of(geometry, source, with_beams, 0) } else { divided }
    }

    /// As [`Aims::new`], with triangles that are halved at most `halvings` times. Stops above [`MAX_PIECES`] unless `halvings` is 0.
    fn of(geometry: &Geometry, source: &PhotonSource, with_beams: bool, halvings: u32) -> Aims {
        let triangles: Vec<(u32, &Triangle)> = smooth_triangles(geometry).collect();
        let mut aims = Aims::default();
        for (number, emitter) in (0..).zip(&source.table) {
            match emitter.kind {
                EMITTER_TRIANGLE | EMITTER_SKY => {}
                EMITTER_BEAM if !with_beams || triangles.is_empty() => {}
                EMITTER_BEAM => {
                    let piece = Piece { emitter: number, triangle: NONE, corners: [Vec3::ZERO; 3] };
                    aims.push(piece, luminance(emitter.strength));
                }
                _ => {
                    for &(triangle, t) in &triangles {
                        let corners = [t.v0, t.v1, t.v2].map(Vec3::from);
                        aims.divide(Piece { emitter: number, triangle, corners }, emitter, halvings);
                        if halvings > 0 && aims.pieces.len() > MAX_PIECES {
                            return aims;
                        }
                    }
                }
            }
        }
        aims
    }

    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// Adds a piece with a share of the photons in proportion to `weight`; none if that is 0.
    pub fn push(&mut self, piece: Piece, weight: f64) {
        if weight > 0.0 && weight.is_finite() {
            self.pieces.push(piece);
            self.weights.push(self.weights.last().copied().unwrap_or(0.0) + weight);
        }
    }

    /// The weight of each piece.
    pub fn piece_weights(&self) -> impl Iterator<Item = f64> {
        let before = std::iter::once(&0.0).chain(&self.weights);
        self.weights.iter().zip(before).map(|(sum, before)| sum - before)
    }

    /// Adds `piece`, divided into smaller ones if it is large as seen from the lamp.
    fn divide(&mut self, piece: Piece, emitter: &Emitter, halvings: u32) {
        let size = size(&piece, emitter);
        let wanted = match emitter.kind {
            EMITTER_SUN => f64::INFINITY,
            EMITTER_SPOT => PIECE_SIZE.min(0.5 * f64::from(emitter.outer).sqrt()),
            _ => PIECE_SIZE,
        };
        if size > wanted && halvings > 0 && !is_dark(&piece, emitter) {
            piece.halves().into_iter().for_each(|half| self.divide(half, emitter, halvings - 1));
        } else {
            self.push(piece, weight(&piece, emitter));
        }
    }

    /// The first states of `count` photons. Photon k of an iteration is a function of seed, iteration, k and `count`. `far`: a distance
    /// beyond the scene.
    pub fn emit(&self, source: &PhotonSource, seed: u32, iteration: u32, count: u32) -> Vec<PathState> {
        let total = self.weights.last().copied().unwrap_or(0.0);
        let start = |number: u32| {
            let u = uniforms(seed, iteration, number);
            let wanted = (f64::from(number) + u[0]) / f64::from(count) * total;
            let index = self.weights.partition_point(|&sum| sum <= wanted).min(self.pieces.len() - 1);
            let weight = self.weights[index] - if index > 0 { self.weights[index - 1] } else { 0.0 };
            source.start(&self.pieces[index], total / (weight * f64::from(count)), [u[1], u[2]])
        };
        (0..count).into_par_iter().map(start).collect()
    }
}

/// What a photon needs of its lamp.
pub struct PhotonSource {
    table: Vec<Emitter>,
    /// Travel time per length around each emitter, and the code of the solid there.
    around: Vec<(f32, u32)>,
    /// A distance beyond the scene.
    far: f64,
}

impl PhotonSource {
    pub fn new(prepared: &PreparedScene) -> PhotonSource {
        let PreparedScene { geometry, emitters, media, .. } = prepared;
        let around = emitters.table.iter().map(|entry| geometry.around(entry.solid, media.surrounding[1])).collect();
        PhotonSource { table: emitters.table.clone(), around, far: geometry.far() }
    }

    /// Size of a piece as seen from its lamp: longest edge over distance. With parallel light, the longest edge; with a beam 0.
    pub fn size(&self, piece: &Piece) -> f64 {
        size(piece, &self.table[piece.emitter as usize])
    }

    /// Whether the light of the lamp is parallel.
    pub fn is_parallel(&self, piece: &Piece) -> bool {
        matches!(self.table[piece.emitter as usize].kind, EMITTER_SUN | EMITTER_BEAM)
    }

    /// The four parts of a piece, with their weights.
    pub fn quarters(&self, piece: &Piece) -> impl Iterator<Item = (Piece, f64)> {
        let emitter = &self.table[piece.emitter as usize];
        let quarters = piece.halves().into_iter().flat_map(|half| half.halves());
        quarters.map(|part| (part, weight(&part, emitter)))
    }

    /// Photon `number` of an evenly spread few from `piece`, as a ray on the host. `None` if the lamp does not shine there.
    pub fn pilot(&self, piece: &Piece, number: u32) -> Option<Ray> {
        let u = ON_SQUARE.map(|step| (0.5 + f64::from(number) * step).fract());
        let state = self.start(piece, 1.0, u);
        let vector = |v: [f32; 3]| DVec3::from(v.map(f64::from));
        let solid = self.table[piece.emitter as usize].solid;
        let ray = Ray::start(vector(state.position), vector(state.direction).normalize_or_zero(), solid);
        (state.flags & PATH_ALIVE != 0).then_some(ray)
    }

    /// A photon towards a point of `piece`, which `u` chooses. `factor`: one over the expected number of photons of the piece.
    fn start(&self, piece: &Piece, factor: f64, u: [f64; 2]) -> PathState {
        let emitter = &self.table[piece.emitter as usize];
        let place = Vec3::from(emitter.position).as_dvec3();
        let axis = Vec3::from(emitter.direction).as_dvec3();
        let [a, b, c] = piece.corners.map(Vec3::as_dvec3);
        let root = u[0].sqrt();
        let target = a + root * (1.0 - u[1]) * (b - a) + root * u[1] * (c - a);
        let area = 0.5 * double_area(&piece.corners);
        let (origin, direction, share) = match emitter.kind {
            EMITTER_BEAM => {
                let (x, angle) = (axis.any_orthonormal_vector(), std::f64::consts::TAU * u[1]);
                let aside = angle.cos() * x + angle.sin() * axis.cross(x);
                (place + f64::from(emitter.outer) * root * aside, axis, 1.0)
            }
            EMITTER_SUN => {
                let disk = std::f64::consts::PI * f64::from(emitter.outer).powi(2);
                (target - self.far * axis, axis, area.dot(axis).abs() / disk)
            }
            _ => {
                let offset = target - place;
                let direction = offset.normalize_or_zero();
                let solid_angle = area.dot(direction).abs() / offset.length_squared().max(1e-300);
                (place, direction, solid_angle * profile(emitter, direction))
            }
        };
        let power = emitter.strength.map(|strength| (f64::from(strength) * share * factor) as f32);
        let (eta, solid) = self.around[piece.emitter as usize];
        let is_lit = power.iter().any(|&power| power > 0.0) && power.iter().all(|power| power.is_finite());
        let smooth = if emitter.kind == EMITTER_BEAM { PATH_SMOOTH } else { 0 };
        PathState {
            position: origin.as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            eta,
            throughput: power,
            flags: solid << PATH_SOLID_SHIFT | smooth | if is_lit { PATH_ALIVE } else { 0 },
            select_pdf: f32::from_bits(piece.triangle),
            emitter: piece.emitter,
            triangle: NONE,
            ..bytemuck::Zeroable::zeroed()
        }
    }
}

/// See [`PhotonSource::size`].
fn size(piece: &Piece, emitter: &Emitter) -> f64 {
    let (_, edge) = piece.longest_edge();
    match emitter.kind {
        EMITTER_BEAM => 0.0,
        EMITTER_SUN => edge,
        _ => edge / f64::from(piece.centre().distance(emitter.position.into())).max(1e-30),
    }
}

/// Estimate of the flux that a piece receives; above 0 unless it receives none.
fn weight(piece: &Piece, emitter: &Emitter) -> f64 {
    if is_dark(piece, emitter) {
        return 0.0;
    }
    let area = 0.5 * double_area(&piece.corners);
    let offset = (piece.centre() - Vec3::from(emitter.position)).as_dvec3();
    let (direction, spread) = match emitter.kind {
        EMITTER_SUN => {
            (Vec3::from(emitter.direction).as_dvec3(), std::f64::consts::PI * f64::from(emitter.outer).powi(2))
        }
        _ => (offset.normalize_or_zero(), offset.length_squared().max(1e-300)),
    };
    let cosine = area.normalize_or_zero().dot(direction).abs();
    luminance(emitter.strength) * area.length() / spread * (cosine + FLOOR) * (profile(emitter, direction) + FLOOR)
}

/// Whether the piece is outside of the cone of a spot.
fn is_dark(piece: &Piece, emitter: &Emitter) -> bool {
    let offset = (piece.centre() - Vec3::from(emitter.position)).as_dvec3();
    emitter.kind == EMITTER_SPOT && is_outside(emitter, offset.normalize_or_zero(), size(piece, emitter))
}

/// Twice the area of a triangle, along its normal.
fn double_area([a, b, c]: &[Vec3; 3]) -> DVec3 {
    (*b - *a).as_dvec3().cross((*c - *a).as_dvec3())
}

/// Intensity along the unit vector `direction`, relative to the strength of the lamp.
fn profile(emitter: &Emitter, direction: DVec3) -> f64 {
    if emitter.kind != EMITTER_SPOT {
        return 1.0;
    }
    let off = 0.5 * (direction - Vec3::from(emitter.direction).as_dvec3()).length_squared();
    let [outer, inner] = [emitter.outer, emitter.inner].map(f64::from);
    ((outer - off) / (outer - inner).max(1e-20)).clamp(0.0, 1.0).powi(2)
}

/// Half of the angle of a spot's cone, in radians. The emitter holds one minus its cosine.
pub fn half_angle(spot: &Emitter) -> f64 {
    (1.0 - f64::from(spot.outer)).clamp(-1.0, 1.0).acos()
}

/// Whether everything within the angle `size` around `direction` is outside of the cone of a spot.
fn is_outside(emitter: &Emitter, direction: DVec3, size: f64) -> bool {
    let cosine = direction.dot(Vec3::from(emitter.direction).as_dvec3()).clamp(-1.0, 1.0);
    size < 1.0 && cosine.acos() > half_angle(emitter) + 2.0 * size.asin() + 1e-6
}

/// Three uniform numbers in [0, 1), a function of the arguments.
fn uniforms(seed: u32, iteration: u32, number: u32) -> [f64; 3] {
    let mut state = mix(u64::from(seed) << 32 | u64::from(iteration)) ^ u64::from(number);
    [(); 3].map(|()| {
        state = state.wrapping_add(STEP);
        (mix(state) >> 11) as f64 / (1u64 << 53) as f64
    })
}

//! Where photons start: light of lamps without a surface that first meets a smooth object.

use glam::Vec3;
use rayon::prelude::*;

use super::source::PhotonSource;
use crate::render::emitters::EmitterKind;
use crate::render::geometry::Geometry;
use crate::render::prepared_scene::PreparedScene;
use crate::render::split_mix::{STEP, mix};
use crate::wgsl::layout::{Emitter, PathState, Triangle};

/// Maximum number of pieces: see [`Aims`].
pub const MAX_PIECES: usize = 50_000;
/// A triangle is divided until its pieces are this small as seen from the lamp: longest edge over distance.
const PIECE_SIZE: f64 = 0.3;
/// Groups of triangles are this much coarser at most, before they are not divided at all.
const MAX_COARSENESS: f64 = 1e3;
/// Maximum number of times that a triangle is halved.
const MAX_HALVINGS: u32 = 14;

/// A place that photons of one lamp are aimed at.
#[derive(Clone, Copy)]
pub struct Piece {
    pub emitter: u32,
    pub target: Target,
}

#[derive(Clone, Copy)]
pub enum Target {
    /// The photons of a beam all travel in one direction.
    Beam,
    /// A smooth triangle or a part of it: its index, and the corners of the part.
    Triangle(u32, [Vec3; 3]),
    /// A group of smooth triangles: see [`Clusters`].
    Group(u32),
}

impl Piece {
    pub fn is_beam(&self) -> bool {
        matches!(self.target, Target::Beam)
    }
}

/// The halves of a triangle on both sides of the middle of its longest edge.
pub fn halves(corners: &[Vec3; 3]) -> [[Vec3; 3]; 2] {
    let k = longest_edge(corners).0;
    let [p, q, r] = [0, 1, 2].map(|step| corners[(k + step) % 3]);
    let middle = 0.5 * (p + q);
    [[p, middle, r], [middle, q, r]]
}

/// The first corner of the longest edge, and its length.
pub fn longest_edge(corners: &[Vec3; 3]) -> (usize, f64) {
    let length = |k: usize| f64::from(corners[k].distance(corners[(k + 1) % 3]));
    [0, 1, 2].map(|k| (k, length(k))).into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
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
    prepared.emitters.table.iter().filter(|entry| !EmitterKind::of(entry).can_be_hit())
}

/// Whether there are lamps without a surface, and smooth objects that they may shine on.
pub fn may_aim(prepared: &PreparedScene) -> bool {
    lamps(prepared).next().is_some() && smooth_triangles(&prepared.geometry).next().is_some()
}

/// The triangles that are smooth at some points, with their indices.
pub fn smooth_triangles(geometry: &Geometry) -> impl Iterator<Item = (u32, &Triangle)> {
    (0..).zip(&geometry.triangles).filter(|(_, t)| geometry.is_smooth(t))
}

impl Aims {
    /// The segments from all lamps of `source` to all smooth triangles of `geometry`. If they are too many, `source` gets groups of
    /// triangles, which are as coarse as is needed.
    pub fn new(geometry: &Geometry, source: &mut PhotonSource, with_beams: bool) -> Aims {
        let triangles: Vec<(u32, &Triangle)> = smooth_triangles(geometry).collect();
        if triangles.is_empty() {
            return Aims::default();
        }
        if triangles.len().saturating_mul(source.lamps().count()) <= MAX_PIECES {
            let corners = |t: &Triangle| [t.v0, t.v1, t.v2].map(Vec3::from);
            let targets: Vec<Target> = triangles.iter().map(|(k, t)| Target::Triangle(*k, corners(t))).collect();
            let aims = Aims::of(&targets, source, with_beams, 1.0);
            if aims.pieces.len() <= MAX_PIECES {
                return aims;
            }
        }
        source.group(&triangles);
        let mut coarseness = 1.0;
        loop {
            let aims = Aims::of(&[Target::Group(0)], source, with_beams, coarseness);
            // The search of places that the camera sees divides pieces further.
            if aims.pieces.len() <= MAX_PIECES / 2 || coarseness > MAX_COARSENESS {
                return aims;
            }
            coarseness = if 2.0 * coarseness > MAX_COARSENESS { f64::INFINITY } else { 2.0 * coarseness };
        }
    }

    /// The pieces of `targets` for each lamp. Stops above [`MAX_PIECES`], unless `coarseness` is infinite.
    fn of(targets: &[Target], source: &PhotonSource, with_beams: bool, coarseness: f64) -> Aims {
        let mut aims = Aims::default();
        for (emitter, kind) in source.lamps() {
            let targets = match kind.is_connectable() {
                true => targets,
                false if with_beams => &[Target::Beam],
                false => &[],
            };
            for &target in targets {
                aims.divide(Piece { emitter, target }, source, coarseness, MAX_HALVINGS);
                if aims.pieces.len() > MAX_PIECES && coarseness.is_finite() {
                    return aims;
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

    /// Adds `piece`, divided into smaller ones if it is large as seen from the lamp. Triangles are halved at most `halvings` times.
    fn divide(&mut self, piece: Piece, source: &PhotonSource, coarseness: f64, halvings: u32) {
        let is_large = source.size(&piece) > coarseness * source.wanted_size(&piece, PIECE_SIZE);
        let left = if matches!(piece.target, Target::Triangle(..)) { halvings } else { halvings + 1 };
        if is_large && left > 0 && !source.is_dark(&piece) && self.pieces.len() <= MAX_PIECES {
            source.halves(&piece).into_iter().for_each(|half| self.divide(half, source, coarseness, left - 1));
        } else {
            self.push(piece, source.weight(&piece));
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

/// Three uniform numbers in [0, 1), a function of the arguments.
fn uniforms(seed: u32, iteration: u32, number: u32) -> [f64; 3] {
    let mut state = mix(u64::from(seed) << 32 | u64::from(iteration)) ^ u64::from(number);
    [(); 3].map(|()| {
        state = state.wrapping_add(STEP);
        (mix(state) >> 11) as f64 / (1u64 << 53) as f64
    })
}

//! The lamps that photons start from: towards which place, and with how much light.

use glam::{DVec3, Vec3};

use super::aims::{Piece, Target, halves, longest_edge};
use super::clusters::{Clusters, Part};
use crate::render::emitters::{EmitterKind, luminance};
use crate::render::missing_light::ON_SQUARE;
use crate::render::missing_light::walk::Ray;
use crate::render::prepared_scene::PreparedScene;
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{Emitter, NONE, PathState, Triangle};

/// Added to factors of a piece's weight that may be 0 at its centre although they are not elsewhere.
const FLOOR: f64 = 0.05;
/// Mean cosine between the light and the normals of a group of triangles that face all directions.
const MEAN_COSINE: f64 = 0.5;

/// Photons start at emitters that no ray can hit.
const NOT_A_LAMP: &str = "pieces belong to lamps without a surface";

/// What a photon needs of its lamp.
pub struct PhotonSource {
    table: Vec<Emitter>,
    /// Travel time per length around each emitter, and the code of the solid there.
    around: Vec<(f32, u32)>,
    /// A distance beyond the scene.
    far: f64,
    /// Groups of triangles, if pieces stand for groups.
    clusters: Option<Clusters>,
}

impl PhotonSource {
    pub fn new(prepared: &PreparedScene) -> PhotonSource {
        let PreparedScene { geometry, emitters, media, .. } = prepared;
        let around = emitters.table.iter().map(|entry| geometry.around(entry.solid, media.surrounding[1])).collect();
        PhotonSource { table: emitters.table.clone(), around, far: geometry.far(), clusters: None }
    }

    /// The lamps without a surface: their indices and kinds.
    pub fn lamps(&self) -> impl Iterator<Item = (u32, EmitterKind)> {
        let all = (0..).zip(&self.table).map(|(number, emitter)| (number, EmitterKind::of(emitter)));
        all.filter(|&(_, kind)| !kind.can_be_hit())
    }

    /// Makes groups of these triangles.
    pub fn group(&mut self, triangles: &[(u32, &Triangle)]) {
        self.clusters = Some(Clusters::new(triangles));
    }

    fn clusters(&self) -> &Clusters {
        self.clusters.as_ref().expect("pieces are groups only after `group`")
    }

    fn emitter(&self, piece: &Piece) -> &Emitter {
        &self.table[piece.emitter as usize]
    }

    fn kind(&self, piece: &Piece) -> EmitterKind {
        EmitterKind::of(self.emitter(piece))
    }

    /// Size of a piece as seen from its lamp: longest edge over distance. With parallel light, the longest edge; with a beam 0.
    pub fn size(&self, piece: &Piece) -> f64 {
        let (emitter, (centre, edge)) = (self.emitter(piece), self.bounds(piece));
        match self.kind(piece) {
            EmitterKind::Beam => 0.0,
            EmitterKind::Sun => edge,
            EmitterKind::Point | EmitterKind::Spot => {
                edge / f64::from(centre.distance(emitter.position.into())).max(1e-30)
            }
            EmitterKind::Triangle | EmitterKind::Sky => unreachable!("{NOT_A_LAMP}"),
        }
    }

    /// The size above which a piece is divided where the search of places does not know better. `most`: of lamps that shine everywhere.
    pub fn wanted_size(&self, piece: &Piece, most: f64) -> f64 {
        match self.kind(piece) {
            EmitterKind::Sun => f64::INFINITY,
            EmitterKind::Spot => most.min(0.5 * f64::from(self.emitter(piece).outer).sqrt()),
            EmitterKind::Point | EmitterKind::Beam => most,
            EmitterKind::Triangle | EmitterKind::Sky => unreachable!("{NOT_A_LAMP}"),
        }
    }

    /// The centre of the piece, and its longest edge or diagonal.
    fn bounds(&self, piece: &Piece) -> (Vec3, f64) {
        match &piece.target {
            Target::Beam => (Vec3::ZERO, 0.0),
            Target::Triangle(_, corners) => ((corners[0] + corners[1] + corners[2]) / 3.0, longest_edge(corners).1),
            Target::Group(group) => self.clusters().bounds(*group),
        }
    }

    /// Whether the light of the lamp is parallel.
    pub fn is_parallel(&self, piece: &Piece) -> bool {
        self.kind(piece).is_parallel()
    }

    /// The halves of a piece, or the triangles of a small group.
    pub fn halves(&self, piece: &Piece) -> Vec<Piece> {
        let targets: Vec<Target> = match &piece.target {
            Target::Beam => vec![],
            Target::Triangle(number, corners) => halves(corners).map(|half| Target::Triangle(*number, half)).into(),
            Target::Group(group) => {
                let target = |part| match part {
                    Part::Group(half) => Target::Group(half),
                    Part::Triangle(number, corners) => Target::Triangle(number, corners),
                };
                self.clusters().parts(*group).into_iter().map(target).collect()
            }
        };
        let emitter = piece.emitter;
        targets.into_iter().map(|target| Piece { emitter, target }).collect()
    }

    /// The halves of the halves of a piece, with their weights.
    pub fn quarters(&self, piece: &Piece) -> impl Iterator<Item = (Piece, f64)> {
        let quarters = self.halves(piece).into_iter().flat_map(|half| self.halves(&half));
        quarters.map(|part| (part, self.weight(&part)))
    }

    /// Estimate of the flux that a piece receives; above 0 unless it receives none.
    pub fn weight(&self, piece: &Piece) -> f64 {
        let emitter = self.emitter(piece);
        if self.is_dark(piece) {
            return 0.0;
        }
        let (centre, edge) = self.bounds(piece);
        let offset = (centre - Vec3::from(emitter.position)).as_dvec3();
        let (direction, spread) = match self.kind(piece) {
            EmitterKind::Beam => return luminance(emitter.strength),
            EmitterKind::Sun => {
                (Vec3::from(emitter.direction).as_dvec3(), std::f64::consts::PI * f64::from(emitter.outer).powi(2))
            }
            EmitterKind::Triangle | EmitterKind::Sky => unreachable!("{NOT_A_LAMP}"),
            EmitterKind::Point | EmitterKind::Spot => (offset.normalize_or_zero(), offset.length_squared().max(1e-300)),
        };
        let (area, cosine, spread) = match &piece.target {
            Target::Beam => return 0.0,
            Target::Triangle(_, corners) => {
                let area = 0.5 * double_area(corners);
                (area.length(), area.normalize_or_zero().dot(direction).abs(), spread)
            }
            // The lamp may be at the centre of the group.
            Target::Group(group) => (self.clusters().area(*group), MEAN_COSINE, spread.max(0.25 * edge * edge)),
        };
        luminance(emitter.strength) * area / spread * (cosine + FLOOR) * (profile(emitter, direction) + FLOOR)
    }

    /// Whether the piece is outside of the cone of a spot.
    pub fn is_dark(&self, piece: &Piece) -> bool {
        let emitter = self.emitter(piece);
        let offset = (self.bounds(piece).0 - Vec3::from(emitter.position)).as_dvec3();
        is_outside(emitter, offset.normalize_or_zero(), self.size(piece))
    }

    /// Photon `number` of an evenly spread few from `piece`, as a ray on the host. `None` if the lamp does not shine there.
    pub fn pilot(&self, piece: &Piece, number: u32) -> Option<Ray> {
        let u = ON_SQUARE.map(|step| (0.5 + f64::from(number) * step).fract());
        let state = self.start(piece, 1.0, u);
        let vector = |v: [f32; 3]| DVec3::from(v.map(f64::from));
        let solid = self.emitter(piece).solid;
        let ray = Ray::start(vector(state.position), vector(state.direction).normalize_or_zero(), solid);
        (state.flags & PATH_ALIVE != 0).then_some(ray)
    }

    /// A photon towards a point of `piece`, which `u` chooses. `factor`: one over the expected number of photons of the piece.
    pub fn start(&self, piece: &Piece, factor: f64, u: [f64; 2]) -> PathState {
        let emitter = self.emitter(piece);
        let place = Vec3::from(emitter.position).as_dvec3();
        let axis = Vec3::from(emitter.direction).as_dvec3();
        let (triangle, corners, area, u) = match piece.target {
            Target::Beam => (NONE, [Vec3::ZERO; 3], DVec3::ZERO, u),
            Target::Triangle(number, corners) => (number, corners, 0.5 * double_area(&corners), u),
            Target::Group(group) => {
                let (number, corners, rest) = self.clusters().choose(group, u[0]);
                let normal = double_area(&corners).normalize_or_zero();
                (number, corners, self.clusters().area(group) * normal, [rest, u[1]])
            }
        };
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let root = u[0].sqrt();
        let target = a + root * (1.0 - u[1]) * (b - a) + root * u[1] * (c - a);
        let (origin, direction, share, smooth) = match self.kind(piece) {
            EmitterKind::Beam => {
                let (x, angle) = (axis.any_orthonormal_vector(), std::f64::consts::TAU * u[1]);
                let aside = angle.cos() * x + angle.sin() * axis.cross(x);
                (place + f64::from(emitter.outer) * root * aside, axis, 1.0, PATH_SMOOTH)
            }
            EmitterKind::Sun => {
                let disk = std::f64::consts::PI * f64::from(emitter.outer).powi(2);
                (target - self.far * axis, axis, area.dot(axis).abs() / disk, 0)
            }
            EmitterKind::Triangle | EmitterKind::Sky => unreachable!("{NOT_A_LAMP}"),
            EmitterKind::Point | EmitterKind::Spot => {
                let offset = target - place;
                let direction = offset.normalize_or_zero();
                let solid_angle = area.dot(direction).abs() / offset.length_squared().max(1e-300);
                (place, direction, solid_angle * profile(emitter, direction), 0)
            }
        };
        let power = emitter.strength.map(|strength| (f64::from(strength) * share * factor) as f32);
        let (eta, solid) = self.around[piece.emitter as usize];
        let is_lit = power.iter().any(|&power| power > 0.0) && power.iter().all(|power| power.is_finite());
        PathState {
            position: origin.as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            eta,
            throughput: power,
            flags: solid << PATH_SOLID_SHIFT | smooth | if is_lit { PATH_ALIVE } else { 0 },
            select_pdf: f32::from_bits(triangle),
            emitter: piece.emitter,
            triangle: NONE,
            ..bytemuck::Zeroable::zeroed()
        }
    }
}

/// Twice the area of a triangle, along its normal.
fn double_area([a, b, c]: &[Vec3; 3]) -> DVec3 {
    (*b - *a).as_dvec3().cross((*c - *a).as_dvec3())
}

/// Intensity along the unit vector `direction`, relative to the strength of the lamp.
fn profile(emitter: &Emitter, direction: DVec3) -> f64 {
    match EmitterKind::of(emitter) {
        EmitterKind::Spot => {
            let off = 0.5 * (direction - Vec3::from(emitter.direction).as_dvec3()).length_squared();
            let [outer, inner] = [emitter.outer, emitter.inner].map(f64::from);
            ((outer - off) / (outer - inner).max(1e-20)).clamp(0.0, 1.0).powi(2)
        }
        EmitterKind::Point | EmitterKind::Beam | EmitterKind::Sun => 1.0,
        EmitterKind::Triangle | EmitterKind::Sky => unreachable!("{NOT_A_LAMP}"),
    }
}

/// Half of the angle of the cone that an emitter shines into, in radians; `None` for kinds without a cone.
pub fn half_angle(emitter: &Emitter) -> Option<f64> {
    match EmitterKind::of(emitter) {
        // The entry holds one minus the cosine.
        EmitterKind::Spot => Some((1.0 - f64::from(emitter.outer)).clamp(-1.0, 1.0).acos()),
        EmitterKind::Triangle | EmitterKind::Point | EmitterKind::Beam | EmitterKind::Sun | EmitterKind::Sky => None,
    }
}

/// Whether everything within the angle `size` around `direction` is outside of the cone of an emitter.
fn is_outside(emitter: &Emitter, direction: DVec3, size: f64) -> bool {
    let cosine = direction.dot(Vec3::from(emitter.direction).as_dvec3()).clamp(-1.0, 1.0);
    half_angle(emitter).is_some_and(|half| size < 1.0 && cosine.acos() > half + 2.0 * size.asin() + 1e-6)
}

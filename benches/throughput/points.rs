//! Light vertices and shade points in the room, for the benches of queries.

use glam::Vec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::lightcone::tree::Item;

use super::rays::{BenchRay, Room, cosine};

/// The gate in metres.
pub const GATE: [f32; 2] = [9.0, 9.15];

/// A vertex of a diffuse path: its position, the normal on the side of the previous vertex, the travel time up to here in metres,
/// and the remaining power.
#[derive(Clone, Copy)]
pub struct Point {
    pub p: Vec3,
    pub n: Vec3,
    pub tau: f32,
    pub power: f32,
    /// Number of segments up to this vertex.
    pub depth: u32,
}

impl Point {
    pub fn item(&self, index: u32) -> Item {
        Item { point: [self.p.x, self.p.y, self.p.z, self.tau], power: self.power, index }
    }
}

/// Traces a diffuse path with at most `depth` segments and calls `reach` for each vertex.
fn walk(room: &Room, mut ray: BenchRay, depth: u32, pcg: &mut Pcg, mut reach: impl FnMut(Point)) {
    let (mut tau, mut power) = (0.0, 1.0f32);
    for depth in 1..=depth {
        let Some((p, n)) = room.land(&ray) else { break };
        tau += (p - Vec3::from(ray.origin)).length();
        power *= 0.7;
        reach(Point { p, n, tau, power, depth });
        ray = BenchRay { origin: p.into(), t_max: 1e30, direction: cosine(n, pcg).into(), pad: 0.0 };
    }
}

/// Vertices of diffuse paths from the light.
pub fn light_vertices(room: &Room, count: usize) -> Vec<Point> {
    let mut pcg = Pcg::new(5);
    let mut points = vec![];
    while points.len() < count {
        let direction = cosine(-Vec3::Y, &mut pcg);
        let ray = BenchRay { origin: room.light.into(), t_max: 1e30, direction: direction.into(), pad: 0.0 };
        walk(room, ray, 8, &mut pcg, |point| points.push(point));
    }
    points.truncate(count);
    points
}

/// First and second hits of camera rays in an image of `side` x `side` pixels.
pub fn shade_points(room: &Room, side: usize) -> Vec<Point> {
    let (mut pcg, mut points) = (Pcg::new(3), vec![]);
    let half = 0.5 * side as f32;
    for i in 0..side * side {
        let (x, y) = ((i % side) as f32 / half - 1.0, 1.0 - (i / side) as f32 / half);
        walk(room, room.primary(x, y), 2, &mut pcg, |point| points.push(point));
    }
    points
}

/// `hash32` of `shared/random.wgsl`.
pub fn hash32(state: u32) -> u32 {
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Advances the random number generator of a query; returns 32 random bits.
fn next_bits(rng: &mut u32) -> u32 {
    *rng = rng.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    hash32(*rng)
}

/// A uniform random number in [0, 1) in steps of 2^-24.
pub fn uniform(rng: &mut u32) -> f32 {
    (next_bits(rng) >> 8) as f32 / 16_777_216.0
}

/// A uniform random number in [0, 1] in steps of 2^-32 near 0.
pub fn fine_uniform(rng: &mut u32) -> f32 {
    next_bits(rng) as f32 / 4_294_967_296.0
}

//! Flights through media, and the vertices where they end.
//!
//! A flight is analogue: its length is drawn from sigma_t, and at a collision the albedo is the probability that the path goes on.
//! In grids, delta tracking with one majorant for the whole grid finds the collisions; null collisions change neither direction
//! nor length. The transmittance of shadow rays is exact in homogeneous media; in grids, ratio tracking estimates it without
//! bias. Null boundaries only change the medium.
//!
//! Without media, these functions draw no random numbers of their own.

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;

use super::bsdf::Sample;
use super::geometry::Ray;
use super::media::{Channel, PreparedMedium, Region, Stretch};
use super::phase::Phase;
use super::world::{Vertex, World};

/// A vertex of a path: a point of a surface, or a point in a medium where light is scattered.
pub enum PathVertex<'a> {
    Surface(Box<Vertex<'a>>),
    Medium(ScatteringPoint<'a>),
}

/// A point in a medium, with its phase function.
pub struct ScatteringPoint<'a> {
    position: DVec3,
    /// Unit vector to the viewer.
    wo: DVec3,
    phase: &'a Phase<'a>,
}

/// How a flight ends.
pub enum Flight<'a> {
    /// At a vertex, after this distance in metres. The region is that of the last part of the flight.
    Vertex { vertex: PathVertex<'a>, distance: f64, region: Region },
    /// A medium absorbs the light.
    Absorbed,
    /// The ray leaves the scene.
    Escaped,
}

impl PathVertex<'_> {
    pub fn position(&self) -> DVec3 {
        match self {
            PathVertex::Surface(vertex) => vertex.position,
            PathVertex::Medium(point) => point.position,
        }
    }

    /// True if all lobes are deltas, or the vertex lies on the black back of a surface: connections to it contribute nothing.
    pub fn only_delta(&self) -> bool {
        match self {
            PathVertex::Surface(vertex) => vertex.only_delta(),
            PathVertex::Medium(_) => false,
        }
    }

    /// The factor of the vertex, in 1 / sr: BSDF times cosine, or phase function. `wi`: unit vector towards the incident light.
    pub fn scattered(&self, wi: DVec3) -> DVec3 {
        let (f, cos) = self.factors(wi);
        DVec3::from(f) * cos
    }

    /// The two factors of [`PathVertex::scattered`]: BSDF and cosine, or phase function and 1.
    pub fn factors(&self, wi: DVec3) -> ([f64; 3], f64) {
        match self {
            PathVertex::Surface(vertex) => (vertex.eval(wi), vertex.cos(wi)),
            PathVertex::Medium(point) => ([point.phase.density(-wi.dot(point.wo)); 3], 1.0),
        }
    }

    /// Density per steradian of [`PathVertex::sample`], without mirrors and glass.
    pub fn pdf(&self, wi: DVec3) -> f64 {
        match self {
            PathVertex::Surface(vertex) => vertex.pdf(wi),
            PathVertex::Medium(point) => point.phase.density(-wi.dot(point.wo)),
        }
    }

    /// Samples a direction of incident light. `None`: the path ends.
    pub fn sample(&self, pcg: &mut Pcg) -> Option<Sample> {
        match self {
            PathVertex::Surface(vertex) => vertex.sample(pcg),
            PathVertex::Medium(point) => {
                let wi = point.phase.sample(-point.wo, pcg);
                Some(Sample { wi, weight: [1.0; 3], pdf: self.pdf(wi), delta: false, refracted: false })
            }
        }
    }

    /// The surface point, if the vertex is one.
    pub fn surface(&self) -> Option<&Vertex<'_>> {
        match self {
            PathVertex::Surface(vertex) => Some(vertex.as_ref()),
            PathVertex::Medium(_) => None,
        }
    }
}

impl World<'_> {
    /// Follows a ray to the next vertex. Null boundaries are no vertices.
    pub fn fly(&self, ray: Ray, mut region: Region, channel: Channel, pcg: &mut Pcg) -> Flight<'_> {
        let (start, mut ray) = (ray.origin, ray);
        loop {
            let surface = self.trace(ray, pcg);
            if !self.media.is_empty() {
                let length = surface.as_ref().map_or(f64::INFINITY, |v| (v.position - ray.origin).length());
                for stretch in self.media.stretches(&ray, length, region) {
                    let Some(at) = collision(&stretch, &ray, channel, pcg) else { continue };
                    let [scattering, absorption] = stretch.medium.coefficients(channel);
                    if pcg.uniform() * (scattering + absorption) >= scattering {
                        return Flight::Absorbed;
                    }
                    let position = ray.origin + ray.direction * at;
                    let point = ScatteringPoint { position, wo: -ray.direction, phase: &stretch.medium.phase };
                    let distance = (position - start).length();
                    return Flight::Vertex { vertex: PathVertex::Medium(point), distance, region };
                }
            }
            let Some(vertex) = surface else { return Flight::Escaped };
            if self.media.is_null_boundary(vertex.surface.instance) {
                region = self.beyond(&vertex, ray.direction, region);
                ray = Ray::new(vertex.position, ray.direction);
                continue;
            }
            let distance = (vertex.position - start).length();
            return Flight::Vertex { vertex: PathVertex::Surface(Box::new(vertex)), distance, region };
        }
    }

    /// Fraction of the light that travels from `b` to `a`. It is 0 if a surface lies between the points, else the transmittance of
    /// the media or an unbiased estimate. `a` lies in `region`. With `far`, `b` stands for a point at infinity.
    pub fn transmittance(
        &self,
        [a, b]: [DVec3; 2],
        far: bool,
        mut region: Region,
        channel: Channel,
        pcg: &mut Pcg,
    ) -> f64 {
        if self.media.is_empty() {
            return f64::from(u8::from(self.visible(a, b, pcg)));
        }
        let (mut from, mut passed) = (a, 1.0);
        let direction = (b - a).normalize();
        loop {
            let ray = if far { Ray::new(from, direction) } else { Ray::between(from, b) };
            let surface = self.trace(ray, pcg);
            let end = surface.as_ref().map_or(b, |vertex| vertex.position);
            let length = if far && surface.is_none() { f64::INFINITY } else { (end - from).length() };
            for stretch in self.media.stretches(&ray, length, region) {
                passed *= transmittance(&stretch, &ray, channel, pcg);
            }
            let Some(vertex) = surface.filter(|_| passed > 0.0) else { return passed };
            if !self.media.is_null_boundary(vertex.surface.instance) {
                return 0.0;
            }
            region = self.beyond(&vertex, ray.direction, region);
            from = vertex.position;
        }
    }

    /// The region where a ray starts.
    pub fn region(&self, ray: Ray) -> Region {
        self.media.region(&self.geometry, ray, |material| self.indices_of(material))
    }

    /// The region behind a surface for a ray that crosses it in direction `onwards`. `region` is the region before the surface.
    pub fn beyond(&self, vertex: &Vertex, onwards: DVec3, region: Region) -> Region {
        match vertex.inside {
            true => self.region(Ray::new(vertex.position, onwards)),
            false => self.media.inside(&vertex.surface, self.indices_of(vertex.surface.material), region),
        }
    }
}

/// Distance along the ray of the first collision in a stretch, if there is one.
fn collision(stretch: &Stretch, ray: &Ray, channel: Channel, pcg: &mut Pcg) -> Option<f64> {
    let majorant = majorant(stretch.medium, channel);
    if majorant == 0.0 {
        return None;
    }
    let mut at = stretch.from;
    loop {
        at -= (1.0 - pcg.uniform()).ln() / majorant;
        if at >= stretch.to {
            return None;
        }
        let Some(max_density) = stretch.medium.max_density() else { return Some(at) };
        if pcg.uniform() * max_density < stretch.medium.density(ray.origin + ray.direction * at) {
            return Some(at);
        }
    }
}

/// Transmittance of a stretch: exact without a grid, else an unbiased estimate in [0, 1].
fn transmittance(stretch: &Stretch, ray: &Ray, channel: Channel, pcg: &mut Pcg) -> f64 {
    let majorant = majorant(stretch.medium, channel);
    if majorant == 0.0 {
        return 1.0;
    }
    let Some(max_density) = stretch.medium.max_density() else {
        return (-majorant * (stretch.to - stretch.from)).exp();
    };
    let (mut at, mut passed) = (stretch.from, 1.0);
    loop {
        at -= (1.0 - pcg.uniform()).ln() / majorant;
        if at >= stretch.to {
            return passed;
        }
        passed *= 1.0 - stretch.medium.density(ray.origin + ray.direction * at) / max_density;
    }
}

/// The greatest sigma_t of a medium, per metre.
fn majorant(medium: &PreparedMedium, channel: Channel) -> f64 {
    let [scattering, absorption] = medium.coefficients(channel);
    (scattering + absorption) * medium.max_density().unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fog::second_moment;
    use taugate::{Emitters, Medium, PhaseFunction, Scene};

    /// Squared distances from the start at the times `taus` of a walk in an infinite medium.
    fn walk(world: &World, taus: &[f64], pcg: &mut Pcg) -> Vec<f64> {
        let (mut ray, mut walked, mut found) = (Ray::new(DVec3::ZERO, DVec3::X), 0.0, vec![]);
        let (region, channel) = (world.region(ray), world.media.channel(pcg));
        loop {
            let Flight::Vertex { vertex, distance, .. } = world.fly(ray, region, channel, pcg) else {
                panic!("without absorption and surfaces, a flight ends in the medium")
            };
            for tau in taus.iter().filter(|&&tau| walked <= tau && tau < walked + distance) {
                found.push((ray.origin + ray.direction * (tau - walked)).length_squared());
            }
            if found.len() == taus.len() {
                return found;
            }
            walked += distance;
            ray = Ray::new(vertex.position(), vertex.sample(pcg).expect("a direction").wi);
        }
    }

    #[test]
    fn second_moment_of_light_in_an_infinite_medium() {
        const WALKS: usize = 50_000;
        let (sigma_s, taus) = (2.0, [0.25, 1.0, 3.0, 10.0]);
        for g in [0.8, 0.0, -0.3] {
            let phase = PhaseFunction::HenyeyGreenstein { g };
            let scene =
                Scene { media: vec![Medium { sigma_s: [sigma_s; 3], phase, ..Medium::default() }], ..Scene::default() };
            let world = World::new(&scene, &Emitters::Scene);
            let mut pcg = Pcg::new(11);
            let (mut sums, mut squares) = ([0.0; 4], [0.0; 4]);
            for _ in 0..WALKS {
                for (i, r2) in walk(&world, &taus, &mut pcg).into_iter().enumerate() {
                    sums[i] += r2;
                    squares[i] += r2 * r2;
                }
            }
            let mut control: f64 = 0.0;
            for (i, tau) in taus.into_iter().enumerate() {
                let mean = sums[i] / WALKS as f64;
                let error = ((squares[i] / WALKS as f64 - mean * mean) / WALKS as f64).sqrt();
                let off = |sigma_s: f64| (mean - second_moment(sigma_s, g, tau)).abs() / error;
                assert!(off(sigma_s) < 4.0, "g {g}, tau {tau}: {mean} +- {error}, {} errors off", off(sigma_s));
                assert!(error < 0.005 * mean, "g {g}, tau {tau}: {error} of {mean}");
                control = control.max(off(1.03 * sigma_s));
            }
            assert!(control > 4.0, "g {g}: a sigma_s that is off by 3 % passes with {control} errors");
        }
    }
}

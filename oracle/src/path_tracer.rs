//! A path tracer with explicit light sampling, which sorts radiance into bins of travel time. Tests compare images with it.
//!
//! Each sample traces one sensor path. At every vertex, the tracer samples one emitter. Paths also hit emissive surfaces, and leave
//! the scene towards the sky, by chance. The balance heuristic weights these two strategies.
//!
//! A beam emits in one direction only, so no vertex can sample it as an emitter. Instead, the tracer follows the beam to its
//! spot, the first point that scatters, and connects the spot to every sensor vertex. If the beam has a radius and no mirror or
//! glass redirects it, there is a second strategy: a sensor vertex inside the spot adds the light that arrives straight from the
//! beam. The balance heuristic weights the two. If the previous vertex of the sensor path is the sensor, a mirror or glass, only
//! the second strategy exists.
//!
//! If the second strategy is impossible (radius 0, or a mirror or glass in front of the beam), the spot is also projected into
//! the image. The tracer finds neither this spot nor a point light if the sensor sees it through a mirror or glass.
//!
//! In media, vertices are also points of the medium. A beam has spots along its way, each at the end of a random flight. The
//! first strategy alone finds such a spot, except behind a mirror or glass, where only the second can. In coloured media, each
//! sample computes one channel.

use glam::DVec3;
use rayon::prelude::*;
use taugate::internals::generate::numbers::Pcg;
use taugate::{Emitters, Gate, Scene};

use super::camera::Sensor;
use super::emitter::{self, BeamSpot, EmitterSet};
use super::flight::{Flight, PathVertex};
use super::geometry::Ray;
use super::media::{Channel, Region};
use super::rgb;
use super::world::World;

/// Settings of a render.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Index into `Scene::cameras`.
    pub camera: usize,
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    pub spp: u32,
    pub seed: u64,
    /// Maximum number of segments of a path, including the segments at the sensor and at the emitter.
    pub max_depth: u32,
    /// Bins: half-open intervals of travel time [lo, hi) in metres, which may overlap.
    pub bins: Vec<(f64, f64)>,
    pub emitters: Emitters,
}

/// Estimated radiance of a pixel in a bin, and the variance of this estimate (not of one sample).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pixel {
    pub mean: [f64; 3],
    pub variance: [f64; 3],
}

/// One image per bin; row 0 is at the top.
#[derive(Debug, Clone)]
pub struct Film {
    pub resolution: [u32; 2],
    pub bins: Vec<Vec<Pixel>>,
}

impl Film {
    /// Mean of a bin over pixels and channels.
    pub fn average(&self, bin: usize) -> f64 {
        let pixels = &self.bins[bin];
        pixels.iter().flat_map(|p| p.mean).sum::<f64>() / (3 * pixels.len()) as f64
    }
}

/// Sums of sample values and of their squares.
#[derive(Clone, Copy, Default)]
struct Sums([f64; 3], [f64; 3]);

impl Sums {
    fn add(&mut self, value: DVec3) {
        for k in 0..3 {
            self.0[k] += value[k];
            self.1[k] += value[k] * value[k];
        }
    }

    /// Mean over `n` samples and variance of this mean. For n = 1 the variance is 0, because it cannot be estimated.
    fn over(&self, n: f64) -> Pixel {
        let mean = self.0.map(|s| s / n);
        let spread = |k: usize| (self.1[k] / n - mean[k] * mean[k]).max(0.0) / (n - 1.0).max(1.0);
        Pixel { mean, variance: [0, 1, 2].map(spread) }
    }
}

/// Sums of the contributions of one sample to its own pixel, one per bin.
struct SampleBins<'s> {
    settings: &'s Settings,
    bins: Vec<DVec3>,
}

impl SampleBins<'_> {
    fn add(&mut self, tau: f64, value: DVec3) {
        for (bin, &(lo, hi)) in self.bins.iter_mut().zip(&self.settings.bins) {
            if (Gate { lo, hi }).contains(tau) {
                *bin += value;
            }
        }
    }
}

/// A spot that the sensor sees: pixel, travel time and value.
type Splat = (usize, f64, DVec3);

/// Renders all bins at once. The same settings give the same bits with any number of threads.
///
/// # Panics
/// If a directional light or a sky is switched on, and a bin is not the steady state: their light has no travel time.
pub fn render(scene: &Scene, settings: &Settings) -> Film {
    let world = World::new(scene, &settings.emitters);
    let has_distant = scene.lights.iter().any(|light| light.kind.is_distant() && world.shines(&light.node));
    let steady = |&(lo, hi): &(f64, f64)| lo <= 0.0 && hi == f64::INFINITY;
    assert!(!has_distant || settings.bins.iter().all(steady), "light from infinitely far away has no travel time");
    let emitters = EmitterSet::new(&world);
    let tracer = Tracer {
        world: &world,
        emitters: &emitters,
        settings,
        sensor: Sensor::new(scene, settings.camera, settings.resolution),
    };
    let [width, height] = settings.resolution;
    let count = (width * height) as usize;
    let traced: Vec<(Vec<Sums>, Vec<Splat>)> = (0..count).into_par_iter().map(|i| tracer.pixel(i)).collect();

    // A sample of any pixel may splat to any other pixel, so splats are averaged over the samples of all pixels.
    let mut splatted = vec![vec![Sums::default(); count]; settings.bins.len()];
    for &(pixel, tau, value) in traced.iter().flat_map(|(_, splats)| splats) {
        for (bin, &(lo, hi)) in splatted.iter_mut().zip(&settings.bins) {
            if (Gate { lo, hi }).contains(tau) {
                bin[pixel].add(value);
            }
        }
    }
    let own = f64::from(settings.spp);
    let pixel = |bin: usize, i: usize| {
        let (a, b) = (traced[i].0[bin].over(own), splatted[bin][i].over(own * count as f64));
        let sum = |x: [f64; 3], y: [f64; 3]| rgb(|k| x[k] + y[k]);
        Pixel { mean: sum(a.mean, b.mean), variance: sum(a.variance, b.variance) }
    };
    let bins = (0..settings.bins.len()).map(|bin| (0..count).map(|i| pixel(bin, i)).collect()).collect();
    Film { resolution: settings.resolution, bins }
}

struct Tracer<'a> {
    world: &'a World<'a>,
    emitters: &'a EmitterSet<'a>,
    settings: &'a Settings,
    sensor: Sensor<'a>,
}

impl Tracer<'_> {
    fn pixel(&self, index: usize) -> (Vec<Sums>, Vec<Splat>) {
        let width = self.settings.resolution[0] as usize;
        let (x, y) = ((index % width) as f64, (index / width) as f64);
        let mut pcg = Pcg::new(scramble(self.settings.seed ^ scramble(index as u64)));
        let mut sums = vec![Sums::default(); self.settings.bins.len()];
        let mut splats = Vec::new();
        for _ in 0..self.settings.spp {
            let (at_x, at_y) = (x + pcg.uniform(), y + pcg.uniform());
            let (ray, delay) = self.sensor.ray(at_x, at_y, &mut pcg);
            let mut sample_bins = SampleBins { settings: self.settings, bins: vec![DVec3::ZERO; sums.len()] };
            let channel = self.world.media.channel(&mut pcg);
            let mut spots = Vec::new();
            for beam in &self.emitters.beams {
                spots.extend(emitter::spots(self.world, beam, self.settings.max_depth - 1, channel, &mut pcg));
            }
            splats.extend(spots.iter().filter_map(|beam_spot| self.splat(beam_spot, channel, &mut pcg)));
            self.path(ray, delay, channel, &spots, &mut sample_bins, &mut pcg);
            sums.iter_mut().zip(&sample_bins.bins).for_each(|(sum, &value)| sum.add(value));
        }
        (sums, splats)
    }

    /// `delay`: length in metres at the sensor that counts besides the segments.
    fn path(
        &self,
        mut ray: Ray,
        delay: f64,
        channel: Channel,
        spots: &[BeamSpot],
        sample_bins: &mut SampleBins,
        pcg: &mut Pcg,
    ) {
        let mut throughput = channel.weight;
        let mut region = self.world.region(ray);
        let mut tau = region.group_index * delay;
        // Density per steradian of the last direction; `None` after the sensor, a mirror or glass.
        let mut last: Option<f64> = None;
        for segments in 1..=self.settings.max_depth {
            let (vertex, distance) = match self.world.fly(ray, region, channel, pcg) {
                Flight::Vertex { vertex, distance, region: before } => {
                    region = before;
                    (vertex, distance)
                }
                Flight::Absorbed => return,
                Flight::Escaped => {
                    if let Some((radiance, pdf)) = self.emitters.sky(ray.direction) {
                        let weight = last.map_or(1.0, |p| p / (p + pdf));
                        sample_bins.add(tau, throughput * DVec3::from(radiance) * weight);
                    }
                    return;
                }
            };
            tau += region.group_index * distance;
            if let Some(surface) = vertex.surface() {
                let emitted = self.world.emitted(&surface.surface, surface.wo);
                if emitted != [0.0; 3] {
                    let weight = last.map_or(1.0, |p| p / (p + self.emitters.pdf(surface, distance)));
                    sample_bins.add(tau, throughput * DVec3::from(emitted) * weight);
                }
            }
            if segments == self.settings.max_depth {
                return;
            }
            if !vertex.only_delta() {
                let last = last.map(|p| (p, distance));
                let end = PathEnd { vertex: &vertex, throughput, tau, region, channel, segments, last };
                self.emitter(&end, sample_bins, pcg);
                self.beams(&end, sample_bins, pcg);
                spots.iter().for_each(|beam_spot| self.connect(&end, beam_spot, sample_bins, pcg));
            }
            let Some(sample) = vertex.sample(pcg) else { return };
            throughput *= DVec3::from(sample.weight);
            if let Some(surface) = vertex.surface().filter(|_| sample.refracted) {
                let beyond = self.world.beyond(surface, sample.wi, region);
                // Radiance scales with the square of the index of refraction.
                throughput *= (region.eta / beyond.eta) * (region.eta / beyond.eta);
                region = beyond;
            }
            if throughput == DVec3::ZERO {
                return;
            }
            last = (!sample.delta).then_some(sample.pdf);
            ray = Ray::new(vertex.position(), sample.wi);
        }
    }

    /// Adds the light of one sampled emitter.
    fn emitter(&self, end: &PathEnd, sample_bins: &mut SampleBins, pcg: &mut Pcg) {
        let Some(light) = self.emitters.sample(end.vertex.position(), pcg) else { return };
        let f = end.vertex.scattered(light.wi);
        if f == DVec3::ZERO {
            return;
        }
        let passed = end.transmittance(self.world, light.position, light.far, pcg);
        if passed == 0.0 {
            return;
        }
        let weight = light.pdf.map_or(1.0, |p| p / (p + end.vertex.pdf(light.wi)));
        let value = end.throughput * f * DVec3::from(light.weight) * weight * passed;
        sample_bins.add(end.tau + end.region.group_index * light.distance, value);
    }

    /// Adds the light of beams that fall on the vertex directly.
    fn beams(&self, end: &PathEnd, sample_bins: &mut SampleBins, pcg: &mut Pcg) {
        // In a medium, the other strategy finds this light, unless the vertex before is a mirror or glass.
        let only_strategy = end.last.is_none() && end.segments > 1;
        if end.vertex.surface().is_none() && !only_strategy {
            return;
        }
        for beam in &self.emitters.beams {
            let straight = emitter::straight(self.world, beam, end.vertex, end.region, end.channel, pcg);
            let Some((distance, value)) = straight else { continue };
            // The other strategy connects the previous vertex to a spot. Both densities are per area.
            let weight = end.last.zip(end.vertex.surface()).map_or(1.0, |((pdf, length), surface)| {
                let radius = emitter::beam(beam).0;
                let joined = -surface.normal.dot(beam.direction) / (std::f64::consts::PI * radius * radius);
                let met = pdf * surface.normal.dot(surface.wo) / (length * length);
                met / (met + joined)
            });
            let value = end.throughput * DVec3::from(value) * weight;
            sample_bins.add(end.tau + end.region.group_index * distance, value);
        }
    }

    /// Adds the light of a beam's spot, connected to the vertex.
    fn connect(&self, end: &PathEnd, beam_spot: &BeamSpot, sample_bins: &mut SampleBins, pcg: &mut Pcg) {
        let (position, spot) = (end.vertex.position(), beam_spot.vertex.position());
        let distance = (spot - position).length();
        if distance == 0.0
            || end.segments + beam_spot.segments + 1 > self.settings.max_depth
            || end.region.eta != beam_spot.region.eta
        {
            return;
        }
        let wi = (spot - position) / distance;
        let f = end.vertex.scattered(wi);
        let value = f * DVec3::from(beam_spot.towards(-wi)) / (distance * distance);
        if value == DVec3::ZERO {
            return;
        }
        let passed = end.transmittance(self.world, spot, false, pcg);
        if passed == 0.0 {
            return;
        }
        let weight = beam_spot.density.zip(beam_spot.vertex.surface()).map_or(1.0, |(joined, surface)| {
            let met = end.vertex.pdf(wi) * surface.normal.dot(-wi) / (distance * distance);
            joined / (joined + met)
        });
        let tau = end.tau + end.region.group_index * distance + beam_spot.tau;
        sample_bins.add(tau, end.throughput * value * weight * passed);
    }

    /// Projects a spot that no sensor path can find into the image. `None` if the sensor does not see the spot.
    fn splat(&self, beam_spot: &BeamSpot, channel: Channel, pcg: &mut Pcg) -> Option<Splat> {
        if beam_spot.density.is_some() || beam_spot.segments + 1 > self.settings.max_depth {
            return None;
        }
        let spot = beam_spot.vertex.position();
        let seen = self.sensor.project(spot, pcg)?;
        let to = seen.sensor - spot;
        let value = DVec3::from(beam_spot.towards(to.normalize())) * seen.density;
        if value == DVec3::ZERO {
            return None;
        }
        let passed = self.world.transmittance([spot, seen.sensor], false, beam_spot.region, channel, pcg);
        let tau = beam_spot.tau + beam_spot.region.group_index * (to.length() + seen.delay);
        (passed > 0.0).then_some((seen.pixel, tau, value * channel.weight * passed))
    }
}

/// The current end of a sensor path.
struct PathEnd<'v> {
    vertex: &'v PathVertex<'v>,
    throughput: DVec3,
    /// Travel time from the vertex to the sensor.
    tau: f64,
    /// The region on the viewer's side.
    region: Region,
    channel: Channel,
    segments: u32,
    /// Density per steradian and length of the last segment; `None` after the sensor, a mirror or glass.
    last: Option<(f64, f64)>,
}

impl PathEnd<'_> {
    /// [`World::transmittance`] between the vertex and another point.
    fn transmittance(&self, world: &World, other: DVec3, far: bool, pcg: &mut Pcg) -> f64 {
        world.transmittance([self.vertex.position(), other], far, self.region, self.channel, pcg)
    }
}

/// SplitMix64's finaliser, which makes the random numbers of neighbouring pixels and seeds independent.
fn scramble(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

//! Algorithm 1: light subpaths, trees, sensor subpaths with queries and connections, film.

pub mod albedo;
mod compaction;
mod coplanar;
mod device_scene;
mod emitters;
pub mod geometry;
mod light;
mod memory;
pub mod place;
mod plan;
mod pool;
mod pool_layout;
mod prepared;
mod probe;
mod reach;
mod samples;
pub mod schedule;
mod sensor;
mod stats;
mod strategies;

use std::time::Instant;

use crate::error::Result;
use crate::gpu::Device;
use crate::gpu::need;
use crate::image::film::Film;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::settings::units::Gate;
use crate::wgsl::layout::constants::VERTEX_DEPTH;
use crate::wgsl::layout::{NONE, PathVertex};

use device_scene::DeviceScene;
use light::{LightTracer, Splat};
pub use memory::MemoryPlan;
pub use plan::Tuning;
use plan::{Observe, Plan};
use pool::{DevicePool, LightPool, SortedPool};
use pool_layout::PoolLayout;
pub use prepared::Prepared;
pub use probe::{TravelTimes, probe};
pub use reach::Reach;
pub use samples::MOST_SAMPLES;
use samples::{Allocation, SampleCounts};
use sensor::{Bound, Seen, SensorTracer};
use stats::stage;
pub use stats::{Stage, Stats};
pub use strategies::{StrategyImage, StrategyImages, strategies};

/// A contribution to the image.
struct Observed {
    /// As it adds to the mean of its pixel; for [`Observe::Strategies`] without its MIS weight.
    rgb: [f32; 3],
    /// Row-major within the crop; NONE where it is not known.
    pixel: u32,
    /// Vertices of the light and of the sensor subpath, the pinhole included.
    s: u32,
    t: u32,
    /// For [`Observe::Times`] the travel time, for [`Observe::Strategies`] the MIS weight.
    tau_or_weight: f32,
}

/// A render in progress. Every iteration adds samples to the film; the same settings give the same bits.
pub struct Renderer {
    device: Device,
    plan: Plan,
    scene: DeviceScene,
    /// Punctual lights as light vertices.
    punctual: Vec<PathVertex>,
    light: LightTracer,
    sensor: Option<(SensorTracer, DevicePool, Bound)>,
    /// None if samples are spread evenly.
    allocation: Option<Allocation>,
    film: Film,
    stats: Stats,
    iteration: u32,
    first_sample: u32,
}

impl Renderer {
    /// Flattens and uploads the scene, compiles the kernels. Errors: nothing emits, the scene does not fit the device, the
    /// estimator cannot render these emitters.
    pub fn new(device: &Device, scene: &Scene, settings: &Settings) -> Result<Renderer> {
        Renderer::with_tuning(device, scene, settings, Tuning::default())
    }

    /// As [`Renderer::new`], with choices that change the speed and never the image.
    pub fn with_tuning(device: &Device, scene: &Scene, settings: &Settings, tuning: Tuning) -> Result<Renderer> {
        let start = Instant::now();
        let prepared = Prepared::new(scene, settings)?;
        let seconds = start.elapsed().as_secs_f64();
        let size = [settings.crop.width(), settings.crop.height()];
        let mut plan = Plan::new(scene, settings, &prepared)?;
        plan.tuning = tuning;
        let mut renderer = Renderer::from_plan(device, plan, size, &prepared)?;
        renderer.stats.add_prepared("build BVH", seconds);
        Ok(renderer)
    }

    /// As [`Renderer::new`] from what was prepared for the same camera and emitters, which may be dropped afterwards.
    pub fn from_prepared(device: &Device, scene: &Scene, settings: &Settings, prepared: &Prepared) -> Result<Renderer> {
        let size = [settings.crop.width(), settings.crop.height()];
        Renderer::from_plan(device, Plan::new(scene, settings, prepared)?, size, prepared)
    }

    fn from_plan(device: &Device, plan: Plan, [width, height]: [u32; 2], prepared: &Prepared) -> Result<Renderer> {
        // Before anything is allocated.
        need::check_all(&memory::certain_needs(device.info(), &plan, prepared), device.info())?;
        let mut stats = Stats::default();
        let scene = stats.prepared("upload scene", || DeviceScene::new(device, prepared))?;
        let light = stats.prepared(stage::COMPILE, || LightTracer::new(device, &scene, &plan))?;
        stats.scene_bytes = scene.bytes();
        stats.triangles = prepared.triangles() as u64;
        let film = Film::new(width, height);
        let (device, punctual) = (device.clone(), prepared.emitters.deterministic.clone());
        let allocation = plan.adaptive.then(|| Allocation::new(width, plan.crop_pixels));
        let sensor = None;
        Ok(Renderer {
            device,
            plan,
            scene,
            punctual,
            light,
            sensor,
            allocation,
            film,
            stats,
            iteration: 0,
            first_sample: 0,
        })
    }

    /// One iteration: a fresh pool of light vertices and `samples` samples a pixel (1 to [`MOST_SAMPLES`]), in
    /// every pixel or on average, added to the film. Where no light can meet the gate, the samples are black without being traced.
    pub fn iterate(&mut self, samples: u32) -> Result<()> {
        assert!((1..=MOST_SAMPLES).contains(&samples));
        let mut image = vec![0.0f32; self.plan.crop_pixels as usize * 3];
        if self.plan.dark {
            self.film.add(&image, samples);
            self.stats.samples += self.plan.crop_pixels * u64::from(samples);
            self.stats.iterations += 1;
            return Ok(());
        }
        self.prepare_iteration(samples, &mut |splat: Splat| {
            let at = splat.pixel_or_tau.to_bits() as usize * 3;
            (0..3).for_each(|k| image[at + k] += splat.rgb[k]);
        })?;
        let counts = match &self.allocation {
            Some(allocation) => self.stats.timed(stage::ALLOT, || allocation.counts(samples)),
            None => SampleCounts::Even(samples),
        };
        if let Some((sensor, _, bound)) = &mut self.sensor {
            let allocation = &mut self.allocation;
            let learn = |film: &[[f32; 4]], image: &[f32]| {
                if let Some(allocation) = allocation {
                    allocation.add(film, image, &counts, samples);
                }
            };
            sensor.run(&self.plan, bound, &counts, &mut image, learn, &mut self.stats)?;
        }
        let film = &mut self.film;
        self.stats.timed(stage::ADD_TO_FILM, || film.add(&image, samples));
        self.stats.device_bytes = self.stats.device_bytes.max(self.device.bytes_in_use());
        self.finish_iteration(counts.greatest());
        Ok(())
    }

    /// As [`Renderer::iterate`] for a plan that observes: instead of forming an image it shows `see` all contributions, their
    /// light as it adds to the image and their travel times or weights.
    fn observe(&mut self, samples: u32, see: &mut impl FnMut(Observed)) -> Result<()> {
        let times = self.plan.observe == Observe::Times;
        let pool = self.prepare_iteration(samples, &mut |splat: Splat| {
            let Splat { rgb, pixel_or_tau, weight, s } = splat;
            let (pixel, tau_or_weight) = if times { (NONE, pixel_or_tau) } else { (pixel_or_tau.to_bits(), weight) };
            see(Observed { rgb, pixel, s, t: 1, tau_or_weight });
        })?;
        if let Some((sensor, _, bound)) = &mut self.sensor {
            let share = 1.0 / samples as f32;
            sensor.observe(&self.plan, bound, &SampleCounts::Even(samples), &mut |seen: Seen| {
                let s = seen.vertex.map_or(0, |vertex| (pool.vertices[vertex].flags & VERTEX_DEPTH) + 1);
                see(Observed {
                    rgb: seen.rgb.map(|x| x * share),
                    pixel: seen.pixel,
                    s,
                    t: seen.t,
                    tau_or_weight: seen.tau_or_weight,
                });
            })?;
        }
        self.finish_iteration(samples);
        Ok(())
    }

    /// Everything before the sensor subpaths, returns the pool; `see`: as in [`LightTracer::run`].
    fn prepare_iteration(&mut self, samples: u32, see: &mut impl FnMut(Splat)) -> Result<SortedPool> {
        // Phase 1: light tracing.
        self.write_frame(samples, None)?;
        let mut pool = LightPool { deterministic: self.punctual.clone(), ..Default::default() };
        self.light.run(&self.plan, &mut pool, see, &mut self.stats)?;

        // Phase 2: hierarchy construction.
        let sorted = self.stats.timed(stage::BUILD_TREES, || pool.sort(&self.plan))?;
        self.stats.deterministic_vertices += pool.deterministic.len() as u64;
        self.stats.emitter_vertices += pool.emitter_points.len() as u64;
        self.stats.scattered_vertices += pool.scattered.len() as u64;

        // Phase 3: sensor tracing and connection.
        self.prepare_sensor(&sorted)?;
        self.write_frame(samples, Some(&sorted.layout))?;
        Ok(sorted)
    }

    fn write_frame(&mut self, samples: u32, pool: Option<&PoolLayout>) -> Result<()> {
        let mut frame = self.plan.frame(self.iteration, self.first_sample, samples, pool);
        if let Some((sensor, ..)) = self.sensor.as_ref().filter(|_| pool.is_some()) {
            frame.slots = sensor.slots();
        }
        self.scene.frame.write(0, &[frame])
    }

    /// `most`: the most samples that a pixel had.
    fn finish_iteration(&mut self, most: u32) {
        self.iteration += 1;
        self.first_sample += most;
        self.stats.iterations += 1;
    }

    /// Forgets the film and starts anew with another seed and gate; scene, kernels and statistics stay.
    pub fn restart(&mut self, seed: u32, gate: Gate) {
        self.plan.set(seed, gate);
        self.film = Film::new(self.film.width(), self.film.height());
        if let Some(allocation) = &mut self.allocation {
            allocation.restart();
        }
        (self.iteration, self.first_sample) = (0, 0);
    }

    /// Puts the pool on the device; makes buffers and descriptor sets anew where they are too small.
    fn prepare_sensor(&mut self, pool: &SortedPool) -> Result<()> {
        let slots = self.plan.slots(&pool.layout);
        let mut tracer = None;
        if let Some((old, mut device_pool, bound)) = self.sensor.take() {
            let fits = old.slots() >= slots && self.stats.timed(stage::UPLOAD, || device_pool.replace(pool))?;
            if fits {
                self.sensor = Some((old, device_pool, bound));
                return Ok(());
            }
            tracer = Some(old);
        }
        let stats = &mut self.stats;
        let tracer = match tracer {
            Some(tracer) if tracer.slots() >= slots => tracer,
            old => {
                let kernels = stats.timed(stage::ALLOCATE, || old.map(SensorTracer::into_kernels));
                SensorTracer::new(&self.device, &self.plan, slots, kernels, stats)?
            }
        };
        let device_pool = stats.timed(stage::UPLOAD, || DevicePool::new(&self.device, pool))?;
        let bound = stats.timed(stage::ALLOCATE, || tracer.bind(&self.scene, &device_pool))?;
        self.sensor = Some((tracer, device_pool, bound));
        Ok(())
    }

    /// Whether bounds say that no light can meet the gate: every sample is black, and none is traced.
    pub fn is_dark(&self) -> bool {
        self.plan.dark
    }

    /// Mean and variance so far, over the crop.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// Least and most samples that a pixel of the crop has had; both [`Film::samples`] where they are spread evenly.
    pub fn samples_in_pixels(&self) -> [u64; 2] {
        match &self.allocation {
            Some(allocation) if !self.plan.dark => allocation.range(),
            _ => [self.film.samples(); 2],
        }
    }

    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// The device buffers hold at least this much for the scene.
    pub fn scene_bytes(&self) -> u64 {
        self.scene.bytes()
    }
}

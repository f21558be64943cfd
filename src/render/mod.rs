//! Algorithm 1: light subpaths, trees, sensor subpaths with queries and connections, film.

pub mod albedo;
mod device_scene;
mod emitters;
pub mod geometry;
mod light;
mod plan;
mod pool;
mod sensor;
mod stats;

use std::time::Instant;

use crate::error::{Error, Result};
use crate::film::Film;
use crate::gpu::Device;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::units::Gate;

use albedo::AlbedoTable;
use device_scene::DeviceScene;
use emitters::EmitterSet;
use geometry::Geometry;
use light::LightTracer;
use plan::Plan;
pub use plan::Tuning;
use pool::{DevicePool, LightPool, SortedPool};
pub use sensor::MOST_SAMPLES;
use sensor::{Bound, SensorTracer};
pub use stats::Stats;

/// A render in progress. Every iteration adds samples to the film; the same settings give the same bits.
pub struct Renderer {
    device: Device,
    plan: Plan,
    scene: DeviceScene,
    emitters: EmitterSet,
    light: LightTracer,
    sensor: Option<(SensorTracer, DevicePool, Bound)>,
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
        let origin = scene.cameras[settings.camera].transform.translation;
        let mut stats = Stats::default();
        let albedo = AlbedoTable::new();
        let mut geometry = stats.timed("build BVH", || Geometry::new(scene, origin, &settings.emitters, &albedo));
        let emitters = EmitterSet::new(scene, &settings.emitters, origin, &mut geometry);
        if emitters.table.is_empty() {
            return Err(Error::Settings(
                "nothing emits light: select other nodes with --emitters, or add a light to the scene".into(),
            ));
        }
        let plan = Plan::new(scene, settings, &geometry, &emitters, tuning)?;
        let scene = stats.timed("upload scene", || DeviceScene::new(device, &geometry, &emitters, &albedo))?;
        let light = LightTracer::new(device, &scene, &plan)?;
        stats.scene_bytes = scene.bytes();
        stats.triangles = geometry.triangles.len() as u64;
        let film = Film::new(settings.crop.width(), settings.crop.height());
        let device = device.clone();
        Ok(Renderer { device, plan, scene, emitters, light, sensor: None, film, stats, iteration: 0, first_sample: 0 })
    }

    /// One iteration: a fresh pool of light vertices and `samples` samples of every pixel (1 to
    /// [`MOST_SAMPLES`]), added to the film.
    pub fn iterate(&mut self, samples: u32) -> Result<()> {
        let start = Instant::now();
        let mut image = vec![0.0f32; self.plan.crop_pixels as usize * 3];

        // Phase 1: light tracing.
        let frame = self.plan.frame(self.iteration, self.first_sample, samples, None);
        self.scene.frame.write(0, &[frame])?;
        let mut pool = LightPool { deterministic: self.emitters.deterministic.clone(), ..Default::default() };
        self.light.run(&self.plan, &mut pool, &mut image, &mut self.stats)?;

        // Phase 2: hierarchy construction.
        let sorted = self.stats.timed("build trees", || pool.sort(&self.plan));
        self.stats.deterministic_vertices += pool.deterministic.len() as u64;
        self.stats.emitter_vertices += pool.emitter_points.len() as u64;
        self.stats.scattered_vertices += pool.scattered.len() as u64;

        // Phase 3: sensor tracing and connection.
        let upload = Instant::now();
        self.prepare_sensor(&sorted)?;
        self.stats.add_host("upload trees", upload.elapsed().as_secs_f64());
        let mut frame = self.plan.frame(self.iteration, self.first_sample, samples, Some(&sorted.layout));
        if let Some((sensor, _, bound)) = &mut self.sensor {
            frame.slots = sensor.slots();
            self.scene.frame.write(0, &[frame])?;
            sensor.run(&self.plan, bound, samples, &mut image, &mut self.stats)?;
        }
        let film = &mut self.film;
        self.stats.timed("add to film", || film.add(&image, samples));
        self.iteration += 1;
        self.first_sample += samples;
        self.stats.iterations += 1;
        self.stats.add_host("render", start.elapsed().as_secs_f64());
        Ok(())
    }

    /// Forgets the film and starts anew with another seed and gate; scene, kernels and statistics stay.
    pub fn restart(&mut self, seed: u32, gate: Gate) {
        self.plan.set(seed, gate);
        self.film = Film::new(self.film.width(), self.film.height());
        (self.iteration, self.first_sample) = (0, 0);
    }

    /// Puts the pool on the device; makes buffers and descriptor sets anew where they are too small.
    fn prepare_sensor(&mut self, pool: &SortedPool) -> Result<()> {
        let slots = self.plan.slots(&pool.layout);
        let mut tracer = None;
        if let Some((old, mut device_pool, bound)) = self.sensor.take()
            && old.slots() >= slots
        {
            if device_pool.replace(pool)? {
                self.sensor = Some((old, device_pool, bound));
                return Ok(());
            }
            tracer = Some(old);
        }
        let tracer = match tracer {
            Some(tracer) => tracer,
            None => SensorTracer::new(&self.device, &self.plan, slots)?,
        };
        let device_pool = DevicePool::new(&self.device, pool)?;
        let bound = tracer.bind(&self.scene, &device_pool)?;
        self.sensor = Some((tracer, device_pool, bound));
        Ok(())
    }

    /// Mean and variance so far, over the crop.
    pub fn film(&self) -> &Film {
        &self.film
    }

    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// The device buffers hold at least this much for the scene.
    pub fn scene_bytes(&self) -> u64 {
        self.scene.bytes()
    }
}

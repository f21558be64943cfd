//! The objects of phase 3 that stay from iteration to iteration. If a pool outgrows them, larger ones replace them.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::tiles::{PixelOrder, Tile};
use super::*;
use crate::gpu::Buffer;
use crate::render::compaction::Compaction;
use crate::render::device_scene::{DeviceScene, frame_buffer};
use crate::render::plan::Iteration;
use crate::render::pool::SortedPool;
use crate::render::responses::{Adding, DeviceFilm};
use crate::settings::Crop;

/// The tracer, the pool on the device, and the descriptor sets over both.
pub struct SensorPhase {
    device: Device,
    compaction: Arc<Compaction>,
    frame: Buffer,
    objects: Option<SensorObjects>,
    /// That of the last iteration.
    order: Option<Arc<PixelOrder>>,
}

/// Everything that sensor tracing needs; the pool of the iteration is on the device.
pub struct SensorObjects {
    tracer: SensorTracer,
    pool: DevicePool,
    bindings: SensorBindings,
    /// If the device keeps the images of several responses.
    adding: Option<Adding>,
}

impl SensorPhase {
    pub fn new(device: &Device, compaction: Arc<Compaction>) -> Result<SensorPhase> {
        Ok(SensorPhase { device: device.clone(), compaction, frame: frame_buffer(device)?, objects: None, order: None })
    }

    /// The order in which the samples of a crop are taken.
    pub fn order(&mut self, crop: Crop) -> Arc<PixelOrder> {
        let order = self.order.take().filter(|order| order.crop == crop);
        self.order.insert(order.unwrap_or_else(|| PixelOrder::new(crop).into())).clone()
    }

    /// Uploads the pool and the frame of an iteration. Creates new buffers and descriptor sets if the present ones are too
    /// small. `film`: the images on the device, and the index of the first pixel of the present part of them.
    pub fn prepare(
        &mut self,
        plan: &Plan,
        iteration: &Iteration,
        scene: &DeviceScene,
        pool: &SortedPool,
        film: Option<(&DeviceFilm, u32)>,
        stats: &mut Stats,
    ) -> Result<&mut SensorObjects> {
        let objects = self.fit(plan, scene, pool, stats)?;
        let objects = self.objects.insert(objects);
        self.frame.write(0, &[plan.frame(iteration, Some((&pool.layout, objects.tracer.slots)))])?;
        let adding =
            film.map(|(film, offset)| film.adding(&self.frame, &objects.tracer.buffers.bindings(), offset)).transpose();
        objects.adding = adding?;
        Ok(objects)
    }

    fn fit(&mut self, plan: &Plan, scene: &DeviceScene, pool: &SortedPool, stats: &mut Stats) -> Result<SensorObjects> {
        let slots = plan.slots(&pool.layout);
        let mut tracer = None;
        if let Some(mut old) = self.objects.take() {
            let fits = old.tracer.slots >= slots && stats.timed(stage::UPLOAD, || old.pool.replace(pool))?;
            if fits {
                return Ok(old);
            }
            tracer = Some(old.tracer);
        }
        let device = &self.device;
        let tracer = match tracer {
            Some(tracer) if tracer.slots >= slots => tracer,
            Some(old) => {
                let kernels = stats.timed(stage::ALLOCATE, || old.into_kernels());
                SensorTracer::new(device, plan, slots, kernels, stats)?
            }
            None => {
                let kernels = stats.timed(stage::COMPILE, || Kernels::new(device, plan, self.compaction.clone()))?;
                SensorTracer::new(device, plan, slots, kernels, stats)?
            }
        };
        let pool = stats.timed(stage::UPLOAD, || DevicePool::new(device, pool))?;
        let bindings = stats
            .timed(stage::ALLOCATE, || tracer.kernels.bind(&tracer.buffers, &scene.bindings(&self.frame), &pool))?;
        Ok(SensorObjects { tracer, pool, bindings, adding: None })
    }
}

impl SensorObjects {
    /// Begins an iteration, which is abandoned soon after `stop` has become true.
    pub fn begin(&mut self, stop: &Arc<AtomicBool>) {
        let tracer = &mut self.tracer;
        tracer.tile.begin(!tracer.abandoned);
        (tracer.stop, tracer.abandoned) = (stop.clone(), false);
    }

    /// Records what comes before the next tile.
    pub fn recorder(&mut self) -> &mut Recorder {
        &mut self.tracer.recorder
    }

    /// Maximum number of samples of the next tile.
    pub fn tile_size(&self) -> usize {
        self.tracer.tile.get()
    }

    /// Starts the sensor subpaths of a tile, one per sample. `pool`: that of the iteration.
    pub fn start<'a>(
        &'a mut self,
        plan: &'a Plan,
        tile: &'a Tile,
        pool: &'a SortedPool,
        stats: &'a mut Stats,
    ) -> Result<SensorSubpaths<'a>> {
        let SensorObjects { tracer, bindings, adding, .. } = self;
        SensorSubpaths::start(tracer, bindings, adding.as_ref(), plan, tile, pool, stats)
    }

    /// The film of so many pixels, see [`Buffers::film`], and the mean luminance of the merged light. Fails if the device's counts
    /// contradict each other.
    pub fn film(&mut self, pixels: usize, stats: &mut Stats) -> Result<(Vec<[f32; 4]>, f64)> {
        // It would keep the images alive.
        self.adding = None;
        // Samples of later iterations must not follow a film that is wrong.
        stats.check()?;
        let SensorTracer { buffers, kernels, .. } = &self.tracer;
        let film = stats.timed(stage::READ_FILM, || buffers.film(pixels))?;
        let merged = if kernels.merge.is_some() { buffers.merged_light(pixels)? } else { 0.0 };
        Ok((film, merged))
    }
}

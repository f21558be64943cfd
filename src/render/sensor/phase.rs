//! The objects of phase 3 that stay from iteration to iteration. If a pool outgrows them, larger ones replace them.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::*;
use crate::render::compaction::Compaction;
use crate::render::plan::Iteration;
use crate::render::pool::SortedPool;
use crate::render::responses::ResponseSums;

/// The tracer, the pool on the device, and the descriptor sets over both.
pub struct SensorPhase {
    device: Device,
    compaction: Arc<Compaction>,
    ready: Option<Ready>,
}

/// Everything that sensor tracing needs; the pool of the iteration is on the device.
pub struct Ready {
    tracer: SensorTracer,
    pool: DevicePool,
    bindings: SensorBindings,
}

impl SensorPhase {
    pub fn new(device: &Device, compaction: Arc<Compaction>) -> SensorPhase {
        SensorPhase { device: device.clone(), compaction, ready: None }
    }

    /// Uploads the pool and the frame of an iteration. Creates new buffers and descriptor sets if the present ones are too
    /// small.
    pub fn prepare(
        &mut self,
        plan: &Plan,
        iteration: &Iteration,
        scene: &mut DeviceScene,
        pool: &SortedPool,
        stats: &mut Stats,
    ) -> Result<&mut Ready> {
        let ready = self.fit(plan, scene, pool, stats)?;
        let ready = self.ready.insert(ready);
        scene.write_frame(&plan.frame(iteration, Some((&pool.layout, ready.tracer.slots))))?;
        Ok(ready)
    }

    fn fit(&mut self, plan: &Plan, scene: &DeviceScene, pool: &SortedPool, stats: &mut Stats) -> Result<Ready> {
        let slots = plan.slots(&pool.layout);
        let mut tracer = None;
        if let Some(mut old) = self.ready.take() {
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
        let bindings = stats.timed(stage::ALLOCATE, || tracer.kernels.bind(&tracer.buffers, scene, &pool))?;
        Ok(Ready { tracer, pool, bindings })
    }
}

impl Ready {
    /// See [`SensorTracer::run`].
    #[allow(clippy::too_many_arguments)]
    pub fn run(
        &mut self,
        plan: &Plan,
        counts: &SampleCounts,
        image: &mut [f32],
        responses: Option<&mut ResponseSums>,
        visit: impl FnOnce(&[[f32; 4]], &[f32]),
        stop: &Arc<AtomicBool>,
        stats: &mut Stats,
    ) -> Result<bool> {
        self.tracer.run(plan, &self.bindings, counts, image, responses, visit, stop, stats)
    }

    /// See [`SensorTracer::observe`].
    pub fn observe(
        &mut self,
        plan: &Plan,
        counts: &SampleCounts,
        visit: &mut impl FnMut(SensorContribution),
    ) -> Result<()> {
        self.tracer.observe(plan, &self.bindings, counts, visit)
    }
}

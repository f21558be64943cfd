//! Phases 1 and 2 of Algorithm 1, which may run beside phase 3 of the iteration before.

use std::sync::mpsc::{Receiver, channel};
use std::thread::{Scope, ScopedJoinHandle};

use super::contribution::Contribution;
use super::device_scene::{DeviceScene, frame_buffer};
use super::*;
use crate::gpu::Buffer;
use crate::render::plan::Iteration;
use crate::render::pool::SortedPool;
use crate::threads;

/// Phases 1 and 2. Its buffers on the device are its own, and it only reads those of the scene.
pub struct LightPhase {
    tracer: LightTracer,
    /// `None` if the render does not merge.
    photons: Option<PhotonTracer>,
    frame: Buffer,
}

/// What phases 1 and 2 of an iteration found.
pub struct Lit {
    pub iteration: Iteration,
    pub pool: SortedPool,
    /// Every light vertex that the sensor sees (t = 1).
    pub splats: Vec<Contribution>,
    pub stats: Stats,
}

/// How far a [`LightPhase`] has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// The light vertices are on the host.
    Traced,
    /// All is done.
    Done,
}

impl LightPhase {
    pub fn new(
        device: &Device,
        scene: &DeviceScene,
        plan: &Plan,
        compaction: &Arc<Compaction>,
        prepared: &PreparedScene,
    ) -> Result<LightPhase> {
        let frame = frame_buffer(device)?;
        let bindings = scene.bindings(&frame);
        let tracer = LightTracer::new(device, &bindings, plan, compaction, &prepared.emitters.deterministic)?;
        let photons =
            plan.merging.is_some().then(|| PhotonTracer::new(device, &bindings, plan, prepared)).transpose()?;
        Ok(LightPhase { tracer, photons, frame })
    }

    /// Follows a camera that has moved. `aims`: see [`PreparedScene::aims`].
    pub fn set_camera(&mut self, aims: Vec<[f32; 4]>) {
        if let Some(photons) = &mut self.photons {
            photons.set_camera(aims);
        }
    }

    /// Follows lamps that have moved.
    pub fn set_lights(&mut self, prepared: &PreparedScene) {
        self.tracer.set_punctual(&prepared.emitters.deterministic);
        if let Some(photons) = &mut self.photons {
            photons.set_lights(prepared);
        }
    }

    /// Traces the light subpaths and builds the trees over their vertices. Also traces photons, if the render merges. Calls `report` when
    /// it has come further.
    pub fn run(&mut self, plan: &Plan, iteration: Iteration, report: impl Fn(Progress)) -> Result<Lit> {
        let (mut splats, mut stats) = (vec![], Stats::default());
        self.frame.write(0, &[plan.frame(&iteration, None)])?;
        let vertices = self.tracer.run(plan, &mut |splat| splats.push(splat), &mut stats)?;
        report(Progress::Traced);
        let mut pool = vertices.sort(plan, &mut stats)?;
        if let Some(photons) = &mut self.photons {
            pool.set_photons(photons.run(plan, &iteration, &mut stats)?);
        }
        report(Progress::Done);
        Ok(Lit { iteration, pool, splats, stats })
    }

    /// As [`LightPhase::run`], in a thread of its own.
    pub fn start<'scope>(
        &'scope mut self,
        scope: &'scope Scope<'scope, '_>,
        plan: &'scope Plan,
        iteration: Iteration,
    ) -> Result<Beside<'scope>> {
        let (sender, progress) = channel();
        let work = move || {
            let start = Instant::now();
            let report = |progress| {
                // Nobody may be listening any more.
                let _ = sender.send(progress);
            };
            let mut lit = self.run(plan, iteration, report)?;
            lit.stats.beside_seconds = start.elapsed().as_secs_f64();
            Ok(lit)
        };
        Ok(Beside { thread: threads::spawn_scoped(scope, "light", work)?, progress })
    }
}

/// Phases 1 and 2 of an iteration, in another thread.
pub struct Beside<'scope> {
    thread: ScopedJoinHandle<'scope, Result<Lit>>,
    progress: Receiver<Progress>,
}

impl Beside<'_> {
    /// Waits until the other thread, if there is one, has come as far as `wanted`, or has failed.
    pub fn wait(beside: &Option<Beside>, wanted: Progress) {
        let Some(beside) = beside else { return };
        while beside.progress.recv().is_ok_and(|progress| progress != wanted) {}
    }

    /// What the other thread has found.
    pub fn end(self) -> Result<Lit> {
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

//! Phase 1 of Algorithm 1: light subpaths, one bounce a submit, read back into the pool.

use super::device_scene::DeviceScene;
use super::plan::{Observe, Plan};
use super::pool::LightPool;
use super::stats::{Stats, stage};
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Device, Kernel, Need, Recorder};
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{Dispatch, NONE, PathState, PathVertex};

/// Light paths traced together: few enough for a short submit. The order of vertices and splats, and so the last bits of the
/// image, depend on it: it is the same everywhere.
const BATCH: usize = 1 << 16;

/// A light vertex as the sensor sees it (t = 1).
pub struct Splat {
    /// As it adds to the mean of its pixel.
    pub rgb: [f32; 3],
    /// Bits of the pixel within the crop; for [`Observe::Times`] the travel time.
    pub pixel_or_tau: f32,
    /// MIS weight that `rgb` still lacks for [`Observe::Strategies`], else 1.
    pub weight: f32,
    /// Vertices of the light subpath.
    pub s: u32,
}

/// Light paths that are traced together.
struct Batch {
    first: u32,
    count: u32,
    /// NONE where each path draws its emitter; else that of the first path, and only its deterministic vertices count.
    emitter: u32,
}

/// Kernels and buffers of the light subpaths.
pub struct LightTracer {
    start: (Kernel, Bindings),
    trace: (Kernel, Bindings),
    splat: (Kernel, Bindings),
    vertices: Buffer,
    states: Buffer,
    list: Buffer,
    splats: Buffer,
    splat_weights: Buffer,
    recorder: Recorder,
    /// Punctual lights as light vertices: they are in every pool.
    punctual: Vec<PathVertex>,
}

impl Splat {
    /// Adds it to the RGB image of the crop.
    pub fn add_to(&self, image: &mut [f32]) {
        let at = self.pixel_or_tau.to_bits() as usize * 3;
        (0..3).for_each(|k| image[at + k] += self.rgb[k]);
    }
}

impl LightTracer {
    pub fn new(device: &Device, scene: &DeviceScene, plan: &Plan, punctual: &[PathVertex]) -> Result<LightTracer> {
        let [states, vertices, list, splats, splat_weights] =
            LightTracer::needs(plan).map(|need| Buffer::for_need(device, &need));
        let (states, vertices, list, splats, splat_weights) = (states?, vertices?, list?, splats?, splat_weights?);
        let mut buffers = scene.bindings();
        buffers.extend([("states", &states), ("vertices", &vertices), ("list", &list), ("splats", &splats)]);
        buffers.push(("splat_weights", &splat_weights));
        let make = |file: &'static str| -> Result<(Kernel, Bindings)> {
            let kernel = Kernel::new(device, file, file, &plan.constants())?;
            let bindings = kernel.bind(&buffers)?;
            Ok((kernel, bindings))
        };
        Ok(LightTracer {
            start: make("light_start")?,
            trace: make("light_trace")?,
            splat: make("light_splat")?,
            recorder: Recorder::new(device)?,
            vertices,
            states,
            list,
            splats,
            splat_weights,
            punctual: punctual.to_vec(),
        })
    }

    /// What the buffers of [`LightTracer::new`] need, in its order.
    pub fn needs(plan: &Plan) -> [Need; 5] {
        let capacity = BATCH.min(plan.traced_paths().max(plan.thin_lights.len() as u32) as usize);
        let remedy = "use fewer --light-paths";
        [
            Need::of::<PathState>("light path states", capacity, remedy),
            Need::of::<PathVertex>("new light vertices", capacity, remedy),
            Need::of::<u32>("living light paths", capacity, remedy),
            Need::of::<[f32; 4]>("light splats", capacity, remedy),
            Need::of::<f32>(
                "weights of splats",
                if plan.observe == Observe::Strategies { capacity } else { 1 },
                remedy,
            ),
        ]
    }

    /// Traces all light subpaths of an iteration and returns their vertices; shows `see` what the sensor sees of them (t = 1), in
    /// the order of the paths.
    pub fn run(&mut self, plan: &Plan, see: &mut impl FnMut(Splat), stats: &mut Stats) -> Result<LightPool> {
        let mut pool = LightPool { deterministic: self.punctual.clone(), ..Default::default() };
        let thin = if plan.traces_light { plan.thin_lights.clone() } else { 0..0 };
        for emitter in thin.clone().step_by(BATCH) {
            let batch = Batch { first: 0, count: (thin.end - emitter).min(BATCH as u32), emitter };
            self.run_batch(plan, &batch, &mut pool, see, stats)?;
        }
        for first in (0..plan.traced_paths()).step_by(BATCH) {
            let count = (plan.traced_paths() - first).min(BATCH as u32);
            self.run_batch(plan, &Batch { first, count, emitter: NONE }, &mut pool, see, stats)?;
        }
        stats.light_paths += u64::from(plan.traced_paths());
        Ok(pool)
    }

    fn run_batch(
        &mut self,
        plan: &Plan,
        batch: &Batch,
        pool: &mut LightPool,
        see: &mut impl FnMut(Splat),
        stats: &mut Stats,
    ) -> Result<()> {
        let &Batch { first, count, emitter } = batch;
        let lists = Dispatch { counter: NONE, list_a: NONE, list_b: NONE, ..bytemuck::Zeroable::zeroed() };
        let constants = |count: u32, bounce: u32| Dispatch { first, count, bounce, emitter, ..lists };
        let groups = self.start.0.groups(count as usize);
        self.recorder.dispatch("light_start", &self.start.0, &self.start.1, &constants(count, 0), groups)?;
        stats.submit(&mut self.recorder)?;
        let mut living: Vec<u32> = (0..count).collect();
        stats.timed(stage::READ_LIGHT, || self.collect(plan, &living, batch, pool))?;
        if !plan.traces_light {
            return Ok(());
        }
        living = stats.timed(stage::READ_LIGHT, || self.survivors(&living))?;
        for bounce in 0..plan.max_depth - 1 {
            if living.is_empty() {
                break;
            }
            stats.timed(stage::UPLOAD, || self.list.write(0, &living))?;
            let constants = constants(living.len() as u32, bounce);
            let groups = self.trace.0.groups(living.len());
            self.recorder.dispatch("light_trace", &self.trace.0, &self.trace.1, &constants, groups)?;
            if plan.splats {
                let groups = self.splat.0.groups(living.len());
                self.recorder.dispatch("light_splat", &self.splat.0, &self.splat.1, &constants, groups)?;
            }
            stats.submit(&mut self.recorder)?;
            stats.closest_rays += living.len() as u64;
            stats.light_rays += living.len() as u64;
            stats.timed(stage::READ_LIGHT, || self.collect(plan, &living, batch, pool))?;
            if plan.splats {
                let show = |splat: Splat| see(Splat { s: bounce + 2, ..splat });
                let splats = || self.show_splats(plan, &living, show);
                let [shown, dropped] = stats.timed(stage::READ_LIGHT, splats)?;
                stats.inside_gate += shown;
                stats.dropped += dropped;
            }
            living = stats.timed(stage::READ_LIGHT, || self.survivors(&living))?;
        }
        Ok(())
    }

    /// Vertices that were just reached by paths that are stored, in the order of the paths.
    fn collect(&self, plan: &Plan, living: &[u32], batch: &Batch, pool: &mut LightPool) -> Result<()> {
        let first = batch.first;
        let is_stored = |slot: u32| batch.emitter != NONE || first + slot < plan.light_paths;
        self.vertices.with::<PathVertex, _>(self.vertices_in_use(living), |vertices| {
            for &slot in living.iter().take_while(|&&slot| is_stored(slot)) {
                let vertex = &vertices[slot as usize];
                if vertex.flags & VERTEX_VALID != 0 {
                    pool.push(first + slot, vertex, plan.max_depth);
                }
            }
        })
    }

    fn survivors(&self, living: &[u32]) -> Result<Vec<u32>> {
        self.states.with::<PathState, _>(self.vertices_in_use(living), |states| {
            living.iter().copied().filter(|&slot| states[slot as usize].flags & PATH_ALIVE != 0).collect()
        })
    }

    fn vertices_in_use(&self, living: &[u32]) -> usize {
        living.last().map_or(0, |&slot| slot as usize + 1)
    }

    /// Returns how many splats were shown, and how many dropped as non-finite.
    fn show_splats(&self, plan: &Plan, living: &[u32], mut see: impl FnMut(Splat)) -> Result<[u64; 2]> {
        let n = self.vertices_in_use(living);
        let (mut shown, mut dropped) = (0, 0);
        let weighs = plan.observe == Observe::Strategies;
        let weights = self.splat_weights.to_vec::<f32>(if weighs { n } else { 0 })?;
        self.splats.with::<[f32; 4], _>(n, |splats| {
            for &slot in living {
                let [r, g, b, pixel_or_tau] = splats[slot as usize];
                if pixel_or_tau.to_bits() != NONE {
                    let finite = [r, g, b].iter().all(|value| value.is_finite());
                    dropped += u64::from(!finite);
                    if finite {
                        shown += 1;
                        let weight = weights.get(slot as usize).copied().unwrap_or(1.0);
                        see(Splat { rgb: [r, g, b], pixel_or_tau, weight, s: 0 });
                    }
                }
            }
        })?;
        Ok([shown, dropped])
    }
}

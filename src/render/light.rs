//! Phase 1 of Algorithm 1: traces the light subpaths and reads their vertices back into the pool.

mod device_loop;
mod host_loop;

use std::sync::Arc;

use super::compaction::{COUNTERS, Compaction};
use super::contribution::Contribution;
use super::plan::{Observe, Plan};
use super::pool::LightPool;
use super::stats::{Stats, computes_wrongly, stage};
use crate::error::Result;
use crate::gpu::{Allocate, Bindings, Buffer, BufferDesc, BufferList, Device, DeviceInfo, Kernel, Recorder};
use crate::wgsl::layout::constants::VERTEX_DEPTH;
use crate::wgsl::layout::{Dispatch, NONE, PathState, PathVertex};
use device_loop::DeviceLoop;

/// Maximum number of light paths in a batch, small enough for a short submit. It is the same for all devices, because it
/// determines the order of vertices and splats, and this order determines the last bits of the image.
const BATCH: usize = 1 << 16;

/// Counts the splats that the device wrote.
struct Tally {
    observe: Observe,
    /// Number of pixels.
    pixels: u32,
    inside_gate: u64,
    /// Splats that were dropped because they are not finite.
    dropped: u64,
    /// Splats whose pixel does not exist.
    misplaced: u64,
}

impl Tally {
    fn new(plan: &Plan) -> Tally {
        Tally { observe: plan.observe, pixels: plan.crop_pixels as u32, inside_gate: 0, dropped: 0, misplaced: 0 }
    }

    /// Counts the splat of a light vertex (t = 1) that the device wrote, and passes it to `visit`. `pixel_or_tau` is the pixel, NONE
    /// if there is no splat, or with [`Observe::Times`] the bits of the travel time. `detail` is the number that [`Observe`] adds.
    fn report(&mut self, [r, g, b, pixel_or_tau]: [u32; 4], detail: f32, s: u32, visit: &mut impl FnMut(Contribution)) {
        if pixel_or_tau == NONE {
            return;
        }
        let (pixel, tau, mis_weight) = match self.observe {
            Observe::Nothing => (pixel_or_tau, f32::NAN, 1.0),
            Observe::Times => (NONE, f32::from_bits(pixel_or_tau), 1.0),
            Observe::Strategies => (pixel_or_tau, f32::NAN, detail),
            Observe::Responses => (pixel_or_tau, detail, 1.0),
        };
        let rgb = [r, g, b].map(f32::from_bits);
        if pixel != NONE && pixel >= self.pixels {
            self.misplaced += 1;
        } else if rgb.iter().all(|value| value.is_finite()) {
            self.inside_gate += 1;
            visit(Contribution { rgb, pixel, tau, mis_weight, s, t: 1, ellipsoidal: false });
        } else {
            self.dropped += 1;
        }
    }

    /// Adds the counts to `stats`. Fails if the pixel of a splat does not exist.
    fn add_to(&self, stats: &mut Stats) -> Result<()> {
        stats.inside_gate += self.inside_gate;
        stats.dropped += self.dropped;
        match self.misplaced {
            0 => Ok(()),
            n => Err(computes_wrongly(&format!("it saw {n} light vertices in pixels that do not exist"))),
        }
    }
}

/// Where the results of an iteration go: light vertices to the pool, and splats to `visit`.
struct Sink<'a, V> {
    plan: &'a Plan,
    pool: &'a mut LightPool,
    visit: &'a mut V,
    tally: Tally,
}

impl<V: FnMut(Contribution)> Sink<'_, V> {
    /// Adds the vertex that the path in `slot` of the batch has just reached. `splat` and `detail`: see [`Tally::report`].
    fn add(&mut self, batch: &Batch, slot: u32, vertex: &PathVertex, splat: [u32; 4], detail: f32) {
        if batch.is_stored(self.plan, slot) {
            self.pool.push(batch.first + slot, vertex, self.plan.max_depth);
        }
        // The first vertex of a path has no splat: sensor subpaths find emitters that are seen directly (s = 0).
        let depth = vertex.flags & VERTEX_DEPTH;
        if self.plan.splats && depth > 0 {
            self.tally.report(splat, detail, depth + 1, self.visit);
        }
    }
}

/// The kind of a batch of light paths.
#[derive(Clone, Copy, PartialEq)]
enum BatchKind {
    /// Each path samples its emitter.
    Subpaths,
    /// The paths yield the deterministic vertices of thin beams. The first path starts from the emitter with this index; each further
    /// path starts from the next one.
    BeamSpots(u32),
    /// Each path that starts with a beam yields at most one event on the line of the beam (`beam_events.wgsl`).
    BeamEvents,
}

/// Light paths that are traced together.
struct Batch {
    first: u32,
    count: u32,
    kind: BatchKind,
}

impl Batch {
    /// The constants that all dispatches of the batch share. The list of its paths has counter 0.
    fn constants(&self) -> Dispatch {
        let &Batch { first, count, kind } = self;
        let emitter = if let BatchKind::BeamSpots(emitter) = kind { emitter } else { NONE };
        let none = Dispatch { list_a: NONE, list_b: NONE, ..bytemuck::Zeroable::zeroed() };
        Dispatch { first, count, emitter, counter: 0, ..none }
    }

    /// Whether the pool stores the vertices of the path in `slot` for connections. Otherwise they serve t = 1 only.
    fn is_stored(&self, plan: &Plan, slot: u32) -> bool {
        match self.kind {
            BatchKind::Subpaths => self.first + slot < plan.light_paths,
            BatchKind::BeamSpots(_) => true,
            BatchKind::BeamEvents => false,
        }
    }
}

/// Phase 1, for all iterations.
pub struct LightTracer {
    subpaths: Subpaths,
    /// Traces several bounces per submit; `None` if the host waits for every round.
    device_loop: Option<DeviceLoop>,
    /// Punctual lights as light vertices, which every pool contains.
    punctual: Vec<PathVertex>,
    /// The pool of the last iteration.
    pool: LightPool,
}

/// Kernels and buffers of the light subpaths of a batch.
struct Subpaths {
    start: (Kernel, Bindings),
    trace: (Kernel, Bindings),
    splat: (Kernel, Bindings),
    /// Only if the plan draws events on beams.
    beam_events: Option<(Kernel, Bindings)>,
    buffers: Buffers,
    /// The paths that the next round traces, if the host waits for every round.
    living: Vec<u32>,
    recorder: Recorder,
}

/// Buffers of the light subpaths of a batch.
struct Buffers<A: Allocate = Device> {
    states: A::Buffer,
    vertices: A::Buffer,
    /// Living paths.
    list: A::Buffer,
    splats: A::Buffer,
    splat_details: A::Buffer,
    counters: A::ReadBack,
}

impl<A: Allocate> Buffers<A> {
    fn new(to: &A, plan: &Plan) -> Result<Buffers<A>> {
        let capacity = LightTracer::capacity(plan);
        let details = if plan.observe.has_splat_details() { capacity } else { 1 };
        let remedy = "use fewer --light-paths";
        Ok(Buffers {
            states: to.buffer(BufferDesc::of::<PathState>("light path states", capacity, remedy))?,
            vertices: to.buffer(BufferDesc::of::<PathVertex>("new light vertices", capacity, remedy))?,
            list: to.buffer(BufferDesc::of::<u32>("living light paths", capacity, remedy))?,
            splats: to.buffer(BufferDesc::of::<[u32; 4]>("light splats", capacity, remedy))?,
            splat_details: to.buffer(BufferDesc::of::<f32>("details of splats", details, remedy))?,
            counters: to.read_back(BufferDesc::of::<u32>("counters", COUNTERS, remedy))?,
        })
    }
}

impl Buffers {
    /// All buffers except `list`, which [`DeviceLoop`] alternates with a second list.
    fn bindings(&self) -> [(&str, &Buffer); 5] {
        [
            ("states", &self.states),
            ("vertices", &self.vertices),
            ("splats", &self.splats),
            ("splat_details", &self.splat_details),
            ("counters", self.counters.buffer()),
        ]
    }
}

impl LightTracer {
    /// `scene`: the buffers of group 0. `punctual`: see [`LightTracer::set_punctual`].
    pub fn new(
        device: &Device,
        scene: &[(&str, &Buffer)],
        plan: &Plan,
        compaction: &Arc<Compaction>,
        punctual: &[PathVertex],
    ) -> Result<LightTracer> {
        let buffers = Buffers::new(device, plan)?;
        let shared = [scene, &buffers.bindings()].concat();
        let listed = [&shared[..], &[("list", &buffers.list)]].concat();
        let make = |file: &'static str| -> Result<(Kernel, Bindings)> {
            let kernel = Kernel::new(device, file, file, &plan.constants())?;
            let bindings = kernel.bind(&listed)?;
            Ok((kernel, bindings))
        };
        let (start, trace, splat) = (make("light_start")?, make("light_trace")?, make("light_splat")?);
        let beam_events = plan.draws_on_beams().then(|| make("beam_events")).transpose()?;
        let device_loop = match device.info().drive.waits_per_bounce {
            true => None,
            false => {
                Some(DeviceLoop::new(device, plan, &shared, &buffers.list, &trace.0, &splat.0, compaction.clone())?)
            }
        };
        let recorder = Recorder::new(device)?;
        let subpaths = Subpaths { start, trace, splat, beam_events, buffers, living: vec![], recorder };
        Ok(LightTracer { subpaths, device_loop, punctual: punctual.to_vec(), pool: LightPool::default() })
    }

    /// Files of the kernels, whose entry points have the same names.
    pub fn files(info: &DeviceInfo, plan: &Plan) -> Vec<&'static str> {
        let device_loop: &[&str] = if info.drive.waits_per_bounce { &[] } else { &["light_mark", "light_keep"] };
        let on_beams: &[&str] = if plan.draws_on_beams() { &["beam_events"] } else { &[] };
        [&["light_start", "light_trace", "light_splat"], device_loop, on_beams].concat()
    }

    /// Replaces the punctual lights.
    pub fn set_punctual(&mut self, punctual: &[PathVertex]) {
        self.punctual = punctual.to_vec();
    }

    /// Maximum number of paths in a batch.
    fn capacity(plan: &Plan) -> usize {
        BATCH.min(plan.traced_paths().max(plan.thin_beams.len() as u32) as usize)
    }

    /// Descriptors of the buffers that [`LightTracer::new`] allocates.
    pub fn buffer_descs(info: &DeviceInfo, plan: &Plan) -> Vec<BufferDesc> {
        let mut buffer_descs = BufferList::of(|list| Buffers::new(list, plan));
        if !info.drive.waits_per_bounce {
            buffer_descs.extend(DeviceLoop::buffer_descs(info, plan));
        }
        buffer_descs
    }

    /// Traces all light subpaths of an iteration and returns the vertices for connections. Calls `visit` with the splat of
    /// every vertex that the sensor sees (t = 1), in the same order on every device.
    pub fn run(&mut self, plan: &Plan, visit: &mut impl FnMut(Contribution), stats: &mut Stats) -> Result<&LightPool> {
        let mut pool = std::mem::take(&mut self.pool);
        pool.restart(&self.punctual);
        let mut sink = Sink { plan, pool: &mut pool, visit, tally: Tally::new(plan) };
        let thin = if plan.traces_light { plan.thin_beams.clone() } else { 0..0 };
        for emitter in thin.clone().step_by(BATCH) {
            let count = (thin.end - emitter).min(BATCH as u32);
            self.run_batch(&Batch { first: 0, count, kind: BatchKind::BeamSpots(emitter) }, &mut sink, stats)?;
        }
        let on_beams = plan.draws_on_beams().then_some(BatchKind::BeamEvents);
        for kind in [BatchKind::Subpaths].into_iter().chain(on_beams) {
            for first in (0..plan.traced_paths()).step_by(BATCH) {
                let count = (plan.traced_paths() - first).min(BATCH as u32);
                self.run_batch(&Batch { first, count, kind }, &mut sink, stats)?;
            }
        }
        sink.tally.add_to(stats)?;
        stats.light_paths += u64::from(plan.traced_paths());
        self.pool = pool;
        Ok(&self.pool)
    }

    /// Traces the paths of a batch: round 0 starts them, and each further round is a bounce. The host waits for every round, or for
    /// several rounds together.
    fn run_batch<V: FnMut(Contribution)>(
        &mut self,
        batch: &Batch,
        sink: &mut Sink<'_, V>,
        stats: &mut Stats,
    ) -> Result<()> {
        if batch.kind == BatchKind::BeamEvents {
            // Paths from other emitters trace no ray.
            stats.add_light_rays((f64::from(batch.count) * sink.plan.beam_share).round() as u64);
        }
        let end = if sink.plan.traces_light && batch.kind != BatchKind::BeamEvents { sink.plan.max_depth } else { 1 };
        let (mut round, mut living) = (0, batch.count);
        while round < end && living > 0 {
            (round, living) = match &mut self.device_loop {
                None => (round + 1, self.subpaths.run_round(batch, round, round + 1 == end, sink, stats)?),
                Some(device_loop) => {
                    device_loop.run_rounds(&mut self.subpaths, batch, round..end, living, sink, stats)?
                }
            };
        }
        Ok(())
    }
}

impl Subpaths {
    /// Records the kernels that write the first vertices of a batch. Events on beams also get their splats; the counter of the list
    /// must hold the number of paths.
    fn record_start(&mut self, batch: &Batch, constants: &Dispatch) -> Result<()> {
        let groups = self.start.0.groups(constants.count as usize);
        if batch.kind == BatchKind::BeamEvents {
            let (kernel, bindings) = self.beam_events.as_ref().expect("the plan draws events on beams");
            self.recorder.dispatch("beam_events", kernel, bindings, constants, groups)?;
            return self.recorder.dispatch("light_splat", &self.splat.0, &self.splat.1, constants, groups);
        }
        self.recorder.dispatch("light_start", &self.start.0, &self.start.1, constants, groups)
    }
}

#[cfg(test)]
mod tests;

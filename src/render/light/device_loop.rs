//! Traces light subpaths without a wait for each bounce. The device lists the paths that continue and collects the vertices
//! of many bounces in one buffer, which the host reads at once.

use std::ops::Range;

use super::*;
use crate::render::compaction::{ARGUMENTS, CompactionBindings, chunk_counts, indirect_over};
use crate::render::submit_size::size_factor;
use crate::wgsl::layout::constants::{CHUNK, COUNTER_TOTALS};

/// Maximum number of rounds per submit. Round 0 starts the paths; each further round is a bounce. The vertices of 16 rounds
/// of a full batch take 112 MiB, and few paths live longer than 16 bounces.
const MAX_ROUNDS: u32 = 16;

/// Indices of the list counters: living paths (two lists that alternate between rounds), and paths whose new vertices are kept.
const LIVING: [u32; 2] = [0, 1];
const KEPT: u32 = 2;

pub struct DeviceLoop {
    mark: Kernel,
    keep: Kernel,
    compaction: Arc<Compaction>,
    /// Descriptor sets of the kernels: `[0]` for even and `[1]` for odd rounds.
    bound: [ParityBindings; 2],
    bound_keep: Bindings,
    buffers: LoopBuffers,
    /// Maximum number of rounds per submit that the buffers allow.
    capacity: u32,
    /// Number of rounds in the next submit, adapted to the time that submits take.
    rounds: u32,
}

/// Buffers that only this loop needs.
struct LoopBuffers<A: Allocate = Device> {
    /// Living paths of odd rounds.
    list: A::Buffer,
    /// Paths whose new vertices are kept.
    kept: A::Buffer,
    marks: A::Buffer,
    chunk_counts: A::Buffer,
    arguments: A::Buffer,
    kept_vertices: A::ReadBack,
    kept_splats: A::ReadBack,
    kept_paths: A::ReadBack,
}

impl<A: Allocate> LoopBuffers<A> {
    fn new(to: &A, info: &DeviceInfo, plan: &Plan) -> Result<LoopBuffers<A>> {
        let paths = LightTracer::capacity(plan);
        let kept = paths * DeviceLoop::capacity(info, plan) as usize;
        let remedy = "use fewer --light-paths";
        let words = |name: &'static str, n: usize| BufferDesc::of::<u32>(name, n, remedy);
        Ok(LoopBuffers {
            list: to.buffer(words("living light paths in turn", paths))?,
            kept: to.buffer(words("light paths with new vertices", paths))?,
            marks: to.buffer(words("marks of light paths", paths.next_multiple_of(CHUNK as usize)))?,
            chunk_counts: to.buffer(BufferDesc::of::<[u32; 2]>(
                "chunk counts of light paths",
                chunk_counts(paths),
                remedy,
            ))?,
            arguments: to.buffer(words("dispatch arguments of light paths", ARGUMENTS))?,
            kept_vertices: to.read_back(BufferDesc::of::<PathVertex>("light vertices of all bounces", kept, remedy))?,
            kept_splats: to.read_back(BufferDesc::of::<[u32; 4]>("light splats of all bounces", kept, remedy))?,
            kept_paths: to.read_back(BufferDesc::of::<[u32; 2]>("light paths of all bounces", kept, remedy))?,
        })
    }
}

struct ParityBindings {
    trace: Bindings,
    splat: Bindings,
    mark: Bindings,
    compaction: CompactionBindings,
}

impl DeviceLoop {
    /// `buffers` are bound to all kernels. `list` holds the living paths of even rounds.
    pub fn new(
        device: &Device,
        plan: &Plan,
        buffers: &[(&str, &Buffer)],
        list: &Buffer,
        trace: &Kernel,
        splat: &Kernel,
        compaction: Arc<Compaction>,
    ) -> Result<DeviceLoop> {
        let own = LoopBuffers::new(device, device.info(), plan)?;
        let make = |file: &'static str| Kernel::new(device, file, file, &plan.constants());
        let (mark, keep) = (make("light_mark")?, make("light_keep")?);
        let turn = |from: &Buffer, to: &Buffer| -> Result<ParityBindings> {
            let lists = [("list", from), ("source", from), ("list_a", to), ("list_b", &own.kept)];
            let others = [("marks", &own.marks), ("chunk_counts", &own.chunk_counts), ("arguments", &own.arguments)];
            let all = [buffers, &lists, &others].concat();
            Ok(ParityBindings {
                trace: trace.bind(&all)?,
                splat: splat.bind(&all)?,
                mark: mark.bind(&all)?,
                compaction: compaction.bind(&all)?,
            })
        };
        let bound = [turn(list, &own.list)?, turn(&own.list, list)?];
        let outputs = [
            ("kept_vertices", own.kept_vertices.buffer()),
            ("kept_splats", own.kept_splats.buffer()),
            ("kept_paths", own.kept_paths.buffer()),
        ];
        let bound_keep = keep.bind(&[buffers, &[("list", &own.kept)], &outputs].concat())?;
        let capacity = DeviceLoop::capacity(device.info(), plan);
        Ok(DeviceLoop {
            mark,
            keep,
            compaction,
            bound,
            bound_keep,
            buffers: own,
            capacity,
            rounds: if plan.tuning.tile.is_some() { capacity } else { 1 },
        })
    }

    /// Maximum number of rounds per submit: each round may produce one vertex per path.
    fn capacity(info: &DeviceInfo, plan: &Plan) -> u32 {
        let round = (LightTracer::capacity(plan) * size_of::<PathVertex>()) as u64;
        let max = if plan.traces_light { plan.max_depth.min(MAX_ROUNDS) } else { 1 };
        (info.largest_buffer() / round).clamp(1, max.into()) as u32
    }

    pub fn buffer_descs(info: &DeviceInfo, plan: &Plan) -> Vec<BufferDesc> {
        BufferList::of(|list| LoopBuffers::new(list, info, plan))
    }

    /// Traces some of the given rounds in one submit; `living` paths take part in the first of them. A second submit copies the new
    /// vertices to the host. Returns the next round, and the number of paths that take part in it.
    pub fn run_rounds<V: FnMut(Contribution)>(
        &mut self,
        subpaths: &mut Subpaths,
        batch: &Batch,
        rounds: Range<u32>,
        living: u32,
        sink: &mut Sink<'_, V>,
        stats: &mut Stats,
    ) -> Result<(u32, u32)> {
        let Range { start, end } = rounds;
        let until = end.min(start + self.rounds);
        stats.timed(stage::RECORD, || self.record(subpaths, sink.plan, batch, start..until, living))?;
        let seconds = stats.submit(&mut subpaths.recorder)?;
        let mut counters = [0u32; COUNTERS];
        stats.timed(stage::READ_COUNTERS, || {
            subpaths.buffers.counters.with(COUNTERS, |read| counters.copy_from_slice(read))
        })?;
        let total = |list: u32| counters[(COUNTER_TOTALS + list) as usize];
        let left = counters[LIVING[until as usize % 2] as usize];
        let (listed, kept) = (total(LIVING[0]) + total(LIVING[1]), total(KEPT));
        let kept_max = batch.count * (until - start);
        if left > batch.count || left > listed || listed > kept_max + batch.count || kept > kept_max {
            return Err(computes_wrongly(&format!(
                "{} light paths gave {left} living paths, {listed} in all bounces, and {kept} vertices",
                batch.count,
            )));
        }
        // A bounce traces one ray per path of its list. Round 0 traces no rays, and the last list is not traced yet.
        let before = if start == 0 { 0 } else { living };
        stats.add_light_rays(u64::from(before + listed - left));
        self.read_back_kept(subpaths, kept as usize, stats)?;
        stats.timed(stage::READ_LIGHT, || self.collect_kept(batch, kept as usize, sink))?;
        // The single round of a batch without bounces says nothing about the time of a bounce.
        if end > 1 && sink.plan.tuning.tile.is_none() {
            self.rounds = ((f64::from(until - start) * size_factor(seconds)) as u32).clamp(1, self.capacity);
        }
        Ok((until, left))
    }

    /// Records the given rounds: the start of the paths (round 0) and bounces. `living` paths take part in the first given round.
    fn record(
        &mut self,
        subpaths: &mut Subpaths,
        plan: &Plan,
        batch: &Batch,
        rounds: Range<u32>,
        living: u32,
    ) -> Result<()> {
        let all = batch.count as usize;
        let groups = self.mark.groups(living as usize);
        let (counters, arguments) = self.compaction.one_list(LIVING[rounds.start as usize % 2], living, groups);
        subpaths.buffers.counters.write(&counters)?;
        self.buffers.arguments.write(0, &arguments)?;
        for round in rounds {
            let (now, next) = (round as usize % 2, 1 - round as usize % 2);
            let (turn, list) = (&self.bound[now], indirect_over(&self.buffers.arguments, LIVING[now]));
            let constants = Dispatch { counter: LIVING[now], ..batch.constants() };
            if round == 0 {
                subpaths.record_start(batch, &constants)?;
            } else {
                let constants = Dispatch { bounce: round - 1, ..constants };
                let (trace, splat, r) = (&subpaths.trace.0, &subpaths.splat.0, &mut subpaths.recorder);
                r.dispatch_indirect("light_trace", trace, &turn.trace, &constants, list)?;
                if plan.splats {
                    r.dispatch_indirect("light_splat", splat, &turn.splat, &constants, list)?;
                }
            }
            let lists = Dispatch { list_a: LIVING[next], list_b: KEPT, ..constants };
            let r = &mut subpaths.recorder;
            r.dispatch_indirect("light_mark", &self.mark, &turn.mark, &lists, list)?;
            self.compaction.record(r, &turn.compaction, &lists, all, &self.buffers.arguments)?;
            let kept = Dispatch { counter: KEPT, ..constants };
            r.dispatch_indirect(
                "light_keep",
                &self.keep,
                &self.bound_keep,
                &kept,
                indirect_over(&self.buffers.arguments, KEPT),
            )?;
        }
        subpaths.recorder.read_back(&subpaths.buffers.counters, subpaths.buffers.counters.buffer().size())
    }

    /// Copies the `count` kept vertices to the host, with their splats and paths.
    fn read_back_kept(&self, subpaths: &mut Subpaths, count: usize, stats: &mut Stats) -> Result<()> {
        if count == 0 {
            return Ok(());
        }
        let r = &mut subpaths.recorder;
        r.read_back(&self.buffers.kept_vertices, (count * size_of::<PathVertex>()) as u64)?;
        r.read_back(&self.buffers.kept_splats, (count * size_of::<[u32; 4]>()) as u64)?;
        r.read_back(&self.buffers.kept_paths, (count * size_of::<[u32; 2]>()) as u64)?;
        stats.submit(r)?;
        Ok(())
    }

    /// Adds the `count` kept vertices to the pool, and reports their splats, bounce by bounce in the order of the paths.
    fn collect_kept<V: FnMut(Contribution)>(&self, batch: &Batch, count: usize, sink: &mut Sink<'_, V>) -> Result<()> {
        let paths = self.buffers.kept_paths.with::<[u32; 2], _>(count, |paths| paths.to_vec())?;
        let splats = self.buffers.kept_splats.with::<[u32; 4], _>(count, |splats| splats.to_vec())?;
        if paths.iter().any(|&[slot, _]| slot >= batch.count) {
            return Err(computes_wrongly("it kept a vertex of a light path that does not exist"));
        }
        self.buffers.kept_vertices.with::<PathVertex, _>(count, |vertices| {
            for ((vertex, splat), [slot, detail]) in vertices.iter().zip(splats).zip(paths) {
                sink.add(batch, slot, vertex, splat, f32::from_bits(detail));
            }
        })
    }
}

//! Records dispatches into a command buffer. They run in order, and each dispatch sees all writes of earlier dispatches.

use std::sync::Arc;

use ash::vk;
use bytemuck::NoUninit;

use super::allocation::Allocation;
use super::bindings::{Bindings, DescriptorSets};
use super::buffer::Buffer;
use super::commands::Commands;
use super::device::Device;
use super::kernel::Kernel;
use super::read_back::ReadBack;
use crate::error::Result;

/// For each label, the seconds that the device spent on the dispatches with this label during one submit. Empty if the device has
/// no timestamps.
pub type Timing = Vec<(&'static str, f64)>;

const MAX_QUERIES: u32 = 2048;

/// Records dispatches and submits them together. A recorder is reused for many submits.
pub struct Recorder {
    device: Device,
    commands: Commands,
    queries: vk::QueryPool,
    labels: Vec<&'static str>,
    /// Keeps everything that is recorded alive until the device has executed it.
    kept: Vec<Kept>,
}

/// What the recorded commands use.
enum Kept {
    Sets(Arc<DescriptorSets>),
    Memory(Arc<Allocation>),
}

impl Kept {
    fn allocations(&self) -> &[Arc<Allocation>] {
        match self {
            Kept::Sets(sets) => &sets.buffers,
            Kept::Memory(allocation) => std::slice::from_ref(allocation),
        }
    }
}

impl Recorder {
    pub fn new(device: &Device) -> Result<Recorder> {
        let commands = Commands::new(&device.shared)?;
        let shared = &device.shared;
        let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(MAX_QUERIES);
        // SAFETY: `info` outlives the call. `drop` destroys the pool.
        let queries = unsafe { shared.device.create_query_pool(&info, None) }
            .map_err(|e| shared.error("creating a query pool", e))?;
        Ok(Recorder { device: device.clone(), commands, queries, labels: vec![], kept: vec![] })
    }

    fn begin(&mut self) -> Result<()> {
        if self.commands.is_recording() {
            return Ok(());
        }
        self.commands.begin()?;
        // SAFETY: recording has begun. `submit` has already read the results of the last submit.
        unsafe {
            let d = &self.device.shared.device;
            d.cmd_reset_query_pool(self.commands.buffer, self.queries, 0, MAX_QUERIES);
        }
        self.labels.clear();
        // The device writes the first timestamp when it has ended the submits of other threads.
        self.stamp("", vk::PipelineStageFlags::BOTTOM_OF_PIPE);
        Ok(())
    }

    /// Records a dispatch of `groups` workgroups of `kernel`; records nothing for 0. `constants` are the immediates of the
    /// kernel. The time of the dispatch counts for `label`.
    pub fn dispatch<P: NoUninit>(
        &mut self,
        label: &'static str,
        kernel: &Kernel,
        bindings: &Bindings,
        constants: &P,
        groups: u32,
    ) -> Result<()> {
        if groups == 0 {
            return Ok(());
        }
        self.begin()?;
        self.bind(kernel, bindings, constants);
        // SAFETY: pipeline, sets and immediates are bound.
        unsafe { self.device.shared.device.cmd_dispatch(self.commands.buffer, groups, 1, 1) };
        self.finish_dispatch(label);
        Ok(())
    }

    /// As [`Recorder::dispatch`], but the device reads the number of workgroups (3 words) from word `word` of `arguments` on.
    pub fn dispatch_indirect<P: NoUninit>(
        &mut self,
        label: &'static str,
        kernel: &Kernel,
        bindings: &Bindings,
        constants: &P,
        (arguments, word): (&Buffer, u64),
    ) -> Result<()> {
        let allocation = &arguments.allocation;
        assert!(Arc::ptr_eq(&self.device.shared, &allocation.shared), "the arguments are on another device");
        assert!(
            word * 4 + size_of::<vk::DispatchIndirectCommand>() as u64 <= allocation.size,
            "the arguments lie past the end of their buffer"
        );
        self.begin()?;
        self.bind(kernel, bindings, constants);
        self.kept.push(Kept::Memory(allocation.clone()));
        // SAFETY: pipeline, sets and immediates are bound. The arguments lie inside the buffer, which has the indirect usage and
        // is kept alive.
        unsafe {
            self.device.shared.device.cmd_dispatch_indirect(self.commands.buffer, allocation.handle, word * 4);
        }
        self.finish_dispatch(label);
        Ok(())
    }

    fn bind<P: NoUninit>(&mut self, kernel: &Kernel, bindings: &Bindings, constants: &P) {
        let bound = &bindings.bound;
        let pipeline = &bound.pipeline;
        assert!(kernel.is_bound_by(bound), "the bindings belong to another kernel");
        assert!(Arc::ptr_eq(&self.device.shared, &pipeline.shared), "the kernel belongs to another device");
        let (d, commands) = (&self.device.shared.device, self.commands.buffer);
        let bytes: &[u8] = bytemuck::bytes_of(constants);
        // SAFETY: recording has begun. The handles belong to this device and to each other, and `kept` keeps them alive.
        unsafe {
            d.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, pipeline.handle);
            if !bound.sets.is_empty() {
                let (point, layout) = (vk::PipelineBindPoint::COMPUTE, pipeline.layout);
                d.cmd_bind_descriptor_sets(commands, point, layout, 0, &bound.sets, &[]);
            }
            if pipeline.constants_size > 0 {
                let used = &bytes[..pipeline.constants_size as usize];
                d.cmd_push_constants(commands, pipeline.layout, vk::ShaderStageFlags::COMPUTE, 0, used);
            }
        }
        self.kept.push(Kept::Sets(bound.clone()));
    }

    fn finish_dispatch(&mut self, label: &'static str) {
        self.stamp(label, vk::PipelineStageFlags::COMPUTE_SHADER);
        let compute = vk::PipelineStageFlags::COMPUTE_SHADER;
        let read_or_write =
            vk::AccessFlags::SHADER_READ | vk::AccessFlags::SHADER_WRITE | vk::AccessFlags::INDIRECT_COMMAND_READ;
        self.commands.barrier(
            (compute, vk::AccessFlags::SHADER_WRITE),
            (compute | vk::PipelineStageFlags::DRAW_INDIRECT, read_or_write),
        );
    }

    /// Makes the first `bytes` bytes of `read_back` readable for the host after the submit, as the dispatches recorded so far leave
    /// them.
    pub fn read_back(&mut self, read_back: &ReadBack, bytes: u64) -> Result<()> {
        // Vulkan copies at least one byte.
        let Some(copy) = read_back.copy.as_ref().filter(|_| bytes > 0) else { return Ok(()) };
        let (from, to) = (&read_back.buffer.allocation, &copy.allocation);
        assert!(Arc::ptr_eq(&self.device.shared, &from.shared), "{} is a buffer of another device", from.name);
        assert!(bytes <= from.size && from.size <= to.size, "{}: read past the end", from.name);
        self.begin()?;
        self.commands.barrier(
            (vk::PipelineStageFlags::COMPUTE_SHADER, vk::AccessFlags::SHADER_WRITE),
            (vk::PipelineStageFlags::TRANSFER, vk::AccessFlags::TRANSFER_READ),
        );
        let region = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: bytes }];
        // SAFETY: recording has begun. The range lies inside both buffers, which have the transfer usages and are kept alive.
        unsafe { self.device.shared.device.cmd_copy_buffer(self.commands.buffer, from.handle, to.handle, &region) };
        self.kept.extend([from, to].map(|memory| Kept::Memory(memory.clone())));
        Ok(())
    }

    /// Records a timestamp that the device writes when all commands so far have passed `stage`. The time since the previous
    /// timestamp counts for `label`. Does nothing if the device has no timestamps, or if the query pool is full.
    fn stamp(&mut self, label: &'static str, stage: vk::PipelineStageFlags) {
        let n = self.labels.len() as u32;
        if n < MAX_QUERIES && self.device.shared.timestamp_ns > 0.0 {
            // SAFETY: recording has begun, and the query was reset at its beginning.
            unsafe { self.device.shared.device.cmd_write_timestamp(self.commands.buffer, stage, self.queries, n) };
            self.labels.push(label);
        }
    }

    /// Submits the recorded commands, waits for the device, and returns the time of each label. Does nothing if nothing is
    /// recorded.
    pub fn submit(&mut self) -> Result<Timing> {
        if !self.commands.is_recording() {
            return Ok(vec![]);
        }
        let used = self.kept.iter().flat_map(Kept::allocations).map(Arc::as_ref);
        // The host accesses memory that is not mapped through staging memory alone.
        let turn = self.device.shared.turns.of_device(used.filter(|memory| memory.mapping.is_some()));
        let done = self.device.submit(&mut self.commands);
        drop(turn);
        self.kept.clear();
        done?;
        self.timing()
    }

    fn timing(&self) -> Result<Timing> {
        let shared = &self.device.shared;
        let mut ticks = vec![0u64; self.labels.len()];
        if ticks.is_empty() {
            return Ok(vec![]);
        }
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: the submit that has just ended wrote these queries.
        unsafe { shared.device.get_query_pool_results(self.queries, 0, &mut ticks, flags) }
            .map_err(|e| shared.error("reading timestamps", e))?;
        let mut timing: Timing = vec![];
        for (pair, &label) in ticks.windows(2).zip(&self.labels[1..]) {
            let seconds = ticks_between(pair[0], pair[1], shared.timestamp_bits) as f64 * shared.timestamp_ns * 1e-9;
            match timing.iter_mut().find(|(l, _)| *l == label) {
                Some((_, sum)) => *sum += seconds,
                None => timing.push((label, seconds)),
            }
        }
        Ok(timing)
    }
}

/// Number of ticks from one timestamp to a later one, of which `bits` bits count (1 to 64). The counter may have wrapped around once.
fn ticks_between(from: u64, to: u64, bits: u32) -> u64 {
    to.wrapping_sub(from) & (u64::MAX >> (64 - bits.clamp(1, 64)))
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // SAFETY: `submit` has waited for the device, so the device does not use the pool.
        unsafe { self.device.shared.device.destroy_query_pool(self.queries, None) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timestamps_of_any_width_give_a_duration() {
        for bits in [1, 32, 36, 63, 64] {
            let last = u64::MAX >> (64 - bits);
            assert_eq!(ticks_between(last - 1, last, bits), 1, "{bits} bits");
            assert_eq!(ticks_between(last, 0, bits), 1, "{bits} bits: the counter wraps around");
        }
        // The bits above the valid ones are undefined.
        assert_eq!(ticks_between(0xf0_0000_0000 | 5, 0x70_0000_0000 | 12, 36), 7);
        assert_eq!(ticks_between(9, 9, 36), 0);
    }
}

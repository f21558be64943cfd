//! One command buffer at a time: dispatches in order, each seeing what the ones before it wrote.

use ash::vk;
use bytemuck::NoUninit;

use super::buffer::Buffer;
use super::device::Device;
use super::kernel::{Bindings, Kernel};
use crate::error::Result;

/// Seconds the device spent on the dispatches that carried a label, over one submit.
pub type Timing = Vec<(&'static str, f64)>;

const MAX_QUERIES: u32 = 2048;

/// Records dispatches and submits them together. Reused from submit to submit.
pub struct Recorder {
    device: Device,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    fence: vk::Fence,
    queries: vk::QueryPool,
    labels: Vec<&'static str>,
    recording: bool,
}

impl Recorder {
    pub fn new(device: &Device) -> Result<Recorder> {
        let shared = &device.shared;
        // SAFETY: all handles belong to this device and are destroyed in `drop`.
        unsafe {
            let pool = shared
                .device
                .create_command_pool(
                    &vk::CommandPoolCreateInfo::default()
                        .queue_family_index(shared.queue_family)
                        .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER),
                    None,
                )
                .map_err(|e| shared.error("creating a command pool", e))?;
            let allocate = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            let commands = shared
                .device
                .allocate_command_buffers(&allocate)
                .map_err(|e| shared.error("allocating a command buffer", e))?[0];
            let fence = shared
                .device
                .create_fence(&vk::FenceCreateInfo::default(), None)
                .map_err(|e| shared.error("creating a fence", e))?;
            let queries = shared
                .device
                .create_query_pool(
                    &vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(MAX_QUERIES),
                    None,
                )
                .map_err(|e| shared.error("creating a query pool", e))?;
            Ok(Recorder { device: device.clone(), pool, commands, fence, queries, labels: vec![], recording: false })
        }
    }

    fn begin(&mut self) -> Result<()> {
        if self.recording {
            return Ok(());
        }
        let shared = &self.device.shared;
        // SAFETY: the last submit was waited for, so the command buffer is free.
        unsafe {
            let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            shared.device.begin_command_buffer(self.commands, &once).map_err(|e| shared.error("recording", e))?;
            shared.device.cmd_reset_query_pool(self.commands, self.queries, 0, MAX_QUERIES);
        }
        self.labels.clear();
        self.recording = true;
        self.stamp("", vk::PipelineStageFlags::TOP_OF_PIPE);
        Ok(())
    }

    /// `groups` workgroups of `kernel`; nothing for 0. `constants` are its immediates.
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
        unsafe { self.device.shared.device.cmd_dispatch(self.commands, groups, 1, 1) };
        self.finish_dispatch(label);
        Ok(())
    }

    /// As [`Recorder::dispatch`], the number of workgroups read by the device from word `word` of `arguments`.
    pub fn dispatch_indirect<P: NoUninit>(
        &mut self,
        label: &'static str,
        kernel: &Kernel,
        bindings: &Bindings,
        constants: &P,
        (arguments, word): (&Buffer, u64),
    ) -> Result<()> {
        self.begin()?;
        self.bind(kernel, bindings, constants);
        // SAFETY: as above; the arguments lie inside the buffer, which has the indirect usage.
        unsafe { self.device.shared.device.cmd_dispatch_indirect(self.commands, arguments.handle, word * 4) };
        self.finish_dispatch(label);
        Ok(())
    }

    fn bind<P: NoUninit>(&mut self, kernel: &Kernel, bindings: &Bindings, constants: &P) {
        let d = self.device.shared.device.clone();
        let bytes: &[u8] = bytemuck::bytes_of(constants);
        // SAFETY: recording has begun; all handles belong to this device.
        unsafe {
            d.cmd_bind_pipeline(self.commands, vk::PipelineBindPoint::COMPUTE, kernel.pipeline);
            if !bindings.sets.is_empty() {
                let (point, layout) = (vk::PipelineBindPoint::COMPUTE, kernel.layout);
                d.cmd_bind_descriptor_sets(self.commands, point, layout, 0, &bindings.sets, &[]);
            }
            if kernel.constants_size > 0 {
                let used = &bytes[..kernel.constants_size as usize];
                d.cmd_push_constants(self.commands, kernel.layout, vk::ShaderStageFlags::COMPUTE, 0, used);
            }
        }
    }

    fn finish_dispatch(&mut self, label: &'static str) {
        self.stamp(label, vk::PipelineStageFlags::COMPUTE_SHADER);
        let d = self.device.shared.device.clone();
        let write = vk::AccessFlags::SHADER_WRITE;
        let read =
            vk::AccessFlags::SHADER_READ | vk::AccessFlags::SHADER_WRITE | vk::AccessFlags::INDIRECT_COMMAND_READ;
        let barrier = [vk::MemoryBarrier::default().src_access_mask(write).dst_access_mask(read)];
        // SAFETY: recording has begun.
        unsafe {
            d.cmd_pipeline_barrier(
                self.commands,
                vk::PipelineStageFlags::COMPUTE_SHADER,
                vk::PipelineStageFlags::COMPUTE_SHADER | vk::PipelineStageFlags::DRAW_INDIRECT,
                vk::DependencyFlags::empty(),
                &barrier,
                &[],
                &[],
            );
        }
    }

    /// The time from the stamp before to the moment when everything recorded so far has passed `stage` belongs to `label`.
    fn stamp(&mut self, label: &'static str, stage: vk::PipelineStageFlags) {
        let n = self.labels.len() as u32;
        if n < MAX_QUERIES && self.device.shared.timestamp_ns > 0.0 {
            // SAFETY: recording has begun, and the query was reset at its beginning.
            unsafe { self.device.shared.device.cmd_write_timestamp(self.commands, stage, self.queries, n) };
            self.labels.push(label);
        }
    }

    /// Submits what was recorded, waits for it, and says how long each label took.
    pub fn submit(&mut self) -> Result<Timing> {
        if !self.recording {
            return Ok(vec![]);
        }
        self.recording = false;
        let shared = &self.device.shared;
        let host = [vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::SHADER_WRITE | vk::AccessFlags::TRANSFER_WRITE)
            .dst_access_mask(
                vk::AccessFlags::HOST_READ
                    | vk::AccessFlags::TRANSFER_READ
                    | vk::AccessFlags::TRANSFER_WRITE
                    | vk::AccessFlags::SHADER_READ
                    | vk::AccessFlags::SHADER_WRITE
                    | vk::AccessFlags::INDIRECT_COMMAND_READ,
            )];
        let commands = [self.commands];
        // SAFETY: the command buffer is complete; the fence is unsignalled and waited for before anything is reused.
        unsafe {
            shared.device.cmd_pipeline_barrier(
                self.commands,
                vk::PipelineStageFlags::COMPUTE_SHADER | vk::PipelineStageFlags::TRANSFER,
                vk::PipelineStageFlags::HOST
                    | vk::PipelineStageFlags::TRANSFER
                    | vk::PipelineStageFlags::COMPUTE_SHADER
                    | vk::PipelineStageFlags::DRAW_INDIRECT,
                vk::DependencyFlags::empty(),
                &host,
                &[],
                &[],
            );
            shared.device.end_command_buffer(self.commands).map_err(|e| shared.error("recording", e))?;
            let submit = [vk::SubmitInfo::default().command_buffers(&commands)];
            shared
                .device
                .queue_submit(shared.queue, &submit, self.fence)
                .map_err(|e| shared.error("submitting work", e))?;
            shared
                .device
                .wait_for_fences(&[self.fence], true, u64::MAX)
                .map_err(|e| shared.error("waiting for the device", e))?;
            shared.device.reset_fences(&[self.fence]).map_err(|e| shared.error("resetting a fence", e))?;
        }
        self.timing()
    }

    fn timing(&self) -> Result<Timing> {
        let shared = &self.device.shared;
        let mut ticks = vec![0u64; self.labels.len()];
        if ticks.is_empty() {
            return Ok(vec![]);
        }
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: these queries were written by the submit that has just finished.
        unsafe { shared.device.get_query_pool_results(self.queries, 0, &mut ticks, flags) }
            .map_err(|e| shared.error("reading timestamps", e))?;
        let mut timing: Timing = vec![];
        for (pair, &label) in ticks.windows(2).zip(&self.labels[1..]) {
            let seconds = pair[1].saturating_sub(pair[0]) as f64 * shared.timestamp_ns * 1e-9;
            match timing.iter_mut().find(|(l, _)| *l == label) {
                Some((_, sum)) => *sum += seconds,
                None => timing.push((label, seconds)),
            }
        }
        Ok(timing)
    }

    /// Copies `bytes` bytes between (buffer, offset) pairs and waits for it.
    pub(super) fn copy(device: &Device, from: (&Buffer, u64), to: (&Buffer, u64), bytes: u64) -> Result<()> {
        if bytes == 0 {
            return Ok(());
        }
        let mut recorder = Recorder::new(device)?;
        recorder.begin()?;
        let region = [vk::BufferCopy { src_offset: from.1, dst_offset: to.1, size: bytes }];
        // SAFETY: both ranges were checked by the callers; both buffers have the transfer usages.
        unsafe { device.shared.device.cmd_copy_buffer(recorder.commands, from.0.handle, to.0.handle, &region) };
        recorder.submit()?;
        Ok(())
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        let d = &self.device.shared.device;
        // SAFETY: every submit was waited for.
        unsafe {
            let _ = d.device_wait_idle();
            d.destroy_query_pool(self.queries, None);
            d.destroy_fence(self.fence, None);
            d.destroy_command_pool(self.pool, None);
        }
    }
}

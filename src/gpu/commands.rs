//! A command buffer that the host records, submits and waits for, repeatedly.

use std::sync::atomic::Ordering;
use std::sync::{Arc, MutexGuard};

use ash::vk;

use super::shared::Shared;
use crate::error::Result;

/// One command buffer. The device executes it only during [`Commands::submit`].
pub(super) struct Commands {
    shared: Arc<Shared>,
    pool: vk::CommandPool,
    pub buffer: vk::CommandBuffer,
    fence: vk::Fence,
    recording: bool,
}

impl Commands {
    pub fn new(shared: &Arc<Shared>) -> Result<Commands> {
        // From here on, `drop` destroys the objects that exist, even after an error. Vulkan ignores null handles.
        let mut commands = Commands {
            shared: shared.clone(),
            pool: vk::CommandPool::null(),
            buffer: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
            recording: false,
        };
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(shared.queue_family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the structures outlive the calls. The pool frees its command buffer when the pool is destroyed.
        unsafe {
            commands.pool = shared
                .device
                .create_command_pool(&pool, None)
                .map_err(|e| shared.error("creating a command pool", e))?;
            let allocate = vk::CommandBufferAllocateInfo::default().command_pool(commands.pool).command_buffer_count(1);
            commands.buffer = shared
                .device
                .allocate_command_buffers(&allocate)
                .map_err(|e| shared.error("allocating a command buffer", e))?[0];
            commands.fence = shared
                .device
                .create_fence(&vk::FenceCreateInfo::default(), None)
                .map_err(|e| shared.error("creating a fence", e))?;
        }
        Ok(commands)
    }

    pub fn is_recording(&self) -> bool {
        self.recording
    }

    /// Begins to record. The command buffer is free, because `submit` waits until the device has finished.
    pub fn begin(&mut self) -> Result<()> {
        let shared = &self.shared;
        let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: `&mut self` makes this the only user of the pool, and the device does not execute the command buffer.
        unsafe { shared.device.begin_command_buffer(self.buffer, &once) }.map_err(|e| shared.error("recording", e))?;
        self.recording = true;
        Ok(())
    }

    /// Records a memory barrier between pairs of pipeline stages and accesses. Later commands with the stages and accesses of
    /// `after` wait for earlier commands (recorded or submitted) with those of `before`.
    pub fn barrier(
        &self,
        before: (vk::PipelineStageFlags, vk::AccessFlags),
        after: (vk::PipelineStageFlags, vk::AccessFlags),
    ) {
        assert!(self.recording, "a barrier needs a recording");
        let memory = [vk::MemoryBarrier::default().src_access_mask(before.1).dst_access_mask(after.1)];
        // SAFETY: recording has begun.
        unsafe {
            let none = vk::DependencyFlags::empty();
            self.shared.device.cmd_pipeline_barrier(self.buffer, before.0, after.0, none, &memory, &[], &[]);
        }
    }

    /// Submits the finished command buffers `first`, then the commands recorded here, and unlocks `queue`. Then waits until the device has
    /// executed them. All writes are then visible to the host and to later submits. The device no longer uses anything that was
    /// recorded, even if this function returns an error.
    pub fn submit(&mut self, queue: MutexGuard<'_, vk::Queue>, mut first: Vec<vk::CommandBuffer>) -> Result<()> {
        first.push(self.finish()?);
        let submit = [vk::SubmitInfo::default().command_buffers(&first)];
        let shared = &self.shared;
        if shared.waits.load(Ordering::Relaxed) >= shared.lost_after.load(Ordering::Relaxed) {
            return Err(shared.error("waiting for the device", vk::Result::ERROR_DEVICE_LOST));
        }
        // SAFETY: the command buffers are complete, and the lock makes this the queue's only user. The last submit has ended, so
        // the fence may be reset. The reset comes before the submit, because a failed wait may have left the fence signalled.
        unsafe {
            shared.device.reset_fences(&[self.fence]).map_err(|e| shared.error("resetting a fence", e))?;
            shared.device.queue_submit(*queue, &submit, self.fence).map_err(|e| shared.error("submitting work", e))?;
            drop(queue);
            shared.waits.fetch_add(1, Ordering::Relaxed);
            if let Err(e) = shared.device.wait_for_fences(&[self.fence], true, u64::MAX) {
                // The device may still execute the commands, and buffers must outlive them. A lost device executes nothing, so an
                // error of this wait can be ignored.
                let _ = shared.device.queue_wait_idle(*shared.queue());
                return Err(shared.error("waiting for the device", e));
            }
        }
        Ok(())
    }

    /// Ends the recording with a barrier, so that the host and all later submits see the writes of the recorded commands.
    pub fn finish(&mut self) -> Result<vk::CommandBuffer> {
        assert!(self.recording, "a submit needs a recording");
        self.barrier(
            (
                vk::PipelineStageFlags::COMPUTE_SHADER | vk::PipelineStageFlags::TRANSFER,
                vk::AccessFlags::SHADER_WRITE | vk::AccessFlags::TRANSFER_WRITE,
            ),
            (
                vk::PipelineStageFlags::HOST
                    | vk::PipelineStageFlags::TRANSFER
                    | vk::PipelineStageFlags::COMPUTE_SHADER
                    | vk::PipelineStageFlags::DRAW_INDIRECT,
                vk::AccessFlags::HOST_READ
                    | vk::AccessFlags::TRANSFER_READ
                    | vk::AccessFlags::TRANSFER_WRITE
                    | vk::AccessFlags::SHADER_READ
                    | vk::AccessFlags::SHADER_WRITE
                    | vk::AccessFlags::INDIRECT_COMMAND_READ,
            ),
        );
        self.recording = false;
        // SAFETY: recording has begun.
        unsafe { self.shared.device.end_command_buffer(self.buffer) }.map_err(|e| self.shared.error("recording", e))?;
        Ok(self.buffer)
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        let d = &self.shared.device;
        // SAFETY: `submit` has waited for the device, so the device uses neither object.
        unsafe {
            d.destroy_fence(self.fence, None);
            d.destroy_command_pool(self.pool, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{Buffer, Device};

    /// A failed wait may leave the fence signalled. The next submit must still wait for the device.
    #[test]
    fn a_submit_waits_though_the_fence_was_left_signalled() {
        let device = Device::open(None).unwrap_or_else(|e| panic!("this test needs a Vulkan device: {e}"));
        let count = 1 << 24;
        let buffer = Buffer::new::<u32>(&device, "numbers", count, "").unwrap();
        let shared = &device.shared;
        let mut commands = Commands::new(shared).unwrap();
        // SAFETY: the fence is unsignalled, the lock makes this the queue's only user, and the queue is idle afterwards.
        unsafe {
            let queue = shared.queue();
            shared.device.queue_submit(*queue, &[], commands.fence).unwrap();
            shared.device.queue_wait_idle(*queue).unwrap();
        }
        commands.begin().unwrap();
        let transfer = (vk::PipelineStageFlags::TRANSFER, vk::AccessFlags::TRANSFER_WRITE);
        for value in 2..=9 {
            // SAFETY: recording has begun. The buffer has the transfer usage and outlives the submit.
            unsafe {
                shared.device.cmd_fill_buffer(commands.buffer, buffer.allocation.handle, 0, vk::WHOLE_SIZE, value);
            }
            commands.barrier(transfer, transfer);
        }
        commands.submit(shared.queue(), vec![]).unwrap();
        assert!(buffer.with::<u32, _>(count, |seen| seen.iter().all(|&x| x == 9)).unwrap());
    }
}

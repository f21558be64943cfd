//! What everything on a device shares: its handles, its queue, and its counters.

use std::sync::atomic::AtomicU64;
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use ash::vk;

use super::info::DeviceInfo;
use super::instance::{Instance, device_error};
use crate::error::Error;

/// An open device; the last that holds it closes it.
pub(super) struct Shared {
    pub device: ash::Device,
    /// Who submits holds it for writing until the device is done; who reads or writes a buffer on the host, for reading.
    pub queue: RwLock<vk::Queue>,
    pub queue_family: u32,
    pub memory: vk::PhysicalDeviceMemoryProperties,
    pub cache: vk::PipelineCache,
    /// Nanoseconds per timestamp tick; 0 where the queue has no timestamps.
    pub timestamp_ns: f64,
    pub info: DeviceInfo,
    /// Memory of all buffers that exist.
    pub bytes: AtomicU64,
    /// How often the host waited for the device, and how often memory was allocated.
    pub waits: AtomicU64,
    pub allocations: AtomicU64,
    // Dropped after `drop` has destroyed the device.
    pub _instance: Instance,
}

impl Shared {
    pub fn error(&self, doing: &str, e: vk::Result) -> Error {
        device_error(doing, e)
    }

    /// The queue, for one submit and the wait for it: nobody else submits, and no host thread touches a buffer meanwhile.
    pub fn submitting(&self) -> RwLockWriteGuard<'_, vk::Queue> {
        // A panic elsewhere leaves no work behind: whoever submits waits before the guard goes.
        self.queue.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// Held while the host reads or writes buffers: the device works on nothing meanwhile.
    pub fn host_access(&self) -> RwLockReadGuard<'_, vk::Queue> {
        self.queue.read().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        // SAFETY: buffers, kernels and recorders hold a clone of the `Arc`, so nothing of theirs is left, and every submit was
        // waited for.
        unsafe {
            self.device.destroy_pipeline_cache(self.cache, None);
            self.device.destroy_device(None);
        }
    }
}

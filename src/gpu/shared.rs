//! State of an open device that all its buffers, kernels and recorders share: handles, queue and counters.

use std::sync::atomic::AtomicU64;
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use ash::vk;

use super::info::DeviceInfo;
use super::instance::{Instance, device_error};
use crate::error::Error;

/// An open device. Dropping the last reference closes the device.
pub(super) struct Shared {
    pub device: ash::Device,
    /// A submit holds the lock for writing until the device has finished. A host access to a buffer holds it for reading.
    pub queue: RwLock<vk::Queue>,
    pub queue_family: u32,
    pub memory: vk::PhysicalDeviceMemoryProperties,
    pub cache: vk::PipelineCache,
    /// Nanoseconds per timestamp tick; 0 if the queue has no timestamps.
    pub timestamp_ns: f64,
    pub info: DeviceInfo,
    /// Size of all device buffers that exist, in bytes.
    pub bytes: AtomicU64,
    /// Number of times that the host has waited for the device.
    pub waits: AtomicU64,
    /// Number of memory allocations.
    pub allocations: AtomicU64,
    // Never read. `drop` destroys the device first; then this field destroys the instance.
    pub _instance: Instance,
}

impl Shared {
    pub fn error(&self, doing: &str, e: vk::Result) -> Error {
        device_error(doing, e)
    }

    /// Locks the queue for one submit and the wait for it. Meanwhile no other thread submits, and no host thread accesses a
    /// buffer.
    pub fn submitting(&self) -> RwLockWriteGuard<'_, vk::Queue> {
        // A poisoned lock is no problem: each submit waits for the device before it drops the guard, so no work is left.
        self.queue.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// Locks the queue while the host reads or writes buffers. The device is idle as long as the guard lives.
    pub fn host_access(&self) -> RwLockReadGuard<'_, vk::Queue> {
        self.queue.read().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        // SAFETY: buffers, kernels and recorders hold a clone of the `Arc`, so all of them are already destroyed. Every submit
        // has waited for the device.
        unsafe {
            self.device.destroy_pipeline_cache(self.cache, None);
            self.device.destroy_device(None);
        }
    }
}

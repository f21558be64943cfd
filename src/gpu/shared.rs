//! State of an open device that all its buffers, kernels and recorders share: handles, queue and counters.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use ash::vk;

use super::acceleration::RayFunctions;
use super::info::DeviceInfo;
use super::instance::{Instance, device_error};
use super::turns::Turns;
use crate::error::{Error, Result};

/// An open device. Dropping the last reference closes the device.
pub(super) struct Shared {
    pub device: ash::Device,
    /// A submit holds the lock until its commands are in the queue, not until they have ended.
    pub queue: Mutex<vk::Queue>,
    pub turns: Turns,
    pub queue_family: u32,
    pub memory: vk::PhysicalDeviceMemoryProperties,
    pub cache: vk::PipelineCache,
    /// Number of bits that count in a timestamp of the queue.
    pub timestamp_bits: u32,
    /// Nanoseconds per timestamp tick; 0 if the queue has no timestamps.
    pub timestamp_ns: f64,
    pub info: DeviceInfo,
    /// What builds acceleration structures; `None` if the device has no ray queries.
    pub rays: Option<RayFunctions>,
    /// Size of all device buffers that exist, in bytes.
    pub bytes: AtomicU64,
    /// Number of times that the host has waited for the device.
    pub waits: AtomicU64,
    /// The device counts as lost when the host has waited this often; see [`lost_after`].
    pub lost_after: AtomicU64,
    /// Whether a call has found the device lost. It then stays lost.
    pub is_lost: AtomicBool,
    /// Number of memory allocations.
    pub allocations: AtomicU64,
    // Never read. `drop` destroys the device first; then this field destroys the instance.
    pub _instance: Instance,
}

/// Environment variable: number of submits after which every device counts as lost, to test how the program takes such a loss.
const LOST_AFTER: &str = "TAUGATE_LOST_AFTER";

/// Number of submits that the environment variable `TAUGATE_LOST_AFTER` allows; `u64::MAX` if it is not set. Fails if the variable is
/// not a number.
pub(super) fn lost_after() -> Result<u64> {
    match std::env::var(LOST_AFTER) {
        Ok(value) if !value.is_empty() => value
            .parse()
            .map_err(|_| Error::Device(format!("{LOST_AFTER} is {value}; set it to a number of submits, or unset it"))),
        _ => Ok(u64::MAX),
    }
}

impl Shared {
    /// The error for the result `e` of a call. Also notes the loss of the device.
    pub fn error(&self, doing: &str, e: vk::Result) -> Error {
        if e == vk::Result::ERROR_DEVICE_LOST {
            self.is_lost.store(true, Ordering::Relaxed);
        }
        device_error(doing, e)
    }

    /// Locks the queue.
    pub fn queue(&self) -> MutexGuard<'_, vk::Queue> {
        // A poisoned lock is no problem: the queue is only a handle.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
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

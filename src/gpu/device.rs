//! Opening a Vulkan device.

#![warn(missing_docs)]

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};

use ash::vk;

use super::commands::Commands;
use super::drive::Drive;
use super::info::{DeviceInfo, choose};
use super::instance::{Instance, device_error};
use super::shared::Shared;
use super::staging::Staging;
use crate::error::{Error, Result};

/// An open device with one compute queue. Cheap to clone; the last clone closes it. Threads may share it: their submits run
/// one after the other.
#[derive(Clone)]
pub struct Device {
    pub(super) shared: Arc<Shared>,
    pub(super) staging: Arc<Mutex<Staging>>,
}

impl Device {
    /// Devices in the driver's order.
    pub fn list() -> Result<Vec<DeviceInfo>> {
        let instance = Instance::open()?;
        Ok(instance.devices()?.into_iter().map(|(_, info)| info).collect())
    }

    /// Opens the device that `selector` names by number or by part of its name. Without a selector: a discrete card before
    /// an integrated one, and software last.
    pub fn open(selector: Option<&str>) -> Result<Device> {
        Device::open_with_drive(selector, None)
    }

    /// As [`Device::open`], driven otherwise than its memory asks for.
    pub fn open_with_drive(selector: Option<&str>, drive: Option<Drive>) -> Result<Device> {
        let instance = Instance::open()?;
        let (physical, infos): (Vec<_>, Vec<_>) = instance.devices()?.into_iter().unzip();
        let index = choose(&infos, selector)?;
        let info = &infos[index];
        open_physical(instance, physical[index], DeviceInfo { drive: drive.unwrap_or(info.drive), ..info.clone() })
    }

    /// What the device is, and its limits.
    pub fn info(&self) -> &DeviceInfo {
        &self.shared.info
    }

    /// Bytes of all buffers that exist now.
    pub fn bytes_in_use(&self) -> u64 {
        self.shared.bytes.load(Ordering::Relaxed)
    }

    /// How often the host has waited for the device.
    pub fn waits(&self) -> u64 {
        self.shared.waits.load(Ordering::Relaxed)
    }

    /// How often memory that the device works with has been allocated.
    pub fn allocations(&self) -> u64 {
        self.shared.allocations.load(Ordering::Relaxed)
    }

    pub(super) fn staging(&self) -> MutexGuard<'_, Staging> {
        // A panic elsewhere leaves whole copies behind.
        self.staging.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Submits `commands` after the writes that wait, and waits for the device.
    pub(super) fn submit(&self, commands: &mut Commands) -> Result<()> {
        let mut staging = self.staging();
        if staging.has_writes() {
            return staging.submit_before(commands);
        }
        // Other threads may write meanwhile.
        drop(staging);
        commands.submit(None)
    }
}

/// Opens `physical`, a device of `instance`.
fn open_physical(instance: Instance, physical: vk::PhysicalDevice, info: DeviceInfo) -> Result<Device> {
    let of = &instance.handle;
    // SAFETY: `physical` belongs to the instance.
    let (families, memory, properties) = unsafe {
        (
            of.get_physical_device_queue_family_properties(physical),
            of.get_physical_device_memory_properties(physical),
            of.get_physical_device_properties(physical),
        )
    };
    let family = families
        .iter()
        .position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE))
        .ok_or_else(|| Error::Device(format!("{} has no compute queue; choose another with --device", info.name)))?;
    let priorities = [1.0];
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family as u32).queue_priorities(&priorities)];
    let create = vk::DeviceCreateInfo::default().queue_create_infos(&queues);
    // SAFETY: every structure outlives the call; the family has one queue at least.
    let (device, queue) = unsafe {
        let device = of.create_device(physical, &create, None).map_err(|e| device_error("opening the device", e))?;
        let queue = device.get_device_queue(family as u32, 0);
        (device, queue)
    };
    let has_timestamps = families[family].timestamp_valid_bits == 64;
    // From here on `drop` destroys what exists.
    let mut shared = Shared {
        device,
        queue: RwLock::new(queue),
        queue_family: family as u32,
        memory,
        cache: vk::PipelineCache::null(),
        timestamp_ns: if has_timestamps { properties.limits.timestamp_period.into() } else { 0.0 },
        info,
        bytes: AtomicU64::new(0),
        waits: AtomicU64::new(0),
        allocations: AtomicU64::new(0),
        _instance: instance,
    };
    // SAFETY: the device is alive.
    shared.cache = unsafe { shared.device.create_pipeline_cache(&vk::PipelineCacheCreateInfo::default(), None) }
        .map_err(|e| device_error("creating the pipeline cache", e))?;
    let shared = Arc::new(shared);
    let staging = Arc::new(Mutex::new(Staging::new(shared.clone())));
    Ok(Device { shared, staging })
}

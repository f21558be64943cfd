//! Opening a Vulkan device.

#![warn(missing_docs)]

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::vk;

use super::acceleration::{self, RayFeatures, RayFunctions};
use super::commands::Commands;
use super::drive::Drive;
use super::info::{DeviceInfo, choose};
use super::instance::{Instance, device_error, has_extension};
use super::kernel::KernelCache;
use super::quirks::RaySupport;
use super::shared::{Shared, lost_after};
use super::staging::{Area, Staging};
use super::turns::Turns;
use crate::error::{Error, Result};
use crate::threads::start_pool;

/// An open device with one compute queue. Clones are cheap and share the device; dropping the last clone closes the device.
/// Threads may share a device: it runs their submits one after the other.
#[derive(Clone)]
pub struct Device {
    pub(super) shared: Arc<Shared>,
    pub(super) staging: Arc<Mutex<Staging>>,
    pub(super) kernels: Arc<Mutex<KernelCache>>,
}

impl Device {
    /// All devices, in the order of the Vulkan loader, usable or not (see [`DeviceInfo::unusable`]). Fails if the machine has no
    /// Vulkan loader or no driver.
    pub fn list() -> Result<Vec<DeviceInfo>> {
        let instance = Instance::open()?;
        Ok(instance.devices()?.into_iter().map(|(_, info)| info).collect())
    }

    /// Opens the device that `selector` gives by its number in [`Device::list`] or by a part of its name (upper and lower case
    /// are the same). Without a selector, opens the first usable device of the preferred [`DeviceKind`](super::DeviceKind): a
    /// discrete card before an integrated one, then software. Devices with [`DeviceInfo::is_incomplete`] come last. Fails if no
    /// device matches, or if the device is unusable.
    pub fn open(selector: Option<&str>) -> Result<Device> {
        Device::open_with_drive(selector, None)
    }

    /// As [`Device::open`], but the host drives the device as `drive` says. `None`: as `DeviceInfo::drive` says.
    #[doc(hidden)]
    pub fn open_with_drive(selector: Option<&str>, drive: Option<Drive>) -> Result<Device> {
        start_pool()?;
        let instance = Instance::open()?;
        let (physical, infos): (Vec<_>, Vec<_>) = instance.devices()?.into_iter().unzip();
        let index = choose(&infos, selector)?;
        let info = DeviceInfo { drive: drive.unwrap_or(infos[index].drive), ..infos[index].clone() };
        let opened = open_physical(instance, physical[index], info);
        // The error advises another device, but not if the user chose this one or if there is no other.
        if selector.is_some() || infos.len() == 1 {
            return opened;
        }
        let name = &infos[index].name;
        let unusable = |message| format!("{name} cannot be used: {message}; choose another device with --device");
        opened.map_err(|error| error.map_device_message(unusable))
    }

    /// Whether both stand for one open device, so that one may use the buffers of the other.
    pub fn is_same(&self, other: &Device) -> bool {
        Arc::ptr_eq(&self.shared, &other.shared)
    }

    /// Name, kind and limits of the device.
    pub fn info(&self) -> &DeviceInfo {
        &self.shared.info
    }

    /// Size of all device buffers that exist now, in bytes. Staging memory and copies in host memory are not included.
    pub fn bytes_in_use(&self) -> u64 {
        self.shared.bytes.load(Ordering::Relaxed)
    }

    /// Number of times that the host has waited for the device since the device was opened.
    pub fn waits(&self) -> u64 {
        self.shared.waits.load(Ordering::Relaxed)
    }

    /// Whether the device was lost. It then runs nothing any more, and must be opened anew.
    pub fn is_lost(&self) -> bool {
        self.shared.is_lost.load(Ordering::Relaxed)
    }

    /// Number of memory allocations since the device was opened, staging memory included.
    pub fn allocations(&self) -> u64 {
        self.shared.allocations.load(Ordering::Relaxed)
    }

    /// Counts as lost after so many further submits.
    #[cfg(test)]
    pub fn lose_after(&self, submits: u64) {
        self.shared.lost_after.store(self.waits() + submits, Ordering::Relaxed);
    }

    pub(super) fn staging(&self) -> MutexGuard<'_, Staging> {
        // A poisoned lock is no problem: a panic of another thread leaves only complete copies in the staging memory.
        self.staging.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Submits the writes that wait in staging memory, then `commands`, and waits for the device.
    pub(super) fn submit(&self, commands: &mut Commands) -> Result<()> {
        // No other submit comes between taking the writes and submitting them: its commands may need them.
        let queue = self.shared.queue();
        let mut areas = self.staging().take_writes();
        let writes = areas.iter_mut().map(Area::finish).collect::<Result<_>>();
        let done = writes.and_then(|writes| commands.submit(queue, writes));
        self.staging().give_back(areas);
        done
    }
}

/// Index of the first family of queues for compute alone, or else of the first one for compute. On a queue that also draws the desktop,
/// long submits would make the desktop stutter.
fn queue_family(families: &[vk::QueueFamilyProperties]) -> Option<usize> {
    let computes = |f: &vk::QueueFamilyProperties| f.queue_flags.contains(vk::QueueFlags::COMPUTE);
    let alone = families.iter().position(|f| computes(f) && !f.queue_flags.contains(vk::QueueFlags::GRAPHICS));
    alone.or_else(|| families.iter().position(computes))
}

/// Opens `physical`, a device of `instance`.
fn open_physical(instance: Instance, physical: vk::PhysicalDevice, info: DeviceInfo) -> Result<Device> {
    let lost_after = lost_after()?;
    let of = &instance.handle;
    // SAFETY: `physical` belongs to the instance.
    let (families, memory, properties, offered) = unsafe {
        (
            of.get_physical_device_queue_family_properties(physical),
            of.get_physical_device_memory_properties(physical),
            of.get_physical_device_properties(physical),
            of.enumerate_device_extension_properties(physical).unwrap_or_default(),
        )
    };
    let family = queue_family(&families).ok_or_else(|| {
        Error::Device(format!("{} has no compute queue; choose another device with --device", info.name))
    })?;
    let priorities = [1.0];
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family as u32).queue_priorities(&priorities)];
    // Vulkan requires that a program enables this extension where a device has it.
    let mut extensions = match has_extension(&offered, ash::khr::portability_subset::NAME) {
        true => vec![ash::khr::portability_subset::NAME.as_ptr()],
        false => vec![],
    };
    let has_rays = info.quirks.rays != RaySupport::Absent;
    if has_rays {
        extensions.extend(acceleration::EXTENSIONS.map(std::ffi::CStr::as_ptr));
    }
    let mut features = RayFeatures::all();
    let used = vk::PhysicalDeviceFeatures::default().shader_float64(info.has_f64);
    let mut create = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&extensions)
        .enabled_features(&used);
    if has_rays {
        create = features.enable(create);
    }
    // SAFETY: every structure outlives the call. The family has at least one queue.
    let (device, queue) = unsafe {
        let device = of.create_device(physical, &create, None).map_err(|e| device_error("opening the device", e))?;
        let queue = device.get_device_queue(family as u32, 0);
        (device, queue)
    };
    let rays = has_rays.then(|| RayFunctions::new(&instance.handle, physical, &device));
    let timestamp_bits = families[family].timestamp_valid_bits;
    // From here on, `drop` destroys the device, even after an error.
    let mut shared = Shared {
        device,
        queue: Mutex::new(queue),
        turns: Turns::default(),
        queue_family: family as u32,
        memory,
        cache: vk::PipelineCache::null(),
        timestamp_bits,
        timestamp_ns: if timestamp_bits > 0 { properties.limits.timestamp_period.into() } else { 0.0 },
        info,
        rays,
        bytes: AtomicU64::new(0),
        waits: AtomicU64::new(0),
        lost_after: lost_after.into(),
        is_lost: AtomicBool::new(false),
        allocations: AtomicU64::new(0),
        _instance: instance,
    };
    // SAFETY: the device is alive.
    shared.cache = unsafe { shared.device.create_pipeline_cache(&vk::PipelineCacheCreateInfo::default(), None) }
        .map_err(|e| device_error("creating the pipeline cache", e))?;
    let shared = Arc::new(shared);
    let staging = Arc::new(Mutex::new(Staging::default()));
    Ok(Device { shared, staging, kernels: Arc::default() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_queue_for_compute_alone_is_preferred() {
        let family = |queue_flags| vk::QueueFamilyProperties { queue_flags, ..Default::default() };
        let (graphics, compute) = (vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE, vk::QueueFlags::COMPUTE);
        let transfer = vk::QueueFlags::TRANSFER;
        assert_eq!(queue_family(&[graphics, transfer, compute, compute].map(family)), Some(2));
        assert_eq!(queue_family(&[transfer, graphics].map(family)), Some(1));
        assert_eq!(queue_family(&[transfer].map(family)), None);
    }
}

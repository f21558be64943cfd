//! Opening a Vulkan device.

#![warn(missing_docs)]

use std::ffi::CStr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use ash::vk;

use super::drive::Drive;
use super::info::{DeviceInfo, choose, describe, most_texels};
use super::staging::Staging;
use crate::error::{Error, Result};

/// An open device with one compute queue. Cheap to clone; the last clone closes it. Threads may share it: their submits run
/// one after the other.
#[derive(Clone)]
pub struct Device {
    pub(super) shared: Arc<Shared>,
    pub(super) staging: Arc<Mutex<Staging>>,
}

pub(super) struct Shared {
    pub device: ash::Device,
    /// Who submits holds it for writing until the device is done; who reads or writes a buffer on the host, for reading.
    queue: RwLock<vk::Queue>,
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
    _instance: Instance,
}

/// A Vulkan instance; with the validation layers where the user asked for them.
struct Instance {
    handle: ash::Instance,
    debug: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    /// Keeps libvulkan loaded.
    entry: ash::Entry,
}

/// Set to a non-empty value to load the validation layers; a message of theirs aborts the process.
const VALIDATE: &str = "TAUGATE_VALIDATE";

impl Device {
    /// Devices in the driver's order.
    pub fn list() -> Result<Vec<DeviceInfo>> {
        let instance = Instance::open()?;
        Ok(instance.devices()?.into_iter().map(|(_, info)| info).collect())
    }

    /// Opens the device that `selector` names by number or by part of its name. Without a selector: a discrete card before
    /// an integrated one, and software last.
    pub fn open(selector: Option<&str>) -> Result<Device> {
        Device::open_driven(selector, None)
    }

    /// As [`Device::open`], driven otherwise than its memory asks for.
    pub fn open_driven(selector: Option<&str>, drive: Option<Drive>) -> Result<Device> {
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

fn device_error(doing: &str, e: vk::Result) -> Error {
    match e {
        vk::Result::ERROR_DEVICE_LOST => Error::Device(format!(
            "the device was lost while {doing}; try --device with another one or a smaller --resolution"
        )),
        vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
            Error::Device(format!("out of memory while {doing}; try a smaller --resolution or fewer --light-paths"))
        }
        _ => Error::Device(format!("{doing} failed ({e})")),
    }
}

impl Instance {
    fn open() -> Result<Instance> {
        // SAFETY: loading libvulkan runs its initialisers, as for every Vulkan program.
        let entry = unsafe { ash::Entry::load() }.map_err(|_| {
            Error::Device(
                "no Vulkan loader (libvulkan.so.1) on this machine; run ./setup.sh, or install a graphics driver"
                    .into(),
            )
        })?;
        let app = vk::ApplicationInfo::default().application_name(c"taugate").api_version(vk::API_VERSION_1_2);
        let layers = if validating() { vec![c"VK_LAYER_KHRONOS_validation".as_ptr()] } else { vec![] };
        let extensions = if validating() { vec![ash::ext::debug_utils::NAME.as_ptr()] } else { vec![] };
        let sync = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&sync);
        let mut info = vk::InstanceCreateInfo::default()
            .application_info(&app)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&extensions);
        if validating() {
            info = info.push_next(&mut features);
        }
        // SAFETY: `info` and all it points to live until the call returns.
        let handle = unsafe { entry.create_instance(&info, None) }.map_err(|e| match e {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => {
                Error::Device("no Vulkan driver on this machine; run ./setup.sh for the software one".into())
            }
            e => device_error("starting Vulkan", e),
        })?;
        let mut instance = Instance { handle, debug: None, entry };
        if validating() {
            let loader = ash::ext::debug_utils::Instance::new(&instance.entry, &instance.handle);
            let create = vk::DebugUtilsMessengerCreateInfoEXT::default()
                .message_severity(
                    vk::DebugUtilsMessageSeverityFlagsEXT::ERROR | vk::DebugUtilsMessageSeverityFlagsEXT::WARNING,
                )
                .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
                .pfn_user_callback(Some(on_message));
            // SAFETY: the extension is enabled; the messenger is destroyed before its instance.
            let messenger = unsafe { loader.create_debug_utils_messenger(&create, None) }
                .map_err(|e| device_error("starting the validation layers", e))?;
            instance.debug = Some((loader, messenger));
        }
        Ok(instance)
    }

    /// All devices, in the driver's order.
    fn devices(&self) -> Result<Vec<(vk::PhysicalDevice, DeviceInfo)>> {
        // SAFETY: the instance is alive.
        let devices =
            unsafe { self.handle.enumerate_physical_devices() }.map_err(|e| device_error("enumerating devices", e))?;
        let (forced, most_texels) = (Drive::forced()?, most_texels()?);
        let describe = |d| {
            let info = describe(&self.handle, d);
            let (drive, max_texels) = (forced.unwrap_or(info.drive), info.max_texels.min(most_texels));
            (d, DeviceInfo { drive, max_texels, ..info })
        };
        Ok(devices.into_iter().map(describe).collect())
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: what was made from the instance is destroyed: `Shared` destroys its device in `drop`, before its fields.
        unsafe {
            if let Some((loader, messenger)) = &self.debug {
                loader.destroy_debug_utils_messenger(*messenger, None);
            }
            self.handle.destroy_instance(None);
        }
    }
}

fn validating() -> bool {
    std::env::var_os(VALIDATE).is_some_and(|v| !v.is_empty())
}

unsafe extern "system" fn on_message(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    _user: *mut std::ffi::c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes a valid structure with a NUL-terminated message.
    let message = unsafe { CStr::from_ptr((*data).p_message) }.to_string_lossy();
    eprintln!("validation {severity:?}: {message}");
    std::process::abort()
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

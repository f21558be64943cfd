//! Finding and opening a Vulkan device.

use std::ffi::CStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;

use crate::error::{Error, Result};

/// What a user needs to know to choose a device, and the limits that decide whether a scene fits.
#[derive(Debug, Clone, serde::Serialize)]
pub struct DeviceInfo {
    pub name: String,
    pub driver: String,
    pub api_version: String,
    /// A software implementation such as lavapipe.
    pub is_cpu: bool,
    /// Size of the largest device-local heap, bytes.
    pub heap_bytes: u64,
    /// Largest storage buffer a kernel can see, bytes.
    pub max_storage_buffer_range: u64,
    /// Texels of the largest texel buffer a kernel can see.
    pub max_texels: u64,
    /// Largest single allocation, bytes.
    pub max_allocation: u64,
    pub subgroup_size: u32,
    pub max_workgroup_invocations: u32,
    /// Why taugate cannot render on it; none where it can.
    pub unusable: Option<&'static str>,
}

impl DeviceInfo {
    /// Bytes of the largest storage buffer that can be both allocated and bound.
    pub fn largest_buffer(&self) -> u64 {
        self.max_storage_buffer_range.min(self.max_allocation)
    }

    /// Bytes of the largest buffer that can be allocated and read as 16-byte texels.
    pub fn largest_texel_buffer(&self) -> u64 {
        self.max_texels.saturating_mul(16).min(self.max_allocation)
    }

    /// Stands in where there is no device: software without limits.
    pub fn unlimited() -> DeviceInfo {
        DeviceInfo {
            name: "no device".into(),
            driver: String::new(),
            api_version: String::new(),
            is_cpu: true,
            heap_bytes: u64::MAX,
            max_storage_buffer_range: u64::MAX,
            max_texels: u64::MAX,
            max_allocation: u64::MAX,
            subgroup_size: 0,
            max_workgroup_invocations: 0,
            unusable: None,
        }
    }
}

/// An open device with one compute queue. Cheap to clone; the last clone closes it.
#[derive(Clone)]
pub struct Device {
    pub(super) shared: Arc<Shared>,
}

pub(super) struct Shared {
    // Keeps libvulkan loaded.
    _entry: ash::Entry,
    instance: ash::Instance,
    pub device: ash::Device,
    pub queue: vk::Queue,
    pub queue_family: u32,
    pub memory: vk::PhysicalDeviceMemoryProperties,
    pub cache: vk::PipelineCache,
    /// Nanoseconds a timestamp tick; 0 where the queue has no timestamps.
    pub timestamp_ns: f64,
    pub info: DeviceInfo,
    /// Memory of all buffers that exist.
    pub bytes: AtomicU64,
    debug: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
}

/// Set to a non-empty value to load the validation layers; a message of theirs aborts the process.
const VALIDATE: &str = "TAUGATE_VALIDATE";

impl Device {
    /// Devices in the driver's order.
    pub fn list() -> Result<Vec<DeviceInfo>> {
        let (_entry, instance) = open_instance()?;
        // SAFETY: the instance is alive, and is destroyed once, after its last use.
        unsafe {
            let devices = instance.enumerate_physical_devices().map_err(|e| device_error("enumerating devices", e))?;
            let infos = devices.into_iter().map(|d| describe(&instance, d)).collect();
            instance.destroy_instance(None);
            Ok(infos)
        }
    }

    /// Opens the device that `selector` names by number or by part of its name; without one the first discrete or
    /// integrated card, else the first device there is.
    pub fn open(selector: Option<&str>) -> Result<Device> {
        let (entry, instance) = open_instance()?;
        // SAFETY: all handles come from this instance and live in `Shared`, which destroys them in order.
        unsafe {
            let devices = instance.enumerate_physical_devices().map_err(|e| device_error("enumerating devices", e))?;
            let infos: Vec<DeviceInfo> = devices.iter().map(|&d| describe(&instance, d)).collect();
            let index = match choose(&infos, selector) {
                Ok(index) => index,
                Err(error) => {
                    instance.destroy_instance(None);
                    return Err(error);
                }
            };
            open_physical(entry, instance, devices[index], infos[index].clone())
        }
    }

    pub fn info(&self) -> &DeviceInfo {
        &self.shared.info
    }

    /// Bytes of all buffers that exist now.
    pub fn bytes_in_use(&self) -> u64 {
        self.shared.bytes.load(Ordering::Relaxed)
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

impl Shared {
    pub fn error(&self, doing: &str, e: vk::Result) -> Error {
        device_error(doing, e)
    }
}

fn open_instance() -> Result<(ash::Entry, ash::Instance)> {
    // SAFETY: loading libvulkan runs its initialisers, as for every Vulkan program.
    let entry = unsafe { ash::Entry::load() }.map_err(|_| {
        Error::Device(
            "no Vulkan loader (libvulkan.so.1) on this machine; run ./setup.sh, or install a graphics driver".into(),
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
    let instance = unsafe { entry.create_instance(&info, None) }.map_err(|e| match e {
        vk::Result::ERROR_INCOMPATIBLE_DRIVER => {
            Error::Device("no Vulkan driver on this machine; run ./setup.sh for the software one".into())
        }
        e => device_error("starting Vulkan", e),
    })?;
    Ok((entry, instance))
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

fn describe(instance: &ash::Instance, physical: vk::PhysicalDevice) -> DeviceInfo {
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut maintenance = vk::PhysicalDeviceMaintenance3Properties::default();
    let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default()
        .push_next(&mut driver)
        .push_next(&mut maintenance)
        .push_next(&mut subgroup);
    // SAFETY: the chain lives until the call returns; `physical` belongs to `instance`.
    let memory = unsafe {
        instance.get_physical_device_properties2(physical, &mut properties);
        instance.get_physical_device_memory_properties(physical)
    };
    // SAFETY: as above.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    let p = properties.properties;
    let unusable = match p.api_version {
        version if version < vk::API_VERSION_1_1 => Some("its driver is older than Vulkan 1.1; update the driver"),
        _ if !families.iter().any(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE)) => {
            Some("it has no compute queue")
        }
        _ => None,
    };
    let heap_bytes = memory
        .memory_heaps_as_slice()
        .iter()
        .filter(|h| h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
        .map(|h| h.size)
        .max();
    let text = |s: &[std::ffi::c_char]| {
        let bytes: Vec<u8> = s.iter().map(|&c| c as u8).take_while(|&c| c != 0).collect();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    DeviceInfo {
        name: text(&p.device_name),
        driver: format!("{} {}", text(&driver.driver_name), text(&driver.driver_info)).trim().to_string(),
        api_version: format!(
            "{}.{}.{}",
            vk::api_version_major(p.api_version),
            vk::api_version_minor(p.api_version),
            vk::api_version_patch(p.api_version)
        ),
        is_cpu: p.device_type == vk::PhysicalDeviceType::CPU,
        heap_bytes: heap_bytes.unwrap_or(0),
        max_storage_buffer_range: p.limits.max_storage_buffer_range.into(),
        max_texels: p.limits.max_texel_buffer_elements.into(),
        max_allocation: maintenance.max_memory_allocation_size,
        subgroup_size: subgroup.subgroup_size,
        max_workgroup_invocations: p.limits.max_compute_work_group_invocations,
        unusable,
    }
}

fn choose(infos: &[DeviceInfo], selector: Option<&str>) -> Result<usize> {
    if infos.is_empty() {
        return Err(Error::Device("no Vulkan device on this machine; run ./setup.sh for the software one".into()));
    }
    let Some(selector) = selector else {
        let usable = |cpu: bool| infos.iter().position(|d| d.unusable.is_none() && d.is_cpu == cpu);
        return usable(false).or_else(|| usable(true)).ok_or_else(|| {
            let reasons: Vec<String> =
                infos.iter().map(|d| format!("{}: {}", d.name, d.unusable.unwrap_or_default())).collect();
            Error::Device(format!(
                "no device can be used ({}); run ./setup.sh for the software one",
                reasons.join(", ")
            ))
        });
    };
    let by_number = selector.parse::<usize>().ok().filter(|&i| i < infos.len());
    let by_name = || infos.iter().position(|d| d.name.to_lowercase().contains(&selector.to_lowercase()));
    let index = by_number.or_else(by_name).ok_or_else(|| {
        let names: Vec<String> = infos.iter().enumerate().map(|(i, d)| format!("{i}: {}", d.name)).collect();
        Error::Device(format!("no device matches --device {selector}; there are {}", names.join(", ")))
    })?;
    match infos[index].unusable {
        Some(reason) => {
            let name = &infos[index].name;
            Err(Error::Device(format!("{name} cannot be used: {reason}; choose another with --device")))
        }
        None => Ok(index),
    }
}

/// # Safety
/// `physical` must belong to `instance`.
unsafe fn open_physical(
    entry: ash::Entry,
    instance: ash::Instance,
    physical: vk::PhysicalDevice,
    info: DeviceInfo,
) -> Result<Device> {
    // SAFETY: see the function's contract; every structure outlives the call it is passed to.
    unsafe {
        let families = instance.get_physical_device_queue_family_properties(physical);
        let family =
            families.iter().position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE)).ok_or_else(|| {
                Error::Device(format!("{} has no compute queue; choose another with --device", info.name))
            })?;
        let priorities = [1.0];
        let queues =
            [vk::DeviceQueueCreateInfo::default().queue_family_index(family as u32).queue_priorities(&priorities)];
        let device = instance
            .create_device(physical, &vk::DeviceCreateInfo::default().queue_create_infos(&queues), None)
            .map_err(|e| device_error("opening the device", e))?;
        let cache = device
            .create_pipeline_cache(&vk::PipelineCacheCreateInfo::default(), None)
            .map_err(|e| device_error("creating the pipeline cache", e))?;
        let properties = instance.get_physical_device_properties(physical);
        let has_timestamps = families[family].timestamp_valid_bits == 64;
        let debug = if validating() {
            let loader = ash::ext::debug_utils::Instance::new(&entry, &instance);
            let create = vk::DebugUtilsMessengerCreateInfoEXT::default()
                .message_severity(
                    vk::DebugUtilsMessageSeverityFlagsEXT::ERROR | vk::DebugUtilsMessageSeverityFlagsEXT::WARNING,
                )
                .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
                .pfn_user_callback(Some(on_message));
            let messenger = loader
                .create_debug_utils_messenger(&create, None)
                .map_err(|e| device_error("starting the validation layers", e))?;
            Some((loader, messenger))
        } else {
            None
        };
        let shared = Shared {
            queue: device.get_device_queue(family as u32, 0),
            queue_family: family as u32,
            memory: instance.get_physical_device_memory_properties(physical),
            cache,
            timestamp_ns: if has_timestamps { properties.limits.timestamp_period.into() } else { 0.0 },
            info,
            bytes: AtomicU64::new(0),
            debug,
            device,
            instance,
            _entry: entry,
        };
        Ok(Device { shared: Arc::new(shared) })
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        // SAFETY: buffers, kernels and recorders hold a clone of the `Arc`, so nothing of theirs is left.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.device.destroy_pipeline_cache(self.cache, None);
            self.device.destroy_device(None);
            if let Some((loader, messenger)) = &self.debug {
                loader.destroy_debug_utils_messenger(*messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(name: &str, is_cpu: bool, unusable: Option<&'static str>) -> DeviceInfo {
        DeviceInfo { name: name.into(), is_cpu, unusable, ..DeviceInfo::unlimited() }
    }

    #[test]
    fn devices_that_cannot_be_used_are_passed_over_and_refused_by_name() {
        let old = Some("it is old");
        let infos = [device("old card", false, old), device("software", true, None), device("card", false, None)];
        assert_eq!(choose(&infos, None).unwrap(), 2);
        assert_eq!(choose(&infos[..2], None).unwrap(), 1);
        assert_eq!(choose(&infos, Some("1")).unwrap(), 1);
        for selector in ["0", "OLD"] {
            let message = choose(&infos, Some(selector)).unwrap_err().to_string();
            assert!(message.contains("old card cannot be used: it is old; choose another"), "{message}");
        }
        let message = choose(&infos[..1], None).unwrap_err().to_string();
        assert!(message.contains("no device can be used (old card: it is old)"), "{message}");
        assert!(choose(&infos, Some("9")).unwrap_err().to_string().contains("1: software"));
    }
}

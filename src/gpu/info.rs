//! Properties of a device that are known before it is opened, and the choice of the device to open.

#![warn(missing_docs)]

use ash::vk;

use super::acceleration;
use super::drive::{CACHED, Drive};
use super::quirks::{Quirks, RaySupport};
use crate::error::{Error, Result};

/// Kind of a device, in order of preference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DeviceKind {
    /// A graphics card with memory of its own.
    Discrete,
    /// A graphics processor that shares the CPU's memory.
    Integrated,
    /// A graphics card that a virtual machine sees.
    Virtual,
    /// A device of a kind that Vulkan has no name for.
    Other,
    /// A software implementation such as lavapipe.
    Software,
}

/// The properties that a user needs to choose a device, and the limits that decide whether a scene fits.
#[derive(Debug, Clone, serde::Serialize)]
pub struct DeviceInfo {
    /// Name of the device, from its driver.
    pub name: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Version of Vulkan that the driver supports, such as `1.3.255`.
    pub api_version: String,
    /// Graphics card or software.
    pub kind: DeviceKind,
    /// Size of the largest device-local heap, in bytes.
    pub heap_bytes: u64,
    /// Maximum size of a storage buffer that is bound to a kernel, in bytes.
    pub max_storage_buffer_range: u64,
    /// Maximum size of a texel buffer that is bound to a kernel, in texels (of 16 bytes).
    pub max_texels: u64,
    /// Maximum size of one allocation, in bytes.
    pub max_allocation: u64,
    /// Maximum numbers of buffers that a kernel may bind.
    #[doc(hidden)]
    pub max_buffers: BufferCounts,
    /// Whether kernels may compute with 64-bit floating-point numbers.
    pub has_f64: bool,
    /// Number of invocations in a subgroup.
    pub subgroup_size: u32,
    /// Maximum number of invocations in a workgroup.
    pub max_workgroup_invocations: u32,
    /// Properties of the driver that kernels must know.
    #[doc(hidden)]
    pub quirks: Quirks,
    /// How the host drives the device.
    #[doc(hidden)]
    pub drive: Drive,
    /// Whether the driver translates Vulkan to another interface and passes only a part of Vulkan's tests: Mesa's Dozen, which
    /// Windows offers to Linux (WSL). Software is preferred.
    pub is_incomplete: bool,
    /// The reason why taugate cannot render on the device; `None` if it can.
    pub unusable: Option<&'static str>,
}

impl DeviceInfo {
    /// Whether kernels run on the host's cores, in the host's memory.
    pub fn is_cpu(&self) -> bool {
        self.kind == DeviceKind::Software
    }

    /// Whether the device may keep the images of many gates: it computes with 64 bits, and does not work in the host's memory.
    #[doc(hidden)]
    pub fn may_keep_images(&self) -> bool {
        self.has_f64 && !self.drive.waits_per_bounce
    }

    /// Maximum size in bytes of a storage buffer that can be both allocated and bound.
    pub fn largest_buffer(&self) -> u64 {
        self.max_storage_buffer_range.min(self.max_allocation)
    }

    /// Maximum size in bytes of a buffer that can be both allocated and read as 16-byte texels.
    pub fn largest_texel_buffer(&self) -> u64 {
        self.max_texels.saturating_mul(16).min(self.max_allocation)
    }

    /// A placeholder if there is no device: software without limits.
    pub fn unlimited() -> DeviceInfo {
        DeviceInfo {
            name: "no device".into(),
            driver: String::new(),
            api_version: String::new(),
            kind: DeviceKind::Software,
            heap_bytes: u64::MAX,
            max_storage_buffer_range: u64::MAX,
            max_texels: u64::MAX,
            max_allocation: u64::MAX,
            max_buffers: BufferCounts::UNLIMITED,
            has_f64: false,
            subgroup_size: 0,
            max_workgroup_invocations: 0,
            quirks: Quirks::NONE,
            drive: Drive::CPU,
            is_incomplete: false,
            unusable: None,
        }
    }
}

/// Environment variable: maximum number of texels in a texel buffer of any device. Larger arrays are read from storage buffers.
const MAX_TEXELS: &str = "TAUGATE_MAX_TEXELS";

/// Maximum number of texels in a texel buffer that the environment variable `TAUGATE_MAX_TEXELS` allows; `u64::MAX` if it is not
/// set. Fails if the variable is not a number.
pub(super) fn max_texels_forced() -> Result<u64> {
    match std::env::var(MAX_TEXELS) {
        Ok(value) if !value.is_empty() => value
            .parse()
            .map_err(|_| Error::Device(format!("{MAX_TEXELS} is {value}; set it to a number of texels, or unset it"))),
        _ => Ok(u64::MAX),
    }
}

/// Numbers of buffers that a kernel binds, or that a device lets a kernel bind. Vulkan guarantees 4 storage buffers and 16 texel
/// buffers, but nearly all devices allow more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct BufferCounts {
    /// Buffers that kernels read and write.
    pub storage: u32,
    /// Buffers that kernels only read, as texels.
    pub texels: u32,
    /// Both together.
    pub all: u32,
}

impl BufferCounts {
    /// Maximum numbers of buffers that a kernel of taugate binds. One storage buffer is for index checks.
    pub const NEEDED: BufferCounts = BufferCounts { storage: 15, texels: 16, all: 31 };
    const UNLIMITED: BufferCounts = BufferCounts { storage: u32::MAX, texels: u32::MAX, all: u32::MAX };

    fn allowed_by(limits: &vk::PhysicalDeviceLimits) -> BufferCounts {
        // Vulkan counts a texel buffer as a sampled image.
        BufferCounts {
            storage: limits.max_per_stage_descriptor_storage_buffers.min(limits.max_descriptor_set_storage_buffers),
            texels: limits.max_per_stage_descriptor_sampled_images.min(limits.max_descriptor_set_sampled_images),
            all: limits.max_per_stage_resources,
        }
    }

    /// Whether a kernel with these buffers can run where `allowed` may be bound.
    pub fn fits(self, allowed: BufferCounts) -> bool {
        self.storage <= allowed.storage && self.texels <= allowed.texels && self.all <= allowed.all
    }
}

/// The remedy where there is no driver that works.
pub(super) const NO_DRIVER: &str = "run ./setup.sh to install the software device; a container sees an NVIDIA card only with \
                                    NVIDIA_DRIVER_CAPABILITIES=graphics";

pub(super) fn describe(instance: &ash::Instance, physical: vk::PhysicalDevice) -> DeviceInfo {
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut maintenance = vk::PhysicalDeviceMaintenance3Properties::default();
    let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default()
        .push_next(&mut driver)
        .push_next(&mut maintenance)
        .push_next(&mut subgroup);
    // SAFETY: the chain lives until the call returns; `physical` belongs to `instance`.
    let (memory, features) = unsafe {
        instance.get_physical_device_properties2(physical, &mut properties);
        (instance.get_physical_device_memory_properties(physical), instance.get_physical_device_features(physical))
    };
    // SAFETY: as above.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    let p = properties.properties;
    let max_buffers = BufferCounts::allowed_by(&p.limits);
    let unusable = match p.api_version {
        version if version < vk::API_VERSION_1_1 => Some("its driver is older than Vulkan 1.1; update the driver"),
        _ if !families.iter().any(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE)) => {
            Some("it has no compute queue")
        }
        _ if !BufferCounts::NEEDED.fits(max_buffers) => Some("it lets a kernel use too few buffers at a time"),
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
    let kind = match p.device_type {
        vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
        vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
        vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
        vk::PhysicalDeviceType::CPU => DeviceKind::Software,
        _ => DeviceKind::Other,
    };
    let has_f64 = features.shader_float64 == vk::TRUE;
    let has_rays = p.api_version >= vk::API_VERSION_1_2 && acceleration::is_offered(instance, physical);
    let rays = match kind {
        _ if !has_rays => RaySupport::Absent,
        DeviceKind::Software => RaySupport::Software,
        _ => RaySupport::Hardware,
    };
    let device_memory = vk::MemoryPropertyFlags::DEVICE_LOCAL | CACHED;
    let has_cached_memory = memory.memory_types_as_slice().iter().any(|t| t.property_flags.contains(device_memory));
    DeviceInfo {
        name: text(&p.device_name),
        driver: format!("{} {}", text(&driver.driver_name), text(&driver.driver_info)).trim().to_string(),
        api_version: format!(
            "{}.{}.{}",
            vk::api_version_major(p.api_version),
            vk::api_version_minor(p.api_version),
            vk::api_version_patch(p.api_version)
        ),
        kind,
        heap_bytes: heap_bytes.unwrap_or(0),
        max_storage_buffer_range: p.limits.max_storage_buffer_range.into(),
        max_texels: p.limits.max_texel_buffer_elements.into(),
        max_allocation: maintenance.max_memory_allocation_size,
        max_buffers,
        has_f64,
        subgroup_size: subgroup.subgroup_size,
        max_workgroup_invocations: p.limits.max_compute_work_group_invocations,
        quirks: Quirks { rays, ..Quirks::of(driver.driver_id) },
        drive: Drive::of(has_cached_memory, kind == DeviceKind::Software),
        is_incomplete: driver.driver_id == vk::DriverId::MESA_DOZEN,
        unusable,
    }
}

/// Index in `infos` of the device that `selector` gives, by number or by a part of its name. Without a selector, index of the
/// first usable device of the preferred kind; devices with incomplete drivers come last. Fails if no device matches, or if the device
/// is unusable.
pub(super) fn choose(infos: &[DeviceInfo], selector: Option<&str>) -> Result<usize> {
    if infos.is_empty() {
        return Err(Error::Device(format!("no Vulkan device on this machine; {NO_DRIVER}")));
    }
    let Some(selector) = selector else {
        // `min_by_key` returns the first device of the preferred kind.
        let usable = infos.iter().enumerate().filter(|(_, d)| d.unusable.is_none());
        return usable.min_by_key(|(_, d)| (d.is_incomplete, d.kind)).map(|(index, _)| index).ok_or_else(|| {
            let reasons: Vec<String> =
                infos.iter().map(|d| format!("{}: {}", d.name, d.unusable.unwrap_or_default())).collect();
            Error::Device(format!("no device can be used ({}); {NO_DRIVER}", reasons.join(", ")))
        });
    };
    let by_number = selector.parse::<usize>().ok().filter(|&i| i < infos.len());
    let by_name = || infos.iter().position(|d| d.name.to_lowercase().contains(&selector.to_lowercase()));
    let index = by_number.or_else(by_name).ok_or_else(|| {
        let names: Vec<String> = infos.iter().enumerate().map(|(i, d)| format!("{i}: {}", d.name)).collect();
        Error::Device(format!("no device matches --device {selector}; choose one of {}", names.join(", ")))
    })?;
    match infos[index].unusable {
        Some(reason) => {
            let name = &infos[index].name;
            Err(Error::Device(format!("{name} cannot be used: {reason}; choose another device with --device")))
        }
        None => Ok(index),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(name: &str, kind: DeviceKind, unusable: Option<&'static str>) -> DeviceInfo {
        DeviceInfo { name: name.into(), kind, unusable, ..DeviceInfo::unlimited() }
    }

    #[test]
    fn a_discrete_card_comes_before_an_integrated_one_and_software_last() {
        use DeviceKind::*;
        // The least preferred device comes first. Two devices are of the best kind.
        let kinds = [Software, Other, Virtual, Integrated, Discrete, Discrete];
        let infos = kinds.map(|kind| device("device", kind, None));
        for n in 1..=5 {
            assert_eq!(choose(&infos[..n], None).unwrap(), n - 1);
        }
        assert_eq!(choose(&infos, None).unwrap(), 4);
    }

    #[test]
    fn an_incomplete_driver_comes_last() {
        let dozen = DeviceInfo { is_incomplete: true, ..device("a card under Windows", DeviceKind::Discrete, None) };
        let infos = [dozen, device("software", DeviceKind::Software, None)];
        assert_eq!(choose(&infos, None).unwrap(), 1);
        assert_eq!(choose(&infos[..1], None).unwrap(), 0);
    }

    #[test]
    fn a_device_must_let_kernels_bind_all_their_buffers() {
        let limits = |storage, texels, all| {
            BufferCounts::allowed_by(&vk::PhysicalDeviceLimits {
                max_per_stage_descriptor_storage_buffers: storage,
                max_descriptor_set_storage_buffers: 1000,
                max_per_stage_descriptor_sampled_images: texels,
                max_descriptor_set_sampled_images: 1000,
                max_per_stage_resources: all,
                ..Default::default()
            })
        };
        assert!(BufferCounts::NEEDED.fits(limits(1000, 1000, 1000)));
        // The least that Vulkan allows, a Raspberry Pi, and too few of both together.
        for too_few in [limits(4, 16, 128), limits(8, 16, 128), limits(1000, 1000, 20)] {
            assert!(!BufferCounts::NEEDED.fits(too_few), "{too_few:?}");
        }
    }

    #[test]
    fn devices_that_cannot_be_used_are_passed_over_and_refused_by_name() {
        let old = Some("it is old");
        let infos = [
            device("old card", DeviceKind::Discrete, old),
            device("software", DeviceKind::Software, None),
            device("card", DeviceKind::Integrated, None),
        ];
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

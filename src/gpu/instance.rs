//! The Vulkan instance, and the list of devices.

use std::ffi::CStr;

use ash::vk;

use super::drive::Drive;
use super::info::{DeviceInfo, NO_DRIVER, describe, max_texels_forced};
use crate::error::{Error, Result};

/// A Vulkan instance, with the validation layers if the user asked for them.
pub(super) struct Instance {
    pub handle: ash::Instance,
    debug: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    /// Keeps libvulkan loaded.
    entry: ash::Entry,
}

/// Environment variable: if it is not empty, the validation layers are loaded, and their first message aborts the process.
const VALIDATE: &str = "TAUGATE_VALIDATE";

/// Converts the error of a Vulkan call, with a remedy if there is one. `doing` says which step failed, such as "submitting work".
pub(super) fn device_error(doing: &str, e: vk::Result) -> Error {
    let message = match e {
        vk::Result::ERROR_DEVICE_LOST => format!(
            "the device was lost while {doing}; choose another device with --device, or try a smaller --resolution"
        ),
        vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
            format!("out of memory while {doing}; try a smaller --resolution or fewer --light-paths")
        }
        _ => format!("{doing} failed ({e})"),
    };
    Error::Vulkan { message, source: e.into() }
}

/// As [`device_error`], for the first calls of Vulkan. They need hardly any memory, but the loader says that it has run out of memory
/// if it cannot use the files that describe the drivers.
fn start_error(doing: &str, e: vk::Result) -> Error {
    let message = match e {
        vk::Result::ERROR_OUT_OF_HOST_MEMORY
        | vk::Result::ERROR_OUT_OF_DEVICE_MEMORY
        | vk::Result::ERROR_INITIALIZATION_FAILED => format!(
            "{doing} failed, because the Vulkan loader cannot use a driver; check the driver manifests (.json) in the folders \
             vulkan/icd.d, or those that VK_DRIVER_FILES or VK_ICD_FILENAMES names; VK_LOADER_DEBUG=error shows which one"
        ),
        _ => return device_error(doing, e),
    };
    Error::Vulkan { message, source: e.into() }
}

impl Instance {
    pub fn open() -> Result<Instance> {
        // SAFETY: loading libvulkan runs its initialisers, as for every Vulkan program.
        let entry = unsafe { ash::Entry::load() }.map_err(|_| {
            Error::Device(
                "no Vulkan loader (libvulkan.so.1) on this machine; run ./setup.sh, or install a graphics driver"
                    .into(),
            )
        })?;
        let app = vk::ApplicationInfo::default().application_name(c"taugate").api_version(vk::API_VERSION_1_2);
        let layers = if validating() { vec![c"VK_LAYER_KHRONOS_validation".as_ptr()] } else { vec![] };
        let mut extensions = if validating() { vec![ash::ext::debug_utils::NAME.as_ptr()] } else { vec![] };
        // Without this extension, the loader hides drivers that lack a part of Vulkan, such as MoltenVK on macOS.
        // SAFETY: the call needs nothing but the loader.
        let offered = unsafe { entry.enumerate_instance_extension_properties(None) }.unwrap_or_default();
        let mut flags = vk::InstanceCreateFlags::empty();
        if has_extension(&offered, ash::khr::portability_enumeration::NAME) {
            extensions.push(ash::khr::portability_enumeration::NAME.as_ptr());
            flags |= vk::InstanceCreateFlags::ENUMERATE_PORTABILITY_KHR;
        }
        let sync = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&sync);
        let mut info = vk::InstanceCreateInfo::default()
            .flags(flags)
            .application_info(&app)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&extensions);
        if validating() {
            info = info.push_next(&mut features);
        }
        // SAFETY: `info` and all it points to live until the call returns.
        let handle = unsafe { entry.create_instance(&info, None) }.map_err(|e| match e {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => {
                Error::Device(format!("no Vulkan driver on this machine; {NO_DRIVER}"))
            }
            e => start_error("starting Vulkan", e),
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

    /// All devices in the order of the Vulkan loader, with the environment variables for drive and texel buffers applied.
    pub fn devices(&self) -> Result<Vec<(vk::PhysicalDevice, DeviceInfo)>> {
        // SAFETY: the instance is alive.
        let devices =
            unsafe { self.handle.enumerate_physical_devices() }.map_err(|e| start_error("enumerating devices", e))?;
        let (forced, max_texels_forced) = (Drive::forced()?, max_texels_forced()?);
        let describe = |d| {
            let info = describe(&self.handle, d);
            let (drive, max_texels) = (forced(info.drive), info.max_texels.min(max_texels_forced));
            (d, DeviceInfo { drive, max_texels, ..info })
        };
        Ok(devices.into_iter().map(describe).collect())
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: everything made from the instance is already destroyed: `Shared` destroys its device in `drop`, before its
        // fields are dropped.
        unsafe {
            if let Some((loader, messenger)) = &self.debug {
                loader.destroy_debug_utils_messenger(*messenger, None);
            }
            self.handle.destroy_instance(None);
        }
    }
}

/// Whether `offered` has the extension `name`.
pub(super) fn has_extension(offered: &[vk::ExtensionProperties], name: &CStr) -> bool {
    offered.iter().any(|extension| extension.extension_name_as_c_str() == Ok(name))
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
    let is_error = severity == vk::DebugUtilsMessageSeverityFlagsEXT::ERROR;
    eprintln!("validation {}: {message}", if is_error { "error" } else { "warning" });
    std::process::abort()
}

#[cfg(test)]
mod tests {
    use std::error::Error as _;

    use super::*;
    use crate::error::ErrorKind;

    #[test]
    fn a_driver_that_does_not_start_is_no_lack_of_memory() {
        let broken = start_error("starting Vulkan", vk::Result::ERROR_OUT_OF_HOST_MEMORY).to_string();
        assert!(broken.contains("driver manifests") && !broken.contains("--resolution"), "{broken}");
        let full = device_error("allocating", vk::Result::ERROR_OUT_OF_HOST_MEMORY).to_string();
        assert!(full.contains("out of memory") && full.contains("--resolution"), "{full}");
    }

    #[test]
    fn an_error_of_the_driver_keeps_its_source() {
        let lost = device_error("submitting work", vk::Result::ERROR_DEVICE_LOST);
        let error = lost.map_device_message(|message| format!("{message}; the files hold 4 samples"));
        assert_eq!(error.kind(), ErrorKind::Device);
        assert!(error.to_string().ends_with("; the files hold 4 samples"), "{error}");
        let source = error.source().and_then(|source| source.downcast_ref::<vk::Result>());
        assert_eq!(source, Some(&vk::Result::ERROR_DEVICE_LOST));
    }
}

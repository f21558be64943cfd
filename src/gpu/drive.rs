//! How the host drives a device, depending on the device's memory.

#![warn(missing_docs)]

use ash::vk;

use crate::error::{Error, Result};

/// Properties of memory that the host can map: host-visible and coherent.
pub(super) const FOR_HOST: vk::MemoryPropertyFlags = vk::MemoryPropertyFlags::from_raw(
    vk::MemoryPropertyFlags::HOST_VISIBLE.as_raw() | vk::MemoryPropertyFlags::HOST_COHERENT.as_raw(),
);
/// Properties of memory that the host reads at full speed: as [`FOR_HOST`], and host-cached.
pub(super) const CACHED: vk::MemoryPropertyFlags =
    vk::MemoryPropertyFlags::from_raw(FOR_HOST.as_raw() | vk::MemoryPropertyFlags::HOST_CACHED.as_raw());

/// Environment variable: `card` or `cpu` forces that drive on every device, for tests and to try out a new device.
const FORCED: &str = "TAUGATE_DRIVE";

/// How the host drives a device. The image is the same bits with every drive; a test compares them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Drive {
    /// True: the host reads and writes the device's memory in place. False: data is copied through staging memory.
    pub maps_memory: bool,
    /// True: after each bounce the host reads how many paths and shade points are left, and omits empty dispatches. False: the
    /// host records all bounces at once, and the device reads the sizes of its dispatches from its own memory.
    pub waits_per_bounce: bool,
}

impl Drive {
    /// For memory that the host reads at full speed. A wait for the device is cheap, but an empty dispatch costs as much as
    /// tracing hundreds of paths.
    pub const CPU: Drive = Drive { maps_memory: true, waits_per_bounce: true };
    /// For memory behind a bus. A wait for the device costs more than an empty dispatch.
    pub const CARD: Drive = Drive { maps_memory: false, waits_per_bounce: false };

    /// Drive of a device. `is_cached`: the host reads the device's memory at full speed. `is_cpu`: the device is a software
    /// implementation on the host.
    pub(super) fn of(is_cached: bool, is_cpu: bool) -> Drive {
        Drive { maps_memory: is_cached, waits_per_bounce: is_cached || is_cpu }
    }

    /// Drive that the environment variable `TAUGATE_DRIVE` forces, if any. Fails if the variable has another value than `card`,
    /// `cpu` or the empty string.
    pub(super) fn forced() -> Result<Option<Drive>> {
        match std::env::var_os(FORCED) {
            None => Ok(None),
            Some(value) => parse(&value.to_string_lossy()),
        }
    }
}

fn parse(value: &str) -> Result<Option<Drive>> {
    match value {
        "" => Ok(None),
        "card" => Ok(Some(Drive::CARD)),
        "cpu" => Ok(Some(Drive::CPU)),
        _ => Err(Error::Device(format!("{FORCED} is {value}; set it to card or cpu, or unset it"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_decides_how_a_device_is_driven() {
        assert_eq!(Drive::of(true, true), Drive::CPU);
        assert_eq!(Drive::of(true, false), Drive::CPU, "an integrated card shares the host's memory");
        assert_eq!(Drive::of(false, false), Drive::CARD);
        assert_eq!(Drive::of(false, true), Drive { maps_memory: false, waits_per_bounce: true });
    }

    #[test]
    fn a_forced_drive_is_named() {
        assert_eq!(parse("card").unwrap(), Some(Drive::CARD));
        assert_eq!(parse("cpu").unwrap(), Some(Drive::CPU));
        assert_eq!(parse("").unwrap(), None);
        let message = parse("gpu").unwrap_err().to_string();
        assert!(message.contains("TAUGATE_DRIVE is gpu; set it to card or cpu"), "{message}");
    }
}

//! How the host drives a device.

use ash::vk;

use crate::error::{Error, Result};

/// Memory for data that the host reads and writes.
pub(super) const FOR_HOST: vk::MemoryPropertyFlags = vk::MemoryPropertyFlags::from_raw(
    vk::MemoryPropertyFlags::HOST_VISIBLE.as_raw() | vk::MemoryPropertyFlags::HOST_COHERENT.as_raw(),
);
/// Memory that the host reads at full speed.
pub(super) const CACHED: vk::MemoryPropertyFlags =
    vk::MemoryPropertyFlags::from_raw(FOR_HOST.as_raw() | vk::MemoryPropertyFlags::HOST_CACHED.as_raw());

/// Set to `card` or `cpu` to drive every device that way, whatever it is: for tests, and for trying out a new device.
const FORCED: &str = "TAUGATE_DRIVE";

/// How the host drives a device. The image does not depend on it; a test holds that.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Drive {
    /// The host reads and writes the device's memory where it lies. Else data is copied, through staging memory that is made once.
    pub maps_memory: bool,
    /// The host looks at what a bounce has left before it records the next one, and leaves out dispatches that have nothing to do.
    /// Else all bounces are recorded at once, and the device reads the sizes of its dispatches from its own memory.
    pub waits_per_bounce: bool,
}

impl Drive {
    /// For memory that the host reaches at full speed: a wait is cheap, and an empty dispatch costs what tracing hundreds of paths
    /// does.
    pub const CPU: Drive = Drive { maps_memory: true, waits_per_bounce: true };
    /// For memory behind a bus: a wait costs more than an empty dispatch.
    pub const CARD: Drive = Drive { maps_memory: false, waits_per_bounce: false };

    /// For a device whose memory the host reads at full speed (`is_cached`) or not.
    pub(super) fn of(is_cached: bool, is_cpu: bool) -> Drive {
        Drive { maps_memory: is_cached, waits_per_bounce: is_cached || is_cpu }
    }

    /// What the user forces on every device, if anything.
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

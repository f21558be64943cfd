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
/// Environment variable: `1` or `2` forces that number of iterations in flight, for tests and to try out a new device.
const IN_FLIGHT: &str = "TAUGATE_IN_FLIGHT";

/// How the host drives a device. The image is the same bits with every drive; a test compares them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Drive {
    /// True: the host reads and writes the device's memory in place. False: data is copied through staging memory.
    pub maps_memory: bool,
    /// True: after each bounce the host reads how many paths and shade points are left, and omits empty dispatches. False: the
    /// host records all bounces at once, and the device reads the sizes of its dispatches from its own memory.
    pub waits_per_bounce: bool,
    /// How many iterations of a render the host and the device work on at a time, 1 or 2. With 2, the light subpaths of the next
    /// iteration are traced and their trees built while the device traces the sensor subpaths of this one.
    pub in_flight: u32,
}

impl Drive {
    /// For memory that the host reads at full speed. A wait for the device is cheap, but an empty dispatch costs as much as
    /// tracing hundreds of paths.
    pub const CPU: Drive = Drive { maps_memory: true, waits_per_bounce: true, in_flight: 1 };
    /// For memory behind a bus. A wait for the device costs more than an empty dispatch.
    pub const CARD: Drive = Drive { maps_memory: false, waits_per_bounce: false, in_flight: 2 };

    /// Drive of a device. `is_cached`: the host reads the device's memory at full speed. `is_cpu`: the device is a software
    /// implementation on the host.
    pub(super) fn of(is_cached: bool, is_cpu: bool) -> Drive {
        Drive {
            maps_memory: is_cached,
            waits_per_bounce: is_cached || is_cpu,
            in_flight: if is_cached || is_cpu { 1 } else { 2 },
        }
    }

    /// Function that gives each device the drive that the environment variables `TAUGATE_DRIVE` and `TAUGATE_IN_FLIGHT` force; its
    /// argument is the drive that suits the device. Fails if a variable has an unknown value.
    pub(super) fn forced() -> Result<impl Fn(Drive) -> Drive> {
        let value =
            |variable| std::env::var_os(variable).map(|value| value.to_string_lossy().into_owned()).unwrap_or_default();
        let drive = parse(FORCED, &value(FORCED), [("card", Drive::CARD), ("cpu", Drive::CPU)])?;
        let in_flight = parse(IN_FLIGHT, &value(IN_FLIGHT), [("1", 1), ("2", 2)])?;
        Ok(move |own| {
            let drive = drive.unwrap_or(own);
            Drive { in_flight: in_flight.unwrap_or(drive.in_flight), ..drive }
        })
    }
}

/// The choice that `value` of the environment variable `variable` names; `None` if it is empty.
fn parse<T: Copy>(variable: &str, value: &str, choices: [(&str, T); 2]) -> Result<Option<T>> {
    match choices.iter().find(|(name, _)| *name == value) {
        Some(&(_, choice)) => Ok(Some(choice)),
        None if value.is_empty() => Ok(None),
        None => {
            let [(one, _), (other, _)] = choices;
            Err(Error::Device(format!("{variable} is {value}; set it to {one} or {other}, or unset it")))
        }
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
        let slow_cpu = Drive { maps_memory: false, waits_per_bounce: true, in_flight: 1 };
        assert_eq!(Drive::of(false, true), slow_cpu);
    }

    #[test]
    fn a_forced_drive_is_named() {
        let drive = |value| parse(FORCED, value, [("card", Drive::CARD), ("cpu", Drive::CPU)]);
        assert_eq!(drive("card").unwrap(), Some(Drive::CARD));
        assert_eq!(drive("cpu").unwrap(), Some(Drive::CPU));
        assert_eq!(drive("").unwrap(), None);
        let message = drive("gpu").unwrap_err().to_string();
        assert!(message.contains("TAUGATE_DRIVE is gpu; set it to card or cpu"), "{message}");
    }
}

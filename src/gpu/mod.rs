//! The Vulkan device. (A place holder: the calls are the ones the program makes, and none finds a device.)

use crate::error::{Error, Result};

/// An open device with its queue.
#[derive(Debug)]
pub struct Device {}

/// What matters about a device when choosing one.
#[derive(Debug, Clone)]
pub struct DeviceInfo {
    pub name: String,
    pub driver: String,
    /// Vulkan version, such as 1.3.296.
    pub api_version: String,
    /// Size of the largest device-local heap.
    pub heap_bytes: u64,
    pub max_storage_buffer_range: u64,
    pub max_allocation: u64,
    pub subgroup_size: u32,
    /// A software implementation such as lavapipe.
    pub is_cpu: bool,
}

impl Device {
    /// Opens the device with this index or whose name contains this text (any case), or the best one.
    pub fn open(_selector: Option<&str>) -> Result<Device> {
        Err(Error::Device("this build has no renderer yet".into()))
    }

    /// All devices, in the order of their indices.
    pub fn list() -> Result<Vec<DeviceInfo>> {
        Err(Error::Device("this build has no renderer yet".into()))
    }
}

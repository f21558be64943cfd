//! Device memory with the buffer that it is bound to.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use ash::vk;

use super::drive::CACHED;
use super::shared::Shared;
use crate::error::{Error, Result};

/// Memory that the device can work with, and the buffer that it is bound to.
pub(super) struct Allocation {
    pub shared: Arc<Shared>,
    pub handle: vk::Buffer,
    memory: vk::DeviceMemory,
    /// Where the host reads and writes it; none where it goes through staging memory.
    pub mapping: Option<*mut u8>,
    pub size: u64,
    pub name: &'static str,
    /// What it adds to the device's sum of bytes: nothing for memory of the host, or before there is memory.
    counted: u64,
}

// SAFETY: the mapping is an address that stays valid until `drop`. A buffer's is written with `&mut Buffer` alone, of which there
// is one per allocation, and touched only under `host_access`, while the device works on nothing; that of staging memory is
// touched under its lock, while no submit uses it.
unsafe impl Send for Allocation {}
// SAFETY: as above.
unsafe impl Sync for Allocation {}

impl Allocation {
    /// `wanted`: [`super::drive::FOR_HOST`], which is mapped, or memory of the device, which is mapped where the device is driven so.
    pub fn new(
        shared: &Arc<Shared>,
        name: &'static str,
        size: u64,
        wanted: vk::MemoryPropertyFlags,
    ) -> Result<Allocation> {
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER
            | vk::BufferUsageFlags::INDIRECT_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        // From here on `drop` destroys what exists; Vulkan ignores null handles.
        let mut new = Allocation {
            shared: shared.clone(),
            handle: vk::Buffer::null(),
            memory: vk::DeviceMemory::null(),
            mapping: None,
            size,
            name,
            counted: 0,
        };
        let info = vk::BufferCreateInfo::default().size(size).usage(usage);
        // SAFETY: handles belong to this device; memory is bound once, before any use.
        unsafe {
            new.handle = shared.device.create_buffer(&info, None).map_err(|e| shared.error("creating a buffer", e))?;
            let requirements = shared.device.get_buffer_memory_requirements(new.handle);
            let for_host = wanted.contains(vk::MemoryPropertyFlags::HOST_VISIBLE);
            let find = |flags| find_memory(&shared.memory, requirements.memory_type_bits, flags);
            let kind = (for_host || shared.info.drive.maps_memory)
                .then(|| find(wanted | CACHED))
                .flatten()
                .or_else(|| find(wanted))
                .ok_or_else(|| Error::Device(format!("{} has no memory for {name}", shared.info.name)))?;
            let allocate = vk::MemoryAllocateInfo::default().allocation_size(requirements.size).memory_type_index(kind);
            new.memory = shared
                .device
                .allocate_memory(&allocate, None)
                .map_err(|e| shared.error("allocating device memory", e))?;
            new.counted = if for_host { 0 } else { size };
            shared.bytes.fetch_add(new.counted, Ordering::Relaxed);
            shared.allocations.fetch_add(1, Ordering::Relaxed);
            shared
                .device
                .bind_buffer_memory(new.handle, new.memory, 0)
                .map_err(|e| shared.error("binding memory", e))?;
            let is_cached = shared.memory.memory_types[kind as usize].property_flags.contains(CACHED);
            if for_host || (shared.info.drive.maps_memory && is_cached) {
                let address = shared
                    .device
                    .map_memory(new.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())
                    .map_err(|e| shared.error("mapping memory", e))?;
                new.mapping = Some(address.cast());
            }
        }
        Ok(new)
    }
}

fn find_memory(
    memory: &vk::PhysicalDeviceMemoryProperties,
    allowed: u32,
    wanted: vk::MemoryPropertyFlags,
) -> Option<u32> {
    let types = memory.memory_types_as_slice();
    (0..types.len()).find(|&i| allowed & (1 << i) != 0 && types[i].property_flags.contains(wanted)).map(|i| i as u32)
}

impl Drop for Allocation {
    fn drop(&mut self) {
        let shared = &self.shared;
        shared.bytes.fetch_sub(self.counted, Ordering::Relaxed);
        // SAFETY: bindings and recorders hold what they use, and every submit was waited for: the device no longer uses it.
        unsafe {
            shared.device.destroy_buffer(self.handle, None);
            shared.device.free_memory(self.memory, None);
        }
    }
}

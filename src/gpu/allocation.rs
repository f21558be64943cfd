//! Device memory, and the buffer that is bound to it.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use ash::vk;

use super::drive::CACHED;
use super::shared::Shared;
use super::turns::Users;
use crate::error::{Error, Result};

/// Memory that the device can access, and the one buffer that is bound to this memory.
pub(super) struct Allocation {
    pub shared: Arc<Shared>,
    pub handle: vk::Buffer,
    memory: vk::DeviceMemory,
    /// Address at which the host reads and writes the memory. `None`: the host copies through staging memory.
    pub mapping: Option<*mut u8>,
    pub size: u64,
    pub name: &'static str,
    pub users: Users,
    /// The acceleration structures that lie in the memory; the last one refers to the others.
    pub structures: Vec<vk::AccelerationStructureKHR>,
    /// Bytes that this allocation adds to [`Shared::bytes`]. 0 for host memory, and before the memory is allocated.
    counted: u64,
}

// SAFETY: the mapping is an address that stays valid until `drop`. The mapping of a buffer is written only through `&mut Buffer`,
// and each allocation has one `Buffer`. The host reads and writes the mapping only in a turn of its own (`Turns::of_host`), while no
// submit uses the memory. The mapping of staging memory is used by the one owner of its area, before the submit of the area or after it.
unsafe impl Send for Allocation {}
// SAFETY: as above.
unsafe impl Sync for Allocation {}

impl Allocation {
    /// `wanted`: the properties of the memory. [`super::drive::FOR_HOST`] is always mapped. Device memory is mapped if the drive
    /// of the device says so ([`super::Drive::maps_memory`]) and the memory is host-cached.
    pub fn new(
        shared: &Arc<Shared>,
        name: &'static str,
        size: u64,
        wanted: vk::MemoryPropertyFlags,
    ) -> Result<Allocation> {
        Allocation::with_usage(shared, name, size, wanted, vk::BufferUsageFlags::empty())
    }

    /// As [`Allocation::new`], for uses beyond those of all buffers.
    pub fn with_usage(
        shared: &Arc<Shared>,
        name: &'static str,
        size: u64,
        wanted: vk::MemoryPropertyFlags,
        further: vk::BufferUsageFlags,
    ) -> Result<Allocation> {
        let usage = further
            | vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER
            | vk::BufferUsageFlags::INDIRECT_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        // From here on, `drop` destroys the objects that exist, even after an error. Vulkan ignores null handles.
        let mut new = Allocation {
            shared: shared.clone(),
            handle: vk::Buffer::null(),
            memory: vk::DeviceMemory::null(),
            mapping: None,
            size,
            name,
            users: Users::default(),
            structures: vec![],
            counted: 0,
        };
        let info = vk::BufferCreateInfo::default().size(size).usage(usage);
        // SAFETY: the handles belong to this device. The memory is bound once, before any use.
        unsafe {
            new.handle = shared.device.create_buffer(&info, None).map_err(|e| shared.error("creating a buffer", e))?;
            let requirements = shared.device.get_buffer_memory_requirements(new.handle);
            let for_host = wanted.contains(vk::MemoryPropertyFlags::HOST_VISIBLE);
            let find = |flags| find_memory(&shared.memory, requirements.memory_type_bits, flags);
            let kind = (for_host || shared.info.drive.maps_memory)
                .then(|| find(wanted | CACHED))
                .flatten()
                .or_else(|| find(wanted))
                .ok_or_else(|| {
                    Error::Device(format!(
                        "{} has no memory type for the buffer {name}; choose another device with --device",
                        shared.info.name
                    ))
                })?;
            let mut addressed = vk::MemoryAllocateFlagsInfo::default().flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
            let mut allocate =
                vk::MemoryAllocateInfo::default().allocation_size(requirements.size).memory_type_index(kind);
            if usage.contains(vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS) {
                allocate = allocate.push_next(&mut addressed);
            }
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
        // SAFETY: bindings and recorders keep the allocations that they use alive, and the host waited for every submit. So the
        // device no longer uses this memory.
        unsafe {
            if let Some(rays) = &shared.rays {
                self.structures.iter().for_each(|&s| rays.functions.destroy_acceleration_structure(s, None));
            }
            shared.device.destroy_buffer(self.handle, None);
            shared.device.free_memory(self.memory, None);
        }
    }
}

//! Storage buffers: device memory, written and read by the host through a mapping where there is one, else by copies.

use std::sync::atomic::Ordering;

use ash::vk;
use bytemuck::{AnyBitPattern, NoUninit};

use super::device::Device;
use super::need::Need;
use super::recorder::Recorder;
use crate::error::{Error, Result};

/// A storage buffer. Its contents are undefined until written.
pub struct Buffer {
    device: Device,
    pub(super) handle: vk::Buffer,
    memory: vk::DeviceMemory,
    mapping: Option<*mut u8>,
    size: u64,
    name: &'static str,
}

// SAFETY: the mapping is a plain address; all access goes through `&mut` or happens between submits.
unsafe impl Send for Buffer {}

impl Buffer {
    /// `count` elements of `T`, or room for them; see [`Need::of`].
    pub fn new<T>(device: &Device, name: &'static str, count: usize, remedy: &'static str) -> Result<Buffer> {
        Buffer::for_need(device, &Need::of::<T>(name, count, remedy))
    }

    /// The buffer that was planned as `need`.
    pub fn for_need(device: &Device, need: &Need) -> Result<Buffer> {
        need.check(device.info())?;
        Buffer::allocate(device, need.name, need.bytes, vk::MemoryPropertyFlags::DEVICE_LOCAL)
    }

    /// A buffer that holds a copy of `data`.
    pub fn from_slice<T: NoUninit>(
        device: &Device,
        name: &'static str,
        data: &[T],
        remedy: &'static str,
    ) -> Result<Buffer> {
        let mut buffer = Buffer::new::<T>(device, name, data.len(), remedy)?;
        buffer.write(0, data)?;
        Ok(buffer)
    }

    fn allocate(device: &Device, name: &'static str, size: u64, wanted: vk::MemoryPropertyFlags) -> Result<Buffer> {
        let shared = &device.shared;
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER
            | vk::BufferUsageFlags::INDIRECT_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        // SAFETY: handles belong to this device; memory is bound once, before any use.
        unsafe {
            let handle = shared
                .device
                .create_buffer(&vk::BufferCreateInfo::default().size(size).usage(usage), None)
                .map_err(|e| shared.error("creating a buffer", e))?;
            let needs = shared.device.get_buffer_memory_requirements(handle);
            // Mapped only where the host reads it at full speed: integrated and software devices, and staging buffers.
            let host = vk::MemoryPropertyFlags::HOST_VISIBLE
                | vk::MemoryPropertyFlags::HOST_COHERENT
                | vk::MemoryPropertyFlags::HOST_CACHED;
            let kind = find_memory(&shared.memory, needs.memory_type_bits, wanted | host)
                .or_else(|| find_memory(&shared.memory, needs.memory_type_bits, wanted))
                .ok_or_else(|| Error::Device(format!("{} has no memory for {name}", shared.info.name)))?;
            let memory = shared
                .device
                .allocate_memory(
                    &vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind),
                    None,
                )
                .map_err(|e| {
                    shared.device.destroy_buffer(handle, None);
                    shared.error("allocating device memory", e)
                })?;
            shared.bytes.fetch_add(size, Ordering::Relaxed);
            let mut buffer = Buffer { device: device.clone(), handle, memory, mapping: None, size, name };
            shared.device.bind_buffer_memory(handle, memory, 0).map_err(|e| shared.error("binding memory", e))?;
            let staging = wanted.contains(vk::MemoryPropertyFlags::HOST_VISIBLE);
            if staging || shared.memory.memory_types[kind as usize].property_flags.contains(host) {
                let address = shared
                    .device
                    .map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())
                    .map_err(|e| shared.error("mapping memory", e))?;
                buffer.mapping = Some(address.cast());
            }
            Ok(buffer)
        }
    }

    /// Size in bytes.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Writes `data` from element `first` on. The device must not be using the buffer.
    pub fn write<T: NoUninit>(&mut self, first: usize, data: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let offset = (first * size_of::<T>()) as u64;
        assert!(offset + bytes.len() as u64 <= self.size, "{}: write past the end", self.name);
        let Some(address) = self.mapping else {
            let mut staging = self.staging(bytes.len() as u64)?;
            staging.write(0, bytes)?;
            return Recorder::copy(&self.device, (&staging, 0), (self, offset), bytes.len() as u64);
        };
        // SAFETY: the range was checked, the mapping covers the whole buffer, and the device is idle on it.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), address.add(offset as usize), bytes.len()) };
        Ok(())
    }

    /// Reads `into.len()` elements from element `first` on. The device must not be writing the buffer.
    pub fn read<T: AnyBitPattern + NoUninit>(&self, first: usize, into: &mut [T]) -> Result<()> {
        let offset = (first * size_of::<T>()) as u64;
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(into);
        assert!(offset + bytes.len() as u64 <= self.size, "{}: read past the end", self.name);
        let Some(address) = self.mapping else {
            let staging = self.staging(bytes.len() as u64)?;
            Recorder::copy(&self.device, (self, offset), (&staging, 0), bytes.len() as u64)?;
            return staging.read(0, bytes);
        };
        // SAFETY: as in `write`.
        unsafe { std::ptr::copy_nonoverlapping(address.add(offset as usize), bytes.as_mut_ptr(), bytes.len()) };
        Ok(())
    }

    /// Shows `look` the first `count` elements where they lie, or a copy where the device's memory is not mapped.
    pub fn with<T: AnyBitPattern + NoUninit, R>(&self, count: usize, look: impl FnOnce(&[T]) -> R) -> Result<R> {
        assert!((count * size_of::<T>()) as u64 <= self.size, "{}: read past the end", self.name);
        match self.mapping {
            // SAFETY: the range was checked, mappings are page-aligned, any bit pattern is valid for T, and the device is idle.
            Some(address) => Ok(look(unsafe { std::slice::from_raw_parts(address.cast::<T>(), count) })),
            None => Ok(look(&self.to_vec(count)?)),
        }
    }

    /// `count` elements from the beginning.
    pub fn to_vec<T: AnyBitPattern + NoUninit>(&self, count: usize) -> Result<Vec<T>> {
        let mut data = vec![T::zeroed(); count];
        self.read(0, &mut data)?;
        Ok(data)
    }

    fn staging(&self, bytes: u64) -> Result<Buffer> {
        let mapped = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        Buffer::allocate(&self.device, "staging", bytes.max(16), mapped)
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

impl Drop for Buffer {
    fn drop(&mut self) {
        self.device.shared.bytes.fetch_sub(self.size, Ordering::Relaxed);
        // SAFETY: recorders wait for their submits, so the device no longer uses the buffer.
        unsafe {
            self.device.shared.device.destroy_buffer(self.handle, None);
            self.device.shared.device.free_memory(self.memory, None);
        }
    }
}

//! Storage buffers: device memory, written and read by the host through a mapping where there is one, else by copies.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use ash::vk;
use bytemuck::{AnyBitPattern, NoUninit};

use super::commands::Commands;
use super::device::Device;
use super::need::Need;
use crate::error::{Error, Result};

/// A storage buffer. Its contents are undefined until written. What it is bound to keeps its memory alive, but the host reads
/// and writes it through this one handle: `&mut` to write.
pub struct Buffer {
    pub(super) allocation: Arc<Allocation>,
}

/// Memory of the device, and the buffer that it is bound to.
pub(super) struct Allocation {
    pub device: Device,
    pub handle: vk::Buffer,
    memory: vk::DeviceMemory,
    mapping: Option<*mut u8>,
    pub size: u64,
    name: &'static str,
    /// What it adds to the device's sum of bytes: nothing until there is memory.
    counted: u64,
}

// SAFETY: the mapping is an address that stays valid until `drop`. The host writes through it only with `&mut Buffer`, of which
// there is one per allocation, and touches it only under `host_access`, while the device works on nothing.
unsafe impl Send for Allocation {}
// SAFETY: as above; what is shared reads only.
unsafe impl Sync for Allocation {}

/// Memory that the host reads at full speed: integrated and software devices, and staging buffers.
const HOST: vk::MemoryPropertyFlags = vk::MemoryPropertyFlags::from_raw(
    vk::MemoryPropertyFlags::HOST_VISIBLE.as_raw()
        | vk::MemoryPropertyFlags::HOST_COHERENT.as_raw()
        | vk::MemoryPropertyFlags::HOST_CACHED.as_raw(),
);

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

    fn staging(device: &Device, bytes: u64) -> Result<Buffer> {
        let mapped = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        Buffer::allocate(device, "staging", bytes.max(16), mapped)
    }

    fn allocate(device: &Device, name: &'static str, size: u64, wanted: vk::MemoryPropertyFlags) -> Result<Buffer> {
        Ok(Buffer { allocation: Arc::new(Allocation::new(device, name, size, wanted)?) })
    }

    /// Size in bytes.
    pub fn size(&self) -> u64 {
        self.allocation.size
    }

    /// Writes `data` from element `first` on. Waits for submits of other threads.
    pub fn write<T: NoUninit>(&mut self, first: usize, data: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let offset = self.offset::<T>(first, bytes.len(), "write");
        let Some(address) = self.allocation.mapping else {
            let mut staging = Buffer::staging(&self.allocation.device, bytes.len() as u64)?;
            staging.write(0, bytes)?;
            return copy((&staging, 0), (self, offset), bytes.len() as u64);
        };
        let _idle = self.allocation.device.shared.host_access();
        // SAFETY: `offset` checked the range, the mapping covers the whole buffer, the device works on nothing, and `&mut self`
        // keeps other host threads away.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), address.add(offset as usize), bytes.len()) };
        Ok(())
    }

    /// Reads `into.len()` elements from element `first` on. Waits for submits of other threads.
    pub fn read<T: AnyBitPattern + NoUninit>(&self, first: usize, into: &mut [T]) -> Result<()> {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(into);
        let offset = self.offset::<T>(first, bytes.len(), "read");
        let Some(address) = self.allocation.mapping else {
            let staging = Buffer::staging(&self.allocation.device, bytes.len() as u64)?;
            copy((self, offset), (&staging, 0), bytes.len() as u64)?;
            return staging.read(0, bytes);
        };
        let _idle = self.allocation.device.shared.host_access();
        // SAFETY: as in `write`; `&self` keeps writers away.
        unsafe { std::ptr::copy_nonoverlapping(address.add(offset as usize), bytes.as_mut_ptr(), bytes.len()) };
        Ok(())
    }

    /// Shows `look` the first `count` elements where they lie, or a copy where the device's memory is not mapped. The device
    /// waits for `look`, which must neither submit work nor touch a buffer.
    pub fn with<T: AnyBitPattern + NoUninit, R>(&self, count: usize, look: impl FnOnce(&[T]) -> R) -> Result<R> {
        self.offset::<T>(count, 0, "read");
        let Some(address) = self.allocation.mapping else { return Ok(look(&self.to_vec(count)?)) };
        let _idle = self.allocation.device.shared.host_access();
        // SAFETY: `offset` checked the range, mappings are page-aligned, any bit pattern is valid for T, the device works on
        // nothing, and `&self` keeps writers away.
        Ok(look(unsafe { std::slice::from_raw_parts(address.cast::<T>(), count) }))
    }

    /// `count` elements from the beginning.
    pub fn to_vec<T: AnyBitPattern + NoUninit>(&self, count: usize) -> Result<Vec<T>> {
        let mut data = vec![T::zeroed(); count];
        self.read(0, &mut data)?;
        Ok(data)
    }

    /// Offset of element `first`, from which `bytes` bytes lie inside the buffer.
    fn offset<T>(&self, first: usize, bytes: usize, doing: &str) -> u64 {
        let offset = first.checked_mul(size_of::<T>());
        let end = offset.and_then(|offset| offset.checked_add(bytes));
        let inside = end.is_some_and(|end| end as u64 <= self.allocation.size);
        assert!(inside, "{}: {doing} past the end", self.allocation.name);
        offset.unwrap_or_default() as u64
    }
}

/// Copies `bytes` bytes between (buffer, offset) pairs, whose ranges the callers have checked, and waits for it.
fn copy(from: (&Buffer, u64), to: (&Buffer, u64), bytes: u64) -> Result<()> {
    if bytes == 0 {
        return Ok(());
    }
    let device = &from.0.allocation.device;
    let mut commands = Commands::new(device)?;
    commands.begin()?;
    let region = [vk::BufferCopy { src_offset: from.1, dst_offset: to.1, size: bytes }];
    let (from, to) = (from.0.allocation.handle, to.0.allocation.handle);
    // SAFETY: recording has begun, both ranges lie inside, both buffers have the transfer usages and outlive the submit.
    unsafe { device.shared.device.cmd_copy_buffer(commands.buffer, from, to, &region) };
    commands.submit()
}

impl Allocation {
    fn new(device: &Device, name: &'static str, size: u64, wanted: vk::MemoryPropertyFlags) -> Result<Allocation> {
        let shared = &device.shared;
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER
            | vk::BufferUsageFlags::INDIRECT_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        // From here on `drop` destroys what exists; Vulkan ignores null handles.
        let mut new = Allocation {
            device: device.clone(),
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
            let needs = shared.device.get_buffer_memory_requirements(new.handle);
            let kind = find_memory(&shared.memory, needs.memory_type_bits, wanted | HOST)
                .or_else(|| find_memory(&shared.memory, needs.memory_type_bits, wanted))
                .ok_or_else(|| Error::Device(format!("{} has no memory for {name}", shared.info.name)))?;
            let allocate = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
            new.memory = shared
                .device
                .allocate_memory(&allocate, None)
                .map_err(|e| shared.error("allocating device memory", e))?;
            new.counted = size;
            shared.bytes.fetch_add(size, Ordering::Relaxed);
            shared
                .device
                .bind_buffer_memory(new.handle, new.memory, 0)
                .map_err(|e| shared.error("binding memory", e))?;
            let staging = wanted.contains(vk::MemoryPropertyFlags::HOST_VISIBLE);
            if staging || shared.memory.memory_types[kind as usize].property_flags.contains(HOST) {
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
        let shared = &self.device.shared;
        shared.bytes.fetch_sub(self.counted, Ordering::Relaxed);
        // SAFETY: bindings and recorders hold what they use, and every submit was waited for: the device no longer uses it.
        unsafe {
            shared.device.destroy_buffer(self.handle, None);
            shared.device.free_memory(self.memory, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The buffer stayed behind where no memory fitted. The validation layers report that when the device closes.
    #[test]
    fn nothing_is_left_of_a_buffer_without_memory() {
        let device = Device::open(None).unwrap_or_else(|e| panic!("this test needs a Vulkan device: {e}"));
        // No type of memory has every property.
        let wanted = vk::MemoryPropertyFlags::from_raw(u32::MAX);
        let Err(error) = Buffer::allocate(&device, "words", 64, wanted) else { panic!("memory of every kind") };
        assert!(error.to_string().contains("has no memory for words"), "{error}");
        assert_eq!(device.bytes_in_use(), 0);
    }
}

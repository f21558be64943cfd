//! Storage buffers: device memory that the host writes and reads, through a mapping if there is one, else with copies.

use std::sync::Arc;

use ash::vk;
use bytemuck::{AnyBitPattern, NoUninit};

use super::allocation::Allocation;
use super::buffer_desc::BufferDesc;
use super::device::Device;
use super::drive::FOR_HOST;
use super::staging;
use crate::error::Result;

/// A storage buffer. Its contents are undefined until they are written. Bindings keep the memory of the buffer alive, but the
/// host reads and writes the buffer through this one handle, and needs `&mut` to write.
pub struct Buffer {
    device: Device,
    pub(super) allocation: Arc<Allocation>,
}

impl Buffer {
    /// A buffer for `count` elements of `T`, of at least 16 bytes; see [`BufferDesc::of`]. Fails if the buffer exceeds a limit of
    /// the device; `remedy` ends the error message.
    pub fn new<T>(device: &Device, name: &'static str, count: usize, remedy: &'static str) -> Result<Buffer> {
        Buffer::from_desc(device, &BufferDesc::of::<T>(name, count, remedy))
    }

    /// The buffer that `desc` describes. Fails if the buffer exceeds a limit of the device.
    pub fn from_desc(device: &Device, desc: &BufferDesc) -> Result<Buffer> {
        desc.check(device.info())?;
        Buffer::allocate(device, desc.name, desc.bytes, vk::MemoryPropertyFlags::DEVICE_LOCAL)
    }

    /// A buffer that holds a copy of `data`; see [`Buffer::new`] for `remedy` and errors.
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

    /// A buffer of `size` bytes in host memory, as the target of copies by the device.
    pub(super) fn on_host(device: &Device, name: &'static str, size: u64) -> Result<Buffer> {
        Buffer::allocate(device, name, size, FOR_HOST)
    }

    fn allocate(device: &Device, name: &'static str, size: u64, wanted: vk::MemoryPropertyFlags) -> Result<Buffer> {
        let allocation = Arc::new(Allocation::new(&device.shared, name, size, wanted)?);
        Ok(Buffer { device: device.clone(), allocation })
    }

    /// A buffer around memory that has its contents already, or that [`Buffer::write`] fills.
    pub(super) fn of_allocation(device: &Device, allocation: Allocation) -> Buffer {
        Buffer { device: device.clone(), allocation: Arc::new(allocation) }
    }

    /// Whether the host reads and writes the device's memory in place.
    pub(super) fn is_mapped(&self) -> bool {
        self.allocation.mapping.is_some()
    }

    /// Size in bytes.
    pub fn size(&self) -> u64 {
        self.allocation.size
    }

    /// Writes `data` from element `first` on; every later submit sees it. Waits for submits of other threads that use the buffer. Panics
    /// if the range does not lie inside the buffer.
    pub fn write<T: NoUninit>(&mut self, first: usize, data: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let offset = self.offset::<T>(first, bytes.len(), "write");
        let Some(address) = self.allocation.mapping else {
            return staging::write(&self.device, &self.allocation, offset, bytes);
        };
        let _turn = self.device.shared.turns.of_host(&self.allocation);
        // SAFETY: `offset` checked the range, the mapping covers the whole buffer, no submit uses the buffer, and
        // `&mut self` keeps other host threads away.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), address.add(offset as usize), bytes.len()) };
        Ok(())
    }

    /// Reads `into.len()` elements from element `first` on. Waits for submits of other threads that use the buffer. Panics if the range
    /// does not lie inside the buffer.
    pub fn read<T: AnyBitPattern + NoUninit>(&self, first: usize, into: &mut [T]) -> Result<()> {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(into);
        let offset = self.offset::<T>(first, bytes.len(), "read");
        let Some(address) = self.allocation.mapping else {
            return staging::read(&self.device, &self.allocation, offset, bytes);
        };
        let _turn = self.device.shared.turns.of_host(&self.allocation);
        // SAFETY: as in `write`; `&self` keeps writers away.
        unsafe { std::ptr::copy_nonoverlapping(address.add(offset as usize), bytes.as_mut_ptr(), bytes.len()) };
        Ok(())
    }

    /// Calls `look` with the first `count` elements: in place if the device's memory is mapped, else with a copy. No submit
    /// that uses the buffer starts until `look` returns. So `look` must not submit such work.
    pub fn with<T: AnyBitPattern + NoUninit, R>(&self, count: usize, look: impl FnOnce(&[T]) -> R) -> Result<R> {
        self.offset::<T>(count, 0, "read");
        let Some(address) = self.allocation.mapping else { return Ok(look(&self.to_vec(count)?)) };
        let _turn = self.device.shared.turns.of_host(&self.allocation);
        // SAFETY: `offset` checked the range, mappings are page-aligned, any bit pattern is valid for T, no submit uses the buffer,
        // and `&self` keeps writers away.
        Ok(look(unsafe { std::slice::from_raw_parts(address.cast::<T>(), count) }))
    }

    /// A copy of the first `count` elements.
    pub fn to_vec<T: AnyBitPattern + NoUninit>(&self, count: usize) -> Result<Vec<T>> {
        let mut data = vec![T::zeroed(); count];
        self.read(0, &mut data)?;
        Ok(data)
    }

    /// Offset in bytes of element `first`. Panics if the `bytes` bytes from there do not lie inside the buffer.
    fn offset<T>(&self, first: usize, bytes: usize, doing: &str) -> u64 {
        let offset = first.checked_mul(size_of::<T>());
        let end = offset.and_then(|offset| offset.checked_add(bytes));
        let inside = end.is_some_and(|end| end as u64 <= self.allocation.size);
        assert!(inside, "{}: {doing} past the end", self.allocation.name);
        offset.unwrap_or_default() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The buffer object once leaked when no memory type fitted. The validation layers report such a leak when the device closes.
    #[test]
    fn nothing_is_left_of_a_buffer_without_memory() {
        let device = Device::open(None).unwrap_or_else(|e| panic!("this test needs a Vulkan device: {e}"));
        // No memory type has every property.
        let wanted = vk::MemoryPropertyFlags::from_raw(u32::MAX);
        let Err(error) = Buffer::allocate(&device, "words", 64, wanted) else {
            panic!("no memory type has all properties")
        };
        assert!(error.to_string().contains("has no memory type for the buffer words"), "{error}");
        assert_eq!(device.bytes_in_use(), 0);
    }
}

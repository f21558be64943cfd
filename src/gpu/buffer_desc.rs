//! Descriptors of buffers that are not allocated yet, and the check whether a device can hold the buffers.

use super::info::DeviceInfo;
use crate::error::{Error, Result};

/// A buffer before it is allocated. `name` (a plural, such as "triangles") appears in messages. `remedy` tells the user what to
/// change if the buffer is too large.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BufferDesc {
    pub name: &'static str,
    pub bytes: u64,
    pub remedy: &'static str,
    /// Kernels only read the buffer, as texels of 16 bytes. It is a texel buffer or a storage buffer, so the larger limit
    /// applies.
    pub texels: bool,
    /// The host reads the buffer after submits. If device memory is not mapped, the host has a copy of it.
    pub read_back: bool,
}

impl BufferDesc {
    /// A storage buffer for `count` elements of `T`, of at least 16 bytes, so that an empty list can be bound.
    pub fn of<T>(name: &'static str, count: usize, remedy: &'static str) -> BufferDesc {
        let bytes = (count as u64).saturating_mul(size_of::<T>() as u64).max(16);
        BufferDesc { name, bytes, remedy, texels: false, read_back: false }
    }

    /// As [`BufferDesc::of`], for a buffer that kernels only read as `texture_1d<u32>`. The size of `T` is a multiple of 16
    /// bytes.
    pub fn of_texels<T>(name: &'static str, count: usize, remedy: &'static str) -> BufferDesc {
        debug_assert_eq!(size_of::<T>() % 16, 0, "{name}");
        BufferDesc { texels: true, ..BufferDesc::of::<T>(name, count, remedy) }
    }

    /// This descriptor for a buffer that the host reads after submits.
    pub fn read_back(self) -> BufferDesc {
        BufferDesc { read_back: true, ..self }
    }

    /// Maximum size of this buffer on `device`, in bytes.
    pub fn limit(&self, device: &DeviceInfo) -> u64 {
        let storage = device.largest_buffer();
        if self.texels { storage.max(device.largest_texel_buffer()) } else { storage }
    }

    /// Fails if the buffer is larger than `device` allows for one buffer or one allocation.
    pub fn check(&self, device: &DeviceInfo) -> Result<()> {
        if self.bytes <= self.limit(device) {
            return Ok(());
        }
        Err(Error::Device(format!(
            "the {} need {}, but {} allows at most {} per buffer; {}",
            self.name,
            mebibytes(self.bytes),
            device.name,
            mebibytes(self.limit(device)),
            self.remedy
        )))
    }
}

/// Checks every buffer against the limits of `device`, and the sum of all buffers against its memory. If the sum is too large,
/// the message gives the remedy of the largest buffer.
pub fn check_all(buffer_descs: &[BufferDesc], device: &DeviceInfo) -> Result<()> {
    buffer_descs.iter().try_for_each(|desc| desc.check(device))?;
    let total: u64 = buffer_descs.iter().map(|desc| desc.bytes).sum();
    match buffer_descs.iter().max_by_key(|desc| desc.bytes) {
        Some(largest) if total > device.heap_bytes => Err(Error::Device(format!(
            "this render needs {} of device memory, but {} has {}; the largest part are the {} with {}: {}",
            mebibytes(total),
            device.name,
            mebibytes(device.heap_bytes),
            largest.name,
            mebibytes(largest.bytes),
            largest.remedy
        ))),
        _ => Ok(()),
    }
}

/// A size as text, such as `12.5 MiB`; from 100 MiB on without the decimal, such as `512 MiB`.
pub fn mebibytes(bytes: u64) -> String {
    let mebi = bytes as f64 / f64::from(1 << 20);
    if mebi < 100.0 { format!("{mebi:.1} MiB") } else { format!("{mebi:.0} MiB") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(range: u64, allocation: u64, heap: u64) -> DeviceInfo {
        DeviceInfo {
            max_storage_buffer_range: range,
            max_allocation: allocation,
            heap_bytes: heap,
            ..DeviceInfo::unlimited()
        }
    }

    #[test]
    fn the_lower_limit_counts_and_the_message_says_what_to_change() {
        let desc = BufferDesc::of::<[u32; 4]>("candidates", 1 << 20, "use fewer --queries");
        assert_eq!(desc.bytes, 16 << 20);
        assert!(desc.check(&device(16 << 20, 16 << 20, 0)).is_ok());
        for device in [device(8 << 20, 16 << 20, 0), device(16 << 20, 8 << 20, 0)] {
            let message = desc.check(&device).unwrap_err().to_string();
            for part in ["candidates", "16.0 MiB", "8.0 MiB", "--queries"] {
                assert!(message.contains(part), "{message}");
            }
        }
    }

    #[test]
    fn texels_have_a_limit_of_their_own() {
        let desc = BufferDesc::of_texels::<[u32; 4]>("triangles", 1 << 20, "fewer");
        let narrow = DeviceInfo { max_texels: 1 << 19, ..device(1, u64::MAX, 0) };
        assert!(desc.check(&narrow).unwrap_err().to_string().contains("at most 8.0 MiB"));
        assert!(desc.check(&DeviceInfo { max_texels: 1 << 20, ..narrow.clone() }).is_ok());
        // If texel buffers are too small, a storage buffer takes their place.
        assert!(desc.check(&DeviceInfo { max_storage_buffer_range: 16 << 20, ..narrow }).is_ok());
    }

    #[test]
    fn all_together_must_fit_the_memory() {
        let buffer_descs = [
            BufferDesc::of::<u8>("film", 3 << 20, "lower --resolution"),
            BufferDesc::of::<u8>("marks", 5 << 20, "use less"),
        ];
        assert!(check_all(&buffer_descs, &device(8 << 20, 8 << 20, 8 << 20)).is_ok());
        let message = check_all(&buffer_descs, &device(8 << 20, 8 << 20, 7 << 20)).unwrap_err().to_string();
        assert!(message.contains("marks") && message.contains("use less") && message.contains("8.0 MiB"), "{message}");
        assert!(check_all(&[], &device(1, 1, 0)).is_ok());
    }
}

//! Descriptors of buffers, which exist before the buffers do, and whether a device can hold them.

use super::info::DeviceInfo;
use crate::error::{Error, Result};

/// A buffer before it is allocated. `name` appears in messages, `remedy` says what the user can change when it is too large.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BufferDesc {
    pub name: &'static str,
    pub bytes: u64,
    pub remedy: &'static str,
    /// Kernels only ever read it, as texels: in a texel buffer or a storage buffer, whichever may be larger on the device.
    pub texels: bool,
    /// The host reads it after submits: where memory is not mapped, the host holds a copy.
    pub read_back: bool,
}

impl BufferDesc {
    /// `count` elements of `T`; at least 16 bytes, so that empty lists can be bound.
    pub fn of<T>(name: &'static str, count: usize, remedy: &'static str) -> BufferDesc {
        let bytes = (count as u64).saturating_mul(size_of::<T>() as u64).max(16);
        BufferDesc { name, bytes, remedy, texels: false, read_back: false }
    }

    /// As [`BufferDesc::of`], for a buffer that kernels see as `texture_1d<u32>` alone. `T` is a multiple of 16 bytes.
    pub fn of_texels<T>(name: &'static str, count: usize, remedy: &'static str) -> BufferDesc {
        debug_assert_eq!(size_of::<T>() % 16, 0, "{name}");
        BufferDesc { texels: true, ..BufferDesc::of::<T>(name, count, remedy) }
    }

    /// As it is, for a buffer that the host reads after submits.
    pub fn read_back(self) -> BufferDesc {
        BufferDesc { read_back: true, ..self }
    }

    /// Bytes that `device` allows.
    pub fn limit(&self, device: &DeviceInfo) -> u64 {
        let storage = device.largest_buffer();
        if self.texels { storage.max(device.largest_texel_buffer()) } else { storage }
    }

    /// Fails where the device's limits on one buffer or one allocation are lower.
    pub fn check(&self, device: &DeviceInfo) -> Result<()> {
        if self.bytes <= self.limit(device) {
            return Ok(());
        }
        Err(Error::Device(format!(
            "the {} need {}, and {} allows {} a buffer; {}",
            self.name,
            mebibytes(self.bytes),
            device.name,
            mebibytes(self.limit(device)),
            self.remedy
        )))
    }
}

/// Checks every buffer by itself and all of them together against the device's memory. The remedy named for the sum is that
/// of the largest buffer.
pub fn check_all(buffer_descs: &[BufferDesc], device: &DeviceInfo) -> Result<()> {
    buffer_descs.iter().try_for_each(|desc| desc.check(device))?;
    let total: u64 = buffer_descs.iter().map(|desc| desc.bytes).sum();
    match buffer_descs.iter().max_by_key(|desc| desc.bytes) {
        Some(largest) if total > device.heap_bytes => Err(Error::Device(format!(
            "this render needs {} on the device, and {} has {}; the largest part are the {} with {}: {}",
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

/// `12.5 MiB`, without the decimal from 100 up.
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
        assert!(desc.check(&narrow).unwrap_err().to_string().contains("allows 8.0 MiB"));
        assert!(desc.check(&DeviceInfo { max_texels: 1 << 20, ..narrow.clone() }).is_ok());
        // Where texel buffers are small, storage buffers take their place.
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

//! Buffers that the host reads after every submit.

use bytemuck::{AnyBitPattern, NoUninit};

use super::buffer::Buffer;
use super::buffer_desc::BufferDesc;
use super::device::Device;
use crate::error::Result;

/// A buffer that submits end with making readable ([`Recorder::read_back`](super::Recorder::read_back)). Where the device's memory
/// is not mapped they copy it to memory of the host, so that reading needs no submit of its own.
pub struct ReadBack {
    pub(super) buffer: Buffer,
    /// What the host sees; none where it sees the buffer itself.
    pub(super) copy: Option<Buffer>,
}

impl ReadBack {
    /// The buffer that was planned as `desc`.
    pub fn from_desc(device: &Device, desc: &BufferDesc) -> Result<ReadBack> {
        assert!(desc.read_back, "{} is not planned to be read back", desc.name);
        let buffer = Buffer::from_desc(device, desc)?;
        let copy = match buffer.is_mapped() {
            true => None,
            false => Some(Buffer::on_host(device, desc.name, buffer.size())?),
        };
        Ok(ReadBack { buffer, copy })
    }

    pub fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Writes `data` from the beginning on.
    pub fn write<T: NoUninit>(&mut self, data: &[T]) -> Result<()> {
        self.buffer.write(0, data)
    }

    /// Shows `look` the first `count` elements as the last submit left them; see [`Buffer::with`].
    pub fn with<T: AnyBitPattern + NoUninit, R>(&self, count: usize, look: impl FnOnce(&[T]) -> R) -> Result<R> {
        self.copy.as_ref().unwrap_or(&self.buffer).with(count, look)
    }
}

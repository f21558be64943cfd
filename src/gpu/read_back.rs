//! Buffers that the host reads after every submit.

use bytemuck::{AnyBitPattern, NoUninit};

use super::buffer::Buffer;
use super::buffer_desc::BufferDesc;
use super::device::Device;
use crate::error::Result;

/// A buffer that the host reads after submits. If the device's memory is not mapped,
/// [`Recorder::read_back`](super::Recorder::read_back) adds a copy to host memory to the submit, so that reading needs no submit
/// of its own.
pub struct ReadBack {
    pub(super) buffer: Buffer,
    /// The copy in host memory; `None` if the host reads the buffer in place, or does not read it.
    pub(super) copy: Option<Buffer>,
}

impl ReadBack {
    /// The buffer that `desc` describes, and its copy in host memory if one is needed.
    pub fn from_desc(device: &Device, desc: &BufferDesc) -> Result<ReadBack> {
        let buffer = Buffer::from_desc(device, desc)?;
        let copy = match desc.read_back && !buffer.is_mapped() {
            true => Some(Buffer::on_host(device, desc.name, buffer.size())?),
            false => None,
        };
        Ok(ReadBack { buffer, copy })
    }

    pub fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Writes `data` to the beginning of the buffer; see [`Buffer::write`].
    pub fn write<T: NoUninit>(&mut self, data: &[T]) -> Result<()> {
        self.buffer.write(0, data)
    }

    /// Calls `look` with the first `count` elements, as the last submit with [`Recorder::read_back`](super::Recorder::read_back)
    /// left them; see [`Buffer::with`].
    pub fn with<T: AnyBitPattern + NoUninit, R>(&self, count: usize, look: impl FnOnce(&[T]) -> R) -> Result<R> {
        self.copy.as_ref().unwrap_or(&self.buffer).with(count, look)
    }
}

//! One function can both allocate buffers and list their descriptors, if the function is generic over [`Allocate`]. With a
//! [`Device`], the function allocates. With a [`BufferList`], the function only lists the descriptors.

use std::cell::RefCell;

use super::buffer::Buffer;
use super::buffer_desc::BufferDesc;
use super::device::Device;
use super::read_back::ReadBack;
use crate::error::Result;

/// Accepts descriptors of buffers, either to allocate the buffers or to list the descriptors.
pub trait Allocate {
    /// [`Buffer`], or the unit type `()` if nothing is allocated.
    type Buffer;
    /// A buffer that the host reads after submits: [`ReadBack`], or the unit type `()` if nothing is allocated.
    type ReadBack;

    fn buffer(&self, desc: BufferDesc) -> Result<Self::Buffer>;

    /// A buffer that the host reads after submits.
    fn read_back(&self, desc: BufferDesc) -> Result<Self::ReadBack> {
        self.read_back_if(true, desc)
    }

    /// As [`Allocate::read_back`] if `is_read`. Otherwise the host does not read the buffer, and there is no copy in host memory.
    fn read_back_if(&self, is_read: bool, desc: BufferDesc) -> Result<Self::ReadBack>;
}

impl Allocate for Device {
    type Buffer = Buffer;
    type ReadBack = ReadBack;

    fn buffer(&self, desc: BufferDesc) -> Result<Buffer> {
        Buffer::from_desc(self, &desc)
    }

    fn read_back_if(&self, is_read: bool, desc: BufferDesc) -> Result<ReadBack> {
        ReadBack::from_desc(self, &if is_read { desc.read_back() } else { desc })
    }
}

/// Descriptors in the order of the calls.
#[derive(Default)]
pub struct BufferList {
    descs: RefCell<Vec<BufferDesc>>,
}

impl BufferList {
    /// Descriptors of all buffers that `make` would allocate, in the order of its calls.
    pub fn of<T>(make: impl FnOnce(&BufferList) -> Result<T>) -> Vec<BufferDesc> {
        let list = BufferList::default();
        make(&list).map(|_| list.descs.into_inner()).expect("nothing is allocated that could fail")
    }
}

impl Allocate for BufferList {
    type Buffer = ();
    type ReadBack = ();

    fn buffer(&self, desc: BufferDesc) -> Result<()> {
        self.descs.borrow_mut().push(desc);
        Ok(())
    }

    fn read_back_if(&self, is_read: bool, desc: BufferDesc) -> Result<()> {
        self.buffer(if is_read { desc.read_back() } else { desc })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_has_what_would_be_allocated() {
        let [a, b] = ["a", "b"].map(|name| BufferDesc::of::<u32>(name, 8, ""));
        let list = BufferList::of(|to| {
            to.read_back(b)?;
            to.read_back_if(false, b)?;
            to.buffer(a)
        });
        assert_eq!(list, [b.read_back(), b, a]);
    }
}

//! Buffers and the list of their descriptors, from one function: it is generic over [`Allocate`]. With a [`Device`] it allocates the
//! buffers, with a [`BufferList`] it lists what it would allocate.

use std::cell::RefCell;

use super::buffer::Buffer;
use super::buffer_desc::BufferDesc;
use super::device::Device;
use super::read_back::ReadBack;
use crate::error::Result;

/// Takes descriptors of buffers.
pub trait Allocate {
    /// Stands for a buffer: [`Buffer`], or nothing.
    type Buffer;
    /// Stands for a buffer that the host reads after submits: [`ReadBack`], or nothing.
    type ReadBack;

    fn buffer(&self, desc: BufferDesc) -> Result<Self::Buffer>;
    fn read_back(&self, desc: BufferDesc) -> Result<Self::ReadBack>;
}

impl Allocate for Device {
    type Buffer = Buffer;
    type ReadBack = ReadBack;

    fn buffer(&self, desc: BufferDesc) -> Result<Buffer> {
        Buffer::from_desc(self, &desc)
    }

    fn read_back(&self, desc: BufferDesc) -> Result<ReadBack> {
        ReadBack::from_desc(self, &desc.read_back())
    }
}

/// Descriptors in the order in which they were taken.
#[derive(Default)]
pub struct BufferList {
    descs: RefCell<Vec<BufferDesc>>,
}

impl BufferList {
    /// What `make` would allocate.
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

    fn read_back(&self, desc: BufferDesc) -> Result<()> {
        self.buffer(desc.read_back())
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
            to.buffer(a)
        });
        assert_eq!(list, [b.read_back(), a]);
    }
}

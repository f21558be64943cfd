//! Host memory for copies to and from device memory that is not mapped. It is kept for later copies.

use std::sync::Arc;

use ash::vk;

use super::allocation::Allocation;
use super::commands::Commands;
use super::device::Device;
use super::drive::FOR_HOST;
use super::shared::Shared;
use crate::error::Result;

/// Size of an area of staging memory in bytes, small for the host.
const SIZE: u64 = 16 << 20;
/// Maximum number of areas that wait for a submit. They hold everything that most iterations write between two submits.
const MAX_WAITING: usize = 4;
/// Every copy begins at a multiple of this number of bytes.
const ALIGNMENT: u64 = 16;

/// Staging memory of a device. Writes wait here for the next submit, of any thread, which executes them first. If all memory is mapped,
/// there is none.
#[derive(Default)]
pub(super) struct Staging {
    /// Areas whose writes wait for the next submit, in order.
    waiting: Vec<Area>,
    free: Vec<Area>,
}

/// A piece of staging memory, and the copies from it to its targets. It has one owner: the staging memory of the device or a submit.
pub(super) struct Area {
    memory: Allocation,
    commands: Commands,
    /// Number of bytes, from the beginning of the memory, that hold data to be copied.
    used: u64,
    /// The targets of the copies, kept alive until the device has copied the data.
    targets: Vec<Arc<Allocation>>,
}

/// Writes `bytes` to `to` from `offset` on. The next submit executes the write first; if too many writes wait, this function submits
/// them. Panics if the range does not lie inside `to`.
pub(super) fn write(device: &Device, to: &Arc<Allocation>, offset: u64, bytes: &[u8]) -> Result<()> {
    let mut written = 0;
    while written < bytes.len() {
        let mut staging = device.staging();
        if staging.is_full() {
            drop(staging);
            flush(device)?;
            continue;
        }
        let area = staging.area(&device.shared)?;
        let part = &bytes[written..bytes.len().min(written + (SIZE - area.used) as usize)];
        area.put(to, offset + written as u64, part)?;
        written += part.len();
    }
    Ok(())
}

/// Reads `into.len()` bytes of `from` from `offset` on, after all writes so far, and waits for the device. Panics if the range does not
/// lie inside `from`.
pub(super) fn read(device: &Device, from: &Arc<Allocation>, offset: u64, into: &mut [u8]) -> Result<()> {
    let mut area = device.staging().free_area(&device.shared)?;
    let mut places = (offset..).step_by(SIZE as usize).zip(into.chunks_mut(SIZE as usize));
    let done = places.try_for_each(|(offset, part)| area.take(device, from, offset, part));
    device.staging().give_back(vec![area]);
    done
}

/// Submits the waiting writes, and waits for the device.
fn flush(device: &Device) -> Result<()> {
    let mut empty = device.staging().free_area(&device.shared)?;
    empty.commands.begin()?;
    let done = device.submit(&mut empty.commands);
    device.staging().give_back(vec![empty]);
    done
}

impl Staging {
    /// The areas whose writes wait for a submit.
    pub fn take_writes(&mut self) -> Vec<Area> {
        std::mem::take(&mut self.waiting)
    }

    /// Takes back areas that the device has finished with.
    pub fn give_back(&mut self, areas: Vec<Area>) {
        for mut area in areas {
            area.used = 0;
            area.targets.clear();
            self.free.push(area);
        }
    }

    fn is_full(&self) -> bool {
        self.waiting.len() == MAX_WAITING && self.waiting.last().is_some_and(|area| area.used == SIZE)
    }

    /// The area for the next write, with some room.
    fn area(&mut self, shared: &Arc<Shared>) -> Result<&mut Area> {
        if self.waiting.last().is_none_or(|area| area.used == SIZE) {
            let mut area = self.free_area(shared)?;
            area.commands.begin()?;
            self.waiting.push(area);
        }
        Ok(self.waiting.last_mut().expect("pushed above"))
    }

    fn free_area(&mut self, shared: &Arc<Shared>) -> Result<Area> {
        match self.free.pop() {
            Some(area) => Ok(area),
            None => {
                let memory = Allocation::new(shared, "staging", SIZE, FOR_HOST)?;
                Ok(Area { memory, commands: Commands::new(shared)?, used: 0, targets: vec![] })
            }
        }
    }
}

impl Area {
    /// Ends the recording of the copies, for a submit.
    pub fn finish(&mut self) -> Result<vk::CommandBuffer> {
        self.commands.finish()
    }

    /// Copies `bytes` to the staging memory and records the copy from there to `to`. Panics if there is no room.
    fn put(&mut self, to: &Arc<Allocation>, offset: u64, bytes: &[u8]) -> Result<()> {
        let size = bytes.len() as u64;
        assert!(self.used + size <= SIZE && offset + size <= to.size, "{}: write past the end", to.name);
        let address = self.address();
        // SAFETY: the range was checked. `&mut self` keeps other host threads away, and no submit uses the memory.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), address.add(self.used as usize), bytes.len()) };
        // This write may overlap an earlier one, and must come after it.
        let transfer = vk::PipelineStageFlags::TRANSFER;
        self.commands.barrier((transfer, vk::AccessFlags::TRANSFER_WRITE), (transfer, vk::AccessFlags::TRANSFER_WRITE));
        self.record_copy((&self.memory, self.used), (to, offset), size);
        self.targets.push(to.clone());
        self.used = (self.used + size).next_multiple_of(ALIGNMENT).min(SIZE);
        Ok(())
    }

    /// Fills `into` from `from`. Panics if `into` is larger than the staging memory.
    fn take(&mut self, device: &Device, from: &Arc<Allocation>, offset: u64, into: &mut [u8]) -> Result<()> {
        let size = into.len() as u64;
        assert!(size <= SIZE && offset + size <= from.size, "{}: read past the end", from.name);
        self.commands.begin()?;
        self.record_copy((from, offset), (&self.memory, 0), size);
        device.submit(&mut self.commands)?;
        // SAFETY: the range was checked, and the device has written it. `&mut self` keeps other host threads away.
        unsafe { std::ptr::copy_nonoverlapping(self.address(), into.as_mut_ptr(), into.len()) };
        Ok(())
    }

    /// Records a copy of `size` bytes from one (allocation, offset) to another. The callers have checked the ranges.
    fn record_copy(&self, from: (&Allocation, u64), to: (&Allocation, u64), size: u64) {
        let region = [vk::BufferCopy { src_offset: from.1, dst_offset: to.1, size }];
        // SAFETY: recording has begun. Both ranges lie inside their buffers, which have the transfer usages and outlive the
        // submit.
        unsafe {
            let device = &self.memory.shared.device;
            device.cmd_copy_buffer(self.commands.buffer, from.0.handle, to.0.handle, &region);
        }
    }

    fn address(&self) -> *mut u8 {
        self.memory.mapping.expect("memory for the host is mapped")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::Device;
    use crate::gpu::{Buffer, BufferDesc, Drive, Kernel, ReadBack, Recorder};

    const TRIPLE: &str = "
@group(0) @binding(0) var<storage, read> numbers: array<u32>;
@group(0) @binding(1) var<storage, read_write> triples: array<u32>;
@compute @workgroup_size(64)
fn triple(@builtin(global_invocation_id) id: vec3<u32>) {
    triples[id.x] = 3u * numbers[id.x];
}";

    fn open(drive: Drive) -> Device {
        Device::open_with_drive(None, Some(drive)).unwrap_or_else(|e| panic!("this test needs a Vulkan device: {e}"))
    }

    #[test]
    fn data_larger_than_the_staging_memory_goes_there_and_back() {
        let device = open(Drive::CARD);
        let count = (11 * SIZE / 2 / 4) as usize;
        let mut expected: Vec<u32> = (0..count as u32).collect();
        let mut buffer = Buffer::from_slice(&device, "numbers", &expected, "").unwrap();
        // Overwrite a part that may still wait for its submit, at an offset that is not aligned.
        buffer.write(7, &[1u32; 1001]).unwrap();
        expected[7..1008].fill(1);
        assert!(buffer.to_vec::<u32>(count).unwrap() == expected);
        let mut part = [0u32; 5];
        buffer.read(1005, &mut part).unwrap();
        assert_eq!(part, [1, 1, 1, 1008, 1009]);
        assert_eq!(device.bytes_in_use(), 4 * count as u64, "staging memory does not count as device memory");
        assert!(buffer.with::<u32, _>(count, |seen| seen == expected).unwrap());
    }

    /// Writes run before dispatches that were recorded earlier, as with mapped memory. A submit allocates nothing and waits once.
    #[test]
    fn a_submit_brings_what_was_written_and_takes_what_is_read() {
        for drive in [Drive::CPU, Drive::CARD] {
            let device = open(drive);
            let desc = BufferDesc::of::<u32>("triples", 64, "").read_back();
            let mut numbers = Buffer::new::<u32>(&device, "numbers", 64, "").unwrap();
            let triples = ReadBack::from_desc(&device, &desc).unwrap();
            let kernel = Kernel::from_source(&device, "test", TRIPLE, "triple", &[]).unwrap();
            let bound = kernel.bind(&[("numbers", &numbers), ("triples", triples.buffer())]).unwrap();
            let mut recorder = Recorder::new(&device).unwrap();
            numbers.write(0, &[9u32; 64]).unwrap();
            let (allocations, waits) = (device.allocations(), device.waits());
            for round in 1..=10u32 {
                numbers.write(0, &[0u32; 64]).unwrap();
                recorder.dispatch("triple", &kernel, &bound, &[0u32; 0], 1).unwrap();
                recorder.read_back(&triples, desc.bytes).unwrap();
                numbers.write(3, &[round; 2]).unwrap();
                recorder.submit().unwrap();
                triples.with::<u32, _>(6, |seen| assert_eq!(seen, [0, 0, 0, 3 * round, 3 * round, 0])).unwrap();
            }
            assert_eq!(device.allocations(), allocations, "{drive:?}");
            assert_eq!(device.waits(), waits + 10, "{drive:?}");
        }
    }
}

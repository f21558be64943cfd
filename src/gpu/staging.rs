//! Memory of the host through which data comes to device memory that is not mapped, and back. It is made once per device.

use std::sync::Arc;

use ash::vk;

use super::allocation::Allocation;
use super::commands::Commands;
use super::drive::FOR_HOST;
use super::shared::Shared;
use crate::error::Result;

/// Bytes that one submit can move: enough for all that an iteration writes between two submits but a large pool, and no burden on
/// the host.
const SIZE: u64 = 16 << 20;
/// Copies begin at multiples of this.
const ALIGNMENT: u64 = 16;

/// Staging memory of a device. Writes wait here for the next submit, which begins with them.
pub(super) struct Staging {
    shared: Arc<Shared>,
    /// None until a copy needs it: where all memory is mapped, none does.
    area: Option<Area>,
}

struct Area {
    memory: Allocation,
    commands: Commands,
    /// Bytes at its beginning that hold data to be copied.
    used: u64,
    /// Where they go, alive until the device has copied them.
    targets: Vec<Arc<Allocation>>,
}

impl Staging {
    pub fn new(shared: Arc<Shared>) -> Staging {
        Staging { shared, area: None }
    }

    /// Whether writes wait for the next submit.
    pub fn has_writes(&self) -> bool {
        self.area.as_ref().is_some_and(|area| area.commands.is_recording())
    }

    /// Submits the writes that wait and `commands` behind them; waits for the device.
    pub fn submit_before(&mut self, commands: &mut Commands) -> Result<()> {
        let area = self.area()?;
        let done = commands.submit(Some(&mut area.commands));
        area.clear();
        done
    }

    /// Writes `bytes` to `to` from `offset` on, before the next submit does anything else. They lie inside, and come at once if
    /// there is room.
    pub fn write(&mut self, to: &Arc<Allocation>, offset: u64, bytes: &[u8]) -> Result<()> {
        let mut written = 0;
        while written < bytes.len() {
            if self.area()?.used == SIZE {
                self.flush()?;
            }
            let area = self.area()?;
            let part = &bytes[written..bytes.len().min(written + (SIZE - area.used) as usize)];
            area.put(to, offset + written as u64, part)?;
            written += part.len();
        }
        Ok(())
    }

    /// Reads `into.len()` bytes of `from` from `offset` on, which lie inside; waits for the device.
    pub fn read(&mut self, from: &Arc<Allocation>, offset: u64, into: &mut [u8]) -> Result<()> {
        self.flush()?;
        let mut read = 0;
        for part in into.chunks_mut(SIZE as usize) {
            self.area()?.take(from, offset + read, part)?;
            read += part.len() as u64;
        }
        Ok(())
    }

    /// Submits what waits here.
    fn flush(&mut self) -> Result<()> {
        let area = self.area()?;
        if !area.commands.is_recording() {
            return Ok(());
        }
        let done = area.commands.submit(None);
        area.clear();
        done
    }

    fn area(&mut self) -> Result<&mut Area> {
        if self.area.is_none() {
            self.area = Some(Area {
                memory: Allocation::new(&self.shared, "staging", SIZE, FOR_HOST)?,
                commands: Commands::new(&self.shared)?,
                used: 0,
                targets: vec![],
            });
        }
        Ok(self.area.as_mut().expect("made above"))
    }
}

impl Area {
    /// Copies `bytes`, for which there is room, and records their way to `to`.
    fn put(&mut self, to: &Arc<Allocation>, offset: u64, bytes: &[u8]) -> Result<()> {
        let size = bytes.len() as u64;
        assert!(self.used + size <= SIZE && offset + size <= to.size, "{}: write past the end", to.name);
        let address = self.address();
        // SAFETY: the range was checked; `&mut self` keeps other host threads away, and no submit works on the memory.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), address.add(self.used as usize), bytes.len()) };
        self.begin()?;
        // It may go over a write that came before it.
        let transfer = vk::PipelineStageFlags::TRANSFER;
        self.commands.barrier((transfer, vk::AccessFlags::TRANSFER_WRITE), (transfer, vk::AccessFlags::TRANSFER_WRITE));
        self.record_copy((&self.memory, self.used), (to, offset), size);
        self.targets.push(to.clone());
        self.used = (self.used + size).next_multiple_of(ALIGNMENT);
        Ok(())
    }

    /// Fills `into`, which is no larger than the memory, from `from`. Nothing may wait here.
    fn take(&mut self, from: &Arc<Allocation>, offset: u64, into: &mut [u8]) -> Result<()> {
        let size = into.len() as u64;
        assert!(size <= SIZE && offset + size <= from.size, "{}: read past the end", from.name);
        self.begin()?;
        self.record_copy((from, offset), (&self.memory, 0), size);
        self.commands.submit(None)?;
        // SAFETY: the range was checked, and the device has written it; `&mut self` as in `put`.
        unsafe { std::ptr::copy_nonoverlapping(self.address(), into.as_mut_ptr(), into.len()) };
        Ok(())
    }

    fn begin(&mut self) -> Result<()> {
        if self.commands.is_recording() { Ok(()) } else { self.commands.begin() }
    }

    /// Records a copy of `size` bytes between allocations and offsets, whose ranges the callers have checked.
    fn record_copy(&self, from: (&Allocation, u64), to: (&Allocation, u64), size: u64) {
        let region = [vk::BufferCopy { src_offset: from.1, dst_offset: to.1, size }];
        // SAFETY: recording has begun; both ranges lie inside, both buffers have the transfer usages and outlive the submit.
        unsafe {
            let device = &self.memory.shared.device;
            device.cmd_copy_buffer(self.commands.buffer, from.0.handle, to.0.handle, &region);
        }
    }

    fn clear(&mut self) {
        self.used = 0;
        self.targets.clear();
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
        let count = (5 * SIZE / 2 / 4) as usize;
        let mut expected: Vec<u32> = (0..count as u32).collect();
        let mut buffer = Buffer::from_slice(&device, "numbers", &expected, "").unwrap();
        // Over what may still wait, at an odd place.
        buffer.write(7, &[1u32; 1001]).unwrap();
        expected[7..1008].fill(1);
        assert!(buffer.to_vec::<u32>(count).unwrap() == expected);
        let mut part = [0u32; 5];
        buffer.read(1005, &mut part).unwrap();
        assert_eq!(part, [1, 1, 1, 1008, 1009]);
        assert_eq!(device.bytes_in_use(), 4 * count as u64, "staging memory is the host's");
        assert!(buffer.with::<u32, _>(count, |seen| seen == expected).unwrap());
    }

    /// Writes go before what was recorded earlier, as in memory that is mapped. Nothing is allocated, and one wait is enough.
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

//! Compaction of lists on the device: keeps the marked entries of a list in their order.

use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Device, Kernel, Recorder};
use crate::wgsl::layout::Dispatch;
use crate::wgsl::layout::constants::{CHUNK, COUNTER_TALLIES, LISTS, SLOTS_PER_MARK};

/// Number of u32 counters: the current length of each list, the sum of its lengths so far, and four tallies of sensor subpaths.
pub const COUNTERS: usize = COUNTER_TALLIES as usize + 4;
/// Number of u32 values for indirect dispatches: two dispatch sizes per list.
pub const ARGUMENTS: usize = 6 * LISTS as usize;

/// Maximum length of a list that one workgroup compacts faster than three dispatches do.
const SHORT_LIST: usize = 1 << 13;

/// Number of count pairs that the compaction of `entries` entries needs: one per chunk.
pub fn chunk_counts(entries: usize) -> usize {
    entries.div_ceil(CHUNK as usize)
}

/// Number of marks that a shade point with `slots` candidate slots needs.
pub fn mark_words(slots: usize) -> usize {
    slots.div_ceil(SLOTS_PER_MARK as usize)
}

/// Kernels of `compact.wgsl`.
pub struct Compaction {
    count: Kernel,
    scan: Kernel,
    scatter: Kernel,
    short: Kernel,
}

/// Descriptor sets of the kernels.
pub struct CompactionBindings {
    count: Bindings,
    scan: Bindings,
    scatter: Bindings,
    short: Bindings,
}

impl Compaction {
    /// File and entry points of the kernels.
    pub const FILE: &str = "compact";
    pub const ENTRIES: [&str; 4] = ["compact_count", "compact_scan", "compact_scatter", "compact_short"];

    pub fn new(device: &Device, constants: &[(&str, f64)]) -> Result<Compaction> {
        let [count, scan, scatter, short] =
            Compaction::ENTRIES.map(|entry| Kernel::new(device, Compaction::FILE, entry, constants));
        Ok(Compaction { count: count?, scan: scan?, scatter: scatter?, short: short? })
    }

    pub fn bind(&self, buffers: &[(&str, &Buffer)]) -> Result<CompactionBindings> {
        Ok(CompactionBindings {
            count: self.count.bind(buffers)?,
            scan: self.scan.bind(buffers)?,
            scatter: self.scatter.bind(buffers)?,
            short: self.short.bind(buffers)?,
        })
    }

    /// Initial contents of the counters and of the dispatch arguments: `list` has `length` entries, and a dispatch over it
    /// has `groups` workgroups. All other lists are empty.
    pub fn one_list(&self, list: u32, length: u32, groups: u32) -> ([u32; COUNTERS], [u32; ARGUMENTS]) {
        let (mut counters, mut arguments) = ([0; COUNTERS], [1; ARGUMENTS]);
        counters[list as usize] = length;
        arguments[3 * list as usize] = groups;
        arguments[3 * (LISTS + list) as usize] = self.count.groups((length as usize).div_ceil(CHUNK as usize));
        (counters, arguments)
    }

    /// Records the compaction of the list `lists.counter` into `lists.list_a` and `lists.list_b`. `entries` is the maximum
    /// number of entries to test; the device knows the actual number.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        bound: &CompactionBindings,
        lists: &Dispatch,
        entries: usize,
        arguments: &Buffer,
    ) -> Result<()> {
        if entries <= SHORT_LIST {
            return recorder.dispatch("compact", &self.short, &bound.short, lists, 1);
        }
        let chunks = (arguments, 3 * u64::from(LISTS + lists.counter));
        recorder.dispatch_indirect("compact", &self.count, &bound.count, lists, chunks)?;
        recorder.dispatch("compact", &self.scan, &bound.scan, lists, 1)?;
        recorder.dispatch_indirect("compact", &self.scatter, &bound.scatter, lists, chunks)
    }
}

/// Buffer and offset (in u32 values) of the size of an indirect dispatch over `list`, one thread per entry.
pub fn indirect_over(arguments: &Buffer, list: u32) -> (&Buffer, u64) {
    (arguments, 3 * u64::from(list))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wgsl::layout::{Frame, NONE};

    /// The marked slots that the device lists, for shade points with `slots` candidate slots each.
    /// `entries`: see [`Compaction::record`].
    fn listed(compaction: &Compaction, device: &Device, marks: &[u32], slots: u32, entries: usize) -> Vec<u32> {
        let shade_points = marks.len() / mark_words(slots as usize);
        let frame = Frame { slots, ..bytemuck::Zeroable::zeroed() };
        let (from, to) = (2, 3);
        let (counters, arguments) = compaction.one_list(from, shade_points as u32, 1);
        let chunks = chunk_counts(marks.len());
        let mut arguments = arguments;
        arguments[3 * (LISTS + from) as usize] = compaction.count.groups(chunks);
        let mut texels = marks.to_vec();
        // What lies behind the marks does not count.
        texels.resize(chunks * CHUNK as usize, u32::MAX);
        let upload = |words: &[u32]| Buffer::from_slice(device, "test", words, "").unwrap();
        let empty = |words: usize| Buffer::new::<u32>(device, "test", words, "").unwrap();
        let buffers = [
            ("frame", upload(bytemuck::cast_slice(&[frame]))),
            ("marks", upload(&texels)),
            ("counters", upload(&counters)),
            ("source", empty(1)),
            ("chunk_counts", empty(2 * chunks)),
            ("list_a", empty(shade_points * slots as usize)),
            ("list_b", empty(1)),
            ("arguments", upload(&arguments)),
        ];
        let named: Vec<(&str, &Buffer)> = buffers.iter().map(|(name, buffer)| (*name, buffer)).collect();
        let bound = compaction.bind(&named).unwrap();
        let lists = Dispatch { counter: from, list_a: to, list_b: NONE, ..bytemuck::Zeroable::zeroed() };
        let mut recorder = Recorder::new(device).unwrap();
        compaction.record(&mut recorder, &bound, &lists, entries, &buffers[7].1).unwrap();
        recorder.submit().unwrap();
        let count = buffers[2].1.to_vec::<u32>(COUNTERS).unwrap()[to as usize];
        buffers[5].1.to_vec(count as usize).unwrap()
    }

    #[test]
    fn the_device_lists_the_marked_slots_in_order() {
        let device = Device::open(None).expect("this test needs a Vulkan device: run ./setup.sh");
        let compaction = Compaction::new(&device, &[]).unwrap();
        for (slots, shade_points) in [(1, 1000u32), (7, 333), (32, 50), (33, 77), (80, 41)] {
            let words = mark_words(slots as usize) as u32;
            let is_marked = |slot: u32| (slot ^ slot >> 3).wrapping_mul(0x9e37_79b9) >> 30 == 0;
            let all: Vec<u32> = (0..shade_points * slots).filter(|&slot| is_marked(slot)).collect();
            let mut marks = vec![0u32; (shade_points * words) as usize];
            for &slot in &all {
                let [rank, number] = [slot / slots, slot % slots];
                marks[(rank * words + number / SLOTS_PER_MARK) as usize] |= 1 << (number % SLOTS_PER_MARK);
            }
            for entries in [SHORT_LIST, SHORT_LIST + 1] {
                assert!(
                    listed(&compaction, &device, &marks, slots, entries) == all,
                    "{slots} slots, {entries} entries"
                );
            }
        }
    }
}

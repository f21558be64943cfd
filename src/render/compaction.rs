//! Compaction of lists on the device: the entries that are marked, in their order.

use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Device, Kernel, Recorder};
use crate::wgsl::layout::Dispatch;
use crate::wgsl::layout::constants::{CHUNK, COUNTER_TOTALS, LISTS, SCAN_THREADS};

/// Words that hold the lengths of lists, and the lengths added up.
pub const COUNTERS: usize = (COUNTER_TOTALS + LISTS) as usize;
/// Words that hold the sizes of dispatches over lists.
pub const ARGUMENTS: usize = 6 * LISTS as usize;

/// Entries of a list that one workgroup compacts faster than three dispatches do.
const SHORT_LIST: usize = 1 << 13;

/// Pairs of counts that the compaction of `entries` entries needs: one per chunk and one per block of chunks.
pub fn chunk_counts(entries: usize) -> usize {
    let chunks = entries.div_ceil(CHUNK as usize);
    chunks + chunks.div_ceil(SCAN_THREADS as usize)
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
    pub fn new(device: &Device, constants: &[(&str, f64)]) -> Result<Compaction> {
        let make = |entry: &str| Kernel::new(device, "compact", entry, constants);
        Ok(Compaction {
            count: make("compact_count")?,
            scan: make("compact_scan")?,
            scatter: make("compact_scatter")?,
            short: make("compact_short")?,
        })
    }

    pub fn bind(&self, buffers: &[(&str, &Buffer)]) -> Result<CompactionBindings> {
        Ok(CompactionBindings {
            count: self.count.bind(buffers)?,
            scan: self.scan.bind(buffers)?,
            scatter: self.scatter.bind(buffers)?,
            short: self.short.bind(buffers)?,
        })
    }

    /// What a counters buffer and its arguments hold at first: `length` entries in `list`, whose kernel has `groups` workgroups.
    pub fn one_list(&self, list: u32, length: u32, groups: u32) -> ([u32; COUNTERS], [u32; ARGUMENTS]) {
        let (mut counters, mut arguments) = ([0; COUNTERS], [1; ARGUMENTS]);
        counters[list as usize] = length;
        arguments[3 * list as usize] = groups;
        arguments[3 * (LISTS + list) as usize] = self.count.groups((length as usize).div_ceil(CHUNK as usize));
        (counters, arguments)
    }

    /// Records the compaction of the list `lists.counter`, of `entries` entries at most. The device knows how many they are.
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

/// Where the size of a dispatch over a list stands, one thread per entry.
pub fn indirect_over(arguments: &Buffer, list: u32) -> (&Buffer, u64) {
    (arguments, 3 * u64::from(list))
}

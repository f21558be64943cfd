//! Compaction of lists on the device: keeps the marked entries of a list in their order.

use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Device, Kernel, Recorder};
use crate::wgsl::layout::Dispatch;
use crate::wgsl::layout::constants::{CHUNK, COUNTER_TALLIES, LISTS};

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

//! Compaction of lists on the device: the entries that are marked, in their order.

use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Device, Kernel, Recorder};
use crate::wgsl::layout::Dispatch;
use crate::wgsl::layout::constants::CHUNK;

/// Entries of a list that one workgroup compacts faster than three dispatches do.
const SHORT_LIST: usize = 1 << 13;

/// Kernels of `compact.wgsl`.
pub struct Compaction {
    count: Kernel,
    scan: Kernel,
    scatter: Kernel,
    short: Kernel,
}

/// Descriptor sets of the kernels.
pub struct BoundCompaction {
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

    pub fn bind(&self, buffers: &[(&str, &Buffer)]) -> Result<BoundCompaction> {
        Ok(BoundCompaction {
            count: self.count.bind(buffers)?,
            scan: self.scan.bind(buffers)?,
            scatter: self.scatter.bind(buffers)?,
            short: self.short.bind(buffers)?,
        })
    }

    /// Records the compaction of a list of `entries` entries at most.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        bound: &BoundCompaction,
        lists: &Dispatch,
        entries: usize,
    ) -> Result<()> {
        if entries <= SHORT_LIST {
            return recorder.dispatch("compact", &self.short, &bound.short, lists, 1);
        }
        let chunks = self.count.groups(entries.div_ceil(CHUNK as usize));
        recorder.dispatch("compact", &self.count, &bound.count, lists, chunks)?;
        recorder.dispatch("compact", &self.scan, &bound.scan, lists, 1)?;
        recorder.dispatch("compact", &self.scatter, &bound.scatter, lists, chunks)
    }
}

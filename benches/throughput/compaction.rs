//! Compaction of a list of slots: counts, prefix sums and scatter on the device, compared with one loop on the host.

use taugate::internals::generate::numbers::Pcg;
use taugate::internals::gpu::{Buffer, Device, Kernel, Recorder};
use taugate::internals::wgsl::layout::constants::{CHUNK, LISTS};
use taugate::internals::wgsl::layout::{Dispatch, Frame, NONE};

use super::Sizes;

/// Percentage of live slots.
const LIVE: usize = 30;
/// Number of words in `counters`.
const COUNTERS: usize = 16;
/// Index of the counter that holds the number of slots.
const FROM: u32 = 2;
/// Index of the counter that receives the number of live slots.
const TO: u32 = 3;

pub fn compare(device: &Device, Sizes { slots, rounds, .. }: Sizes) {
    let mut pcg = Pcg::new(9);
    let marks: Vec<u32> = (0..slots).map(|_| u32::from(pcg.below(100) < LIVE)).collect();
    let chunks = slots.div_ceil(CHUNK as usize);
    let mut counters = [0u32; COUNTERS];
    counters[FROM as usize] = slots as u32;
    let frame = Frame { slots: 1, ..bytemuck::Zeroable::zeroed() };
    let upload = |name, words: &[u32]| Buffer::from_slice(device, name, words, "").expect("upload");
    let empty = |name, words: usize| Buffer::new::<u32>(device, name, words, "").expect("buffer");
    let buffers = [
        ("frame", upload("frame", bytemuck::cast_slice(&[frame]))),
        ("marks", upload("marks", &marks)),
        ("counters", upload("counters", &counters)),
        ("source", empty("source", 1)),
        ("chunk_counts", empty("chunk counts", 2 * chunks)),
        ("list_a", empty("live slots", slots)),
        ("list_b", empty("other list", 1)),
        ("arguments", empty("arguments", 6 * LISTS as usize)),
    ];
    let named: Vec<(&str, &Buffer)> = buffers.iter().map(|(name, buffer)| (*name, buffer)).collect();
    let steps = ["compact_count", "compact_scan", "compact_scatter"].map(|entry| {
        let kernel = Kernel::new(device, "compact", entry, &[]).expect("kernel");
        let bound = kernel.bind(&named).expect("binding");
        (kernel, bound)
    });
    let mut recorder = Recorder::new(device).expect("recorder");
    let mut on_device = || {
        let lists = Dispatch { counter: FROM, list_a: TO, list_b: NONE, ..bytemuck::Zeroable::zeroed() };
        for (i, (kernel, bound)) in steps.iter().enumerate() {
            let groups = if i == 1 { 1 } else { kernel.groups(chunks) };
            recorder.dispatch("compact", kernel, bound, &lists, groups).expect("dispatch");
        }
        recorder.submit().expect("submit");
    };
    let mut list = vec![0u32; slots];
    let mut on_host = || {
        let mut n = 0;
        for (i, mark) in marks.iter().enumerate() {
            list[n] = i as u32;
            n += *mark as usize;
        }
        n
    };
    on_device();
    let live = on_host();
    let there = buffers[5].1.to_vec::<u32>(live).expect("live slots");
    assert_eq!(buffers[2].1.to_vec::<u32>(COUNTERS).expect("counters")[TO as usize] as usize, live);
    let expected: Vec<u32> = (0..slots as u32).filter(|&i| marks[i as usize] == 1).collect();
    assert!(there == expected, "the list of the device differs from that of the host");
    super::report("compaction, one host thread", slots, rounds, on_device, || {
        std::hint::black_box(on_host());
    });
}

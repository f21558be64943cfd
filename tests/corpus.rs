//! Every reader reads its corpus in `fuzz/corpus`, and thousands of damaged copies, within limits of time and memory. `fuzz/run`
//! searches for more such files with libFuzzer.

#[path = "common/memory.rs"]
mod memory;
#[path = "common/readers.rs"]
mod readers;

use std::path::Path;

use memory::Counting;
use readers::READERS;
use taugate::internals::generate::numbers::Pcg;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Number of damaged copies per reader.
const COPIES: usize = 500;

/// `bytes` with a few changes: bytes replaced, bits flipped, parts removed, doubled or taken from `other`.
fn damaged(bytes: &[u8], other: &[u8], pcg: &mut Pcg) -> Vec<u8> {
    let mut copy = bytes.to_vec();
    for _ in 0..1 + pcg.below(4) {
        if copy.is_empty() {
            return copy;
        }
        let at = pcg.below(copy.len());
        let end = copy.len().min(at + 1 + pcg.below(16));
        match pcg.below(6) {
            0 => copy[at] = pcg.below(256) as u8,
            1 => copy[at] ^= 1 << pcg.below(8),
            2 => drop(copy.drain(at..end)),
            3 => copy.extend_from_within(at..end),
            4 => copy.truncate(at),
            _ => {
                let from = pcg.below(other.len().max(1));
                let part = &other[from.min(other.len())..other.len().min(from + end - at)];
                copy[at..at + part.len()].copy_from_slice(part);
            }
        }
    }
    copy
}

/// One test for all readers, because it measures the memory of the whole process.
#[test]
fn damaged_files_are_survived() {
    let mut pcg = Pcg::new(22);
    for reader in READERS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(reader.name);
        let mut paths: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        let files: Vec<Vec<u8>> = paths.iter().map(|path| std::fs::read(path).unwrap()).collect();
        assert!(!files.is_empty(), "{} has no corpus", reader.name);
        for (path, file) in paths.iter().zip(&files) {
            eprintln!("{}", path.display());
            reader.check(file);
        }
        let start = std::time::Instant::now();
        for copy in 0..COPIES {
            let [file, other] = [(); 2].map(|()| &files[pcg.below(files.len())]);
            let bytes = damaged(file, other, &mut pcg);
            eprintln!("{}, copy {copy}", reader.name);
            reader.check(&bytes);
        }
        eprintln!("{}: {} files, {:?}", reader.name, files.len(), start.elapsed());
    }
}

//! Fuzzes the reader that the environment variable TAUGATE_FUZZ names, with libFuzzer. `fuzz/run` sets the variable.

#![no_main]

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use memory::Counting;
use readers::{READERS, Reader};

#[path = "../../tests/common/memory.rs"]
mod memory;
#[path = "../../tests/common/readers.rs"]
mod readers;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn reader() -> &'static Reader {
    static READER: OnceLock<&Reader> = OnceLock::new();
    READER.get_or_init(|| {
        let name = std::env::var("TAUGATE_FUZZ").expect("TAUGATE_FUZZ names a reader");
        READERS.iter().find(|reader| reader.name == name).expect("a reader of this name")
    })
}

fuzz_target!(|bytes: &[u8]| reader().check(bytes));

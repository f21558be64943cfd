//! Ctrl-C.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of what was interrupted.
pub const INTERRUPTED: u8 = 130;

/// What an interrupt does: the first asks the work to stop where it can keep what it has, the second ends the process.
pub struct Interrupts {
    /// Somebody interrupted.
    pub stop: Arc<AtomicBool>,
    at_once: Arc<AtomicBool>,
}

impl Interrupts {
    /// Once a process.
    pub fn new() -> anyhow::Result<Interrupts> {
        let interrupts = Interrupts { stop: Arc::default(), at_once: Arc::default() };
        let (stop, at_once) = (interrupts.stop.clone(), interrupts.at_once.clone());
        ctrlc::set_handler(move || {
            if stop.swap(true, Ordering::SeqCst) || at_once.load(Ordering::SeqCst) {
                std::process::exit(INTERRUPTED.into());
            }
        })?;
        Ok(interrupts)
    }

    /// Whether already the first interrupt ends the process: while nothing is kept and no file is open for writing.
    pub fn exit_at_once(&self, yes: bool) {
        self.at_once.store(yes, Ordering::SeqCst);
        if yes && self.stop.load(Ordering::SeqCst) {
            std::process::exit(INTERRUPTED.into());
        }
    }
}

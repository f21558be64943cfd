//! Handles Ctrl-C and SIGTERM. Batch queues, and systems that shut down, send SIGTERM.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
#[cfg(unix)]
use std::time::{Duration, Instant};

/// Exit code of an interrupted command.
pub const INTERRUPTED: u8 = 130;

/// Which interrupt ends the process.
#[derive(Clone, Copy)]
pub enum Interrupt {
    /// The first, while there is no result to keep.
    First,
    /// The second: the first stops the work and keeps its result so far.
    Second,
    /// None, while files are written: no half-written file may remain.
    None,
}

impl Interrupt {
    /// Counted from 1.
    fn number(self) -> u32 {
        match self {
            Interrupt::First => 1,
            Interrupt::Second => 2,
            Interrupt::None => u32::MAX,
        }
    }
}

/// Counts the interrupts, and ends the process at a chosen one.
pub struct Interrupts {
    /// True after the first interrupt. Loops that work for long check this flag and stop with their result so far.
    pub stop: Arc<AtomicBool>,
    count: Arc<AtomicU32>,
    last: Arc<AtomicU32>,
}

impl Interrupts {
    /// Installs the handlers; may be called once per process. At first no interrupt ends the process
    /// ([`Interrupts::end_the_process_at`] changes this).
    pub fn new() -> anyhow::Result<Interrupts> {
        let last = Arc::new(AtomicU32::new(Interrupt::None.number()));
        let interrupts = Interrupts { stop: Arc::default(), count: Arc::default(), last };
        let (stop, count, last) = (interrupts.stop.clone(), interrupts.count.clone(), interrupts.last.clone());
        let interrupt = move || {
            stop.store(true, Ordering::SeqCst);
            let count = count.fetch_add(1, Ordering::SeqCst) + 1;
            exit_if(count >= last.load(Ordering::SeqCst));
        };
        #[cfg(unix)]
        on_termination(interrupt.clone())?;
        ctrlc::set_handler(interrupt)?;
        Ok(interrupts)
    }

    /// From now on `interrupt` ends the process. If it has already arrived, the process ends at once.
    pub fn end_the_process_at(&self, interrupt: Interrupt) {
        self.last.store(interrupt.number(), Ordering::SeqCst);
        exit_if(self.count.load(Ordering::SeqCst) >= interrupt.number());
    }
}

/// SIGTERM signals within this time are one request: `timeout` of the GNU coreutils sends one to its child and another to
/// the whole process group.
#[cfg(unix)]
const ONE_REQUEST: Duration = Duration::from_secs(1);

/// Calls `interrupt` on SIGTERM. The crate `ctrlc` could handle SIGTERM, but then it would also handle SIGHUP and end
/// processes that nohup keeps alive.
#[cfg(unix)]
fn on_termination(mut interrupt: impl FnMut() + Send + 'static) -> anyhow::Result<()> {
    let mut signals = signal_hook::iterator::Signals::new([signal_hook::consts::SIGTERM])?;
    std::thread::spawn(move || {
        let mut last: Option<Instant> = None;
        for _ in signals.forever() {
            if last.is_none_or(|last| last.elapsed() > ONE_REQUEST) {
                last = Some(Instant::now());
                interrupt();
            }
        }
    });
    Ok(())
}

fn exit_if(enough: bool) {
    if enough {
        std::process::exit(INTERRUPTED.into());
    }
}

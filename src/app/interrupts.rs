//! Ctrl-C, and what a queue or a system that shuts down sends (SIGTERM).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
#[cfg(unix)]
use std::time::{Duration, Instant};

/// Exit code of what was interrupted.
pub const INTERRUPTED: u8 = 130;

/// The interrupt that ends the process.
#[derive(Clone, Copy)]
pub enum Interrupt {
    /// While there is nothing to keep.
    First,
    /// While work goes on that can stop and keep what it has.
    Second,
    /// While files are written: half of one must not be left.
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

/// What was asked by interrupts, and which of them ends the process.
pub struct Interrupts {
    /// Somebody interrupted: work stops where it can keep what it has.
    pub stop: Arc<AtomicBool>,
    count: Arc<AtomicU32>,
    last: Arc<AtomicU32>,
}

impl Interrupts {
    /// Once a process. Until something else is said no interrupt ends it.
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

    /// From now on `interrupt` ends the process, at once if it has come already.
    pub fn end_the_process_at(&self, interrupt: Interrupt) {
        self.last.store(interrupt.number(), Ordering::SeqCst);
        exit_if(self.count.load(Ordering::SeqCst) >= interrupt.number());
    }
}

/// Signals of one request: `timeout` of the GNU coreutils sends SIGTERM to its child and again to the whole group.
#[cfg(unix)]
const ONE_REQUEST: Duration = Duration::from_secs(1);

/// `ctrlc` could do this too, but would take SIGHUP with it, and so end what nohup keeps alive.
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

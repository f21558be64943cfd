//! Handles Ctrl-C and the signals that ask a process to end. Batch queues, and systems that shut down, send SIGTERM. SIGHUP
//! comes when a terminal or an ssh connection is lost.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
#[cfg(unix)]
use std::time::{Duration, Instant};

#[cfg(unix)]
use signal_hook::consts::{SIGHUP, SIGTERM, SIGXCPU, SIGXFSZ};
#[cfg(unix)]
use taugate::internals::threads;

/// Exit code of an interrupted command.
pub const INTERRUPTED: u8 = 130;

/// Which interrupt ends the process.
#[derive(Clone, Copy)]
pub enum Interrupt {
    /// The first, while there is no result to keep.
    First,
    /// The second. The first interrupt stops the work and keeps its result so far.
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
        on_termination(interrupts.stop.clone(), interrupt.clone())?;
        ctrlc::set_handler(interrupt)?;
        Ok(interrupts)
    }

    /// From now on `interrupt` ends the process. If it has already arrived, the process ends at once.
    pub fn end_the_process_at(&self, interrupt: Interrupt) {
        self.last.store(interrupt.number(), Ordering::SeqCst);
        exit_if(self.count.load(Ordering::SeqCst) >= interrupt.number());
    }
}

/// Signals within this time are one request: `timeout` of the GNU coreutils sends one SIGTERM to its child and another to the
/// whole process group, and systemd sends SIGHUP after SIGTERM.
#[cfg(unix)]
const ONE_REQUEST: Duration = Duration::from_secs(1);

/// Calls `interrupt` on SIGTERM, SIGHUP and SIGXCPU. The crate `ctrlc` could handle SIGTERM and SIGHUP, but then it would also
/// end processes that nohup keeps alive.
///
/// SIGHUP says that the terminal is gone, and SIGXCPU that a limit of processor time is near. Neither shows that a user is
/// impatient, so they never count as a second interrupt, which would end the process without a result.
#[cfg(unix)]
fn on_termination(stop: Arc<AtomicBool>, mut interrupt: impl FnMut() + Send + 'static) -> anyhow::Result<()> {
    let mut numbers = vec![SIGTERM, SIGXCPU];
    if !is_ignored(SIGHUP) {
        numbers.push(SIGHUP);
    }
    let mut signals = signal_hook::iterator::Signals::new(numbers)?;
    threads::spawn("signals", move || {
        let mut last: Option<Instant> = None;
        for number in signals.forever() {
            let is_late = number != SIGTERM && stop.load(Ordering::SeqCst);
            if !is_late && last.is_none_or(|last| last.elapsed() > ONE_REQUEST) {
                last = Some(Instant::now());
                interrupt();
            }
        }
    })?;
    Ok(())
}

/// Whether the process ignores the signal `number`. A process inherits this from its parent: nohup makes it ignore SIGHUP.
#[cfg(unix)]
fn is_ignored(number: libc::c_int) -> bool {
    let mut action = std::mem::MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: a null pointer as the new action changes nothing, and `action` has room for the present action. All its bits may
    // be zero, so it is initialised even if the call fails.
    let action = unsafe {
        libc::sigaction(number, std::ptr::null(), action.as_mut_ptr());
        action.assume_init()
    };
    action.sa_sigaction == libc::SIG_IGN
}

/// Makes a write beyond the limit of file sizes (`ulimit -f`) fail with an error. By default, the signal SIGXFSZ ends the
/// process, and its work is lost.
#[cfg(unix)]
pub fn outlive_size_limits() -> std::io::Result<()> {
    signal_hook::flag::register(SIGXFSZ, Arc::default()).map(drop)
}

/// Ends the process if `enough`. On Unix, no exit handlers of libraries run. The handler of a driver may free what another thread uses
/// at the time, and the process would crash. Text that waits in the buffer of stdout is lost.
fn exit_if(enough: bool) {
    if !enough {
        return;
    }
    #[cfg(unix)]
    // SAFETY: `_exit` may be called at any time.
    unsafe {
        libc::_exit(INTERRUPTED.into())
    }
    #[cfg(not(unix))]
    std::process::exit(INTERRUPTED.into());
}

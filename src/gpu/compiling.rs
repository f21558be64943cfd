//! How long the driver has been compiling kernels. Programs tell their users, because the first kernels of a combination of materials
//! may take a minute.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Number of kernels that are being compiled, and the time since which there has been at least one.
static COMPILING: Mutex<(usize, Option<Instant>)> = Mutex::new((0, None));

fn state() -> MutexGuard<'static, (usize, Option<Instant>)> {
    COMPILING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Time since which kernels have been compiled without a pause, by any thread of the process; `None` if no kernel is being compiled.
pub fn compiling_for() -> Option<Duration> {
    state().1.map(|since| since.elapsed())
}

/// Stands for a kernel that is being compiled.
pub(super) struct Compiling;

impl Compiling {
    pub fn begin() -> Compiling {
        let mut state = state();
        state.0 += 1;
        state.1.get_or_insert_with(Instant::now);
        Compiling
    }
}

impl Drop for Compiling {
    fn drop(&mut self) {
        let mut state = state();
        state.0 -= 1;
        if state.0 == 0 {
            state.1 = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kernel_that_is_being_compiled_is_seen() {
        let first = Compiling::begin();
        let second = Compiling::begin();
        drop(first);
        // Other tests may compile kernels at the same time, so only the presence is certain.
        assert!(compiling_for().is_some());
        drop(second);
    }
}

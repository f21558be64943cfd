//! Starts threads. Where the system allows no more threads, the result is an error and not a panic.

use std::error::Error as _;
use std::sync::OnceLock;
use std::sync::mpsc::channel;
use std::thread::{Builder, JoinHandle, Scope, ScopedJoinHandle};

use crate::error::{Error, Result};

/// Starts the threads that share work among the cores. Call this function before the first work of the process: without it, the
/// first work would start them, and panic if that fails. Later calls have the same result, because they can be started only once.
pub fn start_pool() -> Result<()> {
    static FAILURE: OnceLock<Option<String>> = OnceLock::new();
    let start = || match rayon::ThreadPoolBuilder::new().build_global() {
        // Without a source: they have been started already.
        Err(error) => error.source().map(ToString::to_string),
        Ok(()) => None,
    };
    match FAILURE.get_or_init(start) {
        Some(failure) => Err(too_few(failure)),
        None => Ok(()),
    }
}

/// Starts a thread named `name`.
pub fn spawn<T: Send + 'static>(name: &str, work: impl FnOnce() -> T + Send + 'static) -> Result<JoinHandle<T>> {
    Builder::new().name(name.into()).spawn(work).map_err(|error| too_few(&error))
}

/// Starts a thread named `name` that ends before `scope` does.
pub fn spawn_scoped<'scope, 'env, T: Send + 'scope>(
    scope: &'scope Scope<'scope, 'env>,
    name: &str,
    work: impl FnOnce() -> T + Send + 'scope,
) -> Result<ScopedJoinHandle<'scope, T>> {
    Builder::new().name(name.into()).spawn_scoped(scope, work).map_err(|error| too_few(&error))
}

/// Fails if the system does not allow `count` more threads at a time. For libraries that panic if they cannot start a thread.
pub fn check(count: usize) -> Result<()> {
    // The threads wait until the senders are dropped, so that they exist at the same time.
    let mut senders = vec![];
    for _ in 0..count {
        let (sender, receiver) = channel::<()>();
        spawn("check", move || receiver.recv().is_ok())?;
        senders.push(sender);
    }
    Ok(())
}

fn too_few(error: &dyn std::fmt::Display) -> Error {
    Error::Device(format!(
        "the system allows no more threads ({error}); raise the limit of processes (ulimit -u), or end others, and start again"
    ))
}

//! Rendering: devices that all renders of the process share, preparation, and iterations that Python can watch and interrupt.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use taugate::internals::gpu::Device;
use taugate::internals::image::response_film::ResponseFilm;
use taugate::internals::job::iterations::{Abandons, End};
use taugate::internals::job::memory;
use taugate::internals::job::ready::Ready;
use taugate::internals::job::ready_job::{Progress, ReadyJob};
use taugate::internals::settings::Settings;
use taugate::internals::threads::{spawn_scoped, start_pool};

use crate::errors::{Failure, Result};

/// How long the calling thread waits for a step before it asks Python for interrupts. Python reports them only in the main thread.
const PATIENCE: Duration = Duration::from_millis(50);

/// The open devices by the name that selected them.
static DEVICES: Mutex<Option<HashMap<Option<String>, Device>>> = Mutex::new(None);

/// The process that used the module first.
static PROCESS: OnceLock<u32> = OnceLock::new();

/// Locks a mutex, even a poisoned one: a panic elsewhere leaves its contents intact.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Fails in a process that was forked from one that has used the module. Threads do not survive a fork, neither those of the driver nor
/// those that share work among cores, so work would wait for them for ever. Also fails if the system allows no more threads. Each
/// function that works with threads calls this first.
pub fn check_process() -> Result<()> {
    if *PROCESS.get_or_init(std::process::id) == std::process::id() {
        return Ok(start_pool()?);
    }
    Err(taugate::Error::Device(
        "this process was forked from one that has used taugate; start processes with multiprocessing.get_context('spawn')".into(),
    )
    .into())
}

/// The device of this name. It is opened once, and keeps its compiled kernels.
pub fn device(name: Option<&str>) -> taugate::Result<Device> {
    let mut devices = lock(&DEVICES);
    let devices = devices.get_or_insert_default();
    let key = name.map(String::from);
    if let Some(device) = devices.get(&key) {
        return Ok(device.clone());
    }
    let device = Device::open(name)?;
    devices.insert(key, device.clone());
    Ok(device)
}

/// Closes the devices that were lost, so that the next render opens them anew.
pub fn forget_lost() {
    if let Some(devices) = &mut *lock(&DEVICES) {
        devices.retain(|_, device| !device.is_lost());
    }
}

/// Fails if the images of several gates need more memory than is free. They exist twice at the end: in the renderer, which the next
/// render takes over, and in the result. The renderer `before` gives up its images or lends them.
pub fn check_memory(before: Option<&Ready>, settings: &Settings, has_variance: bool) -> Result<()> {
    let (count, crop) = (settings.responses().len(), settings.crop());
    if count == 1 {
        return Ok(());
    }
    let pixels = u64::from(crop.width()) * u64::from(crop.height());
    let needed = ResponseFilm::bytes(pixels, count as u64, has_variance).saturating_mul(2);
    let held = before.map_or(0, |Ready { renderer, .. }| renderer.response_bytes());
    let what = format!("a histogram of {count} gates of {}x{} pixels", crop.width(), crop.height());
    memory::check_bytes(
        needed.saturating_sub(held),
        memory::free(),
        &what,
        "use fewer gates, a smaller resolution, or crop",
    )?;
    Ok(())
}

/// Runs `work` in a thread of its own. The calling thread passes the newest step to `progress`, and asks Python for interrupts. If
/// `progress` or Python raises an exception, the calling thread sets the flag that `work` gets, and waits for `work` to end. Returns
/// the result of `work` and the exception. Fails if the thread cannot be started.
pub fn watched<T: Send>(
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(Sender<Progress>, &Arc<AtomicBool>) -> T + Send,
) -> Result<(T, Option<PyErr>)> {
    let stop = Arc::new(AtomicBool::new(false));
    let (sender, receiver) = channel();
    thread::scope(|scope| {
        let worker = spawn_scoped(scope, "render", || work(sender, &stop))?;
        let mut failure = None;
        loop {
            let step = match receiver.recv_timeout(PATIENCE) {
                // A slow `progress` gets the newest step.
                Ok(step) => Some(receiver.try_iter().last().unwrap_or(step)),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => break,
            };
            // After an exception, only wait for the end.
            if failure.is_some() {
                continue;
            }
            let asked = Python::attach(|py| {
                py.check_signals()?;
                match (progress, step) {
                    (Some(call), Some(step)) => call.call1(py, (step.fraction, step.samples, step.seconds)).map(drop),
                    _ => Ok(()),
                }
            });
            if let Err(error) = asked {
                stop.store(true, Ordering::SeqCst);
                failure = Some(error);
            }
        }
        let result = worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        Ok((result, failure))
    })
}

/// Whether an exception asks to stop and to keep the result so far.
pub fn is_interrupt(error: &PyErr) -> bool {
    Python::attach(|py| error.is_instance_of::<PyKeyboardInterrupt>(py))
}

/// The exception that ended the work of [`watched`] early but keeps the result so far: an interrupt, or the loss of the device. All other
/// failures, and a loss before there was a result, are errors.
pub fn early_end(
    end: taugate::Result<End>,
    failure: Option<PyErr>,
    device: &Device,
    has_result: bool,
) -> Result<Option<PyErr>> {
    match (end.and_then(End::or_error), failure) {
        (Err(loss), _) if device.is_lost() && has_result => Ok(Some(Failure::from(loss).into())),
        (Err(error), _) => Err(error.into()),
        (Ok(End::NotFinite(dropped)), _) => Err(Failure::NotFinite(dropped)),
        (Ok(_), Some(error)) if !is_interrupt(&error) => Err(error.into()),
        (Ok(_), interrupt) => Ok(interrupt),
    }
}

/// Adds iterations until the budget is used or Python asks to stop. Returns the exception that ended it early if the image so far is
/// kept.
pub fn iterate(job: &mut ReadyJob, progress: Option<&Py<PyAny>>) -> Result<Option<PyErr>> {
    let (end, failure) = watched(progress, |steps, stop| {
        job.iterate(stop, Abandons::SafeOnes, |step| {
            // `watched` keeps the receiver until this thread ends, so this cannot fail.
            let _ = steps.send(step.progress);
        })
    })?;
    let renderer = &job.ready.renderer;
    early_end(end, failure, renderer.device(), renderer.film().iterations() > 0)
}

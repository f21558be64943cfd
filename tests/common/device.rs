//! Devices for tests. A device keeps the kernels that it compiled, so tests pass their devices on.

use std::cell::RefCell;
use std::sync::{Mutex, PoisonError};

use taugate::internals::gpu::Device;

/// Devices of tests that have ended.
static FREE: Mutex<Vec<Device>> = Mutex::new(vec![]);

/// A device that the test of this thread uses. Each test has a thread of its own.
struct Taken(Device);

impl Drop for Taken {
    fn drop(&mut self) {
        FREE.lock().unwrap_or_else(PoisonError::into_inner).push(self.0.clone());
    }
}

thread_local! {
    static TAKEN: RefCell<Option<Taken>> = const { RefCell::new(None) };
}

/// The device of this test. No other test uses it at the same time, so tests do not wait for each other. Fails the test if there is no
/// device.
pub fn device() -> Device {
    let free = || FREE.lock().unwrap_or_else(PoisonError::into_inner).pop();
    let open =
        || Device::open(None).unwrap_or_else(|e| panic!("these tests need a Vulkan device; run ./setup.sh: {e}"));
    TAKEN.with_borrow_mut(|taken| taken.get_or_insert_with(|| Taken(free().unwrap_or_else(open))).0.clone())
}

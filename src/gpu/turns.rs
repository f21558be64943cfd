//! Host and device take turns at each piece of mapped memory. While the device may use it, the host waits, and the reverse. Memory that a
//! submit does not use is free for the host meanwhile.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use super::allocation::Allocation;

/// Users of one allocation at the moment: submits, or host accesses. They change under the lock of [`Turns`], and one of them is 0.
#[derive(Default)]
pub(super) struct Users {
    submits: AtomicU32,
    accesses: AtomicU32,
}

/// Guards the [`Users`] of all allocations of a device.
#[derive(Default)]
pub(super) struct Turns {
    lock: Mutex<()>,
    /// Notified when users of an allocation have left.
    left: Condvar,
}

impl Turns {
    /// Waits until the host accesses none of `used`. Then the device may use them until the guard is dropped.
    pub fn of_device<'a, I: Iterator<Item = &'a Allocation> + Clone>(&'a self, used: I) -> Turn<'a, I> {
        let is_free = |a: &Allocation| a.users.accesses.load(Ordering::Relaxed) == 0;
        self.enter(used, is_free, |users| &users.submits)
    }

    /// Waits until no submit uses `accessed`. Then the host may access it until the guard is dropped.
    pub fn of_host<'a>(&'a self, accessed: &'a Allocation) -> Turn<'a, std::iter::Once<&'a Allocation>> {
        let is_free = |a: &Allocation| a.users.submits.load(Ordering::Relaxed) == 0;
        self.enter(std::iter::once(accessed), is_free, |users| &users.accesses)
    }

    fn enter<'a, I: Iterator<Item = &'a Allocation> + Clone>(
        &'a self,
        allocations: I,
        is_free: impl Fn(&Allocation) -> bool,
        count: fn(&Users) -> &AtomicU32,
    ) -> Turn<'a, I> {
        let mut guard = self.locked();
        while !allocations.clone().all(&is_free) {
            guard = self.left.wait(guard).unwrap_or_else(PoisonError::into_inner);
        }
        for allocation in allocations.clone() {
            count(&allocation.users).fetch_add(1, Ordering::Relaxed);
        }
        drop(guard);
        Turn { turns: self, allocations, count }
    }

    fn locked(&self) -> MutexGuard<'_, ()> {
        // A poisoned lock is no problem: counts change one by one, and no code under the lock panics between two of them.
        self.lock.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The right of the host or of one submit to use some allocations, until it is dropped.
pub(super) struct Turn<'a, I: Iterator<Item = &'a Allocation> + Clone> {
    turns: &'a Turns,
    allocations: I,
    count: fn(&Users) -> &AtomicU32,
}

impl<'a, I: Iterator<Item = &'a Allocation> + Clone> Drop for Turn<'a, I> {
    fn drop(&mut self) {
        let guard = self.turns.locked();
        for allocation in self.allocations.clone() {
            (self.count)(&allocation.users).fetch_sub(1, Ordering::Relaxed);
        }
        drop(guard);
        self.turns.left.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;
    use std::time::Duration;

    use crate::gpu::{Buffer, Device, Drive};

    #[test]
    fn the_host_waits_for_the_submits_that_use_a_buffer_and_for_no_others() {
        let device = Device::open_with_drive(None, Some(Drive::CPU)).unwrap_or_else(|e| panic!("a Vulkan device: {e}"));
        let [mut used, mut free] = [1u32, 2].map(|x| Buffer::from_slice(&device, "numbers", &[x; 16], "").unwrap());
        let allocation = used.allocation.clone();
        let turns = &device.shared.turns;
        let submit = turns.of_device([&allocation, &allocation].map(|a| &**a).into_iter());
        free.write(0, &[3u32; 16]).unwrap();
        assert_eq!(free.to_vec::<u32>(16).unwrap(), [3; 16]);
        let (sender, receiver) = mpsc::channel();
        std::thread::scope(|scope| {
            scope.spawn(|| sender.send(used.write(0, &[4u32; 16])).unwrap());
            assert!(receiver.recv_timeout(Duration::from_millis(50)).is_err(), "the host did not wait");
            // Another submit may use the buffer at the same time.
            drop(turns.of_device(std::iter::once(&*allocation)));
            drop(submit);
            receiver.recv_timeout(Duration::from_secs(60)).expect("the host waits for ever").unwrap();
        });
        let reading = turns.of_host(&allocation);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                drop(turns.of_device(std::iter::once(&*allocation)));
                sender.send(Ok(())).unwrap();
            });
            assert!(receiver.recv_timeout(Duration::from_millis(50)).is_err(), "the submit did not wait");
            drop(reading);
            receiver.recv_timeout(Duration::from_secs(60)).expect("the submit waits for ever").unwrap();
        });
    }
}

//! The place where the render leaves snapshots for the thread that sends them. It holds one snapshot, the newest.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::tev::Snapshot;

#[derive(Default)]
pub struct Mailbox {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    snapshot: Option<Snapshot>,
    link: Link,
    is_closed: bool,
    warning: Option<String>,
    has_warned: bool,
}

impl State {
    /// Keeps the first warning of the stream.
    fn warn(&mut self, warning: String) {
        if !self.has_warned {
            (self.warning, self.has_warned) = (Some(warning), true);
        }
    }

    fn is_sent(&self) -> bool {
        self.link == Link::Down || (self.link == Link::Idle && self.snapshot.is_none())
    }
}

/// The state of the connection to tev.
#[derive(Default, PartialEq)]
enum Link {
    /// The first attempt to connect is under way.
    #[default]
    Connecting,
    /// The sender waits for a snapshot.
    Idle,
    Sending,
    /// The last attempt to connect or to send failed.
    Down,
}

/// For the render.
impl Mailbox {
    /// Whether a snapshot would be sent at once.
    pub fn is_free(&self) -> bool {
        let state = self.lock();
        state.link == Link::Idle && state.snapshot.is_none()
    }

    pub fn is_down(&self) -> bool {
        self.lock().link == Link::Down
    }

    /// Replaces a snapshot that is not sent yet.
    pub fn put(&self, snapshot: Snapshot) {
        self.lock().snapshot = Some(snapshot);
        self.changed.notify_all();
    }

    /// Waits until the snapshot is sent or the connection fails. Returns false if neither happens within `timeout`.
    pub fn wait_until_sent(&self, timeout: Duration) -> bool {
        let waited = self.changed.wait_timeout_while(self.lock(), timeout, |state| !state.is_sent());
        waited.unwrap_or_else(PoisonError::into_inner).0.is_sent()
    }

    /// Keeps a warning, if it is the first one.
    pub fn warn(&self, warning: String) {
        self.lock().warn(warning);
    }

    pub fn take_warning(&self) -> Option<String> {
        self.lock().warning.take()
    }

    /// Asks the sender to end.
    pub fn close(&self) {
        self.lock().is_closed = true;
        self.changed.notify_all();
    }
}

/// For the thread that sends.
impl Mailbox {
    /// Waits for the next snapshot; `None` if the mailbox is closed.
    pub fn next(&self) -> Option<Snapshot> {
        let mut state = self.lock();
        state.link = Link::Idle;
        self.changed.notify_all();
        let waits = |state: &mut State| state.snapshot.is_none() && !state.is_closed;
        let mut state = self.changed.wait_while(state, waits).unwrap_or_else(PoisonError::into_inner);
        state.link = Link::Sending;
        state.snapshot.take().filter(|_| !state.is_closed)
    }

    /// Whether the present snapshot need not be sent any more.
    pub fn has_newer(&self) -> bool {
        let state = self.lock();
        state.snapshot.is_some() || state.is_closed
    }

    /// Notes that the connection failed, and drops the waiting snapshot.
    pub fn fail(&self, warning: String) {
        let mut state = self.lock();
        (state.link, state.snapshot) = (Link::Down, None);
        state.warn(warning);
        self.changed.notify_all();
    }

    /// Waits for `pause`. Returns false if the mailbox is closed.
    pub fn wait_to_retry(&self, pause: Duration) -> bool {
        let waited = self.changed.wait_timeout_while(self.lock(), pause, |state| !state.is_closed);
        !waited.unwrap_or_else(PoisonError::into_inner).0.is_closed
    }
}

impl Mailbox {
    /// A panic of the other thread leaves the state complete, so a poisoned lock is no error.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

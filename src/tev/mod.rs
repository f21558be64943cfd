//! Shows images in the viewer tev (<https://github.com/Tom94/tev>) while they are rendered. A thread of its own sends them, so a tev
//! that is slow, absent or gone never makes the render wait.

mod connection;
mod mailbox;
mod packets;

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use crate::image::channels::ChannelGroup;
use crate::settings::tev::TevAddress;
use connection::Connection;
use mailbox::Mailbox;

/// Minimum time between two snapshots that are offered.
const PERIOD: Duration = Duration::from_millis(250);
/// Minimum time between two snapshots, relative to the time that making one takes. Sending costs about as much processor time
/// again. Both together stay below 1 % of the time of the render.
const PERIOD_PER_COST: u32 = 300;
/// Time between two attempts to connect.
const RETRY: Duration = Duration::from_secs(2);

/// An image at one moment of its render.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// Name of the image in tev. Another image of this name is replaced.
    pub name: String,
    /// In pixels.
    pub width: u32,
    pub height: u32,
    /// Each group has a value per name and pixel. tev shows channels as one layer if their names are the same up to the last dot.
    pub groups: Vec<ChannelGroup>,
}

/// Sends snapshots to a tev, the newest one only. Dropping the stream ends it without waiting.
pub struct TevStream {
    address: TevAddress,
    mailbox: Arc<Mailbox>,
    /// Earliest time of the next snapshot that is offered.
    next_offer: Instant,
    /// False after [`TevStream::finish`] reached its timeout.
    is_patient: bool,
}

impl TevStream {
    /// Starts to connect, and returns at once.
    pub fn new(address: TevAddress) -> TevStream {
        let mailbox = Arc::new(Mailbox::default());
        let (inbox, destination) = (mailbox.clone(), address.clone());
        if let Err(error) = thread::Builder::new().name("tev".into()).spawn(move || run(&inbox, &destination)) {
            mailbox.fail(format!("nothing is shown in tev, because no thread can be started ({error})"));
        }
        TevStream { address, mailbox, next_offer: Instant::now(), is_patient: true }
    }

    /// Sends the snapshot that `make` returns, if tev is there, the previous snapshot has been sent, and enough time has passed since
    /// it was made. Otherwise `make` is not called. This method never waits for tev.
    pub fn offer(&mut self, make: impl FnOnce() -> Snapshot) {
        let start = Instant::now();
        if start < self.next_offer || !self.mailbox.is_free() {
            return;
        }
        let snapshot = make();
        let made = Instant::now();
        self.next_offer = made + PERIOD.max((made - start).saturating_mul(PERIOD_PER_COST));
        self.mailbox.put(snapshot);
    }

    /// Sends the snapshot that `make` returns. If an earlier snapshot is being sent, its remaining tiles are skipped. If the connection
    /// is down, `make` is not called. This method never waits for tev.
    pub fn offer_last(&mut self, make: impl FnOnce() -> Snapshot) {
        if !self.mailbox.is_down() {
            self.mailbox.put(make());
        }
    }

    /// Whether the last attempt to connect or to send failed.
    pub fn is_down(&self) -> bool {
        self.mailbox.is_down()
    }

    /// Waits until everything is sent, at most for `timeout`. After one timeout, later calls do not wait. Returns a warning like
    /// [`TevStream::warning`].
    pub fn finish(&mut self, timeout: Duration) -> Option<String> {
        if self.is_patient && !self.mailbox.wait_until_sent(timeout) {
            self.is_patient = false;
            self.mailbox.warn(format!(
                "tev at {} did not take the whole image within {} s, so it may show an earlier one",
                self.address,
                timeout.as_secs_f64()
            ));
        }
        self.warning()
    }

    /// The first problem of the stream, one sentence without a full stop. It is returned once; later problems are not reported.
    pub fn warning(&self) -> Option<String> {
        self.mailbox.take_warning()
    }
}

impl Drop for TevStream {
    fn drop(&mut self) {
        self.mailbox.close();
    }
}

/// Connects, and sends the snapshots of the mailbox until it is closed. Connects again after a failure.
fn run(mailbox: &Mailbox, address: &TevAddress) {
    loop {
        match Connection::open(address) {
            Ok(connection) => match send_all(mailbox, connection) {
                Ok(()) => return,
                Err(error) => mailbox.fail(format!(
                    "tev at {address} is gone ({}); the render goes on, and tev shows it again when it is back",
                    reason(&error)
                )),
            },
            Err(error) => mailbox.fail(format!(
                "no tev answers at {address} ({}); start tev there, or connect the port to a tev on your own computer with \
                 ssh -R {}:localhost:14158; the render goes on",
                reason(&error),
                address.as_pair().1
            )),
        }
        if !mailbox.wait_to_retry(RETRY) {
            return;
        }
    }
}

/// Sends snapshots until the mailbox is closed.
fn send_all(mailbox: &Mailbox, mut connection: Connection) -> std::io::Result<()> {
    while let Some(snapshot) = mailbox.next() {
        connection.send(&snapshot, || mailbox.has_newer())?;
    }
    Ok(())
}

fn reason(error: &std::io::Error) -> String {
    use std::io::ErrorKind::{TimedOut, WouldBlock};
    match error.kind() {
        // On Unix, `WouldBlock` is the error of a write that takes too long.
        TimedOut | WouldBlock => "no answer in time".into(),
        _ => error.to_string(),
    }
}

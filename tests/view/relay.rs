//! Forwards connections to another port, as `ssh -L` does. It can cut them, and delay what the program sends.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread;
use std::time::{Duration, Instant};

#[derive(Default)]
struct Lines {
    open: Mutex<Vec<TcpStream>>,
    is_cut: AtomicBool,
}

pub struct Relay {
    pub port: u16,
    lines: Arc<Lines>,
}

impl Relay {
    pub fn to(target: u16) -> Relay {
        Relay::late(target, Duration::ZERO)
    }

    /// Everything from `target` arrives later by `delay`.
    pub fn late(target: u16, delay: Duration) -> Relay {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let lines = Arc::new(Lines::default());
        let shared = lines.clone();
        // The thread ends with the process.
        thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                if !shared.is_cut.load(Ordering::SeqCst) {
                    let _ = forward(stream, target, delay, &shared);
                }
            }
        });
        Relay { port, lines }
    }

    /// Ends all connections and refuses new ones.
    pub fn cut(&self) {
        self.lines.is_cut.store(true, Ordering::SeqCst);
        for stream in self.lines.open.lock().unwrap().drain(..) {
            let _ = stream.shutdown(Shutdown::Both);
        }
    }

    pub fn mend(&self) {
        self.lines.is_cut.store(false, Ordering::SeqCst);
    }
}

fn forward(client: TcpStream, target: u16, delay: Duration, lines: &Lines) -> io::Result<()> {
    let server = TcpStream::connect(("127.0.0.1", target))?;
    for (from, to, delay) in [(client.try_clone()?, server.try_clone()?, Duration::ZERO), (server, client, delay)] {
        lines.open.lock().unwrap().push(from.try_clone()?);
        let (sender, parts) = mpsc::channel();
        thread::spawn(move || receive(from, &sender));
        thread::spawn(move || deliver(to, &parts, delay));
    }
    Ok(())
}

fn receive(mut from: TcpStream, parts: &mpsc::Sender<(Instant, Vec<u8>)>) {
    let mut bytes = [0; 1 << 16];
    while let Ok(count) = from.read(&mut bytes) {
        if count == 0 || parts.send((Instant::now(), bytes[..count].to_vec())).is_err() {
            break;
        }
    }
}

fn deliver(mut to: TcpStream, parts: &mpsc::Receiver<(Instant, Vec<u8>)>, delay: Duration) {
    for (arrival, part) in parts {
        thread::sleep((arrival + delay).saturating_duration_since(Instant::now()));
        if to.write_all(&part).is_err() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Both);
}

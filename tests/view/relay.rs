//! Forwards connections to another port, as `ssh -L` does, and can cut them.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

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
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let lines = Arc::new(Lines::default());
        let shared = lines.clone();
        // The thread ends with the process.
        thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                if !shared.is_cut.load(Ordering::SeqCst) {
                    let _ = forward(stream, target, &shared);
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

fn forward(client: TcpStream, target: u16, lines: &Lines) -> io::Result<()> {
    let server = TcpStream::connect(("127.0.0.1", target))?;
    for (mut from, mut to) in [(client.try_clone()?, server.try_clone()?), (server, client)] {
        lines.open.lock().unwrap().push(from.try_clone()?);
        thread::spawn(move || {
            let mut bytes = [0; 1 << 16];
            while let Ok(count) = from.read(&mut bytes) {
                if count == 0 || to.write_all(&bytes[..count]).is_err() {
                    break;
                }
            }
            let _ = to.shutdown(Shutdown::Both);
        });
    }
    Ok(())
}

//! A running viewer, and a page that is connected to it.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use half::f16;
use serde_json::{Value as Json, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

/// No answer takes longer than this, even on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// A running viewer. Dropping it ends the program.
pub struct Viewer {
    pub child: Child,
    pub port: u16,
    pub token: String,
}

impl Viewer {
    /// Starts a viewer of `room.glb` in `folder`.
    pub fn start(folder: &Path, flags: &[&str]) -> Viewer {
        Viewer::start_by(&mut Command::new(env!("CARGO_BIN_EXE_taugate")), folder, flags)
    }

    /// Like [`Viewer::start`], with this command, which may have an environment of its own.
    pub fn start_by(command: &mut Command, folder: &Path, flags: &[&str]) -> Viewer {
        let mut child = command
            .args(["view", "room.glb", "--listen", "127.0.0.1:0"])
            .args(flags)
            .current_dir(folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("taugate starts");
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("http://127.0.0.1:").unwrap_or_else(|| panic!("no address: {line:?}"));
        let (port, token) = address.split_once("/#").expect("a token");
        assert_eq!(token.len(), 32);
        Viewer { child, port: port.parse().unwrap(), token: token.into() }
    }

    /// A connection that has sent the token.
    pub fn page(&self) -> Page {
        let mut page = self.connect(&format!("localhost:{}", self.port), "http://localhost:1").expect("a connection");
        page.say(&json!({"do": "hello", "token": self.token}));
        page
    }

    pub fn connect(&self, host: &str, origin: &str) -> Result<Page, String> {
        let mut request = format!("ws://127.0.0.1:{}/ws", self.port).into_client_request().unwrap();
        request.headers_mut().insert("Host", host.parse().unwrap());
        request.headers_mut().insert("Origin", origin.parse().unwrap());
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (socket, _) = tungstenite::client(request, stream).map_err(|e| e.to_string())?;
        Ok(Page { socket, last: BTreeMap::new(), acknowledges: true })
    }

    /// The status line and the body of a request.
    pub fn get(&self, path: &str, host: &str) -> (String, String) {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        let (head, body) = text.split_once("\r\n\r\n").expect("a response");
        (head.into(), body.into())
    }

    pub fn signal(&self) {
        assert!(Command::new("kill").args(["-INT", &self.child.id().to_string()]).status().unwrap().success());
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub struct Page {
    pub socket: WebSocket<TcpStream>,
    /// The newest message of each kind.
    pub last: BTreeMap<String, Json>,
    pub acknowledges: bool,
}

/// A picture as the page gets it.
#[derive(Debug, Clone)]
pub struct Picture {
    pub revision: u32,
    pub size: [u32; 2],
    pub samples: u32,
    pub rgb: Vec<f32>,
}

pub enum Received {
    Text(String, Json),
    Picture(Picture),
    Closed(u16),
}

impl Page {
    pub fn say(&mut self, message: &Json) {
        self.socket.send(Message::text(message.to_string())).unwrap();
    }

    pub fn receive(&mut self) -> Received {
        let message = loop {
            match self.socket.read().expect("a message in time") {
                Message::Ping(_) => {}
                message => break message,
            }
        };
        match message {
            Message::Text(text) => {
                let json: Json = serde_json::from_str(&text).unwrap();
                let kind = json["is"].as_str().unwrap().to_string();
                self.last.insert(kind.clone(), json.clone());
                Received::Text(kind, json)
            }
            Message::Binary(bytes) => {
                let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
                assert_eq!(&bytes[..4], b"TGP1");
                let (size, scale) = ([word(12), word(16)], f32::from_bits(word(32)));
                let halves = bytes[40..].chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32() * scale);
                let picture = Picture { revision: word(8), size, samples: word(28), rgb: halves.collect() };
                assert_eq!(picture.rgb.len(), 3 * (size[0] * size[1]) as usize);
                if self.acknowledges {
                    self.say(&json!({"do": "ack", "frame": word(4)}));
                }
                Received::Picture(picture)
            }
            Message::Close(frame) => Received::Closed(frame.map_or(1005, |frame| frame.code.into())),
            other => panic!("{other:?}"),
        }
    }

    /// Waits for a message of a kind for which `is_wanted` holds. A message that is not an answer may have arrived before this call.
    pub fn wait(&mut self, kind: &str, is_wanted: impl Fn(&Json) -> bool) -> Json {
        let is_answer = ["pixel", "saved", "problem"].contains(&kind);
        if let Some(json) = self.last.get(kind).filter(|json| !is_answer && is_wanted(json)) {
            return json.clone();
        }
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            match self.receive() {
                Received::Text(is, json) if is == kind && is_wanted(&json) => return json,
                Received::Closed(code) => panic!("closed with {code}"),
                _ => {}
            }
        }
        panic!("no {kind}: {:?}", self.last);
    }

    pub fn wait_for_picture(&mut self, is_wanted: impl Fn(&Picture) -> bool) -> Picture {
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            match self.receive() {
                Received::Picture(picture) if is_wanted(&picture) => return picture,
                Received::Closed(code) => panic!("closed with {code}"),
                _ => {}
            }
        }
        panic!("no picture");
    }

    pub fn wait_for_close(&mut self) -> u16 {
        loop {
            if let Received::Closed(code) = self.receive() {
                return code;
            }
        }
    }

    /// Changes settings and returns the new state.
    pub fn set(&mut self, changes: Json) -> Json {
        self.say(&json!({"do": "set", "changes": changes}));
        let before = self.last.get("state").map_or(0, |state| state["revision"].as_u64().unwrap());
        self.wait("state", |state| state["revision"].as_u64().unwrap() > before)
    }
}

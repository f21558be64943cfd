//! Pages that break the rules of a connection. There is no engine behind the server, so nothing is rendered.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Instant;

use tokio::runtime::{Builder, Runtime};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

use super::super::picture::Picture;
use super::super::server::{self, MAX_MESSAGE};
use super::*;

/// Nothing takes longer than this, even on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

struct Server {
    address: SocketAddr,
    shared: Arc<Shared>,
    _runtime: Runtime,
    _commands: Receiver<Command>,
    _end: watch::Sender<bool>,
}

impl Server {
    fn start(patience: Patience) -> Server {
        let (engine, commands) = sync_channel(1);
        let (end, ended) = watch::channel(false);
        let (board, stop) = (Arc::new(Board::new()), Arc::default());
        let shared = Arc::new(Shared { token: "token".into(), board, engine, stop, ended, patience });
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        runtime.spawn(server::serve(listener, shared.clone()));
        Server { address, shared, _runtime: runtime, _commands: commands, _end: end }
    }

    fn connect(&self) -> WebSocket<TcpStream> {
        let mut request = format!("ws://{}/ws", self.address).into_client_request().unwrap();
        request.headers_mut().insert("Origin", format!("http://{}", self.address).parse().unwrap());
        let stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        tungstenite::client(request, stream).unwrap().0
    }

    /// A connection that has sent the token.
    fn page(&self) -> WebSocket<TcpStream> {
        let mut page = self.connect();
        page.send(Message::text(r#"{"do": "hello", "token": "token"}"#)).unwrap();
        page
    }

    /// Waits until there are this many pages, and no other connections.
    fn wait_for_pages(&self, count: usize) {
        let start = Instant::now();
        while self.shared.board.pages_and_strangers() != [count, 0] {
            assert!(
                start.elapsed() < PATIENCE,
                "{:?} instead of {count} pages",
                self.shared.board.pages_and_strangers()
            );
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

#[test]
fn a_connection_without_the_token_is_closed() {
    let server = Server::start(Patience { hello: Duration::from_millis(200), ..Patience::default() });
    let mut silent = server.connect();
    let Message::Close(Some(frame)) = silent.read().unwrap() else { panic!("the connection is not closed") };
    assert_eq!((u16::from(frame.code), frame.reason.contains("token in time")), (TOO_SLOW, true));
    server.wait_for_pages(0);
}

#[test]
fn a_page_that_sends_too_much_is_dropped() {
    let server = Server::start(Patience::default());
    let mut page = server.page();
    page.send(Message::text("x".repeat(MAX_MESSAGE))).unwrap();
    let Message::Text(text) = page.read().unwrap() else { panic!("no answer") };
    assert!(text.contains("does not understand"), "{text}");
    page.send(Message::text("x".repeat(MAX_MESSAGE + 1))).unwrap();
    server.wait_for_pages(0);
}

#[test]
fn a_page_that_stops_reading_is_dropped() {
    // Far more than waits on the way to the page.
    let (size, values) = ([2000, 1000], 3 * 2000 * 1000);
    let picture = Picture {
        revision: 1,
        size,
        samples: 1,
        samples_of_pixels: vec![],
        mean: vec![1.0; values],
        variance: vec![],
        count: 1,
        responses: vec![],
    };
    let server = Server::start(Patience { send: Duration::from_secs(3), seconds_per_byte: 0.0, ..Patience::default() });
    server.shared.board.picture(picture);
    let mut reads = server.page();
    while !matches!(reads.read().unwrap(), Message::Binary(_)) {}
    let _stuck = server.page();
    server.wait_for_pages(2);
    server.wait_for_pages(1);
    reads.send(Message::text("x")).unwrap();
    assert!(matches!(reads.read().unwrap(), Message::Text(_)), "the page that reads is served");
}

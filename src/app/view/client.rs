//! One connection with a page.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep_until, timeout};

use super::board::Board;
use super::engine::Command;
use super::message::{Change, Layer, Pixel, Report, Request};
use super::picture::BETWEEN_PICTURES;
use super::{Answers, board::Surfaces, stage};

/// A page must send the token within this time.
const HELLO: Duration = Duration::from_secs(5);
/// A page that takes no message for this time is dropped.
const SEND: Duration = Duration::from_secs(20);
/// A page that does not acknowledge a picture for this time is dropped.
const ACK: Duration = Duration::from_secs(60);
/// Messages per second that a page may send, and how many it may send at once.
const RATE: f64 = 100.0;
const BURST: f64 = 200.0;
/// A page that sent more malformed messages than this is dropped.
const MAX_MALFORMED: u32 = 20;
/// Maximum number of answers queued for a page.
const ANSWERS: usize = 64;

const WRONG_TOKEN: u16 = 4401;
const TOO_SLOW: u16 = 4408;
const MALFORMED: u16 = 4400;
const TOO_MANY: u16 = 4429;
const GOING_AWAY: u16 = 1001;

/// What all connections share.
pub struct Shared {
    pub token: String,
    pub board: Arc<Board>,
    pub engine: SyncSender<Command>,
    /// See [`super::engine::Engine::stop`].
    pub stop: Arc<AtomicBool>,
    /// True when the program ends.
    pub ended: watch::Receiver<bool>,
}

/// Why a connection ends.
enum End {
    Close(u16, &'static str),
    /// The page is gone, or takes no messages.
    Gone,
}

/// Serves one page until it leaves, breaks a rule, or the program ends.
pub async fn run(mut socket: WebSocket, shared: Arc<Shared>) {
    let _counted = shared.board.count_connection();
    let Err(end) = Client::greet(&mut socket, &shared).await;
    if let End::Close(code, reason) = end {
        let frame = CloseFrame { code, reason: Utf8Bytes::from_static(reason) };
        let _ = timeout(SEND, socket.send(Message::Close(Some(frame)))).await;
    }
}

struct Client<'a> {
    socket: &'a mut WebSocket,
    shared: &'a Shared,
    /// Number of the last publication that was sent as text.
    seen: u64,
    layer: Layer,
    response: u32,
    /// Number of the picture that was sent last. `is_open`: the page has not acknowledged this picture yet.
    frame: u32,
    is_open: bool,
    /// Whether a picture waits because the last one was sent (at time `sent`) too recently.
    is_held_back: bool,
    sent: Option<Instant>,
    /// Publication, layer and response of the picture that was sent last.
    shown: Option<(u64, Layer, u32)>,
    allowance: f64,
    refilled: Instant,
    /// Number of malformed messages so far.
    malformed: u32,
}

impl Client<'_> {
    async fn greet(socket: &mut WebSocket, shared: &Shared) -> Result<std::convert::Infallible, End> {
        let hello = match timeout(HELLO, socket.recv()).await {
            Ok(Some(Ok(Message::Text(text)))) => Request::parse(&text),
            Ok(Some(Ok(_))) => Err(String::new()),
            Ok(_) => return Err(End::Gone),
            Err(_) => return Err(End::Close(TOO_SLOW, "the page did not send its token in time")),
        };
        match hello {
            Ok(Request::Hello { token }) if is_same(&token, &shared.token) => {}
            _ => return Err(End::Close(WRONG_TOKEN, "wrong token")),
        }
        let now = Instant::now();
        let mut client = Client {
            socket,
            shared,
            seen: 0,
            layer: Layer::Mean,
            response: 0,
            frame: 0,
            is_open: false,
            is_held_back: false,
            sent: None,
            shown: None,
            allowance: BURST,
            refilled: now,
            malformed: 0,
        };
        client.serve().await
    }

    async fn serve(&mut self) -> Result<std::convert::Infallible, End> {
        let _counted = self.shared.board.count_page();
        let (sender, mut answers) = mpsc::channel(ANSWERS);
        let answers_of_page = Answers(sender);
        let mut published = self.shared.board.subscribe();
        published.mark_changed();
        let mut ended = self.shared.ended.clone();
        loop {
            let wake = self.wake();
            tokio::select! {
                message = self.socket.recv() => self.receive(message, &answers_of_page).await?,
                Some(answer) = answers.recv() => self.send_text(answer).await?,
                _ = published.changed() => {
                    published.mark_unchanged();
                    self.send_texts().await?;
                    self.send_picture().await?;
                }
                () = sleep_until(wake) => {
                    if self.is_open && self.sent.is_some_and(|sent| sent.elapsed() >= ACK) {
                        return Err(End::Close(TOO_SLOW, "the page is too slow"));
                    }
                    self.send_picture().await?;
                }
                _ = ended.changed() => return Err(End::Close(GOING_AWAY, "the program ends")),
            }
        }
    }

    /// When to check the connection again if no message arrives.
    fn wake(&self) -> Instant {
        match self.sent {
            Some(sent) if self.is_open => sent + ACK,
            Some(sent) if self.is_held_back => sent + BETWEEN_PICTURES,
            _ => Instant::now() + ACK,
        }
    }

    async fn receive(&mut self, message: Option<Result<Message, axum::Error>>, page: &Answers) -> Result<(), End> {
        let text = match message {
            None | Some(Err(_)) | Some(Ok(Message::Close(_))) => return Err(End::Gone),
            Some(Ok(Message::Text(text))) => text,
            Some(Ok(Message::Binary(_))) => Utf8Bytes::default(),
            Some(Ok(Message::Ping(_) | Message::Pong(_))) => return self.count_message(),
        };
        self.count_message()?;
        match Request::parse(&text) {
            Err(message) => {
                self.malformed += 1;
                if self.malformed > MAX_MALFORMED {
                    return Err(End::Close(MALFORMED, "the page sends messages that the program does not know"));
                }
                page.send(&Report::Problem { message });
            }
            Ok(Request::Hello { .. }) => {}
            Ok(Request::Ack { frame }) => {
                if frame == self.frame {
                    self.is_open = false;
                    self.send_picture().await?;
                }
            }
            Ok(Request::Show { layer, response }) => {
                (self.layer, self.response) = (layer, response);
                self.send_picture().await?;
            }
            Ok(Request::Pixel { x, y }) => {
                if let Some(pixel) = self.pixel([x, y]) {
                    page.send(&Report::Pixel(pixel));
                }
            }
            Ok(Request::Pause { on }) => drop(self.command(Command::Pause(on), page)),
            Ok(Request::Save { name }) => drop(self.command(Command::Save { name, page: page.clone() }, page)),
            Ok(Request::Set { changes }) => self.set(changes, page),
        }
        Ok(())
    }

    /// Limits the rate of messages.
    fn count_message(&mut self) -> Result<(), End> {
        let now = Instant::now();
        self.allowance = (self.allowance + RATE * (now - self.refilled).as_secs_f64()).min(BURST) - 1.0;
        self.refilled = now;
        if self.allowance < 0.0 { Err(End::Close(TOO_MANY, "the page sends too many messages")) } else { Ok(()) }
    }

    /// Passes changes to the engine and asks it to end the present iteration. Changes with a typing error are refused and end nothing.
    fn set(&self, changes: BTreeMap<String, Change>, page: &Answers) {
        if let Some(error) = stage::typing_error(&changes) {
            return page.send(&Report::Problem { message: error.to_string() });
        }
        if self.command(Command::Set { changes, page: page.clone() }, page) {
            self.shared.stop.store(true, Ordering::SeqCst);
        }
    }

    /// Sends a command to the engine. Returns false if the queue is full or the engine is gone.
    fn command(&self, command: Command, page: &Answers) -> bool {
        let sent = self.shared.engine.try_send(command);
        if let Err(TrySendError::Full(_)) = sent {
            let message = "the renderer is busy with earlier changes, so this one was dropped; repeat it".into();
            page.send(&Report::Problem { message });
        }
        sent.is_ok()
    }

    /// Sends the messages that are newer than those sent before.
    async fn send_texts(&mut self) -> Result<(), End> {
        let number = self.shared.board.count();
        for text in self.shared.board.texts_after(self.seen) {
            self.send_text(text).await?;
        }
        self.seen = number;
        Ok(())
    }

    /// Sends the newest picture if the page does not have it, has acknowledged the last one, and got the last one long enough ago.
    async fn send_picture(&mut self) -> Result<(), End> {
        self.is_held_back = !self.is_open && self.sent.is_some_and(|sent| sent.elapsed() < BETWEEN_PICTURES);
        if self.is_open || self.is_held_back {
            return Ok(());
        }
        let Some((number, picture)) = self.shared.board.newest_picture() else { return Ok(()) };
        let shown = (number, self.layer, self.response);
        if self.shown == Some(shown) {
            return Ok(());
        }
        // The page must know the settings of the picture before the picture.
        self.send_texts().await?;
        self.frame = self.frame.wrapping_add(1);
        let (frame, layer, response) = (self.frame, self.layer, self.response);
        // Encoding a large picture takes some milliseconds. Do it on another thread, so that other pages need not wait.
        let message = tokio::task::spawn_blocking(move || picture.encode(frame, layer, response)).await;
        let Ok(message) = message else { return Err(End::Gone) };
        (self.shown, self.sent, self.is_open) = (Some(shown), Some(Instant::now()), true);
        self.send(Message::Binary(Bytes::from(message))).await
    }

    async fn send_text(&mut self, text: Arc<str>) -> Result<(), End> {
        self.send(Message::Text(Utf8Bytes::from(&*text))).await
    }

    async fn send(&mut self, message: Message) -> Result<(), End> {
        match timeout(SEND, self.socket.send(message)).await {
            Ok(Ok(())) => Ok(()),
            _ => Err(End::Gone),
        }
    }

    /// The values of a pixel in the newest picture; `None` outside the image, or without a picture.
    fn pixel(&self, [x, y]: [u32; 2]) -> Option<Pixel> {
        let (_, picture) = self.shared.board.newest_picture()?;
        let (surfaces, resolution) = self.shared.board.newest_surfaces();
        let at = picture.at([x, y], resolution)?;
        let three = |values: &[f32]| [values[at], values[at + 1], values[at + 2]];
        let pixel = y as usize * resolution[0] as usize + x as usize;
        let surface = surfaces.as_ref().and_then(|surfaces| {
            let object = *surfaces.object.get(pixel)?;
            (object != Surfaces::NOTHING).then(|| (surfaces.depth[pixel], surfaces.names[object as usize].clone()))
        });
        let has_error = picture.count == 1 && !picture.variance.is_empty();
        Some(Pixel {
            x,
            y,
            radiance: three(picture.shown(self.response)),
            error: has_error.then(|| three(&picture.variance).map(f32::sqrt)),
            samples: picture.samples,
            depth: surface.as_ref().map(|(depth, _)| *depth),
            object: surface.map(|(_, object)| object),
            histogram: picture.histogram(at),
        })
    }
}

/// Compares tokens in a time that does not depend on where they differ.
fn is_same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

//! One connection with a page.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::future::poll_fn;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::task::Poll;
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket};
use futures_util::{SinkExt, StreamExt};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep_until, timeout};

use super::board::Board;
use super::engine::Command;
use super::message::{Change, Layer, Pixel, Report, Request};
use super::picture::BETWEEN_FRAMES;
use super::{Answers, board::Surfaces, viewed_scene};

/// How long the program waits for a page.
pub struct Patience {
    /// A page must send the token within this time.
    pub hello: Duration,
    /// A page that does not take what was sent within this time, plus `seconds_per_byte`, is dropped.
    pub send: Duration,
    /// Seconds that the slowest link with pictures takes for a byte.
    pub seconds_per_byte: f64,
}

impl Default for Patience {
    fn default() -> Patience {
        // The slowest link has 0.5 Mbit/s. Also in link.js.
        Patience { hello: Duration::from_secs(5), send: Duration::from_secs(20), seconds_per_byte: 8.0 / 0.5e6 }
    }
}

/// A page that does not acknowledge a picture within this time, plus [`Patience::seconds_per_byte`], is dropped. After the program has
/// sent a picture, much of it may still wait on the way.
const ACK: Duration = Duration::from_secs(60);
/// A larger picture is announced, so that the page does not take the connection for dead while the picture arrives.
const LARGE: usize = 1 << 20;
/// If nothing was sent for this time, a sign of life is sent.
const PULSE: Duration = Duration::from_secs(30);
/// A page from which nothing comes for this time, not even answers to signs of life, is dropped.
const SILENCE: Duration = Duration::from_secs(90);
/// Messages per second that are read from a page, and how many may come at once. Further messages wait. A page that moves sends 33 changes,
/// and acknowledges as many pictures.
const RATE: f64 = 100.0;
const BURST: f64 = 200.0;
/// A page that sent more malformed messages than this is dropped.
const MAX_MALFORMED: u32 = 20;
/// Maximum number of answers queued for a page.
const ANSWERS: usize = 64;

const WRONG_TOKEN: u16 = 4401;
const TOO_SLOW: u16 = 4408;
const MALFORMED: u16 = 4400;
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
    pub patience: Patience,
}

/// Why a connection ends.
enum End {
    Close(u16, &'static str),
    /// The page is gone, or takes no messages.
    Gone,
}

/// What happens on a connection.
enum Event {
    Received(Option<Result<Message, axum::Error>>),
    Sent,
}

/// Serves one page until it leaves, breaks a rule, or the program ends.
pub async fn run(mut socket: WebSocket, shared: Arc<Shared>) {
    let _counted = shared.board.count_connection();
    let Err(end) = Client::greet(&mut socket, &shared).await;
    if let End::Close(code, reason) = end {
        let frame = CloseFrame { code, reason: Utf8Bytes::from_static(reason) };
        let _ = timeout(shared.patience.send, socket.send(Message::Close(Some(frame)))).await;
    }
}

struct Client<'a> {
    socket: &'a mut WebSocket,
    shared: &'a Shared,
    /// Number of the last publication that was sent as text.
    seen: u64,
    layer: Layer,
    response: u32,
    /// Number of the picture that was sent last. `open`: until when the page must acknowledge it; `None` if it has done so.
    frame: u32,
    open: Option<Instant>,
    /// Whether a picture waits because the last one was sent (at time `sent`) too recently.
    is_held_back: bool,
    sent: Option<Instant>,
    /// Until when the page must take the messages that are on their way; `None` if there are none.
    sending: Option<Instant>,
    /// When messages were sent or received last.
    spoken: Instant,
    heard: Instant,
    /// Publication, layer and response of the picture that was sent last.
    shown: Option<(u64, Layer, u32)>,
    allowance: f64,
    refilled: Instant,
    /// Number of malformed messages so far.
    malformed: u32,
}

impl Client<'_> {
    async fn greet(socket: &mut WebSocket, shared: &Shared) -> Result<std::convert::Infallible, End> {
        let hello = match timeout(shared.patience.hello, socket.recv()).await {
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
            open: None,
            is_held_back: false,
            sent: None,
            sending: None,
            spoken: now,
            heard: now,
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
            let (wake, is_idle) = (self.wake(), self.sending.is_none());
            tokio::select! {
                event = self.event() => match event? {
                    Event::Received(message) => self.receive(message, &answers_of_page)?,
                    Event::Sent => self.sending = None,
                },
                Some(answer) = answers.recv(), if is_idle => {
                    // The page must know the settings before the answer to their change.
                    self.send_texts().await?;
                    self.send_text(answer).await?;
                }
                _ = published.changed(), if is_idle => {}
                () = sleep_until(wake) => self.check_times().await?,
                _ = ended.changed() => return Err(End::Close(GOING_AWAY, "the program ends")),
            }
            if self.sending.is_none() {
                self.send_texts().await?;
                self.send_picture().await?;
            }
        }
    }

    /// Waits until everything is sent, or a message arrives. It can be dropped at any time. Reading goes on while a large picture is on
    /// its way, so the page can change settings meanwhile.
    async fn event(&mut self) -> Result<Event, End> {
        let (is_sending, may_read) = (self.sending.is_some(), self.may_read_from() <= Instant::now());
        poll_fn(|context| {
            if is_sending && let Poll::Ready(sent) = self.socket.poll_flush_unpin(context) {
                return Poll::Ready(sent.map(|()| Event::Sent).map_err(|_| End::Gone));
            }
            if !may_read {
                return Poll::Pending;
            }
            self.socket.poll_next_unpin(context).map(|message| Ok(Event::Received(message)))
        })
        .await
    }

    /// When the next message of the page may be read.
    fn may_read_from(&self) -> Instant {
        self.refilled + Duration::from_secs_f64((1.0 - self.allowance).max(0.0) / RATE)
    }

    /// When to check the connection again if no message arrives.
    fn wake(&self) -> Instant {
        let now = Instant::now();
        let read = Some(self.may_read_from()).filter(|time| *time > now);
        let next = match self.sending {
            Some(until) => [Some(until), None, None],
            None => [
                Some(self.spoken + PULSE),
                Some(self.open.unwrap_or(self.heard + SILENCE)),
                self.sent.filter(|_| self.is_held_back).map(|sent| sent + BETWEEN_FRAMES),
            ],
        };
        next.into_iter().chain([read]).flatten().min().unwrap_or(now)
    }

    /// Ends the connection if the page is too slow or silent, and shows it a sign of life from time to time.
    async fn check_times(&mut self) -> Result<(), End> {
        let now = Instant::now();
        if let Some(until) = self.sending {
            return if now < until { Ok(()) } else { Err(End::Gone) };
        }
        if self.open.is_some_and(|until| now >= until) {
            return Err(End::Close(TOO_SLOW, "the page is too slow"));
        }
        // While a picture is on its way, so may be the last sign of life.
        if self.open.is_none() && now >= self.heard + SILENCE {
            return Err(End::Gone);
        }
        if now >= self.spoken + PULSE {
            // The browser answers the ping, and hides it from the page.
            self.send(Message::Ping(Bytes::new())).await?;
            self.send_text(Report::Alive { bytes: 0 }.to_json().into()).await?;
        }
        Ok(())
    }

    fn receive(&mut self, message: Option<Result<Message, axum::Error>>, page: &Answers) -> Result<(), End> {
        self.heard = Instant::now();
        self.count_message();
        let text = match message {
            None | Some(Err(_)) | Some(Ok(Message::Close(_))) => return Err(End::Gone),
            Some(Ok(Message::Text(text))) => text,
            Some(Ok(Message::Binary(_))) => Utf8Bytes::default(),
            Some(Ok(Message::Ping(_) | Message::Pong(_))) => return Ok(()),
        };
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
                    self.open = None;
                }
            }
            Ok(Request::Show { layer, response }) => (self.layer, self.response) = (layer, response),
            Ok(Request::Pixel { x, y }) => {
                if let Some(pixel) = self.pixel([x, y]) {
                    page.send(&Report::Pixel(pixel));
                }
            }
            Ok(Request::Pause { on }) => drop(self.command(Command::Pause(on), page)),
            Ok(Request::Save { name }) => drop(self.command(Command::Save { name, page: page.clone() }, page)),
            Ok(Request::Set { changes, number }) => self.set(changes, number, page),
        }
        Ok(())
    }

    /// Counts a message, to limit their rate. After a stall of the link, many may come at once.
    fn count_message(&mut self) {
        let now = Instant::now();
        self.allowance = (self.allowance + RATE * (now - self.refilled).as_secs_f64()).min(BURST) - 1.0;
        self.refilled = now;
    }

    /// Passes changes to the engine and asks it to end the present iteration. Changes with a typing error are refused and end nothing.
    fn set(&self, changes: BTreeMap<String, Change>, number: u32, page: &Answers) {
        let error = viewed_scene::typing_error(&changes);
        if let Some(error) = &error {
            page.send(&Report::Problem { message: error.to_string() });
        }
        if error.is_none() && self.command(Command::Set { changes, number, page: page.clone() }, page) {
            self.shared.stop.store(true, Ordering::SeqCst);
        } else {
            page.send(&Report::Answered { number });
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
        self.is_held_back = self.open.is_none() && self.sent.is_some_and(|sent| sent.elapsed() < BETWEEN_FRAMES);
        if self.open.is_some() || self.is_held_back {
            return Ok(());
        }
        let Some((number, picture)) = self.shared.board.newest_picture() else { return Ok(()) };
        let (surfaces, full) = self.shared.board.newest_surfaces();
        let is_of_surfaces = matches!(self.layer, Layer::Depth | Layer::Normal);
        // Until the surfaces are known, the page sees the radiance.
        let layer = if is_of_surfaces && surfaces.is_none() { Layer::Mean } else { self.layer };
        let shown = (number, layer, self.response);
        if self.shown == Some(shown) {
            return Ok(());
        }
        // The page must know the settings of the picture before the picture.
        self.send_texts().await?;
        self.frame = self.frame.wrapping_add(1);
        let (frame, response) = (self.frame, self.response);
        // Encoding a large picture takes some milliseconds. Do it on another thread, so that other pages need not wait.
        let message =
            tokio::task::spawn_blocking(move || picture.encode(frame, layer, response, (surfaces.as_deref(), full)))
                .await;
        let Ok(message) = message else { return Err(End::Gone) };
        let bytes = message.len();
        if bytes > LARGE {
            self.send_text(Report::Alive { bytes }.to_json().into()).await?;
        }
        self.send(Message::Binary(Bytes::from(message))).await?;
        (self.shown, self.sent) = (Some(shown), Some(Instant::now()));
        self.open = self.sending.map(|until| until + ACK);
        Ok(())
    }

    async fn send_text(&mut self, text: Arc<str>) -> Result<(), End> {
        self.send(Message::Text(Utf8Bytes::from(&*text))).await
    }

    /// Puts a message on its way after those that are on their way. [`Client::event`] sends them.
    async fn send(&mut self, message: Message) -> Result<(), End> {
        let bytes = match &message {
            Message::Binary(bytes) => bytes.len(),
            _ => 0,
        };
        let now = Instant::now();
        self.spoken = now;
        let Patience { send, seconds_per_byte, .. } = self.shared.patience;
        let least = now + send + Duration::from_secs_f64(bytes as f64 * seconds_per_byte);
        self.sending = Some(self.sending.map_or(least, |until| until.max(least)));
        match timeout(send, self.socket.feed(message)).await {
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
            revision: picture.revision,
            response: picture.response_shown(Layer::Mean, self.response),
            radiance: three(picture.shown(self.response)),
            error: has_error.then(|| three(&picture.variance).map(f32::sqrt)),
            samples: picture.samples_at(at),
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

//! `taugate view`: renders a scene, and serves a page on which the user watches it converge and changes its settings.

mod board;
mod client;
mod describe;
mod engine;
mod measure;
mod message;
mod page;
mod picture;
mod renderers;
mod save;
mod server;
mod signpost;
mod viewed_scene;

use std::collections::VecDeque;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::{Duration, Instant};

use anyhow::Context;
use taugate::Error;
use taugate::internals::gpu::Device;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::named;
use taugate::internals::job::read;
use taugate::internals::settings::moment::Moment;
use taugate::internals::tev::TevStream;
use taugate::internals::threads;
use tokio::sync::{mpsc, watch};

use super::interrupts::{Interrupt, Interrupts};
use crate::app::cli::ViewArgs;
use board::Board;
use client::{Patience, Shared};
use engine::{Command, Engine, Work};
use message::Report;
use signpost::Signpost;
use viewed_scene::ViewedScene;

/// Maximum number of commands that wait for the engine.
const INBOX: usize = 256;
/// Time between two checks for an interrupt, and between two checks whether all pages are gone.
const POLL: Duration = Duration::from_millis(50);
/// Time that pages get to take their last message.
const GOODBYE: Duration = Duration::from_secs(1);

/// Where answers to one page go.
#[derive(Clone)]
pub struct Answers(mpsc::Sender<Arc<str>>);

impl Answers {
    /// Sends an answer. Drops the answer if the page is gone or its queue is full.
    pub fn send(&self, report: &Report) {
        let _ = self.0.try_send(report.to_json().into());
    }
}

pub fn run(args: ViewArgs) -> anyhow::Result<ExitCode> {
    let ViewArgs { input, flags, listen, open, save_to } = args;
    let mut experiment = read::experiment(input.clone(), flags.0)?;
    experiment.check_paths()?;
    let tev = experiment.output.tev.take();
    let left_out = reduce(&mut experiment)?;
    let is_whole = left_out.is_empty();
    if !is_whole {
        super::say(&format!("note: the viewer leaves out {}", left_out.join(", ")));
    }
    let folder = save_to.canonicalize().with_context(|| format!("the folder {} of --save-to", save_to.display()))?;
    if !folder.is_dir() {
        return Err(Error::settings(format!("--save-to {} is no folder", save_to.display())).into());
    }

    let interrupts = Interrupts::new()?;
    interrupts.end_the_process_at(Interrupt::First);
    let listener = server::bind(listen)?;
    let address = listener.local_addr()?;
    let viewed = ViewedScene::new(experiment)?;
    let device = Device::open(viewed.start().render.device.as_deref())?;
    let token = token()?;

    let (sender, inbox) = sync_channel(INBOX);
    let engine = Engine {
        device,
        viewed,
        board: Arc::new(Board::new()),
        inbox,
        sender: sender.clone(),
        waiting: VecDeque::new(),
        unanswered: vec![],
        stop: Arc::default(),
        input,
        is_whole,
        folder,
        tev: tev.map(TevStream::new),
        work: Work::default(),
    };

    let url = url(address, &token);
    super::print(&format!("{url}\n"))?;
    explain(address);
    // From now on, only the second interrupt ends the process at once. After the first, the program removes the signpost and ends.
    interrupts.end_the_process_at(Interrupt::Second);
    let signpost = if open { open_page(&url) } else { None };

    serve_until_interrupt(engine, sender, token, listener, &interrupts, signpost)?;
    Ok(ExitCode::SUCCESS)
}

/// Opens the page at `url` in a browser, by way of a signpost. The program cannot know when the browser has read the signpost. So the
/// caller keeps the signpost until the program ends.
fn open_page(url: &str) -> Option<Signpost> {
    let opened = Signpost::to(url).and_then(|signpost| {
        open::that_detached(signpost.path())?;
        Ok(signpost)
    });
    opened
        .inspect_err(|e| super::say(&format!("warning: no browser could be opened ({e}); open the address yourself")))
        .ok()
}

/// Renders and serves pages until Ctrl-C, then removes the signpost. Fails if the render thread panics or the server fails.
fn serve_until_interrupt(
    engine: Engine,
    sender: SyncSender<Command>,
    token: String,
    listener: TcpListener,
    interrupts: &Interrupts,
    signpost: Option<Signpost>,
) -> anyhow::Result<()> {
    let (end, ended) = watch::channel(false);
    let (board, stop) = (engine.board.clone(), engine.stop.clone());
    let shared = Arc::new(Shared {
        token,
        board: board.clone(),
        engine: sender.clone(),
        stop: stop.clone(),
        ended,
        patience: Patience::default(),
    });
    let is_over = Arc::new(AtomicBool::new(false));
    let over = OnDrop(is_over.clone());
    // The thread `render`, and those of Tokio, which panics if it cannot start its thread or the first one for pictures.
    threads::check(3)?;
    let rendering = threads::spawn("render", move || {
        // Without the engine the pages would wait for ever. So the server ends when the engine does, even after a panic.
        let _over = over;
        engine.run();
    })?;
    let interrupted = interrupts.stop.clone();
    let until = async move {
        while !interrupted.load(Ordering::Relaxed) && !is_over.load(Ordering::Relaxed) {
            tokio::time::sleep(POLL).await;
        }
        // Remove the signpost before waiting for the pages: a second interrupt would end the process and leave the file behind.
        drop(signpost);
        let _ = end.send(true);
        // Give the pages some time to receive their last message.
        let start = Instant::now();
        while board.pages_and_strangers() != [0, 0] && start.elapsed() < GOODBYE {
            tokio::time::sleep(POLL).await;
        }
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let served = runtime.block_on(async {
        tokio::select! {
            served = server::serve(listener, shared) => served,
            () = until => Ok(()),
        }
    });
    runtime.shutdown_timeout(GOODBYE);
    let _ = sender.send(Command::End);
    stop.store(true, Ordering::SeqCst);
    anyhow::ensure!(rendering.join().is_ok(), "the render stopped because of a defect of taugate");
    served.context("the server failed")
}

/// Sets a flag when it is dropped.
struct OnDrop(Arc<AtomicBool>);

impl Drop for OnDrop {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Removes the settings that the viewer does not support. Returns their names, except `output`. Fails for a scan.
fn reduce(experiment: &mut Experiment) -> Result<Vec<&'static str>, Error> {
    if experiment.scan.is_some() {
        let message = "a scan has no picture to watch; render it with taugate render";
        return Err(Error::settings(message));
    }
    let before = named::as_texts(experiment);
    experiment.output = Default::default();
    experiment.gate.gate_keys = None;
    experiment.camera.crop = None;
    (experiment.render.doppler, experiment.gate.fmcw) = (None, None);
    // The middle of the exposure stays.
    experiment.input.at = experiment.input.moment().map(Moment);
    (experiment.input.shutter, experiment.input.rolling, experiment.gate.heterodyne) = (None, None, None);
    let after = named::as_texts(experiment);
    Ok(before.into_keys().filter(|name| !after.contains_key(name) && *name != "output").collect())
}

/// 128 random bits in hexadecimal digits.
fn token() -> anyhow::Result<String> {
    let mut bytes = [0u8; 16];
    getrandom::fill(&mut bytes)
        .map_err(|e| anyhow::anyhow!("the system gives no random numbers for the token: {e}"))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The address of the page. The token comes after the `#`, which browsers do not send to servers.
fn url(address: SocketAddr, token: &str) -> String {
    format!("http://{}/#{token}", reachable(address))
}

/// An address at which this machine reaches a listener at `address`. It is an IP address, because a browser could resolve `localhost`
/// to the other IP version. Another user may listen there, and a page from there could read the token.
fn reachable(mut address: SocketAddr) -> SocketAddr {
    if address.ip().is_unspecified() {
        address.set_ip(if address.is_ipv4() { Ipv4Addr::LOCALHOST.into() } else { Ipv6Addr::LOCALHOST.into() });
    }
    address
}

/// Tells the user how to go on, and what it means to listen on other addresses.
fn explain(address: SocketAddr) {
    super::say("open this address in a browser; Ctrl-C ends the program");
    if !address.ip().is_loopback() {
        super::say(&format!(
            "warning: {address} can be reached from other machines: whoever has the address of the page sees and changes this render, \
             and nothing is encrypted; prefer ssh -L {}:{}",
            address.port(),
            reachable(address)
        ));
    }
    if address.ip().is_unspecified() {
        super::say(&format!(
            "on another machine, write the IP address of this machine instead of {}",
            reachable(address).ip()
        ));
    }
}

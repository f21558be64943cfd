//! The engine publishes the newest message of each kind, the newest picture and the surfaces here; every page reads them.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

use super::message::Report;
use super::picture::Picture;

/// A kind of message of which only the newest one matters. They are sent in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Topic {
    Welcome,
    State,
    Failed,
    Progress,
    Arrivals,
}

const TOPICS: usize = Topic::Arrivals as usize + 1;

/// The surfaces that the pixels show.
pub struct Surfaces {
    /// Length of the camera ray in metres per pixel of the whole image, row-major; 0 without a surface.
    pub depth: Vec<f32>,
    /// Unit normal per pixel of the whole image, row-major, on the side of the camera; 0 without a surface.
    pub normal: Vec<[f32; 3]>,
    /// Index into `names` of the object per pixel of the whole image, row-major; [`Surfaces::NOTHING`] without a surface.
    pub object: Vec<u32>,
    pub names: Vec<String>,
}

impl Surfaces {
    pub const NOTHING: u32 = u32::MAX;
}

#[derive(Default)]
struct Newest {
    /// Number of the publication, and the message as JSON.
    texts: [Option<(u64, Arc<str>)>; TOPICS],
    picture: Option<(u64, Arc<Picture>)>,
    surfaces: Option<Arc<Surfaces>>,
    /// Size of the whole image in pixels.
    resolution: [u32; 2],
}

/// The board. The engine publishes, connections read.
pub struct Board {
    newest: Mutex<Newest>,
    count: watch::Sender<u64>,
    pages: AtomicUsize,
    connections: AtomicUsize,
}

impl Board {
    pub fn new() -> Board {
        let none = || AtomicUsize::new(0);
        Board { newest: Mutex::default(), count: watch::Sender::new(0), pages: none(), connections: none() }
    }

    fn lock(&self) -> MutexGuard<'_, Newest> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the board and tells all pages.
    fn publish(&self, change: impl FnOnce(&mut Newest, u64)) {
        let number = *self.count.borrow() + 1;
        change(&mut self.lock(), number);
        self.count.send_replace(number);
    }

    pub fn report(&self, topic: Topic, report: &Report) {
        let text: Arc<str> = report.to_json().into();
        self.publish(|newest, number| newest.texts[topic as usize] = Some((number, text)));
    }

    /// Publishes the settings. `is_new`: they differ from the last ones, so the last failure is cleared. `keeps_surfaces`: the
    /// scene, the camera and the resolution are the same. Otherwise the surfaces are cleared.
    pub fn state(&self, report: &Report, resolution: [u32; 2], is_new: bool, keeps_surfaces: bool) {
        let text: Arc<str> = report.to_json().into();
        self.publish(|newest, number| {
            newest.texts[Topic::State as usize] = Some((number, text));
            if is_new {
                newest.texts[Topic::Failed as usize] = None;
            }
            newest.resolution = resolution;
            if !keeps_surfaces {
                newest.surfaces = None;
            }
        });
    }

    pub fn picture(&self, picture: Picture) {
        self.publish(|newest, number| newest.picture = Some((number, Arc::new(picture))));
    }

    /// Keeps the surfaces. Pages that wait for depths or normals get their picture.
    pub fn surfaces(&self, surfaces: Surfaces) {
        self.publish(|newest, _| newest.surfaces = Some(Arc::new(surfaces)));
    }

    /// Number of publications so far.
    pub fn count(&self) -> u64 {
        *self.count.borrow()
    }

    /// Notified after each publication.
    pub fn subscribe(&self) -> watch::Receiver<u64> {
        self.count.subscribe()
    }

    /// The messages that are newer than publication `after`, in the order of [`Topic`].
    pub fn texts_after(&self, after: u64) -> Vec<Arc<str>> {
        let newest = self.lock();
        let newer = newest.texts.iter().flatten().filter(|(number, _)| *number > after);
        newer.map(|(_, text)| text.clone()).collect()
    }

    /// The newest picture with the number of its publication.
    pub fn newest_picture(&self) -> Option<(u64, Arc<Picture>)> {
        self.lock().picture.clone()
    }

    /// The surfaces of the present camera, if they are known, and the size of the whole image.
    pub fn newest_surfaces(&self) -> (Option<Arc<Surfaces>>, [u32; 2]) {
        let newest = self.lock();
        (newest.surfaces.clone(), newest.resolution)
    }

    /// Whether a page is connected. Otherwise the engine makes pictures less often.
    pub fn has_pages(&self) -> bool {
        self.pages.load(Ordering::Relaxed) > 0
    }

    /// Number of pages, and of other connections: those that have not sent the token yet, or that are being closed.
    pub fn pages_and_strangers(&self) -> [usize; 2] {
        let (pages, all) = (self.pages.load(Ordering::Relaxed), self.connections.load(Ordering::Relaxed));
        [pages, all.saturating_sub(pages)]
    }

    /// Counts a page until the guard is dropped.
    pub fn count_page(&self) -> Counted<'_> {
        Counted::new(&self.pages)
    }

    /// Counts a connection until the guard is dropped.
    pub fn count_connection(&self) -> Counted<'_> {
        Counted::new(&self.connections)
    }
}

/// Guard of [`Board::count_page`] and [`Board::count_connection`].
pub struct Counted<'a>(&'a AtomicUsize);

impl Counted<'_> {
    fn new(count: &AtomicUsize) -> Counted<'_> {
        count.fetch_add(1, Ordering::Relaxed);
        Counted(count)
    }
}

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

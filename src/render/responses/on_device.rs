//! The images of several responses, kept by the device. The kernels are in `add_arrivals.wgsl` and `sum_responses.wgsl`. The host has a
//! copy, which is made when somebody looks, and from time to time for the case that the device is lost.

mod objects;

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::weights::Weights;
use super::{Arrival, Undone};
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, BufferDesc, BufferList, Device, DeviceInfo, Kernel, Recorder};
use crate::image::response_film::ResponseFilm;
use crate::render::compaction::indirect_over;
use crate::render::plan::{Observe, Plan};
use crate::render::sensor::MIN_GROUP_LIMIT;
use crate::render::stats::Stats;
use crate::wgsl::layout::{Dispatch, NONE, SensorContribution};
pub use objects::ENTRIES;
use objects::{Buffers, Objects, dispatch_over};

/// Fewest pixels of images on the device. One thread adds the light of a pixel, so fewer would leave most of a card idle (not measured).
const MIN_PIXELS: u64 = 1 << 10;
/// The images take at most this part of the device's memory.
const HEAP_PART: u64 = 4;
/// The host copies the images when this many times the duration of the last copy has passed, and at least this time. Before the first copy,
/// its duration follows from the bytes per second, of which a bus has at least so many.
const PAUSE: u32 = 20;
const MIN_PAUSE: Duration = Duration::from_millis(250);
const BYTES_PER_SECOND: f64 = 4e9;

/// Whether the device keeps the images of `plan`. It needs 64-bit numbers, memory, and gates with sharp edges that ascend and do not
/// overlap. It must be driven as a card: a CPU gains nothing.
pub fn is_suited(info: &DeviceInfo, plan: &Plan) -> bool {
    let fits = || {
        let descs = DeviceFilm::buffer_descs(plan);
        let all: u64 = descs.iter().map(|desc| desc.bytes).sum();
        let are_bound = descs.iter().all(|desc| desc.bytes <= info.largest_buffer());
        are_bound && all <= info.heap_bytes / HEAP_PART && values(plan) < 1 << 31
    };
    let is_wanted = plan.tuning.device_film.unwrap_or(plan.image_pixels >= MIN_PIXELS && info.may_keep_images());
    let can = plan.observe == Observe::Responses && info.has_f64;
    can && is_wanted && gates(plan).is_some() && fits()
}

/// Number of values in the images: R, G, B per pixel and response.
fn values(plan: &Plan) -> u64 {
    plan.image_pixels.saturating_mul(3 * plan.responses.len() as u64)
}

/// Begin and end of each gate in render space, if all are boxes that ascend and do not overlap.
fn gates(plan: &Plan) -> Option<Vec<[f32; 2]>> {
    Weights::new(&plan.responses, &plan.space).ascending_boxes().map(<[_]>::to_vec)
}

/// The images of several responses on the device, and the copy of the host.
pub struct DeviceFilm {
    device: Device,
    constants: Vec<(&'static str, f64)>,
    gates: Vec<[f32; 2]>,
    pixels: usize,
    /// Entries of a shade point for the light of photons.
    merged_entries: u32,
    has_variance: bool,
    /// `None` before the first iteration. `is_new`: their images must be cleared first.
    objects: Option<Objects>,
    is_new: bool,
    /// Whether the sums of the present iteration are 0 on the device, as they are between two iterations; and whether they must be cleared.
    is_clean: bool,
    must_clear: bool,
    /// Samples per pixel of the present iteration, on average.
    samples: u32,
    /// Samples per pixel, and number of iterations.
    length: (u64, u32),
    /// The copy, if it has all iterations.
    copy: OnceLock<ResponseFilm>,
    last: Mutex<LastCopy>,
}

/// What is known of the last copy.
struct LastCopy {
    /// The copy, if it lacks iterations.
    stale: Option<ResponseFilm>,
    at: Instant,
    took: Duration,
}

impl DeviceFilm {
    /// Descriptors of the buffers, with variances.
    pub fn buffer_descs(plan: &Plan) -> Vec<BufferDesc> {
        BufferList::of(|list| Buffers::new(list, plan.image_pixels as usize, plan.responses.len(), true))
    }

    /// Black images; see [`is_suited`]. Takes memory of the device from the first iteration on.
    pub fn new(device: &Device, plan: &Plan, has_variance: bool) -> DeviceFilm {
        let (pixels, gates) = (plan.image_pixels as usize, gates(plan).unwrap_or_default());
        let film = ResponseFilm::new(pixels, gates.len(), has_variance);
        let bytes = ResponseFilm::bytes(pixels as u64, gates.len() as u64, has_variance);
        let took = Duration::from_secs_f64(bytes as f64 / BYTES_PER_SECOND);
        DeviceFilm {
            device: device.clone(),
            constants: plan.constants(),
            gates,
            pixels,
            merged_entries: plan.merged_entries(),
            has_variance,
            objects: None,
            is_new: false,
            is_clean: false,
            must_clear: false,
            samples: 0,
            length: (0, 0),
            copy: film.into(),
            last: Mutex::new(LastCopy { stale: None, at: Instant::now(), took }),
        }
    }

    /// Goes on from the images of earlier iterations.
    pub fn resume(&mut self, film: ResponseFilm) {
        self.objects = None;
        self.has_variance = film.has_variance();
        self.length = film.length();
        self.copy = film.into();
    }

    /// Goes on in another scene with the same responses. Returns false, and changes nothing, if the device cannot keep their images: other
    /// units may round other gates to the same ends.
    pub fn follow(&mut self, plan: &Plan) -> Result<bool> {
        let Some(gates) = gates(plan).filter(|gates| gates.len() == self.gates.len()) else { return Ok(false) };
        (self.gates, self.merged_entries) = (gates, plan.merged_entries());
        if let Some(objects) = &mut self.objects {
            objects.buffers.gates.write(0, &self.gates)?;
        }
        Ok(true)
    }

    /// Clears the images, for the responses of `plan`. Returns false, and changes nothing, if they need other buffers.
    pub fn clear(&mut self, plan: &Plan) -> bool {
        let fits = |gates: &Vec<[f32; 2]>| gates.len() == self.gates.len() && plan.image_pixels == self.pixels as u64;
        let Some(gates) = gates(plan).filter(fits) else { return false };
        let objects = self.objects.take();
        *self = DeviceFilm::new(&self.device, plan, self.has_variance);
        (self.gates, self.objects, self.is_new) = (gates, objects, true);
        true
    }

    pub fn has_variance(&self) -> bool {
        self.has_variance
    }

    /// Number of responses.
    pub fn responses(&self) -> usize {
        self.gates.len()
    }

    /// Whether the copy has all iterations.
    pub fn has_copy(&self) -> bool {
        self.copy.get().is_some()
    }

    /// The images. Copies them if the copy lacks iterations, which fails if the device is lost. Only if it gets lost meanwhile, the last
    /// copy is lost, too.
    pub fn film(&self) -> Result<&ResponseFilm> {
        let mut last = self.last();
        if let Some(film) = self.copy.get() {
            return Ok(film);
        }
        let start = Instant::now();
        let objects = self.objects.as_ref();
        // A device that is lost already must not cost the last copy.
        objects.map(|objects| objects.buffers.total.buffer().read::<f32>(0, &mut [0.0])).transpose()?;
        let new = || ResponseFilm::new(self.pixels, self.responses(), self.has_variance);
        let mut film = last.stale.take().unwrap_or_else(new);
        if let Some(Objects { buffers, .. }) = objects {
            let [sums, squares] = film.replace(self.length);
            buffers.sums.read(0, sums)?;
            buffers.squares.read(0, squares)?;
        }
        (last.at, last.took) = (Instant::now(), start.elapsed());
        Ok(self.copy.get_or_init(|| film))
    }

    /// Copies the images if the last copy is old.
    pub fn copy_if_due(&self) -> Result<()> {
        let last = self.last();
        let is_due = last.at.elapsed() >= MIN_PAUSE.max(PAUSE * last.took);
        drop(last);
        if is_due { self.film().map(drop) } else { Ok(()) }
    }

    /// No copy is due any more.
    #[cfg(test)]
    pub fn copy_never(&self) {
        self.last().took = Duration::MAX / (2 * PAUSE);
    }

    /// Ends an iteration that is not complete.
    pub fn restore(&mut self) -> Undone {
        if !self.device.is_lost() || self.has_copy() {
            return Undone::All;
        }
        let stale = self.last().stale.take();
        match stale {
            Some(film) => {
                self.length = film.length();
                self.copy = film.into();
                Undone::ToLastCopy
            }
            None => Undone::Nothing,
        }
    }

    /// Begins an iteration with `samples` samples per pixel on average.
    pub fn begin(&mut self, samples: u32) -> Result<()> {
        self.samples = samples;
        match &mut self.objects {
            None => {
                let film = self.copy.get().expect("images without objects have a copy");
                self.objects = Some(Objects::new(&self.device, &self.constants, &self.gates, film)?);
                self.is_clean = false;
            }
            Some(objects) if self.is_new => {
                objects.buffers.gates.write(0, &self.gates)?;
                objects.clear(3 * self.pixels * self.gates.len(), self.has_variance)?;
            }
            Some(_) => {}
        }
        self.is_new = false;
        self.must_clear = !std::mem::take(&mut self.is_clean);
        Ok(())
    }

    /// Records the splats of a part of the iteration, before its other light.
    pub fn add_splats(&mut self, mut splats: Vec<Arrival>, recorder: &mut Recorder) -> Result<()> {
        let (values, constants) = (3 * self.pixels * self.responses(), self.dispatch());
        let Objects { kernels: k, buffers, splats: buffer, .. } =
            self.objects.as_mut().expect("an iteration has begun");
        if std::mem::take(&mut self.must_clear) {
            dispatch_over(recorder, &k.clear_present, buffers, Dispatch { count: values as u32, ..constants })?;
        }
        splats.par_sort_by_key(|splat| splat.pixel);
        let entry = |&Arrival { pixel, tau, rgb: [red, green, blue] }: &Arrival| SensorContribution {
            red,
            green,
            blue,
            detail: tau,
            path: pixel,
            vertex: NONE,
        };
        let entries: Vec<SensorContribution> = splats.iter().map(entry).collect();
        if buffer.size() < size_of_val(&entries[..]) as u64 {
            let most = self.device.info().largest_buffer() / size_of::<SensorContribution>() as u64;
            let count = entries.len().next_power_of_two().min(most as usize).max(entries.len());
            *buffer = Buffer::new::<SensorContribution>(&self.device, "splats", count, "use fewer --splat-paths")?;
        }
        buffer.write(0, &entries)?;
        let bound = k.splats.bind(&[&buffers.bindings()[..], &[("observed", buffer)]].concat())?;
        let (count, groups) = (entries.len() as u32, k.splats.groups(entries.len()).min(MIN_GROUP_LIMIT));
        recorder.dispatch("add_arrivals", &k.splats, &bound, &Dispatch { count, ..constants }, groups)
    }

    /// Adds the light of sensor subpaths. `frame` and `tracer`: buffers of their iteration. `offset`: index of the first pixel of the
    /// present part of the image.
    pub fn adding(&self, frame: &Buffer, tracer: &[(&str, &Buffer)], offset: u32) -> Result<Adding> {
        let Objects { kernels, buffers, .. } = self.objects.as_ref().expect("an iteration has begun");
        let bindings = kernels.arrivals.bind(&[tracer, &buffers.bindings(), &[("frame", frame)]].concat())?;
        let constants = Dispatch { first: offset, ..self.dispatch() };
        Ok(Adding { kernel: kernels.arrivals.clone(), bindings, constants, merged_entries: self.merged_entries })
    }

    /// Ends the iteration. Returns the sum over all responses of its images: R, G, B per pixel.
    pub fn end(&mut self, stats: &mut Stats) -> Result<Vec<f32>> {
        let (values, constants) = (3 * self.pixels * self.responses(), self.dispatch());
        let Objects { kernels: k, buffers, recorder, .. } = self.objects.as_mut().expect("an iteration has begun");
        // An iteration in which all is dark has no splats.
        if std::mem::take(&mut self.must_clear) {
            dispatch_over(recorder, &k.clear_present, buffers, Dispatch { count: values as u32, ..constants })?;
        }
        dispatch_over(recorder, &k.total, buffers, Dispatch { count: self.pixels as u32, ..constants })?;
        let add = Dispatch { count: values as u32, rank: self.samples, ..constants };
        dispatch_over(recorder, &k.add, buffers, add)?;
        recorder.read_back(&buffers.total, buffers.total.buffer().size())?;
        stats.submit(recorder)?;
        let total = buffers.total.with(3 * self.pixels, <[f32]>::to_vec)?;
        self.is_clean = true;
        self.length = (self.length.0 + u64::from(self.samples), self.length.1 + 1);
        if let Some(film) = self.copy.take() {
            self.last().stale = Some(film);
        }
        Ok(total)
    }

    /// The constants that all dispatches have.
    fn dispatch(&self) -> Dispatch {
        let counter = self.has_variance.into();
        Dispatch { list_a: self.gates.len() as u32, counter, ..bytemuck::Zeroable::zeroed() }
    }

    fn last(&self) -> MutexGuard<'_, LastCopy> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Adds the light of sensor subpaths to images on the device.
pub struct Adding {
    kernel: Arc<Kernel>,
    bindings: Bindings,
    constants: Dispatch,
    pub merged_entries: u32,
}

impl Adding {
    /// Records the addition of the entries of `list`, each element of which has `entries`. `arguments`: sizes of dispatches over lists.
    pub fn record(&self, recorder: &mut Recorder, arguments: &Buffer, list: u32, entries: u32) -> Result<()> {
        let constants = Dispatch { counter: list, rank: entries, ..self.constants };
        let over = indirect_over(arguments, list);
        recorder.dispatch_indirect("add_arrivals", &self.kernel, &self.bindings, &constants, over)
    }
}

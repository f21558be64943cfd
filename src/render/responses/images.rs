//! The images of several responses, on the host or on the device.

use super::on_device::{self, DeviceFilm};
use super::{Arrival, IndexInTile, ResponseSums, Undone};
use crate::error::{ErrorKind, Result};
use crate::gpu::{Device, Recorder};
use crate::image::response_film::ResponseFilm;
use crate::render::plan::Plan;
use crate::render::stats::{Stats, stage};

/// The images of several responses, and the light of the present iteration that is not in them yet.
pub enum ResponseImages {
    /// The host adds the arrivals that the device lists.
    OnHost(Box<ResponseSums>),
    /// The device adds them.
    OnDevice(Box<DeviceFilm>),
}
use ResponseImages::{OnDevice, OnHost};

impl ResponseImages {
    /// Black images.
    pub fn new(device: &Device, plan: &Plan, has_variance: bool) -> ResponseImages {
        match on_device::is_suited(device.info(), plan) {
            true => OnDevice(DeviceFilm::new(device, plan, has_variance).into()),
            false => OnHost(ResponseSums::new(plan, has_variance).into()),
        }
    }

    /// The images, if they are on the device.
    pub fn on_device(&self) -> Option<&DeviceFilm> {
        match self {
            OnHost(_) => None,
            OnDevice(film) => Some(film),
        }
    }

    /// The images so far. Fails if the device has them and is lost.
    pub fn film(&self) -> Result<&ResponseFilm> {
        match self {
            OnHost(sums) => Ok(sums.film()),
            OnDevice(film) => film.film(),
        }
    }

    /// Number of responses.
    pub fn responses(&self) -> usize {
        match self {
            OnHost(sums) => sums.film().responses(),
            OnDevice(film) => film.responses(),
        }
    }

    pub fn has_variance(&self) -> bool {
        match self {
            OnHost(sums) => sums.film().has_variance(),
            OnDevice(film) => film.has_variance(),
        }
    }

    /// Black images for the responses of `plan`, with variances if there were any.
    pub fn clear(&mut self, device: &Device, plan: &Plan) {
        let is_cleared = match self {
            OnDevice(film) if on_device::is_suited(device.info(), plan) => film.clear(plan),
            _ => false,
        };
        if !is_cleared {
            *self = ResponseImages::new(device, plan, self.has_variance());
        }
    }

    /// Goes on from the images of earlier iterations.
    pub fn resume(&mut self, film: ResponseFilm) {
        match self {
            OnHost(sums) => sums.resume(film),
            OnDevice(own) => own.resume(film),
        }
    }

    /// Goes on in another scene with the same responses.
    pub fn follow(&mut self, plan: &Plan) -> Result<()> {
        if let OnDevice(film) = self {
            if film.follow(plan)? {
                return Ok(());
            }
            self.move_to_host(plan)?;
        }
        if let OnHost(sums) = self {
            sums.follow(plan);
        }
        Ok(())
    }

    /// Turns the phases of a heterodyne sensor. Gates on the device have none.
    pub fn turn_waves(&mut self, turns: f64) {
        if let OnHost(sums) = self {
            sums.turn_waves(turns);
        }
    }

    /// Begins an iteration with `samples` samples per pixel on average. If the device lacks the memory, the host takes the images.
    pub fn begin(&mut self, plan: &Plan, samples: u32) -> Result<()> {
        if let OnDevice(film) = self {
            match film.begin(samples) {
                Err(error) if error.kind() == ErrorKind::Device && film.has_copy() => self.move_to_host(plan)?,
                other => return other,
            }
        }
        if let OnHost(sums) = self {
            sums.begin(samples);
        }
        Ok(())
    }

    fn move_to_host(&mut self, plan: &Plan) -> Result<()> {
        if let OnDevice(film) = self {
            let mut sums = ResponseSums::new(plan, film.has_variance());
            sums.resume(film.film()?.clone());
            *self = OnHost(sums.into());
        }
        Ok(())
    }

    /// Takes the splats of the pixels that are added next. `recorder`: that of the sensor subpaths.
    pub fn set_splats(&mut self, splats: Vec<Arrival>, recorder: &mut Recorder) -> Result<()> {
        match self {
            OnHost(sums) => sums.set_splats(splats),
            OnDevice(film) => film.add_splats(splats, recorder)?,
        }
        Ok(())
    }

    /// Adds what the host has read of the light of a tile; see [`ResponseSums::add`].
    pub fn add(&mut self, pixels: impl FnOnce() -> Vec<u32>, arrivals: &[Vec<Arrival<IndexInTile>>]) {
        if let OnHost(sums) = self {
            sums.add(&pixels(), arrivals);
        }
    }

    /// Ends the iteration. Returns the sum over all responses of its images: R, G, B per pixel.
    pub fn end(&mut self, stats: &mut Stats) -> Result<Vec<f32>> {
        match self {
            OnHost(sums) => Ok(stats.timed(stage::SORT_ARRIVALS, || sums.end())),
            OnDevice(film) => film.end(stats),
        }
    }

    /// Ends an iteration that is not complete. The images become those before it, if they can.
    pub fn restore(&mut self) -> Undone {
        match self {
            OnHost(sums) => match sums.restore() {
                true => Undone::All,
                false => Undone::Nothing,
            },
            OnDevice(film) => film.restore(),
        }
    }
}

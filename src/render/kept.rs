//! What a render goes back to if the device is lost while it keeps the images of several responses.

use super::Renderer;
use super::responses::{DeviceFilm, ResponseImages, Undone};
use super::stats::Stats;
use super::sums::Added;
use crate::error::Result;
use crate::image::accumulation::{Iterations, MergedLight};

/// The state of a render when the host last copied the images of its responses.
pub struct Kept {
    added: Added,
    stats: Stats,
    done: Iterations,
    next: u32,
    first_sample: u32,
    merged: MergedLight,
}

impl Renderer {
    /// Keeps the state, if the device keeps the images of the responses and the host has a copy of all of them.
    pub(super) fn keep_if_copied(&mut self) {
        let film = self.responses.as_ref().and_then(ResponseImages::on_device);
        if film.is_some_and(DeviceFilm::has_copy) && !self.done.is_empty() {
            self.kept = Some(Box::new(Kept {
                added: self.sums.get().clone(),
                stats: self.stats.clone(),
                done: self.done.clone(),
                next: self.next,
                first_sample: self.first_sample,
                merged: self.merged,
            }));
        }
    }

    /// Copies the images of the responses to the host if the last copy is old. If the device is lost, the render goes back to that copy.
    pub(super) fn copy_images_if_due(&mut self) -> Result<()> {
        let film = self.responses.as_ref().and_then(ResponseImages::on_device);
        let done = film.map_or(Ok(()), DeviceFilm::copy_if_due);
        if done.is_err() {
            self.restore_images();
        }
        done
    }

    /// Copies the images of the responses to the host, if the device keeps them. If the device is lost, the render goes back to the last
    /// copy.
    pub(crate) fn settle(&mut self) -> Result<()> {
        let done = self.responses.as_ref().map_or(Ok(()), |images| images.film().map(drop));
        if done.is_err() {
            self.restore_images();
        }
        done
    }

    /// Undoes an iteration that is not complete in the images of the responses. What else the render has follows them.
    pub(super) fn restore_images(&mut self) {
        match self.responses.as_mut().map_or(Undone::All, ResponseImages::restore) {
            Undone::All => {}
            Undone::ToLastCopy => match self.kept.take() {
                Some(kept) => self.go_back_to(*kept),
                None => self.clear(),
            },
            Undone::Nothing => self.clear(),
        }
    }

    fn go_back_to(&mut self, kept: Kept) {
        let Kept { added, stats, done, next, first_sample, merged } = kept;
        *self.sums.get_mut() = added;
        self.stats = stats;
        (self.done, self.next, self.first_sample, self.merged) = (done, next, first_sample, merged);
        (self.ahead, self.counts_ahead) = (None, None);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use crate::generate::{Kind, build};
    use crate::gpu::{Device, Drive};
    use crate::job::iterations::{Abandons, End, Iterations};
    use crate::render::responses::{DeviceFilm, ResponseImages};
    use crate::render::schedule::Schedule;
    use crate::render::{Renderer, Tuning};
    use crate::settings::gates::Gates;
    use crate::settings::units::Gate;
    use crate::settings::{Budget, Estimator, Sampling, Settings};

    /// A device that is driven as a card; `None` if it does not compute with 64 bits.
    fn card() -> Option<Device> {
        let device = Device::open_with_drive(None, Some(Drive::CARD)).expect("this test needs a Vulkan device");
        let has_f64 = device.info().has_f64;
        if !has_f64 {
            eprintln!("skipped: the device does not compute with 64 bits");
        }
        has_f64.then_some(device)
    }

    fn renderer(device: &Device, is_on_device: bool) -> Renderer {
        let gates = Gates::new(Gate { lo: 4.0, hi: 8.0 }, 4).unwrap();
        let settings = Settings::builder().estimator(Estimator::Bdpt).resolution([8, 8]).light_paths(100);
        let settings = settings.splat_paths(20).responses(gates).sampling(Sampling::Adaptive).build().unwrap();
        let tuning = Tuning { device_film: Some(is_on_device), ..Tuning::default() };
        Renderer::with_tuning(device, &build(Kind::CornellBox), &settings, tuning).unwrap()
    }

    fn on_device(renderer: &Renderer) -> &DeviceFilm {
        renderer.responses.as_ref().and_then(ResponseImages::on_device).unwrap()
    }

    fn bits(renderer: &Renderer) -> Vec<f32> {
        let all = renderer.responses().unwrap().unwrap();
        (0..4).map(|k| all.mean(k)).chain([renderer.film().mean()]).flatten().collect()
    }

    /// As a rolling shutter renders them.
    #[test]
    fn parts_of_an_iteration_go_to_their_own_rows() {
        let Some(device) = card() else { return };
        let [expected, found] = [false, true].map(|is_on_device| {
            let mut renderer = renderer(&device, is_on_device);
            for rows in [0..3, 3..4, 4..8].into_iter().cycle().take(6) {
                assert!(renderer.iterate_rows(2, rows, &Arc::default()).unwrap());
            }
            bits(&renderer)
        });
        assert!(expected == found);
    }

    /// Somebody looks at the images after some iterations. Later ones are not copied.
    #[test]
    fn a_lost_device_takes_what_was_not_copied() {
        for done in [2, 4] {
            let Some(device) = card() else { return };
            let mut renderer = renderer(&device, true);
            renderer.iterate(2).unwrap();
            on_device(&renderer).copy_never();
            for iteration in 2..=4 {
                renderer.iterate(2).unwrap();
                if done == iteration {
                    assert!(renderer.responses().is_ok());
                    on_device(&renderer).copy_never();
                }
            }
            device.lose_after(0);
            // A look after the loss does not cost the copy.
            assert_eq!(renderer.responses().is_ok(), done == 4);
            assert!(renderer.iterate(2).is_err());
            let rendered = renderer.rendered();
            assert_eq!((rendered.iterations, rendered.end, rendered.samples), (done, done, 2 * u64::from(done)));
            let mut expected = self::renderer(&card().unwrap(), true);
            (0..done).for_each(|_| expected.iterate(2).unwrap());
            assert!(bits(&renderer) == bits(&expected), "{done} iterations");
            assert_eq!(renderer.stats().samples, expected.stats().samples);
        }
    }

    /// Whenever the device is lost, the images of the gates and their sum have the same iterations, and the program can write them.
    #[test]
    fn images_agree_whenever_the_device_is_lost() {
        let (mut failed, mut black) = (0, 0);
        for submits in 1.. {
            let Some(device) = card() else { return };
            let mut renderer = renderer(&device, true);
            on_device(&renderer).copy_never();
            device.lose_after(submits);
            let iterations = Iterations {
                schedule: Schedule::whole(Budget::Spp(8)),
                strict: false,
                stop: &Arc::default(),
                abandons: Abandons::All,
            };
            let mut looks = 0;
            // As a checkpoint looks. Later copies are made at the end alone.
            let end = iterations.run(&mut renderer, |renderer, _| {
                looks += u32::from(renderer.rendered().iterations == 2 && renderer.responses().is_ok());
                on_device(renderer).copy_never();
            });
            let done = renderer.film().iterations();
            assert_eq!(renderer.responses().unwrap().unwrap().length().1, done, "{submits} submits");
            match end {
                Ok(End::Complete) => {
                    assert_eq!((done, failed > 3, black > 3), (4, true, true));
                    return;
                }
                Ok(End::Failed(_)) => {
                    assert!(looks == 1 && done == 2, "{submits} submits: {done} iterations");
                    failed += 1;
                }
                _ => {
                    assert_eq!(done, 0);
                    black += 1;
                }
            }
        }
    }

    /// As when a lamp has left the scene.
    #[test]
    fn a_dark_iteration_adds_no_light() {
        let Some(device) = card() else { return };
        let [expected, found] = [false, true].map(|is_on_device| {
            let mut renderer = renderer(&device, is_on_device);
            renderer.iterate(2).unwrap();
            // This light belongs to no iteration.
            assert!(renderer.iterate_rows(2, 0..4, &Arc::default()).unwrap());
            renderer.abandon();
            renderer.plan.dark = true;
            renderer.iterate(2).unwrap();
            bits(&renderer)
        });
        assert!(expected == found);
    }
}

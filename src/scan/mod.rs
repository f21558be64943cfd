//! Measures scans, for the program and for Python. A scan consists of one render per point of the laser, all on one renderer. The beams
//! of a LiDAR whose light comes straight back share renders instead: each pixel of an image is a beam. Every beam then has the random
//! numbers of a render of its own. If the LiDAR moves, only beams that are fired at once share a render.

#![warn(missing_docs)]

mod moving;
mod places;
mod seen;

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::error::{ErrorKind, Result};
use crate::gpu::Device;
use crate::image::scan_file::{ScanArrays, ScanFilm};
use crate::input::scan_table::Scan;
use crate::job::iterations::{Abandons, End, Iterations};
use crate::job::memory::{self, ImageParts};
use crate::render::schedule::Schedule;
use crate::render::space::RenderSpace;
use crate::render::{MemoryPlan, PreparedScene, Renderer, check_aimed_points};
use crate::scene::Scene;
use crate::settings::{Budget, Settings};
pub use moving::Moving;
use seen::Seen;

/// Maximum number of segments of light that comes straight back to a LiDAR.
const STRAIGHT_BACK: u32 = 2;
/// Maximum number of beams that share a render. Light subpaths per iteration do not grow with the image up to this size.
const MAX_BEAMS: usize = 4096;
/// Target for the number of beams times the number of responses in a render, which limits the memory of its images.
const MAX_VALUES: usize = 1 << 21;

/// A scan and its scene, ready for a device.
pub struct PreparedScan {
    /// The scene. Its last light is the laser, and the camera of the settings is the sensor.
    pub scene: Scene,
    /// Settings of each render.
    pub settings: Settings,
    /// The scene, prepared for these settings.
    pub prepared: PreparedScene,
    /// Number of beams in each render, `None` if each point of the laser has a render of its own.
    beams: Option<usize>,
    /// `None` if all objects stand still.
    moving: Option<Moving>,
    /// The render space at the first shot.
    home: RenderSpace,
}

impl PreparedScan {
    /// `scene` contains the laser and the sensor of `scan`, and `settings` are those of one render per point of the laser. `moving`: the
    /// animations that play during the scan. Fails as [`PreparedScene::new`].
    pub fn new(scan: &Scan, mut scene: Scene, settings: &Settings, moving: Option<Moving>) -> Result<PreparedScan> {
        places::set_own_velocity(scan, settings, 0, &mut scene);
        let shares = scan.lights_what_it_sees() && settings.max_depth() <= STRAIGHT_BACK;
        if !shares {
            let prepared = PreparedScene::new(&scene, settings)?;
            let (settings, home) = (settings.clone(), prepared.space());
            return Ok(PreparedScan { scene, settings, prepared, beams: None, moving, home });
        }
        let count = scan.laser_points.len();
        let max = (MAX_VALUES / settings.responses().len()).clamp(1, MAX_BEAMS);
        // Renders of nearly equal size, because the last one is filled up with copies of the last beam.
        let together = if scan.places.is_some() || moving.is_some() { scan.at_once } else { count };
        let beams = together.div_ceil(together.div_ceil(max));
        let (camera, seeds) = scan.beams(0..beams, settings.seed());
        scene.cameras[settings.camera()] = camera;
        let settings = settings.change().resolution([beams as u32, 1]).crop(None).build()?;
        let prepared = PreparedScene::new(&scene, &settings)?.with_own_lasers(&seeds);
        let home = prepared.space();
        Ok(PreparedScan { scene, settings, prepared, beams: Some(beams), moving, home })
    }

    /// The warnings about the scene, and the point of the laser at which the most light is missing that no strategy forms (0 if none is).
    /// `settings`: those of one render per point of the laser.
    pub fn warnings(&self, scan: &Scan, settings: &Settings) -> (Vec<String>, usize) {
        let at = |point| (scan.light(point), scan.camera(point));
        let missing = self.prepared.missing_in_scan(&self.scene, settings, scan.laser_points.len(), at);
        let (point, warning) = missing.map_or((0, None), |(point, missing)| (point, Some(missing.describe())));
        (self.prepared.scene_warnings(&self.scene, settings).into_iter().chain(warning).collect(), point)
    }

    /// Fails if a point of the scan must lie on a surface but does not, see [`check_aimed_points`].
    fn check_points(&self, device: &Device, scan: &Scan) -> Result<()> {
        if scan.accounts_first_and_last {
            return Ok(());
        }
        let seen = scan.sensor_points.as_ref().unwrap_or(&scan.laser_points);
        for (who, place, points) in [("sensor", scan.sensor, seen), ("laser", scan.laser, &scan.laser_points)] {
            check_aimed_points(device, &self.scene, &self.settings, who, &Scan::camera_at(place, points))?;
        }
        Ok(())
    }
}

/// The scene while laser and sensor look at point `number` of the laser. `settings`: those of one render per point of the laser.
pub fn scene_at(mut scene: Scene, scan: &Scan, settings: &Settings, number: usize) -> Scene {
    *scene.lights.last_mut().expect("the laser is the last light") = scan.light(number);
    scene.cameras[settings.camera()] = scan.camera(number);
    scene
}

/// Fails if the images or the array of a scan need more memory than is free. `settings`: those of one render per point of the laser.
pub fn check_memory(scan: &Scan, settings: &Settings, has_variance: bool) -> Result<()> {
    memory::check(settings, ImageParts { variance: has_variance, exr: false }, memory::free())?;
    let bytes = ScanFilm::bytes(scan, settings, has_variance);
    memory::check_bytes(bytes, memory::free(), "the array of the scan", "use fewer gates or points")
}

/// A scan in progress.
pub struct Measurement {
    /// The scan that is measured.
    pub scan: Scan,
    of: PreparedScan,
    renderer: Renderer,
    film: ScanFilm,
    measured: usize,
    samples: u64,
    /// Samples that were not finite, of earlier renderers.
    dropped_before: u64,
    /// Time of the shot that the scene is posed for, if objects move.
    posed: Option<f64>,
    /// What the beams met so far, if the user wants layers and the LiDAR or objects move.
    seen: Option<Seen>,
}

impl Measurement {
    /// Uploads the scene and compiles the kernels. Fails as [`Renderer::new`]. Also fails if a point of the scan must lie on a surface
    /// but does not.
    pub fn new(device: &Device, scan: Scan, of: PreparedScan, has_variance: bool) -> Result<Measurement> {
        let memory = MemoryPlan::new(&of.scene, &of.settings, &of.prepared, Some(device.info()))?;
        memory.check(device.info())?;
        of.check_points(device, &scan)?;
        let mut renderer = Renderer::from_memory_plan(device, memory, &of.scene, &of.prepared)?;
        if has_variance {
            renderer.estimate_response_variance();
        }
        let film = ScanFilm::new(&scan, &of.settings, has_variance);
        let posed = scan.times.as_ref().map(|times| times[0]);
        Ok(Measurement { scan, of, renderer, film, measured: 0, samples: 0, dropped_before: 0, posed, seen: None })
    }

    /// Number of points of the laser measured so far.
    pub fn measured(&self) -> usize {
        self.measured
    }

    /// Whether all points of the laser were measured.
    pub fn is_whole(&self) -> bool {
        self.measured == self.scan.laser_points.len()
    }

    /// Samples per pair of points, of the points measured last.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// The measurements so far.
    pub fn film(&self) -> &ScanFilm {
        &self.film
    }

    /// The renderer, for its statistics.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// Number of samples that were not finite. They count as 0.
    pub fn dropped(&self) -> u64 {
        self.dropped_before + self.renderer.dropped()
    }

    /// The scene and the settings of the renders.
    pub fn scene(&self) -> (&Scene, &Settings) {
        (&self.of.scene, &self.of.settings)
    }

    /// The measurements as arrays, for Python.
    pub fn into_arrays(self) -> ScanArrays {
        self.film.into_arrays(&self.scan)
    }

    /// Measures point after point until `stop` is true, and calls `watch` after each of them. `strict`: also ends if a sample is not
    /// finite. Points that are interrupted stay without a measurement. An error of the device is [`End::Failed`] if there is a
    /// measurement.
    pub fn run(&mut self, strict: bool, stop: &Arc<AtomicBool>, mut watch: impl FnMut(&Self)) -> Result<End> {
        while !self.is_whole() {
            match self.step(strict, stop) {
                Ok(End::Complete) => watch(self),
                Err(error) if error.kind() == ErrorKind::Device && self.measured > 0 => return Ok(End::Failed(error)),
                end => return end,
            }
        }
        Ok(End::Complete)
    }

    /// Measures the next point of the laser, or the next beams that share a render. They stay without a measurement unless the render
    /// is complete. Fails if the device is lost.
    fn step(&mut self, strict: bool, stop: &Arc<AtomicBool>) -> Result<End> {
        let count = self.scan.laser_points.len();
        // The place or the scene changes from shot to shot.
        let end = match self.scan.places.is_some() || self.of.moving.is_some() {
            true => (self.measured / self.scan.at_once + 1) * self.scan.at_once,
            false => count,
        };
        let points = self.measured..(self.measured + self.of.beams.unwrap_or(1)).min(end);
        match self.of.moving.is_some() {
            true => self.pose(points.start)?,
            false => self.follow(points.start)?,
        }
        self.see(points.clone())?;
        match self.of.beams {
            Some(beams) => self.turn_beams(points.start..points.start + beams)?,
            None => self.turn(points.start)?,
        }
        let end = self.render(points.len(), strict, stop)?;
        if !matches!(end, End::Complete) {
            return Ok(end);
        }
        let pairs = self.scan.sensor_count();
        let first = points.start * pairs;
        self.film.set(first, points.len() * pairs, self.renderer.film(), self.renderer.responses()?);
        (self.measured, self.samples) = (points.end, self.renderer.film().samples());
        Ok(end)
    }

    /// Turns laser and sensor to point `number` of the laser.
    fn turn(&mut self, number: usize) -> Result<()> {
        self.set_laser(number)?;
        if !self.renderer.set_camera(&self.scan.camera(number))? {
            unreachable!("the sensor is in reach");
        }
        let PreparedScan { settings, prepared, .. } = &self.of;
        self.renderer.set_lights(prepared)?;
        self.renderer.restart(Scan::seed(settings.seed(), number), settings.responses().clone())
    }

    /// Turns the laser of the scene to point `number`, and moves it there. The render space stays, so all shots round alike.
    fn set_laser(&mut self, number: usize) -> Result<()> {
        let PreparedScan { scene, settings, prepared, moving, .. } = &mut self.of;
        *scene.lights.last_mut().expect("the laser is the last light") = self.scan.light(number);
        places::set_own_velocity(&self.scan, settings, number, scene);
        let follows = match self.scan.places.is_some() || moving.is_some() {
            true => prepared.follow_nearby(scene, settings)?,
            false => prepared.follow(scene, settings)?,
        };
        assert!(follows, "the laser is the only light");
        Ok(())
    }

    /// Turns all beams of the next render, and moves them to their place.
    fn turn_beams(&mut self, beams: Range<usize>) -> Result<()> {
        if self.scan.places.is_some() || self.of.moving.is_some() {
            self.set_laser(beams.start)?;
            self.renderer.set_lights(&self.of.prepared)?;
        }
        let (camera, seeds) = self.scan.beams(beams, self.of.settings.seed());
        match self.renderer.set_beams(&camera, &seeds)? {
            true => Ok(()),
            false => unreachable!("the sensor is in reach"),
        }
    }

    /// Renders `points` points of the laser.
    fn render(&mut self, points: usize, strict: bool, stop: &Arc<AtomicBool>) -> Result<End> {
        let share = points as f64 / self.scan.laser_points.len() as f64;
        let (budget, together) = match self.of.settings.budget() {
            Budget::Seconds(seconds) => (Budget::Seconds(seconds * share), self.renderer.film().width()),
            // The length of the iterations decides the last bits, so it does not depend on how many beams share a render.
            budget => (budget, self.scan.sensor_count() as u32),
        };
        // An interrupted point is left out, so its images need not survive.
        let schedule = Schedule::Scan { budget, points: together };
        let iterations = Iterations { schedule, strict, stop, abandons: Abandons::All };
        iterations.run(&mut self.renderer, |_, _| {})?.or_error()
    }
}

//! Algorithm 1: light subpaths, trees, sensor subpaths with queries and connections, film. `iteration.rs` runs these phases in order;
//! each phase has its own file.

mod aimed_points;
pub mod albedo;
mod arrival;
mod black_backs;
mod compaction;
mod contribution;
mod coplanar;
mod device_scene;
mod duplicates;
mod emitters;
mod far_objects;
mod first_surface;
mod formed_light;
pub mod geometry;
mod glass_checks;
pub mod grid;
mod iteration;
mod kept;
mod layers;
mod light;
mod light_phase;
pub mod material;
mod media;
mod memory;
mod missing_light;
mod moments;
mod null_boundary;
mod oversized;
mod parts;
pub mod phase;
mod photons;
mod pinhole_in_fog;
mod plan;
mod pool;
mod pool_layout;
mod precompile;
mod prepared_scene;
mod probe;
mod ray_structure;
mod responses;
mod restart;
mod resume;
mod sample_time;
mod samples;
pub mod schedule;
mod selection_cdf;
mod sensor;
pub mod sheets;
mod solids;
pub mod space;
pub mod split_mix;
mod stats;
mod strategies;
mod submit_size;
mod sums;
mod travel_time_bounds;
pub(crate) mod velocities;
mod view_thickness;

use std::sync::Arc;
use std::time::Instant;

use crate::error::Result;
use crate::gpu::{Device, buffer_desc};
use crate::image::accumulation::{Iterations, MergedLight};
use crate::image::film::Film;
use crate::image::response_film::ResponseFilm;
use crate::scene::Scene;
use crate::settings::{Rays, Settings};

pub use aimed_points::{aimed_surfaces, check_aimed_points};
pub use arrival::first_arrivals;
pub use black_backs::{BlackBacks, black_backs};
use compaction::Compaction;
use device_scene::DeviceScene;
pub use emitters::{luminance, sky_table};
pub use first_surface::{FirstSurface, first_surfaces};
pub use formed_light::formed_light;
pub use layers::{layers, object_ids};
use light::LightTracer;
use light_phase::{LightPhase, Lit};
pub use memory::MemoryPlan;
pub use missing_light::{MissingLight, missing_light, missing_light_at_any_time};
use parts::Begun;
use photons::PhotonTracer;
pub use plan::Tuning;
use plan::{Observe, Plan};
pub use pool::leaf_record;
pub use prepared_scene::PreparedScene;
pub use probe::{TravelTimes, probe};
use responses::ResponseImages;
pub use sample_time::seconds_per_sample;
pub use samples::MAX_AVERAGE_SAMPLES;
use samples::{Allocation, SampleCounts};
use schedule::Following;
use sensor::SensorPhase;
use stats::stage;
pub use stats::{Stage, Stats};
pub use strategies::{StrategyImage, StrategyImages, strategies};
use sums::Sums;
pub use travel_time_bounds::TravelTimeBounds;
pub use view_thickness::{ViewThickness, view_thickness};

/// A render in progress. Every iteration adds samples to the film; the same settings give the same bits.
#[warn(missing_docs)]
pub struct Renderer {
    device: Device,
    plan: Plan,
    scene: DeviceScene,
    light: LightPhase,
    /// Light of the next iteration.
    ahead: Option<Lit>,
    sensor: SensorPhase,
    sums: Sums,
    /// Samples per pixel of the next iteration, on average, and in each pixel, if they are chosen already.
    counts_ahead: Option<(u32, SampleCounts)>,
    /// `None` if there is one response with weight 1 in its gate: its image is the film.
    responses: Option<ResponseImages>,
    /// See [`kept::Kept`].
    kept: Option<Box<kept::Kept>>,
    stats: Stats,
    /// The iteration in progress, while not all its rows are rendered.
    begun: Option<Begun>,
    /// The iterations in the film.
    done: Iterations,
    /// The next iteration, and the sample of the random sequences at which it begins.
    next: u32,
    first_sample: u32,
    /// What comes after the next iteration.
    following: Following,
    /// Number of non-finite samples that were dropped from the sums that the render continues.
    dropped_before: u64,
    /// Light of the film that merging found.
    merged: MergedLight,
}

#[warn(missing_docs)]
impl Renderer {
    /// Flattens and uploads the scene, and compiles the kernels. Fails if [`Scene::check`] fails, if nothing emits, or if the scene does
    /// not fit the device. Also fails if the settings do not suit the scene. For example, the estimator cannot render these emitters, or
    /// a light is infinitely far away and there is a gate.
    pub fn new(device: &Device, scene: &Scene, settings: &Settings) -> Result<Renderer> {
        Renderer::with_tuning(device, scene, settings, Tuning::default())
    }

    /// As [`Renderer::new`], with `tuning` that changes the speed but never the image.
    #[doc(hidden)]
    pub fn with_tuning(device: &Device, scene: &Scene, settings: &Settings, tuning: Tuning) -> Result<Renderer> {
        let start = Instant::now();
        let prepared = PreparedScene::new(scene, settings)?;
        let seconds = start.elapsed().as_secs_f64();
        let size = [settings.crop().width(), settings.crop().height()];
        let mut plan = Plan::new(scene, settings, &prepared, device.info().quirks)?;
        plan.tuning = tuning;
        let mut renderer = Renderer::from_plan(device, plan, size, scene, &prepared)?;
        renderer.stats.add_prepared("build BVH", seconds);
        Ok(renderer)
    }

    /// As [`Renderer::new`], with a scene that is already prepared for the same emitters and the same camera or one nearby.
    /// The renderer does not need `prepared` afterwards.
    #[doc(hidden)]
    pub fn from_prepared(
        device: &Device,
        scene: &Scene,
        settings: &Settings,
        prepared: &PreparedScene,
    ) -> Result<Renderer> {
        let size = [settings.crop().width(), settings.crop().height()];
        let plan = Plan::new(scene, settings, prepared, device.info().quirks)?;
        Renderer::from_plan(device, plan, size, scene, prepared)
    }

    /// A renderer of the same scene on the same device with other settings, such as a smaller image. Both use one copy of the scene
    /// on the device, so [`Renderer::set_camera`] with aimed rays panics in either.
    /// `scene` and `prepared` are those of this renderer, and `settings` select the same emitters.
    #[doc(hidden)]
    pub fn sibling(&self, scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Result<Renderer> {
        let size = [settings.crop().width(), settings.crop().height()];
        let plan = Plan::new(scene, settings, prepared, self.device.info().quirks)?;
        let shared = self.scene.share(&self.device, prepared)?;
        Renderer::on_device(&self.device, plan, size, shared, prepared, Stats::default())
    }

    fn from_plan(
        device: &Device,
        plan: Plan,
        size: [u32; 2],
        scene: &Scene,
        prepared: &PreparedScene,
    ) -> Result<Renderer> {
        // Check the limits of the device before any allocation.
        buffer_desc::check_all(&memory::certain_buffers(device.info(), &plan, prepared), device.info())?;
        let mut stats = Stats::default();
        let scene = stats.prepared("upload scene", || DeviceScene::new(device, scene, prepared, plan.hardware_rays))?;
        Renderer::on_device(device, plan, size, scene, prepared, stats)
    }

    /// Compiles the kernels for a scene that is on the device.
    fn on_device(
        device: &Device,
        plan: Plan,
        [width, height]: [u32; 2],
        scene: DeviceScene,
        prepared: &PreparedScene,
        mut stats: Stats,
    ) -> Result<Renderer> {
        // A dark plan traces nothing. Its sensor kernels are compiled only if a restart changes its gate.
        if !plan.dark {
            stats.prepared(stage::COMPILE, || precompile::compile_all(device, &plan))?;
        }
        let compaction = Arc::new(stats.prepared(stage::COMPILE, || Compaction::new(device, &plan.constants()))?);
        let light = stats.prepared(stage::COMPILE, || LightPhase::new(device, &scene, &plan, &compaction, prepared))?;
        stats.scene_bytes = scene.bytes();
        stats.triangles = prepared.triangles() as u64;
        let mut film = Film::new(width, height);
        if plan.damps_fireflies {
            film.damp_fireflies();
        }
        let device = device.clone();
        let sensor = SensorPhase::new(&device, compaction)?;
        let allocation = plan.adaptive.then(|| Allocation::new(width, plan.crop_pixels));
        let responses = (plan.observe == Observe::Responses).then(|| ResponseImages::new(&device, &plan, false));
        Ok(Renderer {
            device,
            plan,
            scene,
            light,
            ahead: None,
            sensor,
            sums: Sums::new(film, allocation),
            counts_ahead: None,
            responses,
            kept: None,
            stats,
            begun: None,
            done: Iterations::default(),
            next: 0,
            first_sample: 0,
            following: Following::Unknown,
            dropped_before: 0,
            merged: MergedLight::default(),
        })
    }

    /// Whether culling is on and bounds show that no light can arrive inside the gate. If so, every sample is black and none is traced.
    pub fn is_dark(&self) -> bool {
        self.plan.dark
    }

    /// Whether no light was found so far. For a single box, the device must also have counted no light inside the gate. For other
    /// responses its count does not decide: it includes light between two gates, and light where the weight of a table is 0.
    #[doc(hidden)]
    pub fn is_black(&self) -> bool {
        let may_be_black = !self.plan.responses.is_single_box() || self.stats.inside_gate == 0;
        may_be_black && self.film().mean().iter().all(|&x| x == 0.0)
    }

    /// The device that renders.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// What traces the rays: [`Rays::Hardware`] for ray queries of the device, [`Rays::Software`] for kernels.
    #[doc(hidden)]
    pub fn rays(&self) -> Rays {
        if self.plan.hardware_rays { Rays::Hardware } else { Rays::Software }
    }

    /// Mean and variance of the pixels of the crop so far. With several responses: of the sum of their images.
    pub fn film(&self) -> &Film {
        &self.sums.get().film
    }

    /// The images of the responses so far; `None` if there is one response, whose image is [`Renderer::film`]. A graphics card may keep
    /// these images. Then this copies them to the host, and fails if the card is lost.
    pub fn responses(&self) -> Result<Option<&ResponseFilm>> {
        self.responses.as_ref().filter(|images| images.responses() > 1).map(ResponseImages::film).transpose()
    }

    /// Number of responses; 1 if [`Renderer::responses`] is `None`.
    #[doc(hidden)]
    pub fn response_count(&self) -> usize {
        self.responses.as_ref().map_or(1, ResponseImages::responses)
    }

    /// Host bytes of the images of [`Renderer::responses`].
    #[doc(hidden)]
    pub fn response_bytes(&self) -> u64 {
        let bytes = |images: &ResponseImages| {
            ResponseFilm::bytes(self.plan.image_pixels, images.responses() as u64, images.has_variance())
        };
        self.responses.as_ref().map_or(0, bytes)
    }

    /// Whether an abandoned iteration of a large image may clear all images: if the host divides the light into responses, several or a
    /// shaped one.
    #[doc(hidden)]
    pub fn may_lose_images(&self) -> bool {
        self.responses.as_ref().is_some_and(|images| images.on_device().is_none())
    }

    /// Also estimates the variance of the images of several responses, which takes as much memory again as these images. Call it
    /// before the first iteration.
    ///
    /// # Panics
    /// If there was an iteration.
    pub fn estimate_response_variance(&mut self) {
        assert!(self.done.is_empty(), "the variance must be known from the first iteration on");
        if self.responses.is_some() {
            self.responses = Some(ResponseImages::new(&self.device, &self.plan, true));
        }
    }

    /// Whether the images of the responses have variances: see [`Renderer::estimate_response_variance`]. False for a single box,
    /// whose image is the film.
    #[doc(hidden)]
    pub fn has_response_variance(&self) -> bool {
        self.responses.as_ref().is_some_and(ResponseImages::has_variance)
    }
}

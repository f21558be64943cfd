//! The parameters of the kernels: the frame of an iteration (`shared/frame.wgsl`), and the constants that are fixed for a
//! render.

mod camera;
mod choice;
mod constants;
mod gates;
mod merging;
mod slots;
mod tuning;

use std::ops::Range;
use std::sync::Arc;

use glam::Vec3;

use super::emitters::EmitterSet;
use super::material::Features;
use super::photons;
use super::pool_layout::PoolLayout;
use super::prepared_scene::PreparedScene;
use super::samples::{MAX_AIMED_SAMPLES, MAX_AVERAGE_SAMPLES};
use super::solids::Solids;
use super::space::RenderSpace;
use super::travel_time_bounds::{Box3, TravelTimeBounds};
use super::velocities;
use crate::error::{Error, Result};
use crate::estimators::{Ellipsoids, PoolOrder, Record};
use crate::gpu::{Quirks, RaySupport};
use crate::scene::{Distortion, Light, LightKind, Scene};
use crate::settings::{Crop, Fireflies, Importance, Rays, Responses, Sampling, Settings, Strategies};
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{Frame, NONE};
use camera::CameraKind;
use choice::Choice;
use merging::Merging;
pub use tuning::{Observe, Tuning};

/// Represents infinity on the device. Its sum with any travel time is still finite.
const OPEN: f32 = 3e38;

/// Maximum number of triangles in a part of the BVH. A work item searches one part for the triangles that an ellipsoid meets.
const PART_TRIANGLES: u32 = 4096;

/// Identifies an iteration; the random numbers of its samples depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Iteration {
    /// Index of the iteration, from 0.
    pub number: u32,
    /// Index of the first sample of every pixel, counted over the whole render.
    pub first_sample: u32,
    /// Samples per pixel, on average.
    pub samples: u32,
}

/// The parameters of a render that are the same in all iterations.
pub struct Plan {
    pub estimator: &'static Record,
    /// Whether ray queries of the device trace the rays.
    pub hardware_rays: bool,
    /// The conditions, besides the responses, that decide which record of the chosen estimator the render uses.
    choice: Choice,
    pub light_paths: u32,
    splat_paths: u32,
    pub buckets: u32,
    /// Maximum number of vertices in a leaf; 0 if the estimator builds no trees.
    pub leaf_size: u32,
    pub single_tree: bool,
    frontier: u32,
    importance: Importance,
    pub max_depth: u32,
    pub adaptive: bool,
    /// Whether the film can damp fireflies.
    pub damps_fireflies: bool,
    /// Whether the image records velocities.
    records_doppler: bool,
    /// With an FMCW sensor, the length in render space by which a path seems longer per unit of the rate at which it grows; else 0.
    range_coupling: f64,
    pub features: Features,
    /// Whether a light is infinitely far away, so that no gate is possible.
    pub has_distant: bool,
    /// Whether there is a sky.
    has_sky: bool,
    camera_kind: CameraKind,
    pub distortion: Distortion,
    /// Whether each aimed ray has a laser of its own ([`PreparedScene::with_own_lasers`]).
    pub has_own_lasers: bool,
    /// Tangent of half of the divergence of these lasers; else 0.
    laser_radius: f64,
    has_media: bool,
    /// Share of the light subpaths that start from beams.
    pub beam_share: f64,
    /// Travel time per length outside of solids.
    group_index: f64,
    /// Whether light is faster in a solid than outside of it.
    has_fast_solids: bool,
    /// The glass that the camera may be inside of.
    solids: Arc<Solids>,
    /// Parts of the BVH from [`Bvh::parts`](crate::bvh::Bvh::parts); empty unless the estimator has [`Ellipsoids::Enumerated`].
    pub bvh_parts: Vec<u32>,
    /// Values of the WGSL `override` constants that depend on the media.
    media_constants: [(&'static str, f64); 10],
    /// The part of the image that is rendered next, and the number of its pixels.
    pub crop: Crop,
    pub crop_pixels: u64,
    /// Number of pixels of the largest such part: the crop that the plan was made for.
    pub image_pixels: u64,
    /// Whether light subpaths are traced beyond their first vertex, the one on the emitter.
    pub traces_light: bool,
    /// Whether light vertices are connected to the sensor (t = 1).
    pub splats: bool,
    /// Whether and how shade points gather photons (`photons.rs`).
    pub merging: Option<Merging>,
    /// Indices in the emitter table of the beams of zero radius, whose subpaths all begin with the same ray.
    pub thin_beams: Range<u32>,
    /// Maximum number of deterministic vertices: one per punctual light, and one per thin beam if the beam hits a surface.
    max_deterministic: u32,
    pub tuning: Tuning,
    pub observe: Observe,
    cull: bool,
    travel_time_bounds: TravelTimeBounds,
    /// The sensor that the scene was prepared for, and that `travel_time_bounds` hold for.
    prepared_sensor: Box3,
    /// Corners of the present sensor in render space; four equal points for a pinhole.
    sensor_corners: [Vec3; 4],
    /// Maximum over the pixels of the length in metres that does not count for their travel times.
    uncounted: f64,
    /// The travel time of `uncounted` in render space.
    uncounted_time: f32,
    /// Whether culling is on and the bounds show that no light can arrive inside the gate. Then there is nothing to trace.
    pub dark: bool,
    /// See [`Geometry::max_delay`](super::geometry::Geometry::max_delay).
    max_delay: f64,
    pub space: RenderSpace,
    pub responses: Responses,
    frame: Frame,
}

impl Plan {
    /// `quirks`: those of the device that will render.
    pub fn new(scene: &Scene, settings: &Settings, prepared: &PreparedScene, quirks: Quirks) -> Result<Plan> {
        let emitters = &prepared.emitters;
        if !emitters.has_connectable() && settings.missed_lights(scene).next().is_some() {
            return Err(Error::settings(settings.estimator().beam_refusal("beams, the only emitters here")));
        }
        let all = settings.strategies() == Strategies::All;
        let choice = Choice::new(scene, settings, prepared, quirks)?;
        let estimator = choice.record(settings.responses());
        let has_own_lasers = prepared.has_own_lasers;
        let laser = emitters.table.first().filter(|_| has_own_lasers);
        if has_own_lasers {
            check_own_lasers(scene, settings)?;
        }
        // A light subpath would belong to a single beam, and serve only paths of three segments.
        let traces_light = estimator.light_subpaths && settings.max_depth() >= 2 && !has_own_lasers;
        let mut features = prepared.geometry.features;
        // Rays of such beams pass clear sheets anyway (`passes_for_sure` in shared/sheet.wgsl).
        features.clear_sheets &= !has_own_lasers;
        let camera = &scene.cameras[settings.camera()];
        let is_aimed = camera.projection.aims().is_some();
        let [width, height] = settings.resolution();
        if is_aimed && prepared.aims.len() != width as usize * height as usize {
            return Err(Error::settings(format!(
                "the camera '{}' aims at {} points, but the image has {width}x{height} pixels; make as many pixels as points",
                camera.name,
                prepared.aims.len()
            )));
        }
        camera.lens_limit(settings.resolution())?;
        let mut frame = frame(settings, estimator, prepared, all);
        if is_aimed {
            frame.keep_t1 = 0.0;
        }
        let emitter_count = frame.emitter_count;
        let pixels = u64::from(settings.crop().width()) * u64::from(settings.crop().height());
        let observe = if settings.responses().is_single_box() { Observe::Nothing } else { Observe::Responses };
        let mut plan = Plan {
            hardware_rays: traces_by_hardware(settings.rays(), quirks.rays)?,
            estimator,
            choice,
            light_paths: settings.light_paths(),
            splat_paths: settings.splat_paths(),
            buckets: settings.buckets(),
            leaf_size: if estimator.pool_order == PoolOrder::Trees { settings.leaf_size() } else { 0 },
            single_tree: settings.single_tree(),
            frontier: settings.frontier(),
            importance: settings.importance(),
            max_depth: settings.max_depth(),
            adaptive: settings.sampling() == Sampling::Adaptive,
            damps_fireflies: settings.fireflies() == Fireflies::Damp,
            records_doppler: settings.doppler().speed().is_some(),
            range_coupling: velocities::range_coupling(settings) / prepared.space.unit,
            features,
            max_delay: prepared.geometry.max_delay,
            has_distant: emitters.has_distant,
            has_sky: !emitters.sky.is_empty(),
            camera_kind: CameraKind::of(camera),
            distortion: camera.lens.distortion,
            has_own_lasers,
            laser_radius: laser.and_then(photons::half_angle).map_or(0.0, f64::tan),
            has_media: !prepared.media.list.is_empty(),
            beam_share: emitters.beam_share(),
            group_index: prepared.media.surrounding[1].into(),
            has_fast_solids: constants::has_fast_solids(scene, prepared.media.surrounding[1]),
            solids: prepared.solids.clone(),
            bvh_parts: if estimator.ellipsoids == Ellipsoids::Enumerated {
                prepared.geometry.bvh.parts(PART_TRIANGLES)
            } else {
                vec![]
            },
            media_constants: prepared.media.constants(features.transmission),
            crop: settings.crop(),
            crop_pixels: pixels,
            image_pixels: pixels,
            traces_light,
            splats: traces_light && all && !is_aimed,
            merging: photons::merges(scene, settings, prepared).then(|| Merging::new(settings, prepared)),
            thin_beams: emitter_count - emitters.thin_beams..emitter_count,
            max_deterministic: emitters.deterministic.len() as u32 + if traces_light { emitters.thin_beams } else { 0 },
            tuning: Tuning::default(),
            observe,
            cull: !settings.no_cull(),
            travel_time_bounds: prepared.travel_time_bounds(settings.max_depth()),
            prepared_sensor: prepared.sensor,
            sensor_corners: [Vec3::ZERO; 4],
            uncounted: 0.0,
            uncounted_time: 0.0,
            dark: false,
            space: prepared.space,
            responses: settings.responses().clone(),
            frame,
        };
        // The vertices of these beams have no room for both an instance and an interval of the distribution that draws them.
        let draws_some = plan.max_deterministic > DETERMINISTIC_SLOTS && estimator.pool_order != PoolOrder::Trees;
        if velocities::are_needed(settings) && draws_some && emitters.thin_beams > 0 && traces_light {
            return Err(Error::advice(
                format!(
                    "with more than {DETERMINISTIC_SLOTS} lamps, some of which are beams of zero radius, --doppler or --fmcw "
                ),
                "needs --estimator lcs",
            ));
        }
        if plan.single_tree && plan.queries_deterministic(emitters.deterministic.len() as u32) {
            // Lamps have their own tree beside the single tree, and the K queries are divided between the two.
            plan.frame.queries = plan.frame.queries.div_ceil(2);
        }
        if !plan.aim(camera) {
            return Err(Error::settings(format!(
                "the camera '{}' is too far from the camera that the scene was prepared for; prepare the scene for this camera",
                camera.name
            )));
        }
        plan.set(settings.seed(), settings.responses().clone());
        Ok(plan)
    }

    /// Reports contributions to the host instead of rendering. Merging, which adds light of many photons at once, is then off. The
    /// contributions have the colours of the light.
    pub fn observe(&mut self, observe: Observe) {
        self.observe = observe;
        self.merging = None;
        self.records_doppler = false;
        self.range_coupling = 0.0;
    }

    /// The frame of an iteration. `pool` is `None` for the light subpaths. For the sensor subpaths it is the pool's layout and
    /// the number of candidate slots per shade point.
    pub fn frame(&self, iteration: &Iteration, pool: Option<(&PoolLayout, u32)>) -> Frame {
        let &Iteration { number, first_sample, samples } = iteration;
        let mut frame = Frame {
            iteration: number,
            first_sample,
            splat_sample_count: self.estimator.splat_sample_weight * self.traced_paths() as f32 / samples as f32,
            splat_share: self.light_paths as f32 / self.traced_paths() as f32,
            merge_radius: self.merge_radius(number),
            ..self.frame
        };
        if let Some((pool, slots)) = pool {
            frame.photon_list_mask = pool.photon_list_mask;
            [frame.lowest_photon_level, frame.highest_photon_level] = pool.photon_levels;
            frame.deterministic_count = pool.deterministic;
            frame.vertex_count = pool.vertices;
            frame.emitter_vertex_count = pool.emitter_vertices;
            frame.tree3_root = pool.tree3_root;
            frame.tree4_root = pool.tree4_root;
            frame.slots = slots;
        } else {
            // A sensor subpath begins at minus the uncounted length, but a light subpath begins at 0.
            frame.cull_hi += self.uncounted_time;
        }
        frame
    }

    /// Renders another part of the image from now on. `crop`: no larger than the one that the plan was made for.
    pub fn set_crop(&mut self, crop: Crop) {
        (self.crop, self.crop_pixels) = (crop, u64::from(crop.width()) * u64::from(crop.height()));
        (self.frame.crop_y, self.frame.crop_height) = (crop.y0, crop.height());
        (self.frame.crop_x, self.frame.crop_width) = (crop.x0, crop.width());
    }

    /// Maximum number of samples per pixel in one iteration, averaged over the pixels.
    pub fn max_samples(&self) -> u32 {
        if self.camera_kind.aims > 0 && !self.adaptive { MAX_AIMED_SAMPLES } else { MAX_AVERAGE_SAMPLES }
    }

    /// Number of sensor subpaths for `samples` samples of a pixel in an iteration. If camera rays split at thin glass, some more subpaths
    /// stop there (`passing_samples` in `shared/samples.wgsl`).
    pub fn sensor_samples(&self, samples: u32) -> u32 {
        samples + if self.features.clear_sheets { samples.div_ceil(4) } else { 0 }
    }

    /// Number of light subpaths per iteration. The first `light_paths` of them are stored for connections. The others serve
    /// only the strategies with t = 1.
    pub fn traced_paths(&self) -> u32 {
        self.light_paths + if self.splats { self.splat_paths } else { 0 }
    }
}

/// Whether ray queries trace the rays, on a device with this support. Fails if the user demands them and there are none.
fn traces_by_hardware(rays: Rays, support: RaySupport) -> Result<bool> {
    match (rays, support) {
        (Rays::Hardware, RaySupport::Absent) => Err(Error::settings(
            "--rays hardware needs a device with ray queries (VK_KHR_ray_query), and this one has none; give --rays software, or choose \
             another device with --device (see taugate devices)",
        )),
        (Rays::Hardware, _) => Ok(true),
        // No card has run ray queries yet.
        (Rays::Auto | Rays::Software, _) => Ok(false),
    }
}

/// Fails unless the pixels of the camera can have lasers of their own.
fn check_own_lasers(scene: &Scene, settings: &Settings) -> Result<()> {
    let place = scene.cameras[settings.camera()].transform.translation;
    let mut lights = scene.lights.iter().filter(|light| settings.emitters().include(&light.node));
    let is_laser = |light: &Light| matches!(light.kind, LightKind::Spot { .. }) && light.position == place;
    match lights.next().is_some_and(is_laser) && lights.next().is_none() && settings.max_depth() <= 2 {
        true => Ok(()),
        false => Err(Error::settings("beams are rendered together only if the light of one laser comes straight back")),
    }
}

/// The fields of the frame that are the same for all iterations and cameras; the other fields are 0 or NONE.
fn frame(settings: &Settings, estimator: &Record, prepared: &PreparedScene, all: bool) -> Frame {
    let PreparedScene { emitters, media, .. } = prepared;
    let [width, height] = settings.resolution();
    let (emitter_lo, emitter_hi) = bounds(emitters);
    let switch = |on: bool| if on { 1.0 } else { 0.0 };
    let query_sample_count = (estimator.query_sample_count)(settings.queries(), !media.list.is_empty());
    Frame {
        width,
        height,
        emitter_lo,
        emitter_hi,
        light_paths: settings.light_paths(),
        max_depth: settings.max_depth(),
        queries: settings.queries() * estimator.draws_per_query,
        emitter_count: emitters.table.len() as u32,
        media_count: media.outside as u32,
        tree3_root: NONE,
        tree4_root: NONE,
        keep_s0: switch(all) / (query_sample_count * query_sample_count),
        keep_t1: switch(all && estimator.light_subpaths) / (query_sample_count * query_sample_count),
        query_sample_count,
        keep_s2: switch(estimator.light_subpaths),
        crop_x: settings.crop().x0,
        crop_y: settings.crop().y0,
        crop_width: settings.crop().width(),
        crop_height: settings.crop().height(),
        ..bytemuck::Zeroable::zeroed()
    }
}

/// The corners of the bounding box of all emitters.
fn bounds(emitters: &EmitterSet) -> ([f32; 3], [f32; 3]) {
    (emitters.lo.to_array(), emitters.hi.to_array())
}

#[cfg(test)]
mod tests;

//! Photons: light of paths that no strategy forms, which sensor subpaths gather (`shaders/shared/photon.wgsl`).

mod aims;
mod clusters;
mod focus;
mod map;
mod source;

use std::sync::Arc;

use super::Renderer;
use super::geometry::Geometry;
use super::media::Media;
use super::missing_light::walk::{AtSheets, World};
use super::plan::{Iteration, Plan};
use super::prepared_scene::PreparedScene;
use super::stats::{Stats, stage};
use super::velocities;
use crate::error::Result;
use crate::gpu::{Allocate, Bindings, Buffer, BufferDesc, BufferList, Device, Kernel, Recorder};
use crate::image::exr_file::Merged;
use crate::scene::{Camera, Scene};
use crate::settings::{Merge, Settings, Strategies};
use crate::wgsl::layout::constants::{PATH_ALIVE, VERTEX_DEPTH, VERTEX_IN_MEDIUM, VERTEX_VALID};
use crate::wgsl::layout::{Dispatch, NONE, PathState, PathVertex, Photon};
pub use aims::lamps;
use aims::{Aims, may_aim, smooth_triangles};
use focus::{camera_rays, focus};
pub use map::{NO_LEVELS, PhotonMap};
use source::PhotonSource;
pub use source::half_angle;

/// Maximum number of photons in a batch, small enough for a short submit.
const BATCH: usize = 1 << 16;
/// Minimum and maximum number of photons in an iteration.
const MIN_PHOTONS: u64 = 1 << 12;
const MAX_PHOTONS: u64 = 1 << 20;

/// Traces photons.
pub struct PhotonTracer {
    geometry: Arc<Geometry>,
    media: Arc<Media>,
    source: PhotonSource,
    /// See [`PreparedScene::aims`].
    sensor_aims: Vec<[f32; 4]>,
    /// `None` until the next iteration after the camera or a lamp has moved.
    aims: Option<Aims>,
    kernel: Kernel,
    bindings: Bindings,
    buffers: Buffers,
    recorder: Recorder,
}

struct Buffers<A: Allocate = Device> {
    states: A::Buffer,
    vertices: A::Buffer,
    list: A::Buffer,
    counters: A::Buffer,
}

impl<A: Allocate> Buffers<A> {
    fn new(to: &A, plan: &Plan) -> Result<Buffers<A>> {
        let capacity = BATCH.min(plan.photons(plan.max_samples()) as usize);
        let remedy = "use a smaller --resolution, or --merge off";
        Ok(Buffers {
            states: to.buffer(BufferDesc::of::<PathState>("photon states", capacity, remedy))?,
            vertices: to.buffer(BufferDesc::of::<PathVertex>("new vertices of photons", capacity, remedy))?,
            list: to.buffer(BufferDesc::of::<u32>("living photons", capacity, remedy))?,
            counters: to.buffer(BufferDesc::of::<u32>("number of photons", 1, remedy))?,
        })
    }
}

impl PhotonTracer {
    /// `scene`: the buffers of group 0.
    pub fn new(
        device: &Device,
        scene: &[(&str, &Buffer)],
        plan: &Plan,
        prepared: &PreparedScene,
    ) -> Result<PhotonTracer> {
        let buffers = Buffers::new(device, plan)?;
        let kernel = Kernel::new(device, PhotonTracer::FILE, PhotonTracer::FILE, &plan.constants())?;
        let own: [(&str, &Buffer); 4] = [
            ("states", &buffers.states),
            ("vertices", &buffers.vertices),
            ("list", &buffers.list),
            ("counters", &buffers.counters),
        ];
        let bindings = kernel.bind(&[scene, &own].concat())?;
        let recorder = Recorder::new(device)?;
        let (geometry, media) = (prepared.geometry.clone(), prepared.media.clone());
        let (source, sensor_aims) = (PhotonSource::new(prepared), prepared.aims.clone());
        Ok(PhotonTracer { geometry, media, source, sensor_aims, aims: None, kernel, bindings, buffers, recorder })
    }

    /// The kernel's file, whose entry point has the same name.
    pub const FILE: &'static str = "photon_trace";

    /// Descriptors of the buffers that [`PhotonTracer::new`] allocates.
    pub fn buffer_descs(plan: &Plan) -> Vec<BufferDesc> {
        BufferList::of(|list| Buffers::new(list, plan))
    }

    /// Follows lamps that have moved.
    pub fn set_lights(&mut self, prepared: &PreparedScene) {
        (self.source, self.aims) = (PhotonSource::new(prepared), None);
    }

    /// Follows a camera that has moved. `sensor_aims`: see [`PreparedScene::aims`].
    pub fn set_camera(&mut self, sensor_aims: Vec<[f32; 4]>) {
        (self.sensor_aims, self.aims) = (sensor_aims, None);
    }

    /// Traces the photons of an iteration. The frame on the device is that of its light subpaths.
    pub fn run(&mut self, plan: &Plan, iteration: &Iteration, stats: &mut Stats) -> Result<PhotonMap> {
        let aims = self.aims.get_or_insert_with(|| {
            let world = World { geometry: &self.geometry, media: &self.media, sheets: AtSheets::Pass };
            let rays = camera_rays(plan, &self.sensor_aims);
            stats.timed(stage::AIM_PHOTONS, || {
                let all = Aims::new(&self.geometry, &mut self.source, plan.traces_light);
                focus(all, &self.source, plan, &world, &rays)
            })
        });
        if aims.is_empty() {
            return Ok(PhotonMap::default());
        }
        let count = plan.photons(iteration.samples);
        let states = stats.timed(stage::UPLOAD, || aims.emit(&self.source, plan.seed(), iteration.number, count));
        let mut photons = vec![];
        for (first, states) in (0..).step_by(BATCH).zip(states.chunks(BATCH)) {
            self.run_batch(plan, first, states, &mut photons, stats)?;
        }
        stats.light_paths += u64::from(count);
        Ok(stats.timed(stage::BUILD_TREES, || PhotonMap::new(photons, plan, iteration.number)))
    }

    fn run_batch(
        &mut self,
        plan: &Plan,
        first: u32,
        states: &[PathState],
        photons: &mut Vec<Photon>,
        stats: &mut Stats,
    ) -> Result<()> {
        let mut living: Vec<u32> =
            (0..).zip(states).filter(|(_, s)| s.flags & PATH_ALIVE != 0).map(|(k, _)| k).collect();
        stats.timed(stage::UPLOAD, || self.buffers.states.write(0, states))?;
        for bounce in 0..plan.max_depth - 1 {
            let Some(last) = living.last() else { break };
            let end = *last as usize + 1;
            stats.timed(stage::UPLOAD, || {
                self.buffers.counters.write(0, &[living.len() as u32])?;
                self.buffers.list.write(0, &living)
            })?;
            let none = Dispatch { list_a: NONE, list_b: NONE, emitter: NONE, ..bytemuck::Zeroable::zeroed() };
            let constants = Dispatch { first, count: states.len() as u32, bounce, ..none };
            let groups = self.kernel.groups(living.len());
            self.recorder.dispatch(PhotonTracer::FILE, &self.kernel, &self.bindings, &constants, groups)?;
            stats.submit(&mut self.recorder)?;
            stats.closest_rays += living.len() as u64;
            stats.light_rays += living.len() as u64;
            let mut dropped = 0;
            living = stats.timed(stage::READ_LIGHT, || {
                self.buffers.vertices.with::<PathVertex, _>(end, |vertices| {
                    let new = living.iter().map(|&slot| &vertices[slot as usize]);
                    for vertex in new.filter(|vertex| vertex.flags & VERTEX_VALID != 0) {
                        match photon(vertex) {
                            Some(photon) => photons.push(photon),
                            None => dropped += 1,
                        }
                    }
                })?;
                self.buffers.states.with::<PathState, _>(end, |states| {
                    living.iter().copied().filter(|&slot| states[slot as usize].flags & PATH_ALIVE != 0).collect()
                })
            })?;
            stats.dropped += dropped;
        }
        Ok(())
    }
}

/// The photon at a vertex; `None` if its power is not finite.
fn photon(v: &PathVertex) -> Option<Photon> {
    v.throughput.iter().all(|power| power.is_finite()).then(|| Photon {
        position: v.position,
        tau: v.tau,
        direction: v.to_previous.map(|x| -x),
        eta: v.eta,
        power: v.throughput,
        flags: v.flags & (VERTEX_DEPTH | VERTEX_IN_MEDIUM),
        normal: if v.flags & VERTEX_IN_MEDIUM != 0 { [v.material as f32, 0.0, 0.0] } else { v.geometric },
        level: 0,
    })
}

/// Whether the scene has smooth glass or mirrors.
pub fn has_smooth_objects(prepared: &PreparedScene) -> bool {
    smooth_triangles(&prepared.geometry).next().is_some()
}

/// Whether a render gathers photons. It does if there are lamps without a surface and smooth objects that they may shine on. But
/// light of a beam without width cannot meet a pixel without width.
pub fn merges(scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> bool {
    settings.merge() == Merge::Auto && !velocities::are_needed(settings) && can_merge(scene, settings, prepared)
}

/// Whether the pixels of the camera see more than a single ray each.
fn has_area(camera: &Camera) -> bool {
    camera.projection.aims().is_none() || camera.projection.half_height() > 0.0
}

/// As [`merges`], whatever `--merge` says.
pub fn can_merge(scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> bool {
    settings.strategies() == Strategies::All
        && settings.max_depth() > 2
        && (has_area(&scene.cameras[settings.camera()]) || prepared.emitters.thin_beams == 0)
        && may_aim(prepared)
}

impl Renderer {
    /// The light of the film that merging found; `None` if the render does not merge.
    #[doc(hidden)]
    pub fn merged(&self) -> Option<Merged> {
        self.plan.merging.is_some().then(|| self.merged.of(self.film()))
    }
}

/// Number of photons in an iteration of so many `samples`.
pub fn count(samples: u64) -> u32 {
    samples.clamp(MIN_PHOTONS, MAX_PHOTONS) as u32
}

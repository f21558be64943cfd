//! The memory that a render will need, buffer by buffer, computed before anything is allocated.

use super::Renderer;
use super::device_scene::DeviceScene;
use super::light::LightTracer;
use super::photons::PhotonTracer;
use super::plan::Plan;
use super::pool::{DevicePool, PoolSize};
use super::prepared_scene::PreparedScene;
use super::responses::{DeviceFilm, on_device};
use super::sensor::SensorTracer;
use crate::error::{Error, Result};
use crate::estimators::PoolOrder;
use crate::free_memory;
use crate::gpu::{BufferDesc, Device, DeviceInfo};
use crate::scene::{Instance, Scene};
use crate::settings::Settings;
use crate::wgsl::layout::PathVertex;

/// Estimated number of stored vertices per light path. Scenes vary from 1 (outdoors) to more than 10 (white rooms).
const VERTICES_PER_PATH: u32 = 4;
/// Maximum number of host bytes per triangle while the BVH is built: corners, boxes, two node formats, order.
const BUILD_BYTES: u64 = 320;
/// Host bytes per pixel of the double-double sums of the film.
const FILM_BYTES: u64 = 96;
/// Host bytes per pixel: [`FILM_BYTES`], 4 for its cells, 12 for the image of an iteration, 16 for a copy
/// of the device's film, 8 for the list of pixels in sample order.
const PIXEL_BYTES: u64 = 136;
/// Host bytes per pixel of the image that another iteration in flight has: 12 of t = 1, 16 of the device's film, 12 of the total of several
/// responses, 1 for the sample count.
const IMAGE_BYTES: u64 = 41;
/// Host bytes per light vertex: the vertex in the pool, the index of its path, and its place.
const VERTEX_BYTES: u64 = size_of::<PathVertex>() as u64 + 8;
/// Additional host bytes per pixel for adaptive sampling: the sample statistics, the error twice, and the sample count.
const ADAPTIVE_PIXEL_BYTES: u64 = 49;
const GIB: f64 = (1u64 << 30) as f64;
/// Host bytes of the program itself, the driver and the driver's compiler.
const PROGRAM_BYTES: u64 = 120 << 20;

/// Fails if the BVH of the scene needs more memory than this machine has. Takes no memory itself, so it comes before anything that
/// grows with the instances.
pub fn check_build(scene: &Scene) -> Result<()> {
    check_build_in(free_memory::free(), scene)
}

fn check_build_in(free: Option<u64>, scene: &Scene) -> Result<()> {
    let of =
        |instance: &Instance| scene.meshes.get(instance.mesh as usize).map_or(0, |mesh| mesh.triangles.len() as u64);
    let triangles: u64 = scene.instances.iter().map(of).sum();
    let needed = BUILD_BYTES.saturating_mul(triangles);
    match free.filter(|free| needed > *free) {
        None => Ok(()),
        Some(free) => Err(Error::settings(format!(
            "the scene has {triangles} triangles, instances included, which need {:.1} GiB of memory, but only {:.1} GiB are free; \
             simplify the scene or split it",
            needed as f64 / GIB,
            free as f64 / GIB
        ))),
    }
}

/// The memory that a render needs.
pub struct MemoryPlan {
    /// Buffers of the scene.
    pub scene: Vec<BufferDesc>,
    /// Work buffers of an iteration, for the maximum number of candidate slots.
    pub iteration: Vec<BufferDesc>,
    /// Buffers of the light-vertex pool; their size is an estimate.
    pub pool: Vec<BufferDesc>,
    /// Estimate of the program's maximum memory. Includes the buffers if the device is the CPU.
    pub host_bytes: u64,
    /// Number of iterations in flight.
    pub in_flight: u32,
    /// Buffers whose size is known before the first light path, for [`MemoryPlan::check`].
    certain: Vec<BufferDesc>,
    plan: Plan,
}

impl MemoryPlan {
    /// The plan for `device`. Without a device, the plan is for a software device without limits. Fails if the estimator
    /// cannot render the emitters.
    pub fn new(
        scene: &Scene,
        settings: &Settings,
        prepared: &PreparedScene,
        device: Option<&DeviceInfo>,
    ) -> Result<MemoryPlan> {
        let unlimited = DeviceInfo::unlimited();
        let info = device.unwrap_or(&unlimited);
        let mut plan = Plan::new(scene, settings, prepared, info.quirks)?;
        let (scene_buffers, mut iteration) =
            (DeviceScene::buffer_descs(prepared, plan.hardware_rays), iteration_buffers(info, &plan, prepared));
        let vertices = plan.light_paths.saturating_mul(VERTICES_PER_PATH.min(plan.max_depth));
        // A photon may be stored at several bounces.
        let photons = if plan.merging.is_some() { 2 * plan.photons(plan.max_samples()) as usize } else { 0 };
        let pool = pool_buffers(&plan, vertices, photons);
        if on_device::is_suited(info, &plan) {
            let film = DeviceFilm::buffer_descs(&plan);
            let all = sum(&scene_buffers) + sum(&iteration) + sum(&pool) + sum(&film);
            // The pool is an estimate, and other programs need memory, too.
            plan.tuning.device_film = Some(all <= info.heap_bytes / 8 * 7);
            if plan.tuning.device_film == Some(true) {
                iteration.extend(film);
            }
        }
        let buffers = sum(&scene_buffers) + sum(&iteration) + sum(&pool);
        let triangles = prepared.triangles() as u64;
        let flat = DeviceScene::host_bytes(prepared) + size_of_val(&prepared.geometry.bvh.nodes[..]) as u64;
        // The BVH is built before anything is uploaded, so only the larger of the two sums counts below.
        let copies: u64 = iteration.iter().filter(|desc| desc.read_back).map(|desc| desc.bytes).sum();
        let on_host = if info.is_cpu() { buffers } else { 0 } + if info.drive.maps_memory { 0 } else { copies };
        // Each iteration in flight has an image and light vertices on the host.
        let of_iteration = VERTEX_BYTES * u64::from(vertices) + IMAGE_BYTES * plan.crop_pixels;
        let in_flight = in_flight(info.drive.in_flight, of_iteration, free_memory::free());
        plan.tuning.in_flight = Some(in_flight);
        let pools = u64::from(in_flight);
        let adaptive = if plan.adaptive { ADAPTIVE_PIXEL_BYTES } else { 0 };
        let kept = if plan.tuning.device_film == Some(true) { FILM_BYTES + adaptive } else { 0 };
        let pixels = (PIXEL_BYTES + adaptive + kept + (pools - 1) * IMAGE_BYTES) * plan.crop_pixels;
        let host_bytes = PROGRAM_BYTES
            + scene_bytes(scene)
            + (BUILD_BYTES * triangles).max(flat + on_host + pixels + pools * VERTEX_BYTES * u64::from(vertices));
        let certain = certain_buffers(info, &plan, prepared);
        Ok(MemoryPlan { scene: scene_buffers, iteration, pool, host_bytes, in_flight, certain, plan })
    }

    /// Total bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        sum(&self.scene) + sum(&self.iteration) + sum(&self.pool)
    }

    /// All buffers, sorted by size, the largest first.
    pub fn largest(&self) -> Vec<BufferDesc> {
        let mut all: Vec<BufferDesc> = [&self.scene[..], &self.iteration, &self.pool].concat();
        all.sort_by_key(|desc| std::cmp::Reverse(desc.bytes));
        all
    }

    /// A warning if the estimated light-vertex pool exceeds the device's limits, so that the render may fail after its light
    /// paths are traced. `None` if everything fits, or if [`MemoryPlan::check`] already fails.
    pub fn warning(&self, device: &DeviceInfo) -> Option<String> {
        self.check(device).ok()?;
        let all = [&self.scene[..], &self.iteration, &self.pool].concat();
        let error = crate::gpu::buffer_desc::check_all(&all, device).err()?;
        Some(format!(
            "the render may stop after its light paths are traced, if they have as many vertices as estimated: {error}"
        ))
    }

    /// Fails if the render certainly does not fit the device. The error names the flag to change.
    pub fn check(&self, device: &DeviceInfo) -> Result<()> {
        crate::gpu::buffer_desc::check_all(&self.certain, device)
    }
}

impl Renderer {
    /// As [`Renderer::from_prepared`], with the memory plan for `device` of the same scene and settings.
    pub fn from_memory_plan(
        device: &Device,
        memory: MemoryPlan,
        scene: &Scene,
        prepared: &PreparedScene,
    ) -> Result<Renderer> {
        let size = [memory.plan.crop.width(), memory.plan.crop.height()];
        Renderer::from_plan(device, memory.plan, size, scene, prepared)
    }
}

/// How many iterations are in flight. A second one, which takes so many `bytes`, must leave three quarters of the `free` ones.
fn in_flight(of_device: u32, bytes: u64, free: Option<u64>) -> u32 {
    let fits = free.is_none_or(|free| bytes <= free / 4);
    if fits { of_device } else { 1 }
}

/// Descriptors of all buffers whose size is known before the first light path is traced. For the pool this is the minimum size.
pub(super) fn certain_buffers(info: &DeviceInfo, plan: &Plan, prepared: &PreparedScene) -> Vec<BufferDesc> {
    let emitters = &prepared.emitters;
    let every_path_starts_on_a_surface = emitters.has_area() && emitters.lights.is_empty();
    let vertices = if every_path_starts_on_a_surface { plan.light_paths } else { 0 };
    let mut buffer_descs = DeviceScene::buffer_descs(prepared, plan.hardware_rays);
    buffer_descs.extend(iteration_buffers(info, plan, prepared));
    buffer_descs.extend(pool_buffers(plan, vertices, 0));
    buffer_descs
}

fn iteration_buffers(info: &DeviceInfo, plan: &Plan, prepared: &PreparedScene) -> Vec<BufferDesc> {
    let mut buffer_descs = LightTracer::buffer_descs(info, plan);
    buffer_descs.extend(SensorTracer::buffer_descs(info, plan, plan.max_slots(&prepared.emitters)));
    if plan.merging.is_some() {
        buffer_descs.extend(PhotonTracer::buffer_descs(plan));
    }
    buffer_descs
}

/// Buffers of a pool with so many light vertices and stored photons.
fn pool_buffers(plan: &Plan, vertices: u32, photons: usize) -> Vec<BufferDesc> {
    let leaf_size = plan.leaf_size;
    // The tree splits its vertices in halves, so every leaf is at least half full.
    let nodes = if leaf_size > 0 { vertices * 2 / (leaf_size + 1) } else { 0 };
    let offsets = if plan.estimator.pool_order == PoolOrder::ByPath { plan.light_paths as usize + 1 } else { 0 };
    let records = if plan.estimator.pool_order == PoolOrder::Trees { vertices } else { 0 };
    DevicePool::buffer_descs(PoolSize {
        vertices: vertices as usize,
        records: records as usize,
        nodes: nodes as usize,
        offsets,
        photons: photons.max(1),
        photon_lists: if photons > 0 { photons.next_power_of_two() + 1 } else { 1 },
    })
}

/// Host bytes of the loaded scene: meshes, images and density grids.
fn scene_bytes(scene: &Scene) -> u64 {
    let meshes = scene.meshes.iter().map(|m| {
        size_of_val(&m.positions[..])
            + size_of_val(&m.normals[..])
            + size_of_val(&m.uvs[..])
            + size_of_val(&m.colors[..])
            + size_of_val(&m.tangents[..])
            + size_of_val(&m.triangles[..])
    });
    let images = scene.images.iter().map(|i| size_of_val(&i.rgba[..]));
    let grids = scene.media.iter().filter_map(|m| m.grid.as_ref()).map(|grid| size_of_val(&grid.density[..]));
    meshes.chain(images).chain(grids).sum::<usize>() as u64
}

fn sum(buffer_descs: &[BufferDesc]) -> u64 {
    buffer_descs.iter().map(|desc| desc.bytes).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_iteration_is_in_flight_if_another_one_does_not_fit() {
        assert_eq!([None, Some(4000), Some(3999)].map(|free| in_flight(2, 1000, free)), [2, 2, 1]);
        assert_eq!(in_flight(1, 0, None), 1);
    }

    #[test]
    fn a_scene_that_needs_more_memory_than_is_free_is_refused_with_its_count() {
        let mut scene = crate::generate::build(crate::generate::Kind::CornellBox);
        let instance = scene.instances[0].clone();
        scene.instances = vec![instance; 1000];
        // Each instance of the floor has two triangles.
        let needed = 2000 * BUILD_BYTES;
        assert!(check_build_in(Some(needed), &scene).is_ok() && check_build_in(None, &scene).is_ok());
        let message = check_build_in(Some(needed - 1), &scene).unwrap_err().to_string();
        assert!(message.contains("the scene has 2000 triangles, instances included, which need"), "{message}");
    }
}

//! The memory a render will take, buffer by buffer, before anything is allocated.

use super::device_scene::DeviceScene;
use super::light::LightTracer;
use super::plan::Plan;
use super::pool::DevicePool;
use super::prepared::Prepared;
use super::sensor::SensorTracer;
use crate::error::Result;
use crate::estimators::PoolOrder;
use crate::gpu::{DeviceInfo, Need};
use crate::scene::Scene;
use crate::settings::Settings;

/// Vertices a light path is assumed to leave; scenes differ from 1 (outdoors) to over 10 (white rooms).
const VERTICES_A_PATH: u32 = 4;
/// Host bytes at most while the hierarchy over a triangle is built: corners, boxes, two node formats, order.
const BUILD_BYTES: u64 = 320;
/// Host bytes per pixel: the film's sums in twice the digits of f64, the image of an iteration.
const PIXEL_BYTES: u64 = 112;
/// And what is known of it, with its samples, where these are not spread evenly.
const ADAPTIVE_PIXEL_BYTES: u64 = 41;
/// The program itself, the driver and its compiler.
const PROGRAM_BYTES: u64 = 120 << 20;

/// What a render needs.
#[derive(Debug, Clone)]
pub struct MemoryPlan {
    /// Buffers of the scene.
    pub scene: Vec<Need>,
    /// Buffers that every iteration works in, for the most slots it may need.
    pub iteration: Vec<Need>,
    /// The light-vertex pool, an estimate.
    pub pool: Vec<Need>,
    /// The program's own memory at its peak, an estimate; with the buffers where the device is the CPU.
    pub host_bytes: u64,
    certain: Vec<Need>,
}

impl MemoryPlan {
    /// Without a device: as for software without limits.
    pub fn new(
        scene: &Scene,
        settings: &Settings,
        prepared: &Prepared,
        device: Option<&DeviceInfo>,
    ) -> Result<MemoryPlan> {
        let plan = Plan::new(scene, settings, prepared)?;
        let unlimited = DeviceInfo::unlimited();
        let info = device.unwrap_or(&unlimited);
        let (scene_needs, iteration) = (DeviceScene::needs(prepared), iteration_needs(info, &plan, prepared));
        let pool = pool_needs(&plan, plan.light_paths.saturating_mul(VERTICES_A_PATH.min(plan.max_depth)));
        let buffers = sum(&scene_needs) + sum(&iteration) + sum(&pool);
        let triangles = prepared.triangles() as u64;
        let flat = sum(&scene_needs) + size_of_val(&prepared.geometry.bvh.nodes[..]) as u64;
        // The hierarchy is built before anything is uploaded.
        let copies: u64 = iteration.iter().filter(|need| need.read_back).map(|need| need.bytes).sum();
        let on_host = if info.is_cpu() { buffers } else { 0 } + if info.drive.maps_memory { 0 } else { copies };
        let pixels = (PIXEL_BYTES + if plan.adaptive { ADAPTIVE_PIXEL_BYTES } else { 0 }) * plan.crop_pixels;
        let host_bytes = PROGRAM_BYTES + scene_bytes(scene) + (BUILD_BYTES * triangles).max(flat + on_host + pixels);
        let certain = certain_needs(info, &plan, prepared);
        Ok(MemoryPlan { scene: scene_needs, iteration, pool, host_bytes, certain })
    }

    /// Bytes on the device in all.
    pub fn device_bytes(&self) -> u64 {
        sum(&self.scene) + sum(&self.iteration) + sum(&self.pool)
    }

    /// All buffers, the largest first.
    pub fn largest(&self) -> Vec<Need> {
        let mut all: Vec<Need> = [&self.scene[..], &self.iteration, &self.pool].concat();
        all.sort_by_key(|need| std::cmp::Reverse(need.bytes));
        all
    }

    /// A sentence if the render will likely not fit, though only the light vertices of an iteration will tell: what is
    /// estimated of them exceeds the device. None where it fits, or where [`MemoryPlan::check`] fails already.
    pub fn warning(&self, device: &DeviceInfo) -> Option<String> {
        self.check(device).ok()?;
        let all = [&self.scene[..], &self.iteration, &self.pool].concat();
        let error = crate::gpu::need::check_all(&all, device).err()?;
        Some(format!("the render may stop when its light vertices are known: an estimate says that {error}"))
    }

    /// Fails, with the flag to change, where the render certainly does not fit.
    pub fn check(&self, device: &DeviceInfo) -> Result<()> {
        crate::gpu::need::check_all(&self.certain, device)
    }
}

/// Everything whose size is known before the first light path; of the pool only what no iteration can do without.
pub(super) fn certain_needs(info: &DeviceInfo, plan: &Plan, prepared: &Prepared) -> Vec<Need> {
    let emitters = &prepared.emitters;
    let every_path_starts_on_a_surface = emitters.has_area() && emitters.lights.is_empty();
    let vertices = if every_path_starts_on_a_surface { plan.light_paths } else { 0 };
    let mut needs = DeviceScene::needs(prepared);
    needs.extend(iteration_needs(info, plan, prepared));
    needs.extend(pool_needs(plan, vertices));
    needs
}

fn iteration_needs(info: &DeviceInfo, plan: &Plan, prepared: &Prepared) -> Vec<Need> {
    let mut needs = LightTracer::needs(info, plan);
    needs.extend(SensorTracer::needs(info, plan, plan.max_slots(&prepared.emitters)));
    needs
}

fn pool_needs(plan: &Plan, vertices: u32) -> Vec<Need> {
    let leaf_size = plan.leaf_size;
    // Halving leaves them at least half full.
    let nodes = if leaf_size > 0 { vertices * 2 / (leaf_size + 1) } else { 0 };
    let offsets = if plan.estimator.pool_order == PoolOrder::ByPath { plan.light_paths as usize + 1 } else { 0 };
    DevicePool::needs(vertices as usize, nodes as usize, offsets).to_vec()
}

/// What the loaded file holds in memory.
fn scene_bytes(scene: &Scene) -> u64 {
    let meshes = scene.meshes.iter().map(|m| {
        size_of_val(&m.positions[..])
            + size_of_val(&m.normals[..])
            + size_of_val(&m.uvs[..])
            + size_of_val(&m.triangles[..])
    });
    let images = scene.images.iter().map(|i| size_of_val(&i.rgba[..]));
    meshes.chain(images).sum::<usize>() as u64
}

fn sum(needs: &[Need]) -> u64 {
    needs.iter().map(|need| need.bytes).sum()
}

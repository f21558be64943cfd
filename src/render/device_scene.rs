//! The scene on the device: group 0 of the kernels.

use super::albedo::AlbedoTable;
use super::emitters::EmitterSet;
use super::geometry::{Features, Geometry};
use crate::error::Result;
use crate::gpu::layout::Frame;
use crate::gpu::{Buffer, Device};

/// Buffers of group 0, by the names they have in WGSL.
pub struct DeviceScene {
    pub frame: Buffer,
    buffers: Vec<(&'static str, Buffer)>,
    pub features: Features,
}

impl DeviceScene {
    /// Uploads everything; fails with a remedy if a buffer exceeds what the device allows.
    pub fn new(
        device: &Device,
        geometry: &Geometry,
        emitters: &EmitterSet,
        albedo: &AlbedoTable,
    ) -> Result<DeviceScene> {
        let meshes = "use a scene with fewer triangles, or a device with a larger limit (taugate devices)";
        let images = "use smaller textures, or a device with a larger limit (taugate devices)";
        let buffers = vec![
            ("bvh_nodes", Buffer::from_slice(device, "BVH nodes", &geometry.bvh.nodes, meshes)?),
            ("triangles", Buffer::from_slice(device, "triangles", &geometry.triangles, meshes)?),
            ("corners", Buffer::from_slice(device, "triangle corners", &geometry.corners, meshes)?),
            ("attributes", Buffer::from_slice(device, "vertex attributes", &geometry.attributes, meshes)?),
            ("instances", Buffer::from_slice(device, "instances", &geometry.instances, meshes)?),
            ("materials", Buffer::from_slice(device, "materials", &geometry.materials, meshes)?),
            ("textures", Buffer::from_slice(device, "textures", &geometry.textures, images)?),
            ("texels", Buffer::from_slice(device, "texels", &geometry.texels, images)?),
            ("emitters", Buffer::from_slice(device, "emitters", &emitters.table, meshes)?),
            ("albedo_table", Buffer::from_slice(device, "albedo table", &albedo.values, meshes)?),
        ];
        let frame = Buffer::new::<Frame>(device, "frame", 1, "this cannot happen")?;
        Ok(DeviceScene { frame, buffers, features: geometry.features })
    }

    /// Everything a kernel may ask for from group 0.
    pub fn bindings(&self) -> Vec<(&str, &Buffer)> {
        let mut all: Vec<_> = self.buffers.iter().map(|(name, buffer)| (*name, buffer)).collect();
        all.push(("frame", &self.frame));
        all
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        self.buffers.iter().map(|(_, b)| b.size()).sum()
    }
}

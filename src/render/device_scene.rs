//! The scene on the device: group 0 of the kernels.

use std::borrow::Cow;
use std::sync::Arc;

use bytemuck::NoUninit;

use super::geometry::TexelLayout;
use super::material::Material;
use super::prepared_scene::PreparedScene;
use super::ray_structure;
use crate::error::Result;
use crate::gpu::{Buffer, BufferDesc, Device};
use crate::scene::Scene;
use crate::wgsl::layout::{Emitter, Frame};

/// Buffers of group 0, with their names in WGSL.
pub struct DeviceScene {
    emitters: Buffer,
    /// Read-only while two renderers share them.
    buffers: Arc<Vec<(&'static str, Buffer)>>,
}

/// An array of the scene: name in WGSL, buffer descriptor, contents.
type Part<'a> = (&'static str, BufferDesc, Cow<'a, [u8]>);

/// Names in WGSL of the arrays that change between renders.
const EMITTERS: &str = "emitters";
const AIMS: &str = "aims";
const VELOCITIES: &str = "velocities";

pub(super) const MESHES: &str = "use a scene with fewer triangles, or a device with a larger limit (taugate devices)";
const MEDIA: &str = "use fewer media and shorter tables, or a device with a larger limit (taugate devices)";
const GRIDS: &str = "use density grids with fewer voxels, or a device with a larger limit (taugate devices)";
const POINTS: &str = "use fewer sensor points, or a device with a larger limit (taugate devices)";
const SKY: &str = "use a smaller image for --sky, or a device with a larger limit (taugate devices)";
const IMAGES: &str = "use smaller textures, or a device with a larger limit (taugate devices)";

fn parts(prepared: &PreparedScene) -> Vec<Part<'_>> {
    fn part<'a, T: NoUninit>(wgsl: &'static str, name: &'static str, data: &'a [T], remedy: &'static str) -> Part<'a> {
        (wgsl, BufferDesc::of::<T>(name, data.len(), remedy), bytemuck::cast_slice(data).into())
    }
    fn texels<'a, T: NoUninit>(
        wgsl: &'static str,
        name: &'static str,
        data: &'a [T],
        remedy: &'static str,
    ) -> Part<'a> {
        (wgsl, BufferDesc::of_texels::<T>(name, data.len(), remedy), bytemuck::cast_slice(data).into())
    }
    let PreparedScene { geometry, emitters, media, albedo, aims, velocities, .. } = prepared;
    let emissive = geometry.materials.iter().zip(&emitters.densities);
    let materials: Vec<Material> =
        emissive.map(|(material, &emission_density)| Material { emission_density, ..*material }).collect();
    let materials = bytemuck::cast_slice(&materials).to_vec();
    vec![
        texels("bvh_nodes", "BVH nodes", &geometry.bvh.nodes, MESHES),
        texels("triangles", "triangles", &geometry.triangles, MESHES),
        part("corners", "triangle corners", &geometry.corners, MESHES),
        part("attributes", "vertex attributes", &geometry.attributes, MESHES),
        part("details", "vertex colours and tangents", &geometry.details, MESHES),
        texels("instances", "instances", &geometry.instances, MESHES),
        (
            "materials",
            BufferDesc::of_texels::<Material>("materials", geometry.materials.len(), MESHES),
            materials.into(),
        ),
        texels("textures", "textures", &geometry.textures, IMAGES),
        texels(EMITTERS, "emitters", &emitters.table, MESHES),
        texels(AIMS, "rays of sensor points", aims, POINTS),
        texels(VELOCITIES, "velocities", velocities, MESHES),
        texels("sky", "sky", &emitters.sky, SKY),
        texels("media", "media", &media.list, MEDIA),
        texels("phase_tables", "tables of phase functions", &media.phase_tables, MEDIA),
        texels("grids", "headers of density grids", &media.grids, MEDIA),
        texels("densities", "density grids", &media.densities, GRIDS),
        texels("albedo_table", "albedo table", &albedo.texels, MESHES),
    ]
}

/// Descriptor of the array of texels, which the host uploads from the images of the scene.
fn texels_desc(prepared: &PreparedScene) -> BufferDesc {
    BufferDesc::of_texels::<[u8; TexelLayout::WORD]>("texels", prepared.geometry.texels.words, IMAGES)
}

/// Allocates and fills an array.
fn upload(device: &Device, (wgsl, desc, data): Part) -> Result<(&'static str, Buffer)> {
    let mut buffer = Buffer::from_desc(device, &desc)?;
    buffer.write(0, &data)?;
    Ok((wgsl, buffer))
}

fn emitters_buffer(device: &Device, prepared: &PreparedScene) -> Result<Buffer> {
    let part = parts(prepared).into_iter().find(|(wgsl, ..)| *wgsl == EMITTERS);
    Ok(upload(device, part.expect("a scene has emitters"))?.1)
}

/// A buffer for the frame of one phase of an iteration.
pub fn frame_buffer(device: &Device) -> Result<Buffer> {
    Buffer::new::<Frame>(device, "frame", 1, "choose another --device")
}

impl DeviceScene {
    /// Descriptors of the scene's buffers.
    pub fn buffer_descs(prepared: &PreparedScene, hardware_rays: bool) -> Vec<BufferDesc> {
        let copied = parts(prepared).into_iter().map(|(_, desc, _)| desc);
        let rays = hardware_rays.then(|| ray_structure::buffer_descs(prepared)).into_iter().flatten();
        copied.chain([texels_desc(prepared)]).chain(rays).collect()
    }

    /// Bytes of the arrays that the host keeps in the layout of the device: all but the texels.
    pub fn host_bytes(prepared: &PreparedScene) -> u64 {
        parts(prepared).iter().map(|(_, _, data)| data.len() as u64).sum()
    }

    /// Uploads the scene. `prepared` was made from `scene`. If `hardware_rays`, the device also builds what its ray queries need. Fails, with
    /// the remedy, if a buffer exceeds a limit of the device.
    pub fn new(device: &Device, scene: &Scene, prepared: &PreparedScene, hardware_rays: bool) -> Result<DeviceScene> {
        let shared = parts(prepared).into_iter().filter(|(wgsl, ..)| *wgsl != EMITTERS);
        let mut buffers = shared.map(|part| upload(device, part)).collect::<Result<Vec<_>>>()?;
        let mut texels = Buffer::from_desc(device, &texels_desc(prepared))?;
        prepared.geometry.texels.write(scene, |offset, bytes| texels.write(offset, bytes))?;
        buffers.push(("texels", texels));
        if hardware_rays {
            buffers.extend(ray_structure::buffers(device, &prepared.geometry.triangles)?);
        }
        let emitters = emitters_buffer(device, prepared)?;
        Ok(DeviceScene { emitters, buffers: Arc::new(buffers) })
    }

    /// A device scene for another renderer of the same scene. It has its own emitters and shares all other arrays, which
    /// cannot be replaced while both exist.
    pub fn share(&self, device: &Device, prepared: &PreparedScene) -> Result<DeviceScene> {
        let emitters = emitters_buffer(device, prepared)?;
        Ok(DeviceScene { emitters, buffers: self.buffers.clone() })
    }

    /// Replaces the emitters; their number must stay the same.
    pub fn write_emitters(&mut self, emitters: &[Emitter]) -> Result<()> {
        self.emitters.write(0, emitters)
    }

    /// Replaces the rays of the sensor points; their number must stay the same.
    pub fn write_aims(&mut self, aims: &[[f32; 4]]) -> Result<()> {
        self.replace(AIMS, aims)
    }

    /// Replaces the velocities; their number must stay the same.
    pub fn write_velocities(&mut self, velocities: &[[f32; 4]]) -> Result<()> {
        self.replace(VELOCITIES, velocities)
    }

    fn replace(&mut self, array: &str, texels: &[[f32; 4]]) -> Result<()> {
        if texels.is_empty() {
            return Ok(());
        }
        let buffers = Arc::get_mut(&mut self.buffers).expect("the arrays of a renderer with siblings are fixed");
        let buffer = buffers.iter_mut().find(|(name, _)| *name == array);
        buffer.expect("the scene has all its arrays").1.write(0, texels)
    }

    /// All buffers of group 0, for kernels that read `frame`; a kernel may use any of them.
    pub fn bindings<'a>(&'a self, frame: &'a Buffer) -> Vec<(&'a str, &'a Buffer)> {
        let mut all: Vec<_> = self.buffers.iter().map(|(name, buffer)| (*name, buffer)).collect();
        all.extend([("frame", frame), (EMITTERS, &self.emitters)]);
        all
    }

    /// Total bytes of the scene's arrays on the device.
    pub fn bytes(&self) -> u64 {
        self.buffers.iter().map(|(_, b)| b.size()).sum::<u64>() + self.emitters.size()
    }
}

//! What ray queries need on the device: the acceleration structure of the scene's triangles, and the indices of its primitives.

use super::device_scene::MESHES;
use super::prepared_scene::PreparedScene;
use crate::error::Result;
use crate::gpu::{Buffer, BufferDesc, Device, TriangleGroup};
use crate::wgsl::layout::Triangle;
use crate::wgsl::layout::constants::*;

/// Masks of the groups of triangles: those that stop every ray, those that may let rays pass, null boundaries.
const MASKS: [u32; 3] = [RAY_GROUP_OPAQUE, RAY_GROUP_PASSABLE, RAY_GROUP_BOUNDARY];

/// Estimated bytes of an acceleration structure per triangle: lavapipe of Mesa 25 takes 104.
const BYTES_PER_TRIANGLE: usize = 128;

/// Number in [`MASKS`] of the group of a triangle.
fn group_of(triangle: &Triangle) -> usize {
    match triangle.material {
        material if material & TRIANGLE_NULL != 0 => 2,
        material if material & (TRIANGLE_ALPHA | TRIANGLE_SHEET) != 0 => 1,
        _ => 0,
    }
}

/// The words of the array `ray_triangles` of `ray_query.wgsl`.
fn indices(triangles: &[Triangle]) -> Vec<u32> {
    let mut words = vec![0; MASKS.len()];
    for group in 0..MASKS.len() {
        words[group] = words.len() as u32;
        let of_group = triangles.iter().enumerate().filter(|(_, triangle)| group_of(triangle) == group);
        words.extend(of_group.map(|(index, _)| index as u32));
    }
    words
}

/// Estimates of the buffers that [`buffers`] makes.
pub fn buffer_descs(prepared: &PreparedScene) -> [BufferDesc; 2] {
    let count = prepared.triangles();
    [
        BufferDesc::of::<[u8; BYTES_PER_TRIANGLE]>("acceleration structures", count, MESHES),
        BufferDesc::of::<u32>("indices of ray queries", MASKS.len() + count, MESHES),
    ]
}

/// The buffers of ray queries over `triangles`, with their names in WGSL. The device has built the acceleration structure.
pub fn buffers(device: &Device, triangles: &[Triangle]) -> Result<[(&'static str, Buffer); 2]> {
    let group = |number: usize| TriangleGroup {
        corners: triangles
            .iter()
            .filter(|triangle| group_of(triangle) == number)
            .flat_map(|triangle| [triangle.v0, triangle.v1, triangle.v2])
            .collect(),
        is_opaque: number == 0,
        mask: MASKS[number] as u8,
    };
    let structure = Buffer::acceleration_structure(device, "acceleration structures", &[0, 1, 2].map(group))?;
    let indices = Buffer::from_slice(device, "indices of ray queries", &indices(triangles), MESHES)?;
    Ok([("ray_structure", structure), ("ray_triangles", indices)])
}

//! The parts of a generated scene: short names for the functions of [`crate::scene`] that build one, and rotations.

use glam::{DAffine3, DMat3, DVec3};

use super::numbers::sin_cos;
pub use crate::scene::build::look;
use crate::scene::{Camera, Image, LightKind, Material, Mesh, Scene};

/// [`Material::diffuse`].
pub fn diffuse(name: &str, rgb: [f32; 3]) -> Material {
    Material::diffuse(name, rgb)
}

/// [`Material::metal`].
pub fn metal(name: &str, rgb: [f32; 3], roughness: f32) -> Material {
    Material::metal(name, rgb, roughness)
}

/// [`Material::plastic`].
pub fn plastic(name: &str, rgb: [f32; 3], roughness: f32) -> Material {
    Material::plastic(name, rgb, roughness)
}

/// [`Material::glass`].
pub fn glass(name: &str) -> Material {
    Material::glass(name)
}

/// [`Material::emitter`].
pub fn emitter(name: &str, radiance: [f32; 3]) -> Material {
    Material::emitter(name, radiance)
}

/// [`Scene::add_material`].
pub fn material(scene: &mut Scene, material: Material) -> u32 {
    scene.add_material(material)
}

/// [`Scene::add_texture`].
pub fn texture(scene: &mut Scene, image: Image) -> u32 {
    scene.add_texture(image)
}

/// [`Scene::add_mesh`] with a name.
pub fn mesh(scene: &mut Scene, name: &str, material: u32, mesh: Mesh) -> u32 {
    scene.add_mesh(Mesh { name: name.to_owned(), material, ..mesh })
}

/// [`Scene::place`].
pub fn place(scene: &mut Scene, node: &str, mesh: u32, transform: DAffine3) {
    scene.place(node, mesh, transform);
}

/// [`Scene::add_surface`] with a name.
pub fn add(scene: &mut Scene, name: &str, material: u32, shape: Mesh) {
    scene.add_surface(Mesh { name: name.to_owned(), ..shape }, material);
}

/// Adds a camera named `camera` at `eye` that looks at `target`, with y up; `yfov` in radians.
pub fn camera(scene: &mut Scene, eye: DVec3, target: DVec3, yfov: f64, resolution: [u32; 2]) {
    scene.add_camera(Camera::looking_at("camera", eye, target, yfov, resolution));
}

/// [`Scene::add_light`].
pub fn light(scene: &mut Scene, node: &str, position: DVec3, direction: DVec3, kind: LightKind) {
    scene.add_light(node, position, direction, kind);
}

/// Rotation about y by `angle` radians, counter-clockwise as seen from above, then translation to `position`.
pub fn turned(position: DVec3, angle: f64) -> DAffine3 {
    DAffine3::from_mat3_translation(about(DVec3::Y, angle), position)
}

/// Rotation about a unit axis by `angle` radians (Rodrigues' formula).
pub fn about(axis: DVec3, angle: f64) -> DMat3 {
    let (sin, cos) = sin_cos(angle);
    let turn = |v: DVec3| v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos));
    DMat3::from_cols(turn(DVec3::X), turn(DVec3::Y), turn(DVec3::Z))
}

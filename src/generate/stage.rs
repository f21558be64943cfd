//! Helpers to furnish a [`Scene`]: materials by kind, placement, camera and lights.

use glam::{DAffine3, DMat3, DVec3};

use super::numbers::sin_cos;
use crate::scene::{AlphaMode, Camera, Image, Instance, Light, LightKind, Material, Mesh, Scene, Texture, Wrap};

/// Lambert: metallic 0, specular 0, both sides.
pub fn diffuse(name: &str, rgb: [f32; 3]) -> Material {
    Material {
        name: name.to_owned(),
        base_color: [rgb[0], rgb[1], rgb[2], 1.0],
        base_color_texture: None,
        metallic: 0.0,
        roughness: 1.0,
        emission: [0.0; 3],
        emission_texture: None,
        specular: 0.0,
        ior: 1.5,
        transmission: 0.0,
        alpha_mode: AlphaMode::Opaque,
        double_sided: true,
    }
}

/// GGX conductor; a mirror at roughness 0.
pub fn metal(name: &str, rgb: [f32; 3], roughness: f32) -> Material {
    Material { metallic: 1.0, roughness, specular: 1.0, ..diffuse(name, rgb) }
}

/// Diffuse under a GGX coat of refractive index 1.5.
pub fn plastic(name: &str, rgb: [f32; 3], roughness: f32) -> Material {
    Material { roughness, specular: 1.0, ..diffuse(name, rgb) }
}

/// Clear smooth dielectric of refractive index 1.5.
pub fn glass(name: &str) -> Material {
    Material { roughness: 0.0, specular: 1.0, transmission: 1.0, ..diffuse(name, [1.0; 3]) }
}

/// Emits on its front only; reflects nothing.
pub fn emitter(name: &str, radiance: [f32; 3]) -> Material {
    Material { emission: radiance, double_sided: false, ..diffuse(name, [0.0; 3]) }
}

/// Adds a material and gives its index.
pub fn material(scene: &mut Scene, material: Material) -> u32 {
    scene.materials.push(material);
    scene.materials.len() as u32 - 1
}

/// Adds a bilinear, repeating texture and gives its index.
pub fn texture(scene: &mut Scene, image: Image) -> u32 {
    scene.images.push(image);
    scene.textures.push(Texture { image: scene.images.len() as u32 - 1, wrap: [Wrap::Repeat; 2], linear: true });
    scene.textures.len() as u32 - 1
}

/// Adds a mesh without placing it and gives its index.
pub fn mesh(scene: &mut Scene, name: &str, material: u32, mesh: Mesh) -> u32 {
    scene.meshes.push(Mesh { name: name.to_owned(), material, ..mesh });
    scene.meshes.len() as u32 - 1
}

/// Places a mesh in the world.
pub fn place(scene: &mut Scene, node: &str, mesh: u32, transform: DAffine3) {
    scene.instances.push(Instance { mesh, transform, node: node.to_owned() });
}

/// Adds a mesh and places it as it is.
pub fn add(scene: &mut Scene, name: &str, material: u32, shape: Mesh) {
    let index = mesh(scene, name, material, shape);
    place(scene, name, index, DAffine3::IDENTITY);
}

/// Adds the camera `camera` at `eye`, looking at `target`, y up; `yfov` in radians.
pub fn camera(scene: &mut Scene, eye: DVec3, target: DVec3, yfov: f64, resolution: [u32; 2]) {
    scene.cameras.push(Camera {
        name: "camera".to_owned(),
        transform: look(eye, target - eye),
        yfov,
        aspect: Some(f64::from(resolution[0]) / f64::from(resolution[1])),
        resolution: Some(resolution),
    });
}

/// Adds a light on a node of that name; `direction` need not be of unit length.
pub fn light(scene: &mut Scene, node: &str, position: DVec3, direction: DVec3, kind: LightKind) {
    scene.lights.push(Light { node: node.to_owned(), position, direction: direction.normalize(), kind });
}

/// The transform whose -Z points along `direction` and whose Y is as near to world y as that allows.
pub fn look(eye: DVec3, direction: DVec3) -> DAffine3 {
    let z = -direction.normalize();
    let up = if z.y.abs() > 0.999 { DVec3::Z } else { DVec3::Y };
    let x = up.cross(z).normalize();
    DAffine3::from_mat3_translation(DMat3::from_cols(x, z.cross(x), z), eye)
}

/// Rotation about y by `angle` radians, counter-clockwise seen from above, then a move to `position`.
pub fn turned(position: DVec3, angle: f64) -> DAffine3 {
    DAffine3::from_mat3_translation(about(DVec3::Y, angle), position)
}

/// Rotation about a unit axis by `angle` radians (Rodrigues).
pub fn about(axis: DVec3, angle: f64) -> DMat3 {
    let (sin, cos) = sin_cos(angle);
    let turn = |v: DVec3| v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos));
    DMat3::from_cols(turn(DVec3::X), turn(DVec3::Y), turn(DVec3::Z))
}

//! `zoo-area`, `zoo-punctual`, `zoo-beam`: one room with every feature. It has alpha masks and blending, textures, smooth
//! normals, mirrored and stretched instances, mixtures of metal and plastic, a glass block and an emissive texture. The lights
//! are a lamp with area, or a point and a spot, or a beam.

use super::paint;
use super::parts::{about, add, camera, diffuse, glass, light, look, material, mesh, metal, place, plastic, texture};
use super::shapes::{cuboid, icosphere, quad, torus};
use crate::scene::{AlphaMode, Image, LightKind, Material, Mesh, Scene};
use glam::{DAffine3, DMat3, DVec3};

/// An image of `size` x `size` texels with alternating squares of high and low alpha.
fn holes(size: u32) -> Image {
    let texel = |i: u32| {
        let (x, y) = (i % size, i / size);
        [220, 160, 90, if (x / 4 + y / 4).is_multiple_of(2) { 255 } else { 60 }]
    };
    Image { width: size, height: size, rgba: (0..size * size).map(texel).collect() }
}

/// A sphere with normals, for smooth shading.
fn smooth_sphere(radius: f64, subdivisions: u32) -> Mesh {
    let mut sphere = icosphere(radius, subdivisions);
    sphere.normals = sphere.positions.iter().map(|p| glam::Vec3::from(*p).normalize().to_array()).collect();
    sphere
}

fn room(scene: &mut Scene) {
    let tiles = texture(scene, paint::tiles(32, [200, 190, 180], [90, 70, 60]));
    let floor = Material { base_color_texture: Some(tiles), ..plastic("floor", [1.0; 3], 0.4) };
    let floor = material(scene, floor);
    let wall = material(scene, diffuse("wall", [0.7, 0.65, 0.6]));
    let (x, y, z) = (DVec3::X * 4.0, DVec3::Y * 3.0, DVec3::Z * 4.0);
    let corner = DVec3::new(-2.0, 0.0, -2.0);
    add(scene, "floor", floor, quad(corner, z, x, [3.0, 3.0]));
    add(scene, "ceiling", wall, quad(corner + y, x, z, [1.0, 1.0]));
    add(scene, "back", wall, quad(corner, x, y, [1.0, 1.0]));
    add(scene, "front", wall, quad(corner + z, y, x, [1.0, 1.0]));
    add(scene, "left", wall, quad(corner, y, z, [1.0, 1.0]));
    add(scene, "right", wall, quad(corner + x, z, y, [1.0, 1.0]));
}

fn things(scene: &mut Scene, specular: bool) {
    let sphere = smooth_sphere(0.45, 3);
    let mixed = material(scene, Material { metallic: 0.5, ..plastic("half metal", [0.8, 0.4, 0.2], 0.5) });
    let mixed = mesh(scene, "half metal", mixed, sphere.clone());
    // A mirrored, stretched and rotated instance: its normals need the inverse transpose, its winding the sign of the
    // determinant.
    let stretch = DMat3::from_diagonal(DVec3::new(-1.3, 0.7, 1.0)) * about(DVec3::Y, 0.7);
    place(scene, "stretched", mixed, DAffine3::from_mat3_translation(stretch, DVec3::new(-0.9, 0.5, -0.6)));
    let clear = material(scene, if specular { glass("glass") } else { plastic("block", [0.3, 0.5, 0.7], 0.2) });
    add(scene, "glass", clear, {
        let mut block = cuboid(DVec3::new(0.2, 0.001, -0.2), DVec3::new(0.8, 0.7, 0.3));
        block.uvs.clear();
        block
    });
    let mirror = material(scene, metal("mirror", [0.9, 0.9, 0.95], if specular { 0.0 } else { 0.3 }));
    add(scene, "mirror", mirror, quad(DVec3::new(1.2, 0.3, -1.9), DVec3::X * 0.7, DVec3::Y * 1.5, [1.0, 1.0]));
    let brass = material(scene, metal("brass", [0.9, 0.7, 0.3], 0.35));
    let ring = mesh(scene, "ring", brass, torus(0.35, 0.12, 24, 12));
    place(scene, "ring", ring, look(DVec3::new(1.1, 0.5, 0.6), DVec3::new(0.3, 1.0, 0.2)));
    let curtain = material(
        scene,
        Material { alpha_mode: AlphaMode::Blend, base_color: [0.6, 0.2, 0.2, 0.6], ..diffuse("curtain", [0.0; 3]) },
    );
    add(scene, "curtain", curtain, quad(DVec3::new(-1.6, 0.0, 0.4), DVec3::X * 1.4, DVec3::Y * 1.8, [1.0, 1.0]));
    let grid = texture(scene, holes(16));
    let grid =
        Material { alpha_mode: AlphaMode::Mask(0.5), base_color_texture: Some(grid), ..diffuse("grid", [1.0; 3]) };
    let grid = material(scene, grid);
    add(scene, "grid", grid, quad(DVec3::new(-0.4, 1.0, -1.0), DVec3::X * 1.2, DVec3::Y * 0.8, [2.0, 2.0]));
}

/// The emitters of the room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Light {
    /// A textured lamp. The room also has a mirror and a glass block.
    Area,
    /// A point light and a spot light. Nothing in the room is specular, because the oracle's path tracer cannot find caustics
    /// of these lights.
    Punctual,
    /// A collimated beam. Nothing in the room is specular, as for `Punctual`.
    Beam,
}

fn lights(scene: &mut Scene, emitters: Light) {
    match emitters {
        Light::Area => {
            let glow = texture(scene, paint::tiles(16, [255, 200, 120], [30, 60, 90]));
            let lamp =
                Material { emission: [9.0, 8.0, 7.0], emission_texture: Some(glow), ..diffuse("lamp", [0.1; 3]) };
            let lamp = material(scene, lamp);
            add(scene, "lamp", lamp, quad(DVec3::new(-0.4, 2.9, -0.4), DVec3::X * 0.8, DVec3::Z * 0.8, [2.0, 2.0]));
        }
        Light::Punctual => {
            let point = LightKind::Point { intensity: [0.8, 0.9, 1.0] };
            light(scene, "point", DVec3::new(1.6, 2.2, 1.4), DVec3::NEG_Y, point);
            let spot = LightKind::Spot { intensity: [6.0, 5.0, 4.0], inner: 0.2, outer: 0.5 };
            light(scene, "spot", DVec3::new(-1.7, 2.6, 1.7), DVec3::new(1.0, -1.4, -1.3), spot);
        }
        Light::Beam => {
            let kind = LightKind::Beam { power: [5.0, 5.0, 8.0], radius: 0.1 };
            light(scene, "beam", DVec3::new(-1.2, 1.2, 1.5), DVec3::new(0.15, -0.1, -1.0), kind);
        }
    }
}

/// The room with these emitters.
pub fn zoo(emitters: Light) -> Scene {
    let mut scene = Scene::default();
    room(&mut scene);
    things(&mut scene, emitters == Light::Area);
    lights(&mut scene, emitters);
    camera(&mut scene, DVec3::new(0.4, 1.6, 1.8), DVec3::new(-0.1, 0.9, -0.8), 1.1, [32, 24]);
    scene
}

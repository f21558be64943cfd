//! The scene as plain data: what a glTF file says, checked, in metres and world space, before anything is flattened.
//!
//! `gltf.rs` is the only file that knows glTF; `build.rs` makes scenes from arrays. `check.rs` says what every scene promises: the
//! loader checks it for a file, the renderer for every scene that it is given.

#![warn(missing_docs)]

pub mod build;
pub mod check;
pub mod gltf;
mod light;
mod material;

use glam::{BVec3, DAffine3, DVec3, Vec3};

pub use light::{Light, LightKind};
pub use material::{AlphaMode, Material};

/// A loaded scene. Lengths are metres; transforms are kept in f64 until the renderer moves the origin to the sensor.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// One mesh a glTF primitive, in its own space.
    pub meshes: Vec<Mesh>,
    /// Where meshes stand in the world; several instances may share a mesh.
    pub instances: Vec<Instance>,
    /// Never empty: primitives without a material use the glTF default material.
    pub materials: Vec<Material>,
    /// Images with their samplers.
    pub textures: Vec<Texture>,
    /// Texels, which textures may share.
    pub images: Vec<Image>,
    /// In the order of the nodes that carry them.
    pub cameras: Vec<Camera>,
    /// Punctual lights and beams; emissive meshes are found through `materials`.
    pub lights: Vec<Light>,
    /// What the file asks for and taugate does not do, one sentence each, in the file's order.
    pub warnings: Vec<String>,
}

impl Scene {
    /// Metres from one corner to the other of the box around all instances, their meshes taken as their own boxes; 0 without any.
    pub fn diagonal(&self) -> f64 {
        let boxes: Vec<[DVec3; 2]> = self.meshes.iter().map(Mesh::bounds).collect();
        let corners = self.instances.iter().flat_map(|instance| {
            let [lo, hi] = boxes[instance.mesh as usize];
            let corner = move |k: usize| DVec3::select(BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), hi, lo);
            (0..8).map(move |k| instance.transform.transform_point3(corner(k)))
        });
        let whole = corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[lo, hi], p| [lo.min(p), hi.max(p)]);
        (whole[1] - whole[0]).max(DVec3::ZERO).length()
    }
}

impl Mesh {
    /// Least and greatest coordinates of its positions, of which there is one at least.
    pub(crate) fn bounds(&self) -> [DVec3; 2] {
        let points = self.positions.iter().map(|&p| Vec3::from(p).as_dvec3());
        points.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[lo, hi], p| [lo.min(p), hi.max(p)])
    }
}

/// Triangles of one glTF primitive.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// For messages: mesh name and primitive number, e.g. `Chair[0]`.
    pub name: String,
    /// Corners in the mesh's own space.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals, one a position, or empty for flat shading.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates (set 0), one a position, or empty.
    pub uvs: Vec<[f32; 2]>,
    /// Counter-clockwise corners seen from the front; every index is below `positions.len()`. Triangles of zero area
    /// are already dropped.
    pub triangles: Vec<[u32; 3]>,
    /// Index into [`Scene::materials`].
    pub material: u32,
}

/// A mesh placed in the world.
#[derive(Debug, Clone)]
pub struct Instance {
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// World from mesh space. May mirror or scale unevenly; never singular.
    pub transform: DAffine3,
    /// Name of the glTF node, `node 17` when it has none.
    pub node: String,
}

/// How texture coordinates outside [0, 1] are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// The image repeats.
    #[default]
    Repeat,
    /// The image repeats, every other time mirrored.
    Mirror,
    /// The texels at the edge go on.
    Clamp,
}

/// An image with its sampler. Minification filters and mip levels are not used.
#[derive(Debug, Clone)]
pub struct Texture {
    /// Index into [`Scene::images`].
    pub image: u32,
    /// Across and down.
    pub wrap: [Wrap; 2],
    /// Bilinear if true, else nearest.
    pub linear: bool,
}

/// Decoded texels, row 0 at the top (v = 0), sRGB-encoded colour and linear alpha, 8 bits each.
#[derive(Debug, Clone)]
pub struct Image {
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// Row by row.
    pub rgba: Vec<[u8; 4]>,
}

/// A pinhole camera: looks along -Z of its transform, +Y up, +X right.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Different from that of any other camera of the scene.
    pub name: String,
    /// World from camera, rotation and translation only (scale removed).
    pub transform: DAffine3,
    /// Vertical field of view in radians, in (0, pi).
    pub yfov: f64,
    /// Width over height if the file says so.
    pub aspect: Option<f64>,
    /// `extras.width`, `extras.height` if the file says so.
    pub resolution: Option<[u32; 2]>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_diagonal_is_of_the_placed_meshes() {
        assert_eq!(Scene::default().diagonal(), 0.0);
        let mesh = Mesh { positions: vec![[0.0; 3], [1.0, 2.0, 0.0]], ..Mesh::default() };
        let at = |x: f64| Instance {
            mesh: 0,
            transform: DAffine3::from_translation(DVec3::new(x, 0.0, 0.0))
                * DAffine3::from_rotation_z(std::f64::consts::FRAC_PI_2),
            node: String::new(),
        };
        // Turned the box is 2 by 1; two of them stand 3 apart.
        let scene = Scene { meshes: vec![mesh], instances: vec![at(0.0), at(3.0)], ..Scene::default() };
        assert!((scene.diagonal() - 26f64.sqrt()).abs() < 1e-12);
    }
}

//! The scene as plain data: the checked content of a glTF file, in metres and world space, before the renderer flattens anything.
//!
//! Only `gltf.rs` knows glTF; `build.rs` makes scenes from arrays. `check.rs` defines the properties that every scene must have.
//! The loader checks them for a file, and the renderer checks them for every scene that it receives.

#![warn(missing_docs)]

pub mod build;
mod camera;
pub mod check;
pub mod gltf;
pub mod grid;
mod lens;
mod light;
mod material;
mod medium;
mod mesh_shape;
mod optical_thickness;
mod sky;
mod tangents;
mod velocities;
mod vignetting;

use std::collections::BTreeSet;

use glam::{BVec3, DAffine2, DAffine3, DVec3, Vec3};

pub use camera::{Aim, Camera, Projection};
pub use lens::{Aperture, Distortion, Lens};
pub use light::{Light, LightKind};
pub(crate) use light::{MAX_DISTANT, cap_height, spot_solid_angle};
pub use material::{AlphaMode, Material, Retroreflector};
pub(crate) use medium::check_bounds;
pub use medium::{DensityGrid, GridFilter, MAX_COEFFICIENT, Medium, PhaseFunction, surrounding_indices};
pub use optical_thickness::optical_thickness;
pub use sky::SkyImage;
pub use velocities::Velocities;
pub use vignetting::Vignetting;

/// A loaded scene. Lengths are in metres; transforms stay in f64 until the renderer moves the origin to the sensor.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// One mesh per glTF primitive, in its own space.
    pub meshes: Vec<Mesh>,
    /// Placements of meshes in the world; several instances may share a mesh.
    pub instances: Vec<Instance>,
    /// Never empty: primitives without a material use the glTF default material.
    pub materials: Vec<Material>,
    /// Images with their samplers.
    pub textures: Vec<Texture>,
    /// Texels; several textures may share an image.
    pub images: Vec<Image>,
    /// In the order of the nodes that carry them.
    pub cameras: Vec<Camera>,
    /// Cameras of the file that cannot be used. They are an error only if the user chooses one of them.
    pub unusable_cameras: Vec<UnusableCamera>,
    /// Punctual lights, beams and the sky; emissive meshes are found through `materials`.
    pub lights: Vec<Light>,
    /// Names of the nodes whose light is off, because the transform of the node leaves it no direction. `lights` has the light with
    /// the strength 0.
    pub lights_off: Vec<String>,
    /// Fog and other media outside of transmissive solids; where they overlap, the last counts.
    pub media: Vec<Medium>,
    /// The image of the sky, if one of the lights is a [`LightKind::Sky`] that is not the same in all directions.
    pub sky: Option<SkyImage>,
    /// Names of the nodes that move, if the scene is one moment of an animation. A node also moves if the animation deforms its
    /// mesh through a skin or morph targets.
    pub moving: Option<BTreeSet<String>>,
    /// How its parts move; needed for [`crate::settings::doppler`] alone.
    pub velocities: Option<Velocities>,
    /// Features of the file that taugate does not support, one sentence each, in the order of the file.
    pub warnings: Vec<String>,
}

impl Scene {
    /// Length in metres of the diagonal of [`Scene::bounds`]; 0 without instances.
    pub fn diagonal(&self) -> f64 {
        self.bounds().map_or(0.0, |[lo, hi]| (hi - lo).length())
    }

    /// Whether an animation moves the instance.
    pub(crate) fn is_moving(&self, instance: &Instance) -> bool {
        self.moving.as_ref().is_some_and(|moving| moving.contains(&instance.node))
    }

    /// Whether all surfaces have the same place as in `other`, which must have the same objects.
    #[doc(hidden)]
    pub fn has_same_places(&self, other: &Scene) -> bool {
        self.instances == other.instances
    }

    /// Whether `other` has the same surfaces and media, and as many cameras and lights. Cameras, lights, and the surfaces that move
    /// may stand elsewhere.
    #[doc(hidden)]
    pub fn has_same_objects(&self, other: &Scene) -> bool {
        let is_same = |(a, b): (&Instance, &Instance)| {
            a == b || ((a.mesh, &a.node) == (b.mesh, &b.node) && self.is_moving(a) && other.is_moving(b))
        };
        let has_same_lights = || {
            let mut pairs = self.lights.iter().zip(&other.lights);
            self.lights.len() == other.lights.len() && pairs.all(|(a, b)| a.node == b.node && a.kind == b.kind)
        };
        self.cameras.len() == other.cameras.len()
            && has_same_lights()
            && self.moving == other.moving
            && self.instances.len() == other.instances.len()
            && self.instances.iter().zip(&other.instances).all(is_same)
            && self.materials == other.materials
            && self.textures == other.textures
            && (&self.media, &self.sky) == (&other.media, &other.sky)
            && self.meshes == other.meshes
            && self.images == other.images
    }

    /// Lower and upper corner of a box around all instances, in metres. The box contains the transformed box of each mesh, so it
    /// may be larger than the tightest box around the triangles. Without instances, it is a box around the media that have bounds
    /// or a grid; `None` if there are no such media. Instances of meshes that the scene does not have are left out;
    /// [`Scene::check`] finds them.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        let boxes: Vec<[DVec3; 2]> = self.meshes.iter().map(Mesh::bounds).collect();
        let box_of = |instance: &Instance| Some(corners(*boxes.get(instance.mesh as usize)?, &instance.transform));
        let corners: Vec<DVec3> = match self.instances.is_empty() {
            false => self.instances.iter().filter_map(box_of).flatten().collect(),
            true => self.media.iter().filter_map(Medium::extent).flatten().collect(),
        };
        corners.into_iter().map(|p| [p, p]).reduce(|[lo, hi], [p, _]| [lo.min(p), hi.max(p)])
    }
}

/// The corners of a box, transformed.
pub(crate) fn corners([lo, hi]: [DVec3; 2], transform: &DAffine3) -> [DVec3; 8] {
    let corner = |k: u32| DVec3::select(BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), hi, lo);
    [0, 1, 2, 3, 4, 5, 6, 7].map(|k| transform.transform_point3(corner(k)))
}

impl Mesh {
    /// Smallest and largest coordinates of its positions, in its own space; there must be at least one position.
    pub(crate) fn bounds(&self) -> [DVec3; 2] {
        let points = self.positions.iter().map(|&p| Vec3::from(p).as_dvec3());
        points.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[lo, hi], p| [lo.min(p), hi.max(p)])
    }
}

/// A camera of a file without a usable view.
#[derive(Debug, Clone, PartialEq)]
pub struct UnusableCamera {
    /// Name of the camera, as [`Camera::name`] would have it.
    pub name: String,
    /// One sentence: the reason, and the remedy.
    pub why: String,
}

/// The triangles of one glTF primitive.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Name in messages: mesh name and primitive number, e.g. `Chair[0]`.
    pub name: String,
    /// Vertex positions in the mesh's own space.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals, one per position, or empty for flat shading.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates: one set, which all textures of the material use. One per position, or empty.
    pub uvs: Vec<[f32; 2]>,
    /// Linear RGB and alpha in [0, 1], one per position, or empty. They multiply the base colour.
    pub colors: Vec<[f32; 4]>,
    /// Tangents for the normal map, one per position, or empty: a unit vector along u, and 1 or -1 in w. The green channel of
    /// the map points along cross(normal, tangent) w. [`Mesh::add_tangents`] computes them.
    pub tangents: Vec<[f32; 4]>,
    /// Indices of the corners, counter-clockwise as seen from the front; each is below `positions.len()`. The loader has dropped
    /// triangles of zero area.
    pub triangles: Vec<[u32; 3]>,
    /// Index into [`Scene::materials`].
    pub material: u32,
}

/// A mesh placed in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct Instance {
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// World from mesh space. It may mirror or scale non-uniformly; it is never singular.
    pub transform: DAffine3,
    /// Name of the glTF node; `node 17` if node 17 has no name.
    pub node: String,
}

/// How texture coordinates outside [0, 1] are treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// The image repeats.
    #[default]
    Repeat,
    /// The image repeats; every second copy is mirrored.
    Mirror,
    /// The texels at the edge are extended.
    Clamp,
}

/// An image with its sampler. Minification filters and mip levels are not used.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    /// Index into [`Scene::images`].
    pub image: u32,
    /// Horizontal and vertical wrap mode.
    pub wrap: [Wrap; 2],
    /// Bilinear filtering if true, nearest texel if false.
    pub linear: bool,
    /// Maps the texture coordinates of a mesh to those of the image, where (0, 0) is the top left corner and (1, 1) the bottom
    /// right one. Finite.
    pub transform: DAffine2,
}

/// Decoded texels, row 0 at the top (v = 0), 8 bits per channel. The use decides what they mean: colours are sRGB, alpha is linear,
/// data textures (roughness, normals) are linear in all channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Texels row by row.
    pub rgba: Vec<[u8; 4]>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_diagonal_is_of_the_placed_meshes() {
        assert_eq!((Scene::default().diagonal(), Scene::default().bounds()), (0.0, None));
        let mesh = Mesh { positions: vec![[0.0; 3], [1.0, 2.0, 0.0]], ..Mesh::default() };
        let at = |x: f64| Instance {
            mesh: 0,
            transform: DAffine3::from_translation(DVec3::new(x, 0.0, 0.0))
                * DAffine3::from_rotation_z(std::f64::consts::FRAC_PI_2),
            node: String::new(),
        };
        // The turned box is 2 by 1 m; its two copies stand 3 m apart.
        let scene = Scene { meshes: vec![mesh], instances: vec![at(0.0), at(3.0)], ..Scene::default() };
        assert!((scene.diagonal() - 26f64.sqrt()).abs() < 1e-12);
        let lost = Scene { instances: vec![Instance { mesh: 7, ..at(0.0) }], ..scene };
        assert_eq!(lost.bounds(), None);
    }
}

//! Builds a scene from arrays: materials, meshes and their placement, cameras and lights. Each added object gets an index.
//! [`Scene::check`] then checks that all objects fit together.

#![warn(missing_docs)]

use glam::{DAffine2, DAffine3, DMat3, DVec3};

use super::{Camera, Image, Instance, Lens, Light, LightKind, Material, Mesh, Projection, Scene, Texture, Wrap};

impl Scene {
    /// Adds a material and returns its index for [`Mesh::material`].
    pub fn add_material(&mut self, material: Material) -> u32 {
        push(&mut self.materials, material)
    }

    /// Adds an image as a bilinear, repeating texture. Returns its index for [`Material::base_color_texture`].
    pub fn add_texture(&mut self, image: Image) -> u32 {
        let image = push(&mut self.images, image);
        push(
            &mut self.textures,
            Texture { image, wrap: [Wrap::Repeat; 2], linear: true, transform: DAffine2::IDENTITY },
        )
    }

    /// Adds a mesh without placing it in the world. Returns its index for [`Scene::place`].
    pub fn add_mesh(&mut self, mesh: Mesh) -> u32 {
        push(&mut self.meshes, mesh)
    }

    /// Places a mesh in the world. `node` names the instance in messages and in the selection of emitters.
    pub fn place(&mut self, node: &str, mesh: u32, transform: DAffine3) {
        self.instances.push(Instance { mesh, transform, node: node.into() });
    }

    /// Adds a mesh with a material and places it without a transform. The instance takes the name of the mesh.
    pub fn add_surface(&mut self, mesh: Mesh, material: u32) {
        let node = mesh.name.clone();
        let mesh = self.add_mesh(Mesh { material, ..mesh });
        self.place(&node, mesh, DAffine3::IDENTITY);
    }

    /// Adds a camera and returns its index for the settings.
    pub fn add_camera(&mut self, camera: Camera) -> usize {
        push(&mut self.cameras, camera) as usize
    }

    /// Adds a light; `node` is its name. `direction` need not have unit length; point lights ignore it.
    pub fn add_light(&mut self, node: &str, position: DVec3, direction: DVec3, kind: LightKind) {
        let direction = direction.try_normalize().unwrap_or(DVec3::NEG_Z);
        self.lights.push(Light { node: node.into(), position, direction, kind });
    }
}

fn push<T>(all: &mut Vec<T>, one: T) -> u32 {
    all.push(one);
    all.len() as u32 - 1
}

impl Mesh {
    /// A flat-shaded mesh. Positions are in metres; triangles are counter-clockwise as seen from the front.
    pub fn flat(name: &str, positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Mesh {
        Mesh { name: name.into(), positions, triangles, ..Mesh::default() }
    }
}

impl Camera {
    /// A pinhole at `eye` that looks at `target`, with y up. `target` must differ from `eye`; `yfov` is in radians.
    pub fn looking_at(name: &str, eye: DVec3, target: DVec3, yfov: f64, resolution: [u32; 2]) -> Camera {
        Camera {
            name: name.into(),
            transform: look(eye, target - eye),
            projection: Projection::Perspective { yfov },
            aspect: Some(f64::from(resolution[0]) / f64::from(resolution[1])),
            resolution: Some(resolution),
            principal_point: Camera::CENTRED,
            lens: Lens::PINHOLE,
        }
    }
}

/// The transform at `eye` whose -Z points along `direction` and whose Y is as close as possible to world Y. For a vertical
/// `direction` its Y is as close as possible to world Z.
pub fn look(eye: DVec3, direction: DVec3) -> DAffine3 {
    let z = -direction.normalize();
    look_upright(eye, direction, if z.y.abs() > 0.999 { DVec3::Z } else { DVec3::Y })
}

/// The transform at `eye` whose -Z points along `direction` and whose Y is as close as possible to `up`, which must not be
/// parallel to `direction`. Both may have any length except 0.
pub fn look_upright(eye: DVec3, direction: DVec3, up: DVec3) -> DAffine3 {
    let z = -direction.normalize();
    let x = up.cross(z).normalize();
    DAffine3::from_mat3_translation(DMat3::from_cols(x, z.cross(x), z), eye)
}

//! Scenes from arrays.

use std::collections::BTreeSet;

use glam::{DAffine2, DAffine3, DMat4};
use numpy::ndarray::{ArrayView, Dimension};
use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use serde::Deserialize;
use serde_json::value::RawValue;
use taugate::internals::input::light_table::LightTable;
use taugate::internals::scene::gltf::medium_from_json;
use taugate::internals::scene::{
    self, AlphaMode, DensityGrid, GridFilter, Image, Instance, Material, Medium, Scene, Texture, Wrap,
};

use crate::errors::{Result, settings};

/// Triangles of one material.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Mesh<'py> {
    name: String,
    vertices: PyReadonlyArray2<'py, f32>,
    triangles: PyReadonlyArray2<'py, u32>,
    normals: Option<PyReadonlyArray2<'py, f32>>,
    uvs: Option<PyReadonlyArray2<'py, f32>>,
    material: u32,
}

/// The part of a scene that may change between renders without new meshes.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Objects {
    /// Name, index of the mesh, and the matrix from mesh space to world space, row by row.
    instances: Vec<(String, u32, [[f64; 4]; 4])>,
    /// JSON: the tables `[[light]]` of an experiment.
    lights: String,
    /// Names of instances that may move.
    moves: Vec<String>,
}

/// The class `Material` of Python.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MaterialSpec {
    name: String,
    color: [f32; 3],
    alpha: f32,
    metallic: f32,
    roughness: f32,
    specular: f32,
    specular_color: [f32; 3],
    ior: f32,
    transmission: f32,
    clearcoat: f32,
    clearcoat_roughness: f32,
    emission: [f32; 3],
    double_sided: bool,
    thin: Option<bool>,
    thickness: f32,
    /// In the form of `extras.medium` of a glTF material.
    interior: Option<Box<RawValue>>,
    /// Whether rays pass where alpha is below 1.
    blend: bool,
    texture: Option<u32>,
    roughness_texture: Option<u32>,
}

/// The class `Texture` of Python.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TextureSpec {
    image: u32,
    /// `repeat`, `mirror` or `clamp`.
    wrap: [String; 2],
    linear: bool,
    /// Row by row.
    transform: [[f64; 3]; 2],
}

impl TextureSpec {
    fn texture(self) -> Texture {
        let wrap = self.wrap.map(|mode| match mode.as_str() {
            "mirror" => Wrap::Mirror,
            "clamp" => Wrap::Clamp,
            _ => Wrap::Repeat,
        });
        let [[a, c, x], [b, d, y]] = self.transform;
        let transform = DAffine2::from_cols_array(&[a, b, c, d, x, y]);
        Texture { image: self.image, wrap, linear: self.linear, transform }
    }
}

impl MaterialSpec {
    fn material(self) -> Result<Material> {
        let [r, g, b] = self.color;
        let read = |json: Box<RawValue>| medium_from_json(json.get(), &format!("material '{}'", self.name));
        let interior = self.interior.map(read).transpose().map_err(settings)?;
        Ok(Material {
            interior,
            thin: self.thin,
            thickness: self.thickness,
            base_color: [r, g, b, self.alpha],
            base_color_texture: self.texture,
            metallic: self.metallic,
            roughness: self.roughness,
            surface_texture: self.roughness_texture,
            emission: self.emission,
            specular: self.specular,
            specular_color: self.specular_color,
            ior: self.ior,
            transmission: self.transmission,
            clearcoat: self.clearcoat,
            clearcoat_roughness: self.clearcoat_roughness,
            alpha_mode: if self.blend { AlphaMode::Blend } else { AlphaMode::Opaque },
            double_sided: self.double_sided,
            ..Material::diffuse(&self.name, self.color)
        })
    }
}

/// A medium outside of meshes.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct MediumSpec<'py> {
    name: String,
    /// JSON in the form of `extras.medium` of a glTF scene.
    medium: String,
    /// Densities with the axes z, y, x.
    density: Option<PyReadonlyArray3<'py, f32>>,
    /// The matrix from the space of the grid to world space, row by row.
    transform: [[f64; 4]; 4],
    linear: bool,
}

impl MediumSpec<'_> {
    fn medium(self) -> Result<Medium> {
        let of = format!("the medium '{}'", self.name);
        let mut medium = medium_from_json(&self.medium, &of).map_err(settings)?;
        if let Some(density) = self.density {
            let Some(bounds) = medium.bounds.take() else {
                return Err(settings(format!("{of} has a density, but no bounds; give it the box of the density")));
            };
            let [nz, ny, nx] = [0, 1, 2].map(|axis| density.shape()[axis] as u32);
            medium.grid = Some(DensityGrid {
                resolution: [nx, ny, nz],
                density: density.as_array().iter().copied().collect(),
                bounds,
                transform: transform(self.transform),
                filter: if self.linear { GridFilter::Linear } else { GridFilter::Nearest },
            });
        }
        medium.check(&of).map_err(settings)?;
        Ok(medium)
    }
}

/// The scene of materials, textures, their images (row 0 at the top), meshes and media, without instances.
pub fn scene(
    materials: &str,
    textures: &str,
    images: Vec<PyReadonlyArray3<'_, u8>>,
    meshes: Vec<Mesh>,
    media: Vec<MediumSpec>,
) -> Result<Scene> {
    let materials: Vec<MaterialSpec> = parsed("the materials", materials)?;
    let textures: Vec<TextureSpec> = parsed("the textures", textures)?;
    let mut scene = Scene::default();
    for texels in images {
        let (height, width) = (texels.shape()[0] as u32, texels.shape()[1] as u32);
        let rgba = rows(&texels.as_array(), "the texture")?;
        scene.images.push(Image { width, height, rgba });
    }
    scene.textures = textures.into_iter().map(TextureSpec::texture).collect();
    scene.materials = materials.into_iter().map(MaterialSpec::material).collect::<Result<_>>()?;
    scene.media = media.into_iter().map(MediumSpec::medium).collect::<Result<_>>()?;
    for mesh in meshes {
        let name = &mesh.name;
        let optional = |array: &Option<PyReadonlyArray2<f32>>| array.as_ref().map(|array| array.as_array().to_owned());
        let positions = rows(&mesh.vertices.as_array(), &format!("the vertices of '{name}'"))?;
        let triangles = rows(&mesh.triangles.as_array(), &format!("the triangles of '{name}'"))?;
        scene.add_mesh(scene::Mesh {
            name: name.clone(),
            positions,
            normals: match optional(&mesh.normals) {
                Some(array) => rows(&array.view(), &format!("the normals of '{name}'"))?,
                None => vec![],
            },
            uvs: match optional(&mesh.uvs) {
                Some(array) => rows(&array.view(), &format!("the uvs of '{name}'"))?,
                None => vec![],
            },
            triangles,
            material: mesh.material,
            ..scene::Mesh::default()
        });
    }
    Ok(scene)
}

impl Objects {
    /// Replaces the instances and lights of the scene, and the names of instances that may move.
    pub fn place(self, scene: &mut Scene) -> Result<()> {
        let lights: Vec<LightTable> = parsed("the lights", &self.lights)?;
        let lights = lights.iter().enumerate().map(|(k, table)| table.light(k + 1));
        scene.lights = lights.collect::<std::result::Result<_, _>>().map_err(settings)?;
        let instance = |(node, mesh, matrix)| Instance { mesh, transform: transform(matrix), node };
        scene.instances = self.instances.into_iter().map(instance).collect();
        scene.moving = (!self.moves.is_empty()).then(|| BTreeSet::from_iter(self.moves));
        Ok(())
    }
}

/// The transform of a matrix given by its rows.
pub fn transform(rows: [[f64; 4]; 4]) -> DAffine3 {
    DAffine3::from_mat4(DMat4::from_cols_array_2d(&rows).transpose())
}

/// Reads JSON. `what` begins the message if it cannot be read.
pub fn parsed<T: for<'de> Deserialize<'de>>(what: &str, json: &str) -> Result<T> {
    serde_json::from_str(json).map_err(|error| settings(format!("{what} cannot be read: {error}")))
}

/// The rows of an array whose last axis has N values.
fn rows<T: Copy, D: Dimension, const N: usize>(array: &ArrayView<'_, T, D>, what: &str) -> Result<Vec<[T; N]>> {
    if array.shape().last() != Some(&N) {
        return Err(settings(format!("{what} have the shape {:?}; the last axis must be {N} long", array.shape())));
    }
    let array = array.as_standard_layout();
    let (rows, _) = array.as_slice().unwrap_or_default().as_chunks();
    Ok(rows.to_vec())
}

//! The scene, flattened for the device: triangles in render space, attributes, materials, textures.

use std::collections::HashMap;

use glam::{DAffine2, DMat3, DVec3};

use super::albedo::AlbedoTable;
use super::duplicates::{Dropped, ShadingAttributes, drop_copies};
use super::material::{Features, MATERIAL_BLEND, MATERIAL_DOUBLE_SIDED, Material, MaterialSet, SmoothShares};
use super::sheets;
use super::solids::{ClosedGlass, Orientation};
use super::space::RenderSpace;
use crate::bvh::{self, Bvh};
use crate::scene::{Image, Instance, Mesh, Scene, Wrap};
use crate::settings::Emitters;
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{InstanceNormals, NONE, TextureInfo, Triangle, VertexAttributes, VertexDetails};

/// The arrays of the scene, in the layout of `shared/scene.wgsl`.
#[derive(Clone)]
pub struct Geometry {
    pub bvh: Bvh,
    pub triangles: Vec<Triangle>,
    /// Number of triangles that were dropped as copies, and the instance of the first one.
    pub copies: Option<(usize, u32)>,
    pub corners: Vec<u32>,
    pub attributes: Vec<VertexAttributes>,
    /// As long as `attributes`, or empty if no mesh has vertex colours or tangents.
    pub details: Vec<VertexDetails>,
    pub instances: Vec<InstanceNormals>,
    /// See [`MaterialSet::list`]; then double-sided copies of some of them, see [`Dropped::double_sided`].
    pub materials: Vec<Material>,
    /// Of each of `materials`.
    pub smooth: Vec<SmoothShares>,
    pub textures: Vec<TextureInfo>,
    /// Where the texels of the scene's images lie on the device. The texels are not copied before the upload.
    pub texels: TexelLayout,
    pub features: Features,
    /// Maximum travel time per length: the group index outside of solids, or the index of a transmissive material.
    pub max_ior: f32,
    /// Upper bound on the delay of light by thin glass on one segment of a path, in units of render space.
    pub max_delay: f64,
    /// Index in `materials` for each instance, with TRIANGLE_ bits.
    instance_materials: Vec<u32>,
    /// Index in `corners` of the first corner of each mesh; NONE for a mesh without attributes.
    first_corners: Vec<u32>,
    /// Index in `materials` of the double-sided copy of a material.
    double_sided: HashMap<u32, u32>,
    /// The closed meshes of glass, and which of their triangles are turned around.
    pub glass: ClosedGlass,
    pub orientation: Orientation,
    /// `None` if nothing can move.
    fixed: Option<Fixed>,
}

impl Geometry {
    /// Flattens the scene into the coordinates of `space`, drops copies of triangles and builds the BVH.
    pub fn new(scene: &Scene, space: &RenderSpace, emitters: &Emitters, albedo: &AlbedoTable) -> Geometry {
        let mut materials = MaterialSet::new(scene, emitters, albedo, space.unit);
        let (corners, attributes, first_corners) = attributes(scene);
        let instance_materials = scene.instances.iter().map(|instance| materials.number(instance)).collect();
        let (textures, texels) = textures(scene, materials.features.textures);
        let mut geometry = Geometry {
            bvh: bvh::build(&[]),
            triangles: vec![],
            copies: None,
            corners,
            attributes,
            details: details(scene),
            instances: vec![],
            textures,
            texels,
            features: materials.features,
            max_ior: materials.max_ior,
            max_delay: if materials.features.delays { sheets::max_delay(scene) / space.unit } else { 0.0 },
            materials: materials.list,
            smooth: materials.smooth,
            instance_materials,
            first_corners,
            double_sided: HashMap::new(),
            glass: if materials.features.transmission { ClosedGlass::new(scene) } else { ClosedGlass::default() },
            orientation: Orientation::default(),
            fixed: None,
        };
        geometry.place(scene, space);
        geometry
    }

    /// Computes what depends on the transforms of the instances: triangles, BVH, and matrices of normals. The BVH of the instances
    /// that never move is built in the first call and kept.
    pub fn place(&mut self, scene: &Scene, space: &RenderSpace) {
        self.instances = scene.instances.iter().map(|instance| normal_columns(instance.transform.matrix3)).collect();
        let orientation = Orientation::new(scene, &self.glass);
        let is_fixed = |instance: u32| !scene.is_moving(&scene.instances[instance as usize]);
        let is_kept = orientation.is_same_for(&self.orientation, is_fixed);
        self.orientation = orientation;
        let fixed = match self.fixed.take() {
            Some(fixed) if is_kept => {
                self.triangles.truncate(fixed.triangles);
                fixed
            }
            _ => {
                let part = Part::new(self, scene, space, |instance| !scene.is_moving(instance));
                self.triangles = part.triangles;
                Fixed { bvh: part.bvh, triangles: self.triangles.len(), copies: part.copies }
            }
        };
        if scene.moving.is_none() {
            (self.bvh, self.copies) = (fixed.bvh, fixed.copies);
            return;
        }
        let moving = Part::new(self, scene, space, |instance| scene.is_moving(instance));
        self.bvh = Bvh::joined(&fixed.bvh, &moving.bvh);
        self.triangles.extend(moving.triangles);
        self.copies = match (fixed.copies, moving.copies) {
            (Some((a, first)), Some((b, _))) => Some((a + b, first)),
            (a, b) => a.or(b),
        };
        self.fixed = Some(fixed);
    }
}

/// The instances that do not move.
#[derive(Clone)]
struct Fixed {
    bvh: Bvh,
    /// Number of their triangles, which come first.
    triangles: usize,
    copies: Option<(usize, u32)>,
}

/// The triangles of some of the instances, in the order of their BVH, without copies.
struct Part {
    triangles: Vec<Triangle>,
    bvh: Bvh,
    copies: Option<(usize, u32)>,
}

impl Part {
    fn new(geometry: &mut Geometry, scene: &Scene, space: &RenderSpace, has: impl Fn(&Instance) -> bool) -> Part {
        let mut triangles = vec![];
        for (number, instance) in scene.instances.iter().enumerate().filter(|(_, instance)| has(instance)) {
            let mesh = &scene.meshes[instance.mesh as usize];
            let positions: Vec<[f32; 3]> = mesh
                .positions
                .iter()
                .map(|p| {
                    let world = instance.transform.transform_point3(DVec3::from(p.map(f64::from)));
                    space.point(world).to_array()
                })
                .collect();
            let mut material = geometry.instance_materials[number];
            if instance.transform.matrix3.determinant() < 0.0 {
                material ^= TRIANGLE_MIRRORED;
            }
            if !mesh.normals.is_empty() {
                material |= TRIANGLE_SMOOTH;
            }
            if is_detailed(mesh) {
                material |= TRIANGLE_DETAILED;
            }
            let base = geometry.first_corners[instance.mesh as usize];
            for (i, t) in mesh.triangles.iter().enumerate() {
                let [v0, v1, v2] = t.map(|c| positions[c as usize]);
                let corner = if base == NONE { NONE } else { base + 3 * i as u32 };
                let turned = if geometry.orientation.turns(number as u32, i) { TRIANGLE_MIRRORED } else { 0 };
                triangles.push(Triangle { v0, instance: number as u32, v1, corner, v2, material: material ^ turned });
            }
        }
        let Dropped { copies, double_sided } = drop_copies(&mut triangles, |t| geometry.shading_attributes(t));
        for triangle in double_sided {
            let material = &mut triangles[triangle].material;
            *material = geometry.double_sided(*material);
        }
        let bvh = bvh::build(&triangles.iter().map(|t| [t.v0, t.v1, t.v2]).collect::<Vec<_>>());
        let triangles = bvh.order.iter().map(|&i| triangles[i as usize]).collect();
        Part { triangles, bvh, copies }
    }
}

impl Geometry {
    /// Travel time per length in the glass of a material, and the code of this glass (`shared/solid.wgsl`). `material`: index in
    /// `materials`, or NONE outside of glass. `surrounding`: group index outside of glass.
    pub fn around(&self, material: u32, surrounding: f32) -> (f32, u32) {
        match self.materials.get(material as usize) {
            None => (surrounding, OUTSIDE_SOLIDS),
            Some(glass) if glass.interior == NONE => (glass.group_index, CLEAR_SOLID),
            Some(glass) => (glass.group_index, FIRST_INTERIOR + glass.interior),
        }
    }

    /// Whether points of the triangle have a lobe without width. Boundaries of media that do not bend light do not count.
    pub fn is_smooth(&self, t: &Triangle) -> bool {
        t.material & TRIANGLE_NULL == 0 && self.smooth[(t.material & TRIANGLE_MATERIAL) as usize].is_smooth()
    }

    /// Whether the triangle is thin glass that reflects without blur.
    pub fn is_smooth_sheet(&self, t: &Triangle) -> bool {
        t.material & TRIANGLE_SHEET != 0 && self.smooth[(t.material & TRIANGLE_MATERIAL) as usize].is_smooth_sheet()
    }

    /// A distance beyond the scene, from any point of it.
    pub fn far(&self) -> f64 {
        let bounds = self.bvh.host.total_aabb;
        2.0 * f64::from((bounds.max - bounds.min).length()).max(1e-9)
    }

    /// The index of a material's double-sided copy, with the TRIANGLE_ bits of `material`.
    fn double_sided(&mut self, material: u32) -> u32 {
        let number = material & TRIANGLE_MATERIAL;
        let copy = *self.double_sided.entry(number).or_insert_with(|| {
            let single = self.materials[number as usize];
            self.materials.push(Material { flags: single.flags | MATERIAL_DOUBLE_SIDED, ..single });
            self.smooth.push(self.smooth[number as usize]);
            self.materials.len() as u32 - 1
        });
        material & !TRIANGLE_MATERIAL | copy
    }

    /// The data that distinguish the triangle from others with the same corners and material. `None` for a translucent layer. A
    /// translucent lamp does not count as one, because each of its copies would shine.
    fn shading_attributes(&self, t: &Triangle) -> Option<ShadingAttributes> {
        let material = &self.materials[(t.material & TRIANGLE_MATERIAL) as usize];
        let is_translucent = t.material & TRIANGLE_ALPHA != 0 && material.flags & MATERIAL_BLEND != 0;
        if is_translucent && material.emission == [0.0; 3] {
            return None;
        }
        let smooth = t.material & TRIANGLE_SMOOTH != 0;
        let textured = material.textures().iter().any(|&texture| texture != NONE);
        let corner = |k: u32| {
            let vertex = self.corners[(t.corner + k) as usize] as usize;
            let VertexAttributes { normal, u, v } = self.attributes[vertex];
            let VertexDetails { red_green, blue_alpha, tangent } = self.details.get(vertex).copied().unwrap_or(PLAIN);
            let bits = |x: f32| if textured { x.to_bits() } else { 0 };
            [if smooth { normal } else { 0 }, bits(u), bits(v), red_green, blue_alpha, tangent]
        };
        let InstanceNormals { x, y, z, .. } = self.instances[t.instance as usize];
        let columns: [f32; 9] = bytemuck::cast([x, y, z]);
        let reflects_only =
            material.emission == [0.0; 3] && material.transmission == 0.0 && t.material & TRIANGLE_NULL == 0;
        Some(ShadingAttributes {
            corners: if t.corner == NONE { [[0; 6]; 3] } else { [0, 1, 2].map(corner) },
            normal_matrix: if smooth || material.normal_texture != NONE { columns.map(f32::to_bits) } else { [0; 9] },
            may_get_back: reflects_only && material.flags & MATERIAL_DOUBLE_SIDED == 0,
        })
    }
}

/// Columns of the inverse transpose of `linear`, scaled so that the largest entry is 1. Only the direction of the result
/// matters; the scaling keeps the entries in the range of f32.
fn normal_columns(linear: DMat3) -> InstanceNormals {
    let m = linear.inverse().transpose();
    let size = m.to_cols_array().iter().fold(0.0f64, |a, x| a.max(x.abs())).max(1e-300);
    let column = |c: DVec3| (c / size).as_vec3().to_array();
    InstanceNormals { x: column(m.x_axis), pad0: 0.0, y: column(m.y_axis), pad1: 0.0, z: column(m.z_axis), pad2: 0.0 }
}

/// Whether the mesh has any attribute besides positions.
fn has_attributes(mesh: &Mesh) -> bool {
    !mesh.normals.is_empty() || !mesh.uvs.is_empty() || !mesh.colors.is_empty()
}

/// Whether the mesh has vertex colours or tangents.
fn is_detailed(mesh: &Mesh) -> bool {
    !mesh.colors.is_empty() || (!mesh.tangents.is_empty() && has_attributes(mesh))
}

/// A vertex without colour and tangent.
const PLAIN: VertexDetails = VertexDetails { red_green: u32::MAX, blue_alpha: u32::MAX, tangent: 0 };

/// The details of all vertices, in the order of [`attributes`]; empty if no mesh has any.
fn details(scene: &Scene) -> Vec<VertexDetails> {
    if !scene.meshes.iter().any(is_detailed) {
        return vec![];
    }
    let pack = |low: f32, high: f32| {
        let [low, high] = [low, high].map(|x| (x.clamp(0.0, 1.0) * 65535.0).round() as u32);
        low | high << 16
    };
    let vertex = |mesh: &Mesh, i: usize| {
        let [r, g, b, a] = mesh.colors.get(i).copied().unwrap_or([1.0; 4]);
        let tangent = mesh.tangents.get(i).map_or(0, |&[x, y, z, w]| {
            let mirrored = if w < 0.0 { TANGENT_MIRRORED } else { 0 };
            octahedral([x, y, z]) & !TANGENT_MIRRORED | mirrored
        });
        VertexDetails { red_green: pack(r, g), blue_alpha: pack(b, a), tangent }
    };
    let meshes = scene.meshes.iter().filter(|mesh| has_attributes(mesh));
    meshes.flat_map(|mesh| (0..mesh.positions.len()).map(move |i| vertex(mesh, i))).collect()
}

/// For the meshes with attributes: the vertex index of every triangle corner, the vertices, and the index of the first corner
/// per mesh (NONE for a mesh without attributes).
fn attributes(scene: &Scene) -> (Vec<u32>, Vec<VertexAttributes>, Vec<u32>) {
    let (mut corners, mut attributes, mut bases) = (vec![], vec![], vec![]);
    for mesh in &scene.meshes {
        if !has_attributes(mesh) {
            bases.push(NONE);
            continue;
        }
        bases.push(corners.len() as u32);
        let first = attributes.len() as u32;
        for i in 0..mesh.positions.len() {
            let [u, v] = mesh.uvs.get(i).copied().unwrap_or_default();
            let normal = mesh.normals.get(i).map_or(0, |&n| octahedral(n));
            attributes.push(VertexAttributes { normal, u, v });
        }
        corners.extend(mesh.triangles.iter().flatten().map(|&c| first + c));
    }
    (corners, attributes, bases)
}

/// Packs a unit vector as two 16-bit octahedral coordinates (Cigolle et al. 2014), x in the low half.
pub fn octahedral(n: [f32; 3]) -> u32 {
    let sum = n[0].abs() + n[1].abs() + n[2].abs();
    let (mut x, mut y) = (n[0] / sum, n[1] / sum);
    if n[2] < 0.0 {
        (x, y) = ((1.0 - y.abs()) * 1f32.copysign(x), (1.0 - x.abs()) * 1f32.copysign(y));
    }
    let pack = |v: f32| u32::from((v.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
    pack(x) | (pack(y) << 16)
}

/// Where the texels of each image lie in the array `texels` of `shared/scene.wgsl`, which consists of words of four texels.
#[derive(Debug, Clone, Default)]
pub struct TexelLayout {
    /// First word of each image of the scene; empty if no material uses a texture.
    first: Vec<u32>,
    /// Number of words of all images.
    pub words: usize,
}

impl TexelLayout {
    /// Bytes per word of the device's array.
    pub const WORD: usize = 16;

    fn new(images: &[Image]) -> TexelLayout {
        let mut layout = TexelLayout::default();
        for image in images {
            // A scene whose words exceed 32 bits fits no device, and is refused before the upload.
            layout.first.push(u32::try_from(layout.words).unwrap_or(u32::MAX));
            layout.words += image.rgba.len().div_ceil(4);
        }
        layout
    }

    /// Calls `write` with the texels of each image, and with their offset in bytes in the device's array. After an image, up to
    /// 12 bytes stay unwritten; no kernel reads them.
    pub fn write<E>(&self, scene: &Scene, mut write: impl FnMut(usize, &[u8]) -> Result<(), E>) -> Result<(), E> {
        let mut images = self.first.iter().zip(&scene.images);
        images.try_for_each(|(&first, image)| write(Self::WORD * first as usize, image.rgba.as_flattened()))
    }
}

/// The records of the textures, then the records of their transforms; and the layout of the texels.
fn textures(scene: &Scene, needed: bool) -> (Vec<TextureInfo>, TexelLayout) {
    if !needed {
        return (vec![], TexelLayout::default());
    }
    let texels = TexelLayout::new(&scene.images);
    let wrap = |w: Wrap| match w {
        Wrap::Repeat => 0,
        Wrap::Mirror => 1,
        Wrap::Clamp => 2,
    };
    let infos = scene.textures.iter().map(|t| {
        let image = &scene.images[t.image as usize];
        let sampler = wrap(t.wrap[0]) | (wrap(t.wrap[1]) << 2) | (u32::from(t.linear) << 4);
        TextureInfo { first: texels.first[t.image as usize], width: image.width, height: image.height, sampler }
    });
    let mut infos: Vec<TextureInfo> = infos.collect();
    for (i, texture) in scene.textures.iter().enumerate() {
        if texture.transform != DAffine2::IDENTITY {
            infos[i].sampler |= (infos.len() as u32) << TEXTURE_TRANSFORM_SHIFT;
            let [a, b, c, d, x, y] = texture.transform.to_cols_array().map(|value| value as f32);
            infos.extend([[a, b, c, d], [x, y, 0.0, 0.0]].map(bytemuck::cast::<[f32; 4], TextureInfo>));
        }
    }
    (infos, texels)
}

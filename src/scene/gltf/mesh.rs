//! Reads meshes: turns the attributes and indices of each primitive into valid triangles.

use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap};

use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked::{Invalid, Valid};
use glam::DVec3;

use super::Checked;
use super::accessor::{DIRECTION, MAX_ELEMENTS, QUANTIZED};
use super::clean::{drop_unused, has_zero_area, normalise, normalise_tangents, transform_uvs};
use super::document::{Document, Warnings, label};
use super::material::Materials;
use super::node::Worlds;
use super::pose::{Pose, Skin};
use super::source::Source;
use crate::free_memory;
use crate::scene::Mesh;

/// Maximum number of triangles in a scene, instances included.
pub const MAX_TRIANGLES: u64 = 64 << 20;

/// Upper bound on [`Meshes::tangent_work`]: this number, and more per corner of a triangle. About six triangles share a vertex of a
/// usual mesh, so its work per corner is about six.
const FREE_TANGENT_WORK: u64 = 1 << 26;
const TANGENT_WORK_PER_CORNER: u64 = 32;

/// Bytes that a vertex takes at least: its position.
const VERTEX_BYTES: u64 = 12;

/// The meshes of a node.
#[derive(Clone)]
pub struct Placement {
    /// Indices into [`Meshes::meshes`].
    pub meshes: Vec<usize>,
    /// The origin of the meshes in the world, if a skin places them. Then the node's transform has no effect.
    pub skinned_at: Option<DVec3>,
}

/// A glTF mesh in one pose. Nodes with equal shapes share their meshes.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Shape {
    mesh: usize,
    skin: Option<usize>,
    /// The bits of the weights of its morph targets.
    weights: Vec<u32>,
}

/// The meshes that nodes of the scene use, in the order of the file, and counts for warnings and limits.
#[derive(Default)]
pub struct Meshes {
    pub meshes: Vec<Mesh>,
    /// By node.
    placements: HashMap<usize, Placement>,
    /// The mesh of each primitive so far; `None` if it has no visible triangle.
    known: HashMap<Source, Option<usize>>,
    /// Bytes of memory that were free before the first mesh was read, if they are known.
    free: Option<u64>,
    /// Vertices read so far. A limit on the file size is not enough, because many primitives may share one accessor.
    vertices_read: u64,
    /// Triangle corners read so far.
    corners_read: u64,
    /// Sum of [`Mesh::tangent_work`] so far.
    tangent_work: u64,
    degenerate: u64,
    points_or_lines: u64,
    flattened: Vec<String>,
    missing_uvs: Vec<String>,
    /// Meshes whose tangents would take too long.
    crowded: Vec<String>,
    /// The error about the first attribute that no material needs.
    unneeded: Option<String>,
}

/// Reads every mesh that a visible node of the scene refers to; drops and counts primitives and triangles that cannot be seen.
pub fn load(doc: &Document, worlds: &Worlds, materials: &mut Materials, warnings: &mut Warnings) -> Checked<Meshes> {
    let mut out = Meshes { free: free_memory::free(), ..Meshes::default() };
    let mut skins: HashMap<usize, Option<Skin>> = HashMap::new();
    let mut matrices_read = 0;
    let mut nodes_of: BTreeMap<Shape, Vec<usize>> = BTreeMap::new();
    for (index, _) in worlds.visible() {
        let Some(node) = doc.root.nodes.get(index) else { continue };
        let Some(number) = node.mesh.map(|mesh| mesh.value()) else { continue };
        let mesh = doc.root.meshes.get(number).ok_or_else(|| {
            format!("node `{}` refers to mesh {number}, which does not exist; re-export the file", doc.node_name(index))
        })?;
        let skin = match node.skin.map(|skin| skin.value()) {
            None => None,
            Some(number) => {
                let skin = match skins.entry(number) {
                    Entry::Occupied(known) => known.into_mut(),
                    Entry::Vacant(new) => new.insert(Skin::load(doc, worlds, number, &mut matrices_read, warnings)?),
                };
                skin.as_ref().map(|_| number)
            }
        };
        let weights = node.weights.as_ref().or(mesh.weights.as_ref()).into_iter().flatten();
        let shape = Shape { mesh: number, skin, weights: weights.map(|weight| weight.to_bits()).collect() };
        nodes_of.entry(shape).or_default().push(index);
    }
    let mut poses: HashMap<(Option<usize>, Vec<u32>), usize> = HashMap::new();
    for (shape, nodes) in nodes_of {
        let Some(mesh) = doc.root.meshes.get(shape.mesh) else { continue };
        let weights: Vec<f32> = shape.weights.iter().copied().map(f32::from_bits).collect();
        let skin = shape.skin.and_then(|number| skins[&number].as_ref());
        let pose = Pose { weights: &weights, skin };
        let next = poses.len();
        let pose_number = *poses.entry((shape.skin, shape.weights)).or_insert(next);
        let mut meshes = vec![];
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let name = format!("{}[{number}]", label(mesh.name.as_deref(), "mesh", shape.mesh));
            meshes.extend(out.primitive(doc, name, primitive, (&pose, pose_number), materials)?);
        }
        let placement = Placement { meshes, skinned_at: skin.map(|skin| skin.origin) };
        out.placements.extend(nodes.into_iter().map(|node| (node, placement.clone())));
    }
    out.warn(warnings);
    if materials.materials.is_empty() {
        materials.of(None, "the scene")?;
    }
    Ok(out)
}

impl Meshes {
    /// The meshes of a node; `None` if the node has none.
    pub fn of(&self, node: usize) -> Option<&Placement> {
        self.placements.get(&node)
    }

    /// The warning for a scene without instances.
    pub fn nothing_to_render(&self) -> String {
        let why = match (self.degenerate, self.points_or_lines) {
            (0, 0) => String::new(),
            (0, _) => ", only points or lines".into(),
            (count, _) => format!(", only {count} of zero area"),
        };
        format!("the scene has no triangles{why}; export a scene with visible meshes")
    }

    fn warn(&self, warnings: &mut Warnings) {
        let first = |names: &[String]| names.first().map(|name| (names.len(), name.clone()));
        if self.degenerate > 0 {
            warnings.push(format!("{} triangles of zero area are left out", self.degenerate));
        }
        if self.points_or_lines > 0 {
            warnings.push(format!("{} primitives of points or lines are left out", self.points_or_lines));
        }
        if let Some((count, name)) = first(&self.flattened) {
            warnings.push(format!("{count} meshes with normals of zero length are shaded flat (first: {name})"));
        }
        if let Some((count, name)) = first(&self.missing_uvs) {
            warnings.push(format!("{count} textured meshes have no texture coordinates (first: {name})"));
        }
        if let Some(why) = &self.unneeded {
            let why = why.split("; ").next().unwrap_or(why);
            warnings.push(format!("vertex attributes that the material does not need are left out: {why}"));
        }
        if let Some((count, name)) = first(&self.crowded) {
            warnings.push(format!(
                "the normal maps of {count} meshes are left out: too many triangles share a vertex to compute tangents; export \
                 the tangents too (first: {name})"
            ));
        }
    }

    /// Index of the mesh of one primitive, which is read unless it is known; `None` if it has no visible triangle. Equal poses have
    /// equal numbers.
    fn primitive(
        &mut self,
        doc: &Document,
        name: String,
        primitive: &Primitive,
        (pose, pose_number): (&Pose, usize),
        materials: &mut Materials,
    ) -> Checked<Option<usize>> {
        let mode = match primitive.mode {
            Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => mode,
            Valid(_) => {
                self.points_or_lines += 1;
                return Ok(None);
            }
            Invalid => return Err(format!("{name} has an unknown mode; re-export the file")),
        };
        let source = Source::new(mode, primitive, pose_number);
        if let Some(known) = self.known.get(&source) {
            return Ok(*known);
        }
        let mesh = self.read(doc, name, mode, primitive, pose, materials)?;
        let index = mesh.map(|mesh| {
            self.meshes.push(mesh);
            self.meshes.len() - 1
        });
        self.known.insert(source, index);
        Ok(index)
    }

    /// The mesh of one primitive; `None` if it has no visible triangle.
    fn read(
        &mut self,
        doc: &Document,
        name: String,
        mode: Mode,
        primitive: &Primitive,
        pose: &Pose,
        materials: &mut Materials,
    ) -> Checked<Option<Mesh>> {
        let mut mesh = self.vertices(doc, name, primitive, materials)?;
        self.count_vertices(mesh.positions.len() as u64 * pose.targets(primitive), &mesh.name)?;
        let is_mirrored = pose.apply(doc, primitive, &mut mesh)?;
        check_finite(&mesh.positions, &format!("POSITION of {} after deformation", mesh.name))?;
        let corners = self.corners(doc, &mesh, primitive)?;
        let number = corners.len();
        if number < 3 || (mode == Mode::Triangles && !number.is_multiple_of(3)) {
            let name = mesh.name;
            return Err(format!("{name} has {number} corners, which do not make whole triangles; re-export the file"));
        }
        let mut push = |triangle: [usize; 3]| {
            let mut triangle = triangle.map(|corner| corners[corner]);
            if is_mirrored.get(triangle[0] as usize) == Some(&true) {
                triangle.swap(1, 2);
            }
            if has_zero_area(triangle.map(|index| mesh.positions[index as usize])) {
                self.degenerate += 1;
            } else {
                mesh.triangles.push(triangle);
            }
        };
        match mode {
            Mode::TriangleStrip => (0..number - 2).for_each(|i| push([i, i + 1 + i % 2, i + 2 - i % 2])),
            Mode::TriangleFan => (0..number - 2).for_each(|i| push([i + 1, i + 2, 0])),
            _ => (0..number / 3).for_each(|i| push([3 * i, 3 * i + 1, 3 * i + 2])),
        }
        if mesh.triangles.is_empty() {
            return Ok(None);
        }

        drop_unused(&mut mesh);
        if !normalise(&mut mesh.normals) {
            mesh.normals = Vec::new();
            self.flattened.push(mesh.name.clone());
        }
        // The tangents of the file do not fit the normals of flat or deformed meshes.
        let is_smooth = !mesh.normals.is_empty() && !pose.deforms();
        let has_tangents = is_smooth && !mesh.uvs.is_empty() && normalise_tangents(&mut mesh.tangents);
        self.complete_tangents(&mut mesh, has_tangents, materials);
        if mesh.uvs.is_empty() && materials.is_textured(mesh.material) {
            self.missing_uvs.push(mesh.name.clone());
        }
        Ok(Some(mesh))
    }

    /// Gives the mesh the tangents that its material needs, or a material without a normal map if they would take too long.
    /// `has_tangents`: whether the mesh has valid tangents.
    pub fn complete_tangents(&mut self, mesh: &mut Mesh, has_tangents: bool, materials: &mut Materials) {
        if !materials.is_bumped(mesh.material) {
            mesh.tangents = Vec::new();
        } else if !has_tangents {
            mesh.tangents = Vec::new();
            if self.can_have_tangents(mesh) {
                mesh.compute_tangents();
            } else {
                mesh.material = materials.without_normal_map(mesh.material);
                self.crowded.push(mesh.name.clone());
            }
        }
    }

    /// Counts vertices, or vertices of morph targets, before they are read. Fails if there are too many.
    fn count_vertices(&mut self, count: u64, name: &str) -> Checked<()> {
        self.vertices_read += count;
        if self.vertices_read > MAX_ELEMENTS {
            return Err(format!(
                "the scene has more than {MAX_ELEMENTS} vertices at {name}, morph targets included; simplify it or split it"
            ));
        }
        match self.free.filter(|free| self.vertices_read * VERTEX_BYTES > *free) {
            Some(free) => Err(format!(
                "the scene has {} vertices up to {name}, too many for the {} MiB of memory that are free; simplify it or split it",
                self.vertices_read,
                free >> 20
            )),
            None => Ok(()),
        }
    }

    /// Whether the tangents of the mesh can be computed in a time that is about proportional to the number of all triangles.
    fn can_have_tangents(&mut self, mesh: &Mesh) -> bool {
        let work = mesh.tangent_work();
        let limit = FREE_TANGENT_WORK + TANGENT_WORK_PER_CORNER * self.corners_read;
        let is_possible = work.is_some_and(|work| self.tangent_work + work <= limit);
        self.tangent_work += work.filter(|_| is_possible).unwrap_or(0);
        is_possible
    }

    /// Reads a mesh without its triangles. Normals and tangents are finite, but not yet of unit length.
    fn vertices(
        &mut self,
        doc: &Document,
        name: String,
        primitive: &Primitive,
        materials: &mut Materials,
    ) -> Checked<Mesh> {
        let what = |attribute: &str| format!("{attribute} of {name}");
        let positions = attribute(primitive, Semantic::Positions)
            .ok_or_else(|| format!("{name} has no POSITION attribute; remove it or re-export the file"))?;
        let count = doc.count(positions, &what("POSITION"))?;
        self.count_vertices(count, &name)?;
        let positions = doc.vectors::<3>(positions, &what("POSITION"), QUANTIZED)?;
        check_finite(&positions, &what("POSITION"))?;

        let beside_positions = |accessor: usize, what: &str| match doc.count(accessor, what)? {
            other if other == count => Ok(accessor),
            other => Err(format!(
                "accessor {accessor} ({what}) has {other} elements for {count} positions; re-export the file"
            )),
        };
        let normals = match attribute(primitive, Semantic::Normals) {
            None => Vec::new(),
            Some(accessor) => {
                let accessor = beside_positions(accessor, &what("NORMAL"))?;
                doc.vectors::<3>(accessor, &what("NORMAL"), DIRECTION)?
            }
        };
        check_finite(&normals, &what("NORMAL"))?;
        let (material, mapping) = materials.of(primitive.material.map(|material| material.value()), &name)?;
        let set = format!("TEXCOORD_{}", mapping.set);
        let uvs = attribute(primitive, Semantic::TexCoords(mapping.set)).map_or(Ok(Vec::new()), |accessor| {
            let accessor = beside_positions(accessor, &what(&set))?;
            let mut uvs = doc.vectors::<2>(accessor, &what(&set), QUANTIZED)?;
            if let Some(transform) = mapping.transform {
                transform_uvs(&mut uvs, &transform);
            }
            check_finite(&uvs, &what(&set))?;
            Ok(uvs)
        });
        let uvs = self.unless_unneeded(uvs, materials.is_textured(material))?;
        let colors = match attribute(primitive, Semantic::Colors(0)) {
            None => Vec::new(),
            Some(accessor) => doc.colors(beside_positions(accessor, &what("COLOR_0"))?, &what("COLOR_0"))?,
        };
        let tangents = attribute(primitive, Semantic::Tangents).map_or(Ok(Vec::new()), |accessor| {
            let accessor = beside_positions(accessor, &what("TANGENT"))?;
            let tangents = doc.vectors::<4>(accessor, &what("TANGENT"), DIRECTION)?;
            check_finite(&tangents, &what("TANGENT"))?;
            Ok(tangents)
        });
        let tangents = self.unless_unneeded(tangents, materials.is_bumped(material))?;
        Ok(Mesh { positions, normals, uvs, colors, tangents, triangles: Vec::new(), material, name })
    }

    /// The attribute `values`. If it cannot be read and the material does not need it, it is empty, and the user gets a warning.
    fn unless_unneeded<T>(&mut self, values: Checked<Vec<T>>, is_needed: bool) -> Checked<Vec<T>> {
        match values {
            Err(why) if !is_needed => {
                self.unneeded.get_or_insert(why);
                Ok(Vec::new())
            }
            values => values,
        }
    }

    /// The vertex index of each corner in drawing order; each is below `mesh.positions.len()`.
    fn corners(&mut self, doc: &Document, mesh: &Mesh, primitive: &Primitive) -> Checked<Vec<u32>> {
        let name = &mesh.name;
        let what = format!("indices of {name}");
        let count = mesh.positions.len();
        let accessor = primitive.indices.map(|accessor| accessor.value());
        self.corners_read += accessor.map_or(Ok(count as u64), |accessor| doc.count(accessor, &what))?;
        if self.corners_read > MAX_ELEMENTS {
            return Err(format!(
                "the meshes have more than {MAX_TRIANGLES} triangles at {name}; simplify or split the scene"
            ));
        }
        let Some(accessor) = accessor else { return Ok((0..count as u32).collect()) };
        let corners = doc.indices(accessor, &what)?;
        match corners.iter().find(|&&index| index as usize >= count) {
            None => Ok(corners),
            Some(index) => Err(format!(
                "accessor {accessor} ({what}) has the index {index}, but there are only {count} positions; re-export the file"
            )),
        }
    }
}

/// The accessor of an attribute; `None` if the primitive does not have the attribute.
pub fn attribute(primitive: &Primitive, semantic: Semantic) -> Option<usize> {
    primitive.attributes.get(&Valid(semantic)).map(|accessor| accessor.value())
}

/// An error if a component is not finite. `what` names the attribute.
pub fn check_finite<const N: usize>(vectors: &[[f32; N]], what: &str) -> Checked<()> {
    match vectors.iter().position(|vector| vector.iter().any(|value| !value.is_finite())) {
        None => Ok(()),
        Some(vertex) => Err(format!("{what} is not finite at vertex {vertex}; clean the mesh and re-export")),
    }
}

//! Reads meshes: turns the attributes and indices of each primitive into valid triangles.

use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked::{Invalid, Valid};
use glam::{DAffine2, DVec2, DVec3, Vec3};

use super::Checked;
use super::accessor::{DIRECTION, MAX_ELEMENTS, QUANTIZED};
use super::document::{Document, Warnings, label};
use super::material::Materials;
use super::node::Worlds;
use super::pose::{Pose, Skin};
use crate::scene::Mesh;

/// Maximum number of triangles in a scene, instances included.
pub const MAX_TRIANGLES: u64 = 64 << 20;

/// Upper bound on [`Meshes::tangent_work`]: this number, and more per corner of a triangle. About six triangles share a vertex of a
/// usual mesh, so its work per corner is about six.
const FREE_TANGENT_WORK: u64 = 1 << 26;
const TANGENT_WORK_PER_CORNER: u64 = 32;

/// The meshes of a node.
#[derive(Clone)]
pub struct Placement {
    /// Indices into [`Meshes::meshes`].
    pub range: Range<usize>,
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
}

/// Reads every mesh that a visible node of the scene refers to; drops and counts primitives and triangles that cannot be seen.
pub fn load(doc: &Document, worlds: &Worlds, materials: &mut Materials, warnings: &mut Warnings) -> Checked<Meshes> {
    let mut out = Meshes::default();
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
    for (shape, nodes) in nodes_of {
        let Some(mesh) = doc.root.meshes.get(shape.mesh) else { continue };
        let weights: Vec<f32> = shape.weights.into_iter().map(f32::from_bits).collect();
        let skin = shape.skin.and_then(|number| skins[&number].as_ref());
        let pose = Pose { weights: &weights, skin };
        let start = out.meshes.len();
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let name = format!("{}[{number}]", label(mesh.name.as_deref(), "mesh", shape.mesh));
            out.primitive(doc, name, primitive, &pose, materials)?;
        }
        let placement = Placement { range: start..out.meshes.len(), skinned_at: skin.map(|skin| skin.origin) };
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
        if let Some((count, name)) = first(&self.crowded) {
            warnings.push(format!(
                "the normal maps of {count} meshes are left out: too many triangles share a vertex to compute tangents; export \
                 the tangents too (first: {name})"
            ));
        }
    }

    /// Appends the mesh of one primitive, unless it has no visible triangle.
    fn primitive(
        &mut self,
        doc: &Document,
        name: String,
        primitive: &Primitive,
        pose: &Pose,
        materials: &mut Materials,
    ) -> Checked<()> {
        let mode = match primitive.mode {
            Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => mode,
            Valid(_) => {
                self.points_or_lines += 1;
                return Ok(());
            }
            Invalid => return Err(format!("{name} has an unknown mode; re-export the file")),
        };
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
            return Ok(());
        }

        drop_unused(&mut mesh);
        if !normalise(&mut mesh.normals) {
            mesh.normals = Vec::new();
            self.flattened.push(mesh.name.clone());
        }
        // The tangents of the file do not fit the normals of flat or deformed meshes.
        let is_smooth = !mesh.normals.is_empty() && !pose.deforms();
        let has_tangents = is_smooth && !mesh.uvs.is_empty() && normalise_tangents(&mut mesh.tangents);
        if !materials.is_bumped(mesh.material) {
            mesh.tangents = Vec::new();
        } else if !has_tangents {
            mesh.tangents = Vec::new();
            if self.can_have_tangents(&mesh) {
                mesh.compute_tangents();
            } else {
                mesh.material = materials.without_normal_map(mesh.material);
                self.crowded.push(mesh.name.clone());
            }
        }
        if mesh.uvs.is_empty() && materials.is_textured(mesh.material) {
            self.missing_uvs.push(mesh.name.clone());
        }
        self.meshes.push(mesh);
        Ok(())
    }

    /// Counts vertices, or vertices of morph targets, before they are read. Fails if there are too many.
    fn count_vertices(&mut self, count: u64, name: &str) -> Checked<()> {
        self.vertices_read += count;
        match self.vertices_read > MAX_ELEMENTS {
            true => Err(format!(
                "the scene has more than {MAX_ELEMENTS} vertices at {name}, morph targets included; simplify it or split it"
            )),
            false => Ok(()),
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
        let mut uvs = match attribute(primitive, Semantic::TexCoords(mapping.set)) {
            None => Vec::new(),
            Some(accessor) => {
                let accessor = beside_positions(accessor, &what(&set))?;
                doc.vectors::<2>(accessor, &what(&set), QUANTIZED)?
            }
        };
        let colors = match attribute(primitive, Semantic::Colors(0)) {
            None => Vec::new(),
            Some(accessor) => doc.colors(beside_positions(accessor, &what("COLOR_0"))?, &what("COLOR_0"))?,
        };
        let tangents = match attribute(primitive, Semantic::Tangents) {
            None => Vec::new(),
            Some(accessor) => {
                doc.vectors::<4>(beside_positions(accessor, &what("TANGENT"))?, &what("TANGENT"), DIRECTION)?
            }
        };
        check_finite(&tangents, &what("TANGENT"))?;
        if let Some(transform) = mapping.transform {
            transform_uvs(&mut uvs, &transform);
        }
        check_finite(&uvs, &what(&set))?;
        Ok(Mesh { positions, normals, uvs, colors, tangents, triangles: Vec::new(), material, name })
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

fn transform_uvs(uvs: &mut [[f32; 2]], transform: &DAffine2) {
    for uv in uvs {
        *uv = transform.transform_point2(DVec2::from(uv.map(f64::from))).as_vec2().to_array();
    }
}

/// Whether the cross product of two edges vanishes in f64. The test is exact if corners coincide.
fn has_zero_area(corners: [[f32; 3]; 3]) -> bool {
    let [a, b, c] = corners.map(|corner| Vec3::from(corner).as_dvec3());
    (b - a).cross(c - a) == glam::DVec3::ZERO
}

/// Removes vertices that no triangle uses: some exporters give every primitive the vertices of all primitives.
fn drop_unused(mesh: &mut Mesh) {
    let mut is_used = vec![false; mesh.positions.len()];
    for &index in mesh.triangles.iter().flatten() {
        is_used[index as usize] = true;
    }
    let kept = is_used.iter().filter(|is_used| **is_used).count();
    if kept == is_used.len() {
        return;
    }
    fn keep<T: Copy>(values: &mut Vec<T>, is_used: &[bool]) {
        *values = values.iter().zip(is_used).filter(|(_, is_used)| **is_used).map(|(value, _)| *value).collect();
    }
    keep(&mut mesh.positions, &is_used);
    keep(&mut mesh.normals, &is_used);
    keep(&mut mesh.uvs, &is_used);
    keep(&mut mesh.colors, &is_used);
    keep(&mut mesh.tangents, &is_used);
    let mut next = 0;
    let renumbered: Vec<u32> = is_used
        .iter()
        .map(|&is_used| {
            next += u32::from(is_used);
            next.wrapping_sub(1)
        })
        .collect();
    for index in mesh.triangles.iter_mut().flatten() {
        *index = renumbered[*index as usize];
    }
}

/// Scales all tangents to unit length, and their w to 1 or -1; false if there are none, or if a tangent has length zero.
fn normalise_tangents(tangents: &mut [[f32; 4]]) -> bool {
    !tangents.is_empty()
        && tangents.iter_mut().all(|tangent| {
            let [x, y, z, w] = tangent.map(f64::from);
            let Some(unit) = glam::DVec3::new(x, y, z).try_normalize() else { return false };
            *tangent = unit.as_vec3().extend(1f32.copysign(w as f32)).to_array();
            true
        })
}

/// Scales all normals to unit length; false if a normal has length zero.
fn normalise(normals: &mut [[f32; 3]]) -> bool {
    normals.iter_mut().all(|normal| match Vec3::from(*normal).as_dvec3().try_normalize() {
        Some(unit) => {
            *normal = unit.as_vec3().to_array();
            true
        }
        None => false,
    })
}

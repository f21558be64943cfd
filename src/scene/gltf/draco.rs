//! Primitives that KHR_draco_mesh_compression compresses.
//!
//! A compressed primitive names accessors without data. This file maps these accessors to the Draco mesh that has their data, so
//! that the rest of the reader need not know about the compression.

use std::collections::{BTreeMap, HashMap};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use ::gltf::json::accessor::ComponentType;
use ::gltf::json::mesh::Primitive;
use ::gltf::json::validation::Checked::Valid;
use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder};
use serde::Deserialize;

use super::Checked;
use super::accessor::MAX_ELEMENTS;
use super::document::{Document, printable};
use super::mesh::MAX_TRIANGLES;
use super::resolve::MAX_TOTAL_BYTES;
use super::root::Root;

const EXTENSION: &str = "KHR_draco_mesh_compression";

/// The extension's object in a primitive.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Source {
    buffer_view: usize,
    attributes: BTreeMap<String, u32>,
}

/// Which part of a Draco mesh an accessor stands for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    Indices,
    /// The attribute with this number in the Draco mesh.
    Attribute(u32),
}

/// The Draco meshes of a file. Each is decoded on first use.
#[derive(Default)]
pub struct DracoMeshes {
    /// By accessor: the buffer view of its mesh, and the part of the mesh.
    accessors: HashMap<usize, (usize, Part)>,
    /// By buffer view.
    meshes: HashMap<usize, OnceLock<Checked<Mesh>>>,
    decoded_bytes: AtomicU64,
}

impl DracoMeshes {
    /// Finds the accessors whose data is in Draco meshes. A primitive that also has plain data is not decompressed.
    pub fn find(root: &Root) -> Checked<Self> {
        let mut out = Self::default();
        for (index, mesh) in root.meshes.iter().enumerate() {
            for (number, primitive) in mesh.primitives.iter().enumerate() {
                out.add(root, primitive, &format!("primitive {number} of mesh {index}"))?;
            }
        }
        Ok(out)
    }

    fn add(&mut self, root: &Root, primitive: &Primitive, name: &str) -> Checked<()> {
        let object = primitive.extensions.as_ref().and_then(|extensions| extensions.others.get(EXTENSION));
        let Some(object) = object else { return Ok(()) };
        let source = Source::deserialize(object)
            .map_err(|e| format!("the Draco data of {name} cannot be read ({e}); re-export the file"))?;
        let named = primitive.attributes.iter().filter_map(|(semantic, accessor)| match semantic {
            Valid(semantic) => {
                Some((accessor.value(), Part::Attribute(*source.attributes.get(&semantic.to_string())?)))
            }
            _ => None,
        });
        let indices = primitive.indices.map(|accessor| (accessor.value(), Part::Indices));
        for (accessor, part) in named.chain(indices) {
            let is_plain = root.accessors.get(accessor).is_some_and(|accessor| accessor.buffer_view.is_some());
            if is_plain {
                continue;
            }
            let place = (source.buffer_view, part);
            if *self.accessors.entry(accessor).or_insert(place) != place {
                return Err(format!("accessor {accessor} has the data of two Draco meshes; re-export the file"));
            }
            self.meshes.entry(source.buffer_view).or_default();
        }
        Ok(())
    }

    fn part(&self, doc: &Document, accessor: usize, what: &str) -> Option<(Checked<&Mesh>, Part)> {
        let (view, part) = *self.accessors.get(&accessor)?;
        let mesh = self.meshes.get(&view)?.get_or_init(|| self.decode(doc, view, what)).as_ref().map_err(Clone::clone);
        Some((mesh, part))
    }

    fn decode(&self, doc: &Document, view: usize, what: &str) -> Checked<Mesh> {
        let left = MAX_TOTAL_BYTES.saturating_sub(self.decoded_bytes.load(Ordering::Relaxed));
        let limits = DecodeLimits::default()
            .with_max_points(MAX_ELEMENTS)
            .with_max_faces(MAX_TRIANGLES)
            .with_max_decoded_bytes(left);
        let mut buffer = DecoderBuffer::new(doc.view(view, what)?.bytes).with_limits(limits);
        let mut mesh = Mesh::new();
        MeshDecoder::new().decode(&mut buffer, &mut mesh).map_err(|e| {
            let why = printable(&e.to_string(), 120);
            format!("the Draco data of {what} cannot be decoded ({why}); re-export the file without Draco compression")
        })?;
        let bytes = (0..mesh.num_attributes()).map(|k| mesh.attribute(k).buffer().data().len() as u64).sum::<u64>();
        self.decoded_bytes.fetch_add(bytes + 12 * mesh.num_faces() as u64, Ordering::Relaxed);
        Ok(mesh)
    }

    /// Number of elements of an accessor; `None` if its data is not in a Draco mesh.
    pub fn count(&self, doc: &Document, accessor: usize, what: &str) -> Option<Checked<u64>> {
        let (mesh, part) = self.part(doc, accessor, what)?;
        Some(mesh.map(|mesh| match part {
            Part::Indices => 3 * mesh.num_faces() as u64,
            Part::Attribute(_) => mesh.num_points() as u64,
        }))
    }

    /// The elements of an accessor, tightly packed, with `width` components per element, and the type of the components: U32 for
    /// indices, else `component`. `None` if its data is not in a Draco mesh.
    pub fn bytes(
        &self,
        doc: &Document,
        accessor: usize,
        component: ComponentType,
        width: usize,
        what: &str,
    ) -> Option<Checked<(ComponentType, Vec<u8>)>> {
        let (mesh, part) = self.part(doc, accessor, what)?;
        Some(mesh.and_then(|mesh| match part {
            Part::Indices => {
                let bytes = mesh.faces().iter().flatten().flat_map(|point| point.0.to_le_bytes()).collect();
                Ok((ComponentType::U32, bytes))
            }
            Part::Attribute(number) => {
                let attribute = mesh
                    .attribute_by_unique_id(number)
                    .ok_or_else(|| format!("the Draco data of {what} has no attribute {number}; re-export the file"))?;
                // The values are whole numbers if the accessor has integers.
                let values = attribute.read_f32s(mesh.num_points(), width).into_iter();
                let bytes = match component {
                    ComponentType::I8 => values.flat_map(|value| (value as i8).to_le_bytes()).collect(),
                    ComponentType::U8 => values.flat_map(|value| (value as u8).to_le_bytes()).collect(),
                    ComponentType::I16 => values.flat_map(|value| (value as i16).to_le_bytes()).collect(),
                    ComponentType::U16 => values.flat_map(|value| (value as u16).to_le_bytes()).collect(),
                    ComponentType::U32 => values.flat_map(|value| (value as u32).to_le_bytes()).collect(),
                    ComponentType::F32 => values.flat_map(|value| value.to_le_bytes()).collect(),
                };
                Ok((component, bytes))
            }
        }))
    }
}

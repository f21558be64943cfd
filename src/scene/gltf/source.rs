//! Recognizes primitives with the same data.

use ::gltf::json::mesh::{Mode, Primitive};
use ::gltf::json::validation::Checked::{Invalid, Valid};

/// What determines the mesh of a primitive. Primitives with equal sources share their mesh, so that a small file cannot fill the
/// memory with copies of its accessors.
#[derive(PartialEq, Eq, Hash)]
pub struct Source {
    mode: u32,
    /// Accessors by the name of the attribute.
    attributes: Vec<(String, usize)>,
    indices: Option<usize>,
    material: Option<usize>,
    /// Accessors of positions and normals of the morph targets.
    targets: Vec<[Option<usize>; 2]>,
    pose: usize,
}

impl Source {
    /// `pose` is the number of the skin and the weights of the morph targets together.
    pub fn new(mode: Mode, primitive: &Primitive, pose: usize) -> Source {
        let attributes = primitive.attributes.iter().filter_map(|(semantic, accessor)| match semantic {
            Valid(semantic) => Some((semantic.to_string(), accessor.value())),
            Invalid => None,
        });
        let targets = primitive.targets.iter().flatten();
        let targets = targets.map(|target| [target.positions, target.normals].map(|a| a.map(|index| index.value())));
        Source {
            mode: mode.as_gl_enum(),
            attributes: attributes.collect(),
            indices: primitive.indices.map(|accessor| accessor.value()),
            material: primitive.material.map(|material| material.value()),
            targets: targets.collect(),
            pose,
        }
    }
}

//! Copies of a node's mesh by EXT_mesh_gpu_instancing.

use std::collections::BTreeMap;

use ::gltf::json::Node;
use glam::DAffine3;
use serde::Deserialize;
use serde_json::Value;

use super::Checked;
use super::accessor::{DIRECTION, FLOAT};
use super::document::Document;
use super::node::compose;

const EXTENSION: &str = "EXT_mesh_gpu_instancing";
/// Maximum number of instances in a scene.
pub const MAX_INSTANCES: u64 = 4 << 20;

/// The extension's object in a node: accessors by attribute.
#[derive(Deserialize)]
struct Source {
    attributes: BTreeMap<String, usize>,
}

fn object(node: &Node) -> Option<&Value> {
    node.extensions.as_ref().and_then(|extensions| extensions.others.get(EXTENSION))
}

/// Whether the node has the extension.
pub fn has_copies(node: &Node) -> bool {
    object(node).is_some()
}

fn source(object: &Value, name: &str) -> Checked<Source> {
    Source::deserialize(object)
        .map_err(|e| format!("the instances of node `{name}` cannot be read ({e}); re-export the file"))
}

/// Number of copies of the node `name`, at most [`MAX_INSTANCES`]. All attributes must have the same number of elements, including
/// attributes that taugate does not read.
fn count_of(doc: &Document, source: &Source, name: &str) -> Checked<u64> {
    let mut count = None;
    for (attribute, &accessor) in &source.attributes {
        let number = doc.count(accessor, &format!("{attribute} of the instances of node `{name}`"))?;
        if *count.get_or_insert(number) != number {
            return Err(format!(
                "the attributes of the instances of node `{name}` differ in length; re-export the file"
            ));
        }
    }
    match count.unwrap_or(1) {
        count if count > MAX_INSTANCES => Err(too_many()),
        count => Ok(count),
    }
}

/// Number of copies of the node; 1 if it does not have the extension. Reads no copies.
pub fn count(doc: &Document, index: usize, node: &Node) -> Checked<u64> {
    let Some(object) = object(node) else { return Ok(1) };
    let name = doc.node_name(index);
    count_of(doc, &source(object, &name)?, &name)
}

/// Transforms from mesh space to the node's space, one per copy; only the identity if the node does not have the extension.
pub fn copies(doc: &Document, index: usize, node: &Node) -> Checked<Vec<DAffine3>> {
    let Some(object) = object(node) else { return Ok(vec![DAffine3::IDENTITY]) };
    let name = doc.node_name(index);
    let source = source(object, &name)?;
    let count = count_of(doc, &source, &name)?;
    let what = |attribute: &str| format!("{attribute} of the instances of node `{name}`");
    let read = |attribute: &str, default: [f32; 3]| match source.attributes.get(attribute) {
        None => Ok(vec![default; count as usize]),
        Some(&accessor) => doc.vectors::<3>(accessor, &what(attribute), FLOAT),
    };
    let translations = read("TRANSLATION", [0.0; 3])?;
    let scales = read("SCALE", [1.0; 3])?;
    let rotations = match source.attributes.get("ROTATION") {
        None => vec![[0.0, 0.0, 0.0, 1.0]; count as usize],
        Some(&accessor) => doc.vectors::<4>(accessor, &what("ROTATION"), DIRECTION)?,
    };
    let all = translations.into_iter().zip(rotations).zip(scales).enumerate();
    all.map(|(copy, ((translation, rotation), scale))| {
        compose(translation, rotation, scale).filter(|transform| transform.is_finite()).ok_or_else(|| {
            format!("instance {copy} of node `{name}` has no finite transform; correct it and re-export")
        })
    })
    .collect()
}

pub fn too_many() -> String {
    format!("the scene has more than {} million instances; simplify it or split it", MAX_INSTANCES >> 20)
}

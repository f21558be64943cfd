//! Resolves the node hierarchy to one world transform per node.

use ::gltf::json::Node;
use ::gltf::json::scene::UnitQuaternion;
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec4, Vec3};

use super::Checked;
use super::document::Document;

/// The last row of a matrix may differ from 0, 0, 0, 1 by this number, because exporters round it.
const ROUNDING: f64 = 1e-5;

/// The nodes of the scene, by node index; `None` for nodes that are not in the scene.
pub struct Worlds(Vec<Option<Placed>>);

#[derive(Clone, Copy)]
struct Placed {
    /// World from node space.
    world: DAffine3,
    /// False if the node or one of its ancestors is hidden by KHR_node_visibility.
    visible: bool,
}

impl Worlds {
    /// The nodes in the scene: index and world transform, by increasing index.
    pub fn iter(&self) -> impl Iterator<Item = (usize, DAffine3)> + '_ {
        self.0.iter().enumerate().filter_map(|(index, placed)| Some((index, (*placed)?.world)))
    }

    /// As [`Worlds::iter`], without hidden nodes. A hidden node has no meshes and no lights, but keeps its camera.
    pub fn visible(&self) -> impl Iterator<Item = (usize, DAffine3)> + '_ {
        self.iter().filter(|(index, _)| self.0[*index].is_some_and(|placed| placed.visible))
    }

    /// World transform of a node; `None` if it is not in the scene.
    pub fn get(&self, node: usize) -> Option<DAffine3> {
        Some((*self.0.get(node)?)?.world)
    }
}

/// Walks the default scene without recursion, or scene 0 if there is no default, or all root nodes if there is no scene. A node
/// that is reached twice is an error.
pub fn world_transforms(doc: &Document) -> Checked<Worlds> {
    let nodes = &doc.root.nodes;
    let mut worlds = vec![None; nodes.len()];
    let roots = roots(doc)?;
    let above = Placed { world: DAffine3::IDENTITY, visible: true };
    let mut stack: Vec<(usize, Placed)> = roots.iter().rev().map(|&root| (root, above)).collect();
    while let Some((index, parent)) = stack.pop() {
        let (Some(node), Some(place)) = (nodes.get(index), worlds.get_mut(index)) else {
            return Err(format!("node {index} is referred to but does not exist; re-export the file"));
        };
        let name = || doc.node_name(index);
        if place.is_some() {
            return Err(format!("node `{}` has two parents or is its own ancestor; re-export the file", name()));
        }
        let here = Placed { world: parent.world * local(node, name)?, visible: parent.visible && !is_hidden(node) };
        if !here.world.is_finite() {
            return Err(format!("the transform of node `{}` is not finite; correct it and re-export", name()));
        }
        *place = Some(here);
        stack.extend(node.children.iter().flatten().rev().map(|child| (child.value(), here)));
    }
    if doc.root.scenes.is_empty() {
        // Without scenes, all nodes are part of the render. A node that no root reaches is its own ancestor.
        if let Some(index) = worlds.iter().position(Option::is_none) {
            return Err(format!("node `{}` is its own ancestor; re-export the file", doc.node_name(index)));
        }
    }
    Ok(Worlds(worlds))
}

fn roots(doc: &Document) -> Checked<Vec<usize>> {
    let scene = match doc.root.scene {
        Some(index) => Some(
            doc.root
                .scenes
                .get(index.value())
                .ok_or_else(|| format!("the default scene {} does not exist; re-export the file", index.value()))?,
        ),
        None => doc.root.scenes.first(),
    };
    if let Some(scene) = scene {
        return Ok(scene.nodes.iter().map(|node| node.value()).collect());
    }
    let mut is_child = vec![false; doc.root.nodes.len()];
    for child in doc.root.nodes.iter().flat_map(|node| node.children.iter().flatten()) {
        if let Some(flag) = is_child.get_mut(child.value()) {
            *flag = true;
        }
    }
    Ok((0..is_child.len()).filter(|&index| !is_child[index]).collect())
}

/// Whether KHR_node_visibility hides the node and its descendants.
fn is_hidden(node: &Node) -> bool {
    let extension = node.extensions.as_ref().and_then(|extensions| extensions.others.get("KHR_node_visibility"));
    extension.and_then(|extension| extension.get("visible")?.as_bool()) == Some(false)
}

/// Transform from the node's space to its parent's.
fn local(node: &Node, name: impl Fn() -> String) -> Checked<DAffine3> {
    if let Some(matrix) = node.matrix {
        let matrix = DMat4::from_cols_array(&matrix.map(f64::from));
        if !matrix.row(3).abs_diff_eq(DVec4::W, ROUNDING) {
            return Err(format!("the matrix of node `{}` is not affine; re-export the file", name()));
        }
        return Ok(DAffine3::from_mat4(matrix));
    }
    let rotation = node.rotation.unwrap_or(UnitQuaternion([0.0, 0.0, 0.0, 1.0])).0;
    compose(node.translation.unwrap_or([0.0; 3]), rotation, node.scale.unwrap_or([1.0; 3]))
        .ok_or_else(|| format!("the rotation of node `{}` has no direction; correct it and re-export", name()))
}

/// Scale, then rotation, then translation; `None` if the rotation, a quaternion of any length, is zero or not finite.
pub fn compose(translation: [f32; 3], rotation: [f32; 4], scale: [f32; 3]) -> Option<DAffine3> {
    let rotation = DQuat::from_array(rotation.map(f64::from));
    let length = rotation.length();
    if !(length.is_finite() && length > 0.0) {
        return None;
    }
    let vector = |v: [f32; 3]| Vec3::from(v).as_dvec3();
    let rotation = DQuat::from_vec4(glam::DVec4::from(rotation) / length);
    Some(DAffine3::from_scale_rotation_translation(vector(scale), rotation, vector(translation)))
}

/// Rotation and translation of `transform`. The result keeps the direction of -Z, and of +Y as far as it is perpendicular to -Z.
/// `None` if the transform flattens either axis.
pub fn rigid(transform: &DAffine3) -> Option<DAffine3> {
    let back = transform.matrix3.z_axis.try_normalize()?;
    let up = transform.matrix3.y_axis.try_normalize()?.reject_from_normalized(back);
    if up.length() < 1e-6 {
        return None;
    }
    let up = up.normalize();
    let matrix = DMat3::from_cols(up.cross(back), up, back);
    Some(DAffine3::from_mat3_translation(matrix, transform.translation))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn rigid_drops_scale_and_mirrors() {
        let rotation = DQuat::from_rotation_y(0.5);
        let scaled = DAffine3::from_scale_rotation_translation(DVec3::new(-2.0, 3.0, 0.5), rotation, DVec3::X);
        let rigid = rigid(&scaled).unwrap();
        assert!(rigid.abs_diff_eq(DAffine3::from_rotation_translation(rotation, DVec3::X), 1e-12));
    }
}

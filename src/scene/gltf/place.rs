//! Places the meshes of the nodes in the world.

use std::collections::HashMap;

use glam::DAffine3;

use super::document::{Document, Warnings};
use super::flat::Flattening;
use super::material::Materials;
use super::mesh::{self, Meshes};
use super::{Checked, instancing, node};
use crate::scene::Instance;
use crate::scene::check::is_singular;

/// The instances, in the order of the nodes: one per primitive of a node's mesh and per copy of the node. Adds flat copies of meshes
/// that a node flattens to a plane.
pub fn place(
    doc: &Document,
    worlds: &node::Worlds,
    meshes: &mut Meshes,
    materials: &mut Materials,
    warnings: &mut Warnings,
) -> Checked<Vec<Instance>> {
    check_counts(doc, worlds, meshes)?;
    let mut instances = Vec::new();
    let mut flattened = Flattened::default();
    for (index, world) in worlds.visible() {
        let (Some(node), Some(placement)) = (doc.root.nodes.get(index), meshes.of(index)) else { continue };
        let numbers = placement.meshes.clone();
        if numbers.is_empty() {
            continue;
        }
        let name = doc.node_name(index);
        let transforms = match placement.skinned_at {
            Some(origin) => {
                if instancing::has_copies(node) {
                    warnings.once("skinned copies", || {
                        format!(
                            "the copies of node `{name}` (EXT_mesh_gpu_instancing) are left out, because a skin places its mesh"
                        )
                    });
                }
                vec![DAffine3::from_translation(origin)]
            }
            None => instancing::copies(doc, index, node)?.into_iter().map(|copy| world * copy).collect(),
        };
        for transform in transforms {
            let flattens = is_singular(&transform);
            for &mesh in &numbers {
                let usable = match flattens {
                    true => flattened.usable(&transform, mesh, meshes, materials),
                    false => Some((transform, mesh)),
                };
                match usable {
                    Some((transform, mesh)) => {
                        instances.push(Instance { mesh: mesh as u32, transform, node: name.clone() });
                    }
                    None => warnings
                        .once("singular", || format!("node `{name}` is scaled to nothing, so its mesh is left out")),
                }
            }
        }
    }
    Ok(instances)
}

/// Fails if the scene has too many instances or triangles. They are counted before memory is taken for them. Copies that will be
/// left out count too, because reading them takes as long.
fn check_counts(doc: &Document, worlds: &node::Worlds, meshes: &Meshes) -> Checked<()> {
    let (mut triangles, mut count) = (0u64, 0u64);
    for (index, _) in worlds.visible() {
        let (Some(node), Some(placement)) = (doc.root.nodes.get(index), meshes.of(index)) else { continue };
        if placement.meshes.is_empty() {
            continue;
        }
        let copies = if placement.skinned_at.is_some() { 1 } else { instancing::count(doc, index, node)? };
        let per_copy: u64 = placement.meshes.iter().map(|&mesh| meshes.meshes[mesh].triangles.len() as u64).sum();
        triangles = triangles.saturating_add(per_copy.saturating_mul(copies));
        count = count.saturating_add(copies.saturating_mul(placement.meshes.len() as u64));
        if triangles > mesh::MAX_TRIANGLES {
            return Err(format!(
                "the scene has more than {} million triangles, instances included; simplify it or split it",
                mesh::MAX_TRIANGLES >> 20
            ));
        }
        if count > instancing::MAX_INSTANCES {
            return Err(instancing::too_many());
        }
    }
    Ok(())
}

/// Flat copies of meshes, by the index of the mesh and the bits of the direction that is lost. `None` if nothing is left of the mesh.
#[derive(Default)]
struct Flattened(HashMap<(usize, [u64; 3]), Option<usize>>);

impl Flattened {
    /// An invertible transform and a mesh that show what `mesh` looks like after `transform`, which is singular. `None` if nothing is
    /// left of it.
    fn usable(
        &mut self,
        transform: &DAffine3,
        mesh: usize,
        meshes: &mut Meshes,
        materials: &mut Materials,
    ) -> Option<(DAffine3, usize)> {
        let flattening = Flattening::new(transform)?;
        if let Some(transform) = flattening.invertible(&meshes.meshes[mesh]) {
            return Some((transform, mesh));
        }
        let key = (mesh, flattening.lost.to_array().map(f64::to_bits));
        let flat = (*self.0.entry(key).or_insert_with(|| {
            let mut flat = flattening.flatten(&meshes.meshes[mesh])?;
            meshes.complete_tangents(&mut flat, false, materials);
            meshes.meshes.push(flat);
            Some(meshes.meshes.len() - 1)
        }))?;
        Some((flattening.invertible(&meshes.meshes[flat])?, flat))
    }
}

//! Deforms meshes to the pose of the nodes: morph targets with the weights of the node or mesh, and skins with the transforms of
//! their joints. [`super::animation`] has already posed the nodes.

use ::gltf::json::mesh::{Primitive, Semantic};
use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};

use super::Checked;
use super::accessor::{DIRECTION, FLOAT, FRACTION, JOINT, QUANTIZED};
use super::document::{Document, Warnings, label};
use super::mesh::{attribute, check_finite};
use super::node::Worlds;
use crate::scene::Mesh;

/// Maximum number of sets of four joints per vertex that are read.
const MAX_SETS: u32 = 4;
/// Maximum number of inverse bind matrices of all skins together.
const MAX_MATRICES: u64 = 4 << 20;

/// A skin with the transforms of its joints.
pub struct Skin {
    name: String,
    /// World from mesh space, by joint.
    joints: Vec<DAffine3>,
    /// Point of the world near the mesh: the origin of its deformed positions, which are f32.
    pub origin: DVec3,
}

/// How a node deforms its mesh.
#[derive(Default)]
pub struct Pose<'a> {
    /// Weights of the morph targets; targets without a weight have no effect.
    pub weights: &'a [f32],
    pub skin: Option<&'a Skin>,
}

impl Skin {
    /// Reads skin `index`; `None`, with a warning, if one of its joints is not part of the scene. `matrices_read`: number of matrices of
    /// all skins so far. Skins may share an accessor.
    pub fn load(
        doc: &Document,
        worlds: &Worlds,
        index: usize,
        matrices_read: &mut u64,
        warnings: &mut Warnings,
    ) -> Checked<Option<Self>> {
        let skin = (doc.root.skins.get(index))
            .ok_or_else(|| format!("skin {index} is referred to but does not exist; re-export the file"))?;
        let name = format!("skin `{}`", label(skin.name.as_deref(), "skin", index));
        let mut joints = Vec::with_capacity(skin.joints.len());
        for joint in &skin.joints {
            let Some(world) = worlds.get(joint.value()) else {
                warnings.once("joints", || {
                    format!(
                        "{name} has joints outside the scene, so its meshes are not deformed and stay at their nodes"
                    )
                });
                return Ok(None);
            };
            joints.push(world);
        }
        let origin = joints.first().map_or(DVec3::ZERO, |joint| joint.translation);
        if let Some(accessor) = skin.inverse_bind_matrices {
            let what = format!("inverse bind matrices of {name}");
            *matrices_read += doc.count(accessor.value(), &what)?;
            if *matrices_read > MAX_MATRICES {
                return Err(format!(
                    "the skins have more than {MAX_MATRICES} matrices at the {what}; remove some skins"
                ));
            }
            let matrices = doc.vectors::<16>(accessor.value(), &what, FLOAT)?;
            if matrices.len() < joints.len() {
                return Err(format!(
                    "{name} has {} inverse bind matrices for {} joints; re-export the file",
                    matrices.len(),
                    joints.len()
                ));
            }
            for (joint, matrix) in joints.iter_mut().zip(&matrices) {
                // The last row of an affine matrix is 0, 0, 0, 1. It is not read, because exporters round it.
                *joint *= DAffine3::from_mat4(DMat4::from_cols_array(&matrix.map(f64::from)));
            }
        }
        if let Some(joint) = joints.iter().position(|joint| !joint.is_finite()) {
            return Err(format!("joint {joint} of {name} has no finite transform; correct it and re-export"));
        }
        Ok(Some(Self { name, joints, origin }))
    }
}

impl Pose<'_> {
    /// Whether [`Pose::apply`] may change the mesh.
    pub fn deforms(&self) -> bool {
        self.skin.is_some() || self.weights.iter().any(|&weight| weight != 0.0)
    }

    /// Number of morph targets that [`Pose::apply`] reads for each vertex.
    pub fn targets(&self, primitive: &Primitive) -> u64 {
        primitive.targets.iter().flatten().zip(self.weights).filter(|(_, weight)| **weight != 0.0).count() as u64
    }

    /// Moves the positions and normals of `mesh`; `primitive` has its attributes. Returns for each vertex whether the skin
    /// mirrors its surroundings: then the winding of its triangles must be reversed. The list is empty if no vertex is mirrored.
    pub fn apply(&self, doc: &Document, primitive: &Primitive, mesh: &mut Mesh) -> Checked<Vec<bool>> {
        self.morph(doc, primitive, mesh)?;
        self.skin.map_or(Ok(Vec::new()), |skin| skin.apply(doc, primitive, mesh))
    }

    fn morph(&self, doc: &Document, primitive: &Primitive, mesh: &mut Mesh) -> Checked<()> {
        let targets = primitive.targets.iter().flatten().zip(self.weights);
        for (number, (target, &weight)) in targets.enumerate().filter(|(_, (_, weight))| **weight != 0.0) {
            let what = |name: &str| format!("{name} of morph target {number} of {}", mesh.name);
            if let Some(accessor) = target.positions {
                let offsets = doc.vectors::<3>(accessor.value(), &what("POSITION"), QUANTIZED)?;
                add(&mut mesh.positions, &offsets, weight, &what("POSITION"))?;
            }
            if let Some(accessor) = target.normals.filter(|_| !mesh.normals.is_empty()) {
                let offsets = doc.vectors::<3>(accessor.value(), &what("NORMAL"), DIRECTION)?;
                add(&mut mesh.normals, &offsets, weight, &what("NORMAL"))?;
            }
        }
        Ok(())
    }
}

/// Adds `weight * offsets` to `vectors`.
fn add(vectors: &mut [[f32; 3]], offsets: &[[f32; 3]], weight: f32, what: &str) -> Checked<()> {
    if offsets.len() != vectors.len() {
        return Err(format!(
            "{what} has {} elements for {} vertices; re-export the file",
            offsets.len(),
            vectors.len()
        ));
    }
    for (vector, offset) in vectors.iter_mut().zip(offsets) {
        *vector = (Vec3::from(*vector) + weight * Vec3::from(*offset)).to_array();
    }
    Ok(())
}

impl Skin {
    fn apply(&self, doc: &Document, primitive: &Primitive, mesh: &mut Mesh) -> Checked<Vec<bool>> {
        let blended = self.blend(doc, primitive, mesh)?;
        for (position, matrix) in mesh.positions.iter_mut().zip(&blended) {
            let world = matrix.transform_point3(Vec3::from(*position).as_dvec3());
            *position = (world - self.origin).as_vec3().to_array();
        }
        for (normal, matrix) in mesh.normals.iter_mut().zip(&blended) {
            *normal = (normal_matrix(&matrix.matrix3) * Vec3::from(*normal).as_dvec3()).as_vec3().to_array();
        }
        let is_mirrored: Vec<bool> = blended.iter().map(|matrix| matrix.matrix3.determinant() < 0.0).collect();
        Ok(if is_mirrored.contains(&true) { is_mirrored } else { Vec::new() })
    }

    /// The transform of each vertex: the weighted average of the transforms of its joints.
    fn blend(&self, doc: &Document, primitive: &Primitive, mesh: &Mesh) -> Checked<Vec<DAffine3>> {
        let count = mesh.positions.len();
        let mut sums = vec![Sum { matrix: DMat3::ZERO, translation: DVec3::ZERO, weight: 0.0 }; count];
        let mut sets = 0;
        while sets < MAX_SETS {
            let joints = attribute(primitive, Semantic::Joints(sets));
            let weights = attribute(primitive, Semantic::Weights(sets));
            let (Some(joints), Some(weights)) = (joints, weights) else { break };
            let what = |name: &str| format!("{name}_{sets} of {}", mesh.name);
            let joints = doc.vectors::<4>(joints, &what("JOINTS"), JOINT)?;
            let weights = doc.vectors::<4>(weights, &what("WEIGHTS"), FRACTION)?;
            check_finite(&weights, &what("WEIGHTS"))?;
            if joints.len() != count || weights.len() != count {
                return Err(format!(
                    "{} and {} must have {count} elements; re-export the file",
                    what("JOINTS"),
                    what("WEIGHTS")
                ));
            }
            for ((sum, joints), weights) in sums.iter_mut().zip(joints).zip(weights) {
                for (joint, weight) in joints.into_iter().zip(weights).filter(|(_, weight)| *weight > 0.0) {
                    let joint = self.joints.get(joint as usize).ok_or_else(|| {
                        format!(
                            "{} refers to joint {joint}, but {} has {}; re-export the file",
                            what("JOINTS"),
                            self.name,
                            self.joints.len()
                        )
                    })?;
                    sum.add(joint, weight.into());
                }
            }
            sets += 1;
        }
        // Vertices without weights follow the first joint, as in other viewers.
        let first = self.joints.first().copied().unwrap_or_default();
        Ok(sums.into_iter().map(|sum| sum.mean().unwrap_or(first)).collect())
    }
}

/// A weighted sum of transforms.
#[derive(Clone)]
struct Sum {
    matrix: DMat3,
    translation: DVec3,
    weight: f64,
}

impl Sum {
    fn add(&mut self, transform: &DAffine3, weight: f64) {
        self.matrix += transform.matrix3 * weight;
        self.translation += transform.translation * weight;
        self.weight += weight;
    }

    /// The sum divided by its weight; `None` if the weight is 0.
    fn mean(&self) -> Option<DAffine3> {
        let scale = (self.weight > 0.0).then(|| self.weight.recip())?;
        Some(DAffine3::from_mat3_translation(self.matrix * scale, self.translation * scale))
    }
}

/// The inverse transpose of `matrix`, up to a positive factor. It exists even if the matrix is singular.
fn normal_matrix(matrix: &DMat3) -> DMat3 {
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * matrix.determinant().signum()
}

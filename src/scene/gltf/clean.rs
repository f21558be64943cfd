//! Small repairs of the arrays of a mesh.

use glam::{DAffine2, DVec2, DVec3, Vec3};

use crate::scene::Mesh;

/// Applies `transform` to all texture coordinates.
pub fn transform_uvs(uvs: &mut [[f32; 2]], transform: &DAffine2) {
    for uv in uvs {
        *uv = transform.transform_point2(DVec2::from(uv.map(f64::from))).as_vec2().to_array();
    }
}

/// Whether the cross product of two edges vanishes in f64. The test is exact if corners coincide.
pub fn has_zero_area(corners: [[f32; 3]; 3]) -> bool {
    let [a, b, c] = corners.map(|corner| Vec3::from(corner).as_dvec3());
    (b - a).cross(c - a) == DVec3::ZERO
}

/// Removes vertices that no triangle uses: some exporters give every primitive the vertices of all primitives.
pub fn drop_unused(mesh: &mut Mesh) {
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
pub fn normalise_tangents(tangents: &mut [[f32; 4]]) -> bool {
    !tangents.is_empty()
        && tangents.iter_mut().all(|tangent| {
            let [x, y, z, w] = tangent.map(f64::from);
            let Some(unit) = DVec3::new(x, y, z).try_normalize() else { return false };
            *tangent = unit.as_vec3().extend(1f32.copysign(w as f32)).to_array();
            true
        })
}

/// Scales all normals to unit length; false if a normal has length zero.
pub fn normalise(normals: &mut [[f32; 3]]) -> bool {
    normals.iter_mut().all(|normal| match Vec3::from(*normal).as_dvec3().try_normalize() {
        Some(unit) => {
            *normal = unit.as_vec3().to_array();
            true
        }
        None => false,
    })
}

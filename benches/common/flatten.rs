//! The cluttered room as a list of triangles, without instances.

use glam::DAffine3;
use taugate::internals::generate::{Kind, build};

/// Corners of all triangles, in coordinates with the camera at the origin, and the transform of the camera.
pub fn cluttered_room(triangles: u32) -> (Vec<[[f32; 3]; 3]>, DAffine3) {
    let scene = build(Kind::ClutteredRoom { triangles });
    let camera = scene.cameras[0].transform;
    let mut corners = vec![];
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh as usize];
        let place = |i: u32| {
            let p = mesh.positions[i as usize].map(f64::from);
            (instance.transform.transform_point3(p.into()) - camera.translation).as_vec3().to_array()
        };
        corners.extend(mesh.triangles.iter().map(|t| t.map(place)));
    }
    (corners, camera)
}

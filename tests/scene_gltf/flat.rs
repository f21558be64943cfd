//! Nodes that flatten their mesh to a plane, and meshes that share their accessors.

use glam::{DQuat, DVec3};

use super::*;

/// A pyramid without a floor. Its sides face +Z, and its normals lean outwards.
fn terrain() -> Glb {
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.3]];
    let mut glb = Glb::new();
    let positions = glb.floats(&corners);
    let normals = glb.floats(&corners.map(|[x, y, _]| Vec3::new(x, y, 1.0).normalize().to_array()));
    let indices = glb.indices(&[0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4]);
    let primitive = json!({ "attributes": { "POSITION": positions, "NORMAL": normals }, "indices": indices });
    glb.push("meshes", json!({ "name": "Hill", "primitives": [primitive] }));
    glb.push("nodes", json!({ "name": "plain", "mesh": 0 }));
    glb
}

/// Area-weighted normals and the corners of the triangles of all instances, in world space.
fn triangles(scene: &Scene) -> Vec<(DVec3, [DVec3; 3])> {
    let of = |instance: &taugate::Instance| {
        let mesh = &scene.meshes[instance.mesh as usize];
        let transform = instance.transform;
        let place = |corner: u32| transform.transform_point3(Vec3::from(mesh.positions[corner as usize]).as_dvec3());
        // A transform that mirrors turns the winding around.
        let sign = transform.matrix3.determinant().signum();
        let all = mesh.triangles.iter().map(|triangle| triangle.map(place));
        all.map(|[a, b, c]| (0.5 * sign * (b - a).cross(c - a), [a, b, c])).collect::<Vec<_>>()
    };
    scene.instances.iter().flat_map(of).collect()
}

#[test]
fn a_mesh_that_is_flattened_along_one_axis_is_a_surface() {
    let mut glb = terrain();
    glb.json["nodes"][0]["scale"] = json!([1, 1, 0]);
    glb.json["nodes"][0]["translation"] = json!([0, 0, -2]);
    let scene = read(&glb);
    check_invariants(&scene);
    assert_eq!(scene.warnings, Vec::<String>::new());
    let triangles = triangles(&scene);
    let area: DVec3 = triangles.iter().map(|(normal, _)| *normal).sum();
    assert!(area.abs_diff_eq(DVec3::new(0.0, 0.0, 4.0), 1e-9) && triangles.len() == 4, "{area}");
    assert!(triangles.iter().flat_map(|(_, corners)| corners).all(|corner| corner.z == -2.0));
    // Normals of the hill would shade the plane as a hill.
    assert!(scene.meshes[scene.instances[0].mesh as usize].normals.is_empty());

    // The mesh of another node stays as it is.
    glb.push("nodes", json!({ "mesh": 0, "scale": [2, 2, 2] }));
    let scene = read(&glb);
    assert!(scene.meshes[scene.instances[1].mesh as usize].normals.len() == 5);
}

#[test]
fn a_plane_may_have_any_direction() {
    // The parent flattens its Z axis, and the child turns the direction (1, 2, 2) / 3 of the mesh there.
    let rotation = DQuat::from_rotation_arc(DVec3::new(1.0, 2.0, 2.0) / 3.0, DVec3::Z);
    let mut glb = terrain();
    glb.json["nodes"][0]["rotation"] = json!(rotation.to_array());
    let flat = json!({ "scale": [1, 1, 0], "children": [0] });
    glb.json["nodes"].as_array_mut().unwrap().push(flat);
    glb.push("scenes", json!({ "nodes": [1] }));
    let scene = read(&glb);
    check_invariants(&scene);
    let triangles = triangles(&scene);
    assert!(!triangles.is_empty() && scene.warnings.is_empty());
    let hill =
        [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.3]].map(DVec3::from);
    for (normal, corners) in triangles {
        // Each corner is the projection of a vertex of the hill.
        for corner in corners {
            let near = |p: &DVec3| ((rotation * *p) * DVec3::new(1.0, 1.0, 0.0)).distance(corner) < 1e-6;
            assert!(hill.iter().any(near), "{corner}");
        }
        assert!(normal.x.hypot(normal.y) < 1e-6 * normal.length(), "{normal}");
    }
}

#[test]
fn what_is_flattened_to_a_line_or_seen_edge_on_is_left_out() {
    let mut glb = terrain();
    for scale in [json!([1, 0, 0]), json!([0, 0, 0])] {
        glb.json["nodes"][0]["scale"] = scale;
        let scene = read(&glb);
        assert!(scene.instances.is_empty() && scene.warnings[0].contains("`plain` is scaled to nothing"));
    }
    // The slopes remain of a hill that is seen from the side: two of its triangles project to areas, two to lines or areas.
    glb.json["nodes"][0]["scale"] = json!([0, 1, 1]);
    let scene = read(&glb);
    check_invariants(&scene);
    let areas: Vec<DVec3> = triangles(&scene).into_iter().map(|(normal, _)| normal).collect();
    assert_eq!(areas.len(), 2, "{areas:?}");
    assert!(areas.iter().all(|area| area.abs_diff_eq(DVec3::X * 0.3 * area.x.signum(), 1e-6)), "{areas:?}");
}

#[test]
fn a_flattened_mesh_with_a_normal_map_has_tangents() {
    let mut glb = complete();
    glb.json["materials"][0]["normalTexture"] = json!({ "index": 0 });
    glb.bin[8..12].copy_from_slice(&0.5f32.to_le_bytes());
    glb.json["nodes"][1]["scale"] = json!([1, 1, 0]);
    let scene = read(&glb);
    check_invariants(&scene);
    let mesh = &scene.meshes[scene.instances[0].mesh as usize];
    assert!(mesh.normals.is_empty() && !mesh.tangents.is_empty() && mesh.tangents.iter().all(|t| t[2] == 0.0));
}

/// Many meshes that name the same accessors once took memory for each of them.
#[cfg(target_os = "linux")]
#[test]
fn meshes_that_share_their_accessors_share_their_geometry() {
    let side = 100u32;
    let mut glb = Glb::new();
    let grid: Vec<[f32; 3]> = (0..=side).flat_map(|y| (0..=side).map(move |x| [x as f32, y as f32, 0.0])).collect();
    let corner = |x: u32, y: u32| (y * (side + 1) + x) as u16;
    let cells = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
    let indices: Vec<u16> = cells
        .flat_map(|(x, y)| {
            let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
            [a, b, c, a, c, d]
        })
        .collect();
    let (positions, indices) = (glb.floats(&grid), glb.indices(&indices));
    for mesh in 0..300 {
        let primitive = json!({ "attributes": { "POSITION": positions }, "indices": indices });
        glb.push("meshes", json!({ "name": format!("Cell{mesh}"), "primitives": [primitive] }));
        glb.push("nodes", json!({ "mesh": mesh, "translation": [0, 0, mesh] }));
    }
    let scene = read(&glb);
    assert_eq!((scene.meshes.len(), scene.instances.len()), (1, 300));
    assert!(scene.instances.iter().zip(0..).all(|(instance, z)| instance.transform.translation.z == f64::from(z)));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, glb.build()).unwrap();
    // Without sharing, it is 110 MiB.
    let (peak, outcome) = crate::peak::peak("textures::helper_peak", &path);
    assert!(outcome == "0 images" && peak < 64, "{peak} MiB: {outcome}");

    // Another material or another winding is another mesh.
    let material = glb.push("materials", json!({}));
    glb.json["meshes"][7]["primitives"][0]["material"] = json!(material);
    glb.json["meshes"][8]["primitives"][0]["mode"] = json!(5);
    assert_eq!(read(&glb).meshes.len(), 3);
}

//! Cameras: their projection, their film and their names.

use glam::{DAffine3, DVec3};
use taugate::internals::generate::glb::write;
use taugate::internals::scene::Projection;

use super::*;

/// The magnifications are half the size of the view in metres; the scale of the node, which is 2, does not count.
#[test]
fn an_orthographic_camera_is_read() {
    let mut glb = complete();
    glb.json["cameras"][0] = json!({
        "type": "orthographic", "orthographic": { "xmag": 3.0, "ymag": 1.5, "zfar": 1.0, "znear": 0.0 },
        "extras": { "principal_point": [0.25, 1.5] },
    });
    let scene = read(&glb);
    let camera = &scene.cameras[0];
    let projection = Projection::Orthographic { height: 3.0 };
    assert_eq!((camera.name.as_str(), &camera.projection, camera.aspect), ("eye", &projection, Some(2.0)));
    assert_eq!((camera.resolution, camera.principal_point), (None, [0.25, 1.5]));
    assert!(camera.transform.abs_diff_eq(DAffine3::from_translation(DVec3::Z * 10.0), 1e-12));
    assert_eq!(scene.warnings, Vec::<String>::new());
    // The generator writes what the loader reads.
    let again = load_slice(&write(&scene), Path::new("again.glb")).unwrap();
    assert_eq!((&again.cameras[0].projection, again.cameras[0].aspect), (&projection, Some(2.0)));
}

#[test]
fn a_principal_point_in_the_extras_is_read() {
    let of = |extras: serde_json::Value| {
        let mut glb = complete();
        glb.json["cameras"][0]["extras"] = extras;
        read(&glb).cameras[0].principal_point
    };
    assert_eq!(of(json!({ "principal_point": [0.25, 1.5], "width": 4 })), [0.25, 1.5]);
    for other in [json!({ "principal_point": "centre" }), json!({ "principal_point": [1] }), json!([1])] {
        assert_eq!(of(other), [0.5, 0.5]);
    }
}

#[test]
fn cameras_with_one_name_are_numbered() {
    let mut glb = complete();
    let nodes = glb.json["nodes"].as_array_mut().unwrap();
    let first = nodes.len();
    nodes.extend(["eye", "eye", "eye#2", "eye"].map(|name| json!({ "name": name, "camera": 0 })));
    let added = (first..first + 4).collect::<Vec<usize>>();
    glb.json["scenes"][0]["nodes"].as_array_mut().unwrap().extend(added.into_iter().map(|node| json!(node)));
    let scene = read(&glb);
    let names: Vec<&str> = scene.cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["eye", "eye#2", "eye#3", "eye#2#2", "eye#4"]);
}

//! Cameras: their projection, their film and their names.

use glam::{DAffine3, DVec3};
use taugate::internals::generate::glb::write;
use taugate::internals::scene::Projection;

use super::*;
use crate::hostile::{Case, orthographic};

/// Name of a case, a change to the only camera of the complete scene, and the words that the reason must contain.
#[rustfmt::skip]
const UNUSABLE: &[Case] = &[
    ("absent camera", |g| g.json["nodes"][2]["camera"] = json!(4), &["`eye`", "camera 4"]),
    ("yfov zero", |g| g.json["cameras"][0]["perspective"]["yfov"] = json!(0.0), &["`eye`", "yfov"]),
    ("yfov above pi", |g| g.json["cameras"][0]["perspective"]["yfov"] = json!(3.2), &["`eye`", "yfov"]),
    ("aspect negative", |g| g.json["cameras"][0]["perspective"]["aspectRatio"] = json!(-1.0), &["`eye`", "aspectRatio"]),
    ("xmag zero", |g| orthographic(g, json!({ "xmag": 0, "ymag": 1, "znear": 0, "zfar": 1 })), &["`eye`", "the xmag", "is 0, but must be above 0"]),
    ("ymag negative", |g| orthographic(g, json!({ "xmag": 1, "ymag": -2, "znear": 0, "zfar": 1 })), &["`eye`", "the ymag", "is -2,"]),
    ("ymag infinite", |g| orthographic(g, json!({ "xmag": 1, "ymag": 1e39, "znear": 0, "zfar": 1 })), &["`eye`", "the ymag"]),
    ("ymag beyond all scenes", |g| orthographic(g, json!({ "xmag": 1, "ymag": 1e30, "znear": 0, "zfar": 1 })), &["'eye'", "m high"]),
    ("camera of no kind", |g| { g.json["cameras"][0].as_object_mut().unwrap().remove("perspective"); }, &["`eye`", "neither perspective nor orthographic"]),
    ("flat camera", |g| g.json["nodes"][2]["scale"] = json!([1, 0, 1]), &["`eye`", "scale"]),
    ("principal point in pixels", |g| g.json["cameras"][0]["extras"]["principal_point"] = json!([320, 240]), &["'eye'", "fractions"]),
];

/// A render with another camera does not need them.
#[test]
fn cameras_that_cannot_be_used_are_left_out_with_a_reason() {
    for (name, change, words) in UNUSABLE {
        let mut glb = complete();
        change(&mut glb);
        let scene = read(&glb);
        let [unusable] = &scene.unusable_cameras[..] else { panic!("{name}: {:?}", scene.unusable_cameras) };
        assert!(scene.cameras.is_empty() && unusable.name == "eye", "{name}");
        for word in *words {
            assert!(unusable.why.contains(word), "{name}: `{word}` is not in: {}", unusable.why);
        }
        assert!(unusable.why.contains("; "), "{name}: no remedy in: {}", unusable.why);
        assert_eq!(scene.warnings, [format!("a camera is left out: {}", unusable.why)], "{name}");
    }
}

/// The numbers of cameras with one name do not depend on which of them can be used.
#[test]
fn a_camera_that_is_left_out_keeps_its_name() {
    let mut glb = complete();
    glb.json["nodes"][2]["scale"] = json!([0, 0, 0]);
    glb.push("nodes", json!({ "name": "eye", "camera": 0 }));
    glb.json["scenes"][0]["nodes"] = json!([0, 5]);
    let scene = read(&glb);
    assert_eq!((scene.cameras[0].name.as_str(), scene.unusable_cameras[0].name.as_str()), ("eye#2", "eye"));
}

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
        let scene = read(&glb);
        (scene.cameras[0].principal_point, scene.warnings.len())
    };
    assert_eq!(of(json!({ "principal_point": [0.25, 1.5], "width": 4.0, "height": 2 })), ([0.25, 1.5], 0));
    for (other, warnings) in [
        (json!({ "principal_point": "centre" }), 1),
        (json!({ "principal_point": [1] }), 1),
        (json!([1]), 0),
        (json!([[0.25, 1.5]]), 0),
    ] {
        assert_eq!(of(other), ([0.5, 0.5], warnings));
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

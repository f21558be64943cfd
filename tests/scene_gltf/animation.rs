//! Animations: the pose of nodes at a time.

use glam::{DQuat, DVec3};
use taugate::internals::scene::gltf::{Playback, end_of_animations, load_slice_at};

use super::*;

fn playback(at: f64) -> Playback<'static> {
    Playback { at: Some(at), animation: None }
}

fn posed(glb: &Glb, playback: Playback) -> Result<Scene, String> {
    load_slice_at(&glb.build(), Path::new("test.glb"), playback).map_err(|e| e.to_string())
}

/// A triangle, and an animation of its node: the path of the channel, the interpolation, the times and the values.
fn animated<const N: usize>(path: &str, interpolation: &str, times: &[f32], values: &[[f32; N]]) -> Glb {
    let mut glb = single(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], json!({}));
    add(&mut glb, path, interpolation, times, values);
    glb
}

fn add<const N: usize>(glb: &mut Glb, path: &str, interpolation: &str, times: &[f32], values: &[[f32; N]]) {
    let times: Vec<[f32; 1]> = times.iter().map(|&time| [time]).collect();
    let (input, output) = (glb.floats(&times), glb.floats(values));
    glb.push(
        "animations",
        json!({
            "name": format!("{path}-{interpolation}"),
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": path } }],
            "samplers": [{ "input": input, "output": output, "interpolation": interpolation }],
        }),
    );
}

fn translation(glb: &Glb, at: f64) -> DVec3 {
    posed(glb, playback(at)).unwrap().instances[0].transform.translation
}

#[test]
fn translations_follow_their_keys() {
    let keys = [[0.0, 0.0, 0.0], [4.0, 0.0, 2.0], [4.0, 8.0, 2.0]];
    let linear = animated("translation", "LINEAR", &[1.0, 2.0, 4.0], &keys);
    for (at, expected) in
        [(0.0, [0.0, 0.0, 0.0]), (1.25, [1.0, 0.0, 0.5]), (3.0, [4.0, 4.0, 2.0]), (4.0, [4.0, 8.0, 2.0])]
    {
        assert!(translation(&linear, at).abs_diff_eq(DVec3::from(expected), 1e-6), "{at}");
    }
    let step = animated("translation", "STEP", &[1.0, 2.0, 4.0], &keys);
    assert_eq!((translation(&step, 1.99).x, translation(&step, 2.0).x), (0.0, 4.0));
    // With in-tangent, value and out-tangent per key, the cubic t^3 - 2 t^2 + 3 on [0, 2] is reproduced exactly.
    let cubic = |t: f32| t * t * t - 2.0 * t * t + 3.0;
    let slope = |t: f32| 3.0 * t * t - 4.0 * t;
    let spline: Vec<[f32; 3]> = [0.0, 2.0]
        .into_iter()
        .flat_map(|t| [[slope(t), 0.0, 0.0], [cubic(t), 1.0, 0.0], [slope(t), 0.0, 0.0]])
        .collect();
    let spline = animated("translation", "CUBICSPLINE", &[0.0, 2.0], &spline);
    for at in [0.0f32, 0.3, 1.0, 1.7] {
        let found = translation(&spline, at.into());
        assert!((found.x - f64::from(cubic(at))).abs() < 1e-5 && (found.y - 1.0).abs() < 1e-6, "{at}: {found}");
    }
    assert_eq!(posed(&linear, Playback::default()).unwrap().instances[0].transform.translation, DVec3::ZERO);
}

/// Keys are f32: the last key of these clips is slightly before its time in f64.
#[test]
fn the_last_frame_is_inside_the_animation() {
    for (end, at) in [(0.7f32, 0.7), ((100.0f64 / 30.0) as f32, 100.0 / 30.0)] {
        assert!(f64::from(end) < at, "{at}");
        let glb = animated("translation", "LINEAR", &[0.0, end], &[[0.0; 3], [2.0, 0.0, 0.0]]);
        assert_eq!(translation(&glb, at).x, 2.0, "{at}");
        assert_eq!(translation(&glb, -1e-7 * at).x, 0.0, "{at}");
        assert!(posed(&glb, playback(at * 1.00001)).is_err(), "{at}");
    }
}

/// Keys are f32, and about half of them are slightly after the time of their frame in f64.
#[test]
fn keys_at_frames_count_at_these_frames() {
    for fps in [24.0, 25.0, 30.0, 60.0] {
        let frames = 0..=50;
        let times: Vec<f32> = frames.clone().map(|k| (f64::from(k) / fps) as f32).collect();
        let late = frames.clone().zip(&times).filter(|(k, time)| f64::from(**time) > f64::from(*k) / fps);
        assert!(late.count() > 10, "{fps}");
        // Neighbouring keys differ by 1, also those of a spline, whose tangents are 0.
        let keys: Vec<[f32; 3]> = frames.clone().map(|k| [k as f32, 0.0, 0.0]).collect();
        let spline: Vec<[f32; 3]> = keys.iter().flat_map(|&key| [[0.0; 3], key, [0.0; 3]]).collect();
        let clips = [
            (animated("translation", "STEP", &times, &keys), 0.0),
            (animated("translation", "LINEAR", &times, &keys), 1e-4),
            (animated("translation", "CUBICSPLINE", &times, &spline), 1e-4),
        ];
        for (clip, bound) in &clips {
            for k in frames.clone() {
                let x = translation(clip, f64::from(k) / fps).x;
                assert!((x - f64::from(k)).abs() <= *bound, "frame {k} at {fps} frames per second: {x}");
            }
        }
    }
}

#[test]
fn rotations_take_the_shorter_way_and_scales_are_linear() {
    // A quarter turn, whose second key has the opposite sign: the same rotation.
    let quarter = std::f32::consts::FRAC_PI_4;
    let keys = [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -quarter.sin(), -quarter.cos()]];
    let turned = posed(&animated("rotation", "LINEAR", &[0.0, 1.0], &keys), playback(1.0 / 3.0)).unwrap();
    let x = turned.instances[0].transform.transform_vector3(DVec3::X);
    assert!(x.abs_diff_eq(DQuat::from_rotation_z(std::f64::consts::FRAC_PI_6) * DVec3::X, 1e-6), "{x}");

    let mut both = animated("scale", "LINEAR", &[0.0, 1.0], &[[1.0, 1.0, 1.0], [3.0, 1.0, 1.0]]);
    add(&mut both, "translation", "LINEAR", &[0.0, 2.0], &[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
    let transform = posed(&both, playback(0.5)).unwrap().instances[0].transform;
    assert!(transform.transform_point3(DVec3::X).abs_diff_eq(DVec3::new(2.5, 0.0, 0.0), 1e-6));
    let alone = Playback { animation: Some("scale-LINEAR"), ..playback(0.5) };
    assert_eq!(posed(&both, alone).unwrap().instances[0].transform.translation, DVec3::ZERO);
}

#[test]
fn cameras_lights_and_morph_targets_move_too() {
    let mut glb = animated("translation", "LINEAR", &[0.0, 1.0], &[[0.0, 0.0, 0.0], [0.0, 0.0, 8.0]]);
    glb.push("cameras", json!({ "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } }));
    glb.push("nodes", json!({ "name": "eye", "camera": 0, "translation": [0.0, 1.0, 0.0] }));
    glb.json["nodes"][0]["children"] = json!([1]);
    let eye = posed(&glb, playback(0.25)).unwrap().cameras[0].transform.translation;
    assert!(eye.abs_diff_eq(DVec3::new(0.0, 1.0, 2.0), 1e-6), "{eye}");

    let mut morph = animated("weights", "LINEAR", &[0.0, 1.0], &[[0.0], [1.0]]);
    let moves = morph.floats(&[[0.0, 0.0, 4.0], [0.0, 0.0, 4.0], [0.0, 0.0, 4.0]]);
    morph.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": moves }]);
    assert_eq!(posed(&morph, playback(0.5)).unwrap().meshes[0].positions[0], [0.0, 0.0, 2.0]);
}

/// glTF allows normalized integers for rotations and for weights of morph targets; gltfpack writes such weights.
#[test]
fn rotations_and_weights_may_be_normalized_integers() {
    let values = |bytes: &[u8], component, shape| {
        let mut glb = animated("weights", "LINEAR", &[0.0, 1.0], &[[0.0], [1.0]]);
        let output = glb.accessor(bytes, component, shape, 2);
        glb.json["accessors"][output]["normalized"] = json!(true);
        glb.json["animations"][0]["samplers"][0]["output"] = json!(output);
        glb
    };
    for (bytes, component, expected) in [
        (&[51, 255][..], 5121, 0.6f32),
        (&[127, 0x81], 5120, 0.0),
        (&[0, 0, 0xff, 0xff], 5123, 0.5),
        (&[0xff, 0x7f, 0xff, 0x7f], 5122, 1.0),
    ] {
        let mut glb = values(bytes, component, "SCALAR");
        let moves = glb.floats(&[[0.0, 0.0, 1.0]; 3]);
        glb.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": moves }]);
        let z = posed(&glb, playback(0.5)).unwrap().meshes[0].positions[0][2];
        assert!((z - expected).abs() < 1e-6, "{component}: {z}");
        glb.json["accessors"]
            .as_array_mut()
            .unwrap()
            .iter_mut()
            .for_each(|accessor| accessor["normalized"] = json!(false));
        let error = posed(&glb, playback(0.5)).unwrap_err();
        assert!(error.contains("integers that are not normalized"), "{error}");
    }
    // A half turn around y, as unsigned bytes.
    let mut glb = values(&[0, 255, 0, 0, 0, 255, 0, 0], 5121, "VEC4");
    glb.json["animations"][0]["channels"][0]["target"]["path"] = json!("rotation");
    let x = posed(&glb, playback(0.5)).unwrap().instances[0].transform.transform_vector3(DVec3::X);
    assert!(x.abs_diff_eq(DVec3::NEG_X, 1e-6), "{x}");
}

#[test]
fn animations_of_one_name_are_numbered() {
    let mut glb = animated("translation", "LINEAR", &[0.0, 1.0], &[[0.0; 3], [1.0, 0.0, 0.0]]);
    add(&mut glb, "translation", "LINEAR", &[0.0, 1.0], &[[0.0; 3], [5.0, 0.0, 0.0]]);
    for (name, x) in [("translation-LINEAR", 1.0), ("translation-LINEAR#2", 5.0)] {
        let alone = Playback { animation: Some(name), ..playback(1.0) };
        assert_eq!(posed(&glb, alone).unwrap().instances[0].transform.translation.x, x, "{name}");
    }
    let error = posed(&glb, playback(1.0)).unwrap_err();
    assert!(error.contains("`translation-LINEAR` and `translation-LINEAR#2` both move"), "{error}");
}

/// A file that animates only properties of materials and cameras has no end: its nodes keep their pose.
#[test]
fn animations_end_with_the_last_key_of_a_node() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("test.glb");
    let end = |glb: &Glb, name: Option<&str>| {
        std::fs::write(&path, glb.build()).unwrap();
        end_of_animations(&path, &[], name).map_err(|e| e.to_string())
    };
    let keys = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
    let mut glb = animated("translation", "LINEAR", &[0.0, 1.0], &keys);
    add(&mut glb, "scale", "LINEAR", &[0.0, 2.5], &keys);
    assert_eq!((end(&glb, None), end(&glb, Some("translation-LINEAR"))), (Ok(Some(2.5)), Ok(Some(1.0))));
    assert!(end(&glb, Some("walk")).unwrap_err().contains("choose one of"));
    assert_eq!(end(&glb, Some("none")), Ok(None));
    for animation in 0..2 {
        let target =
            json!({ "path": "pointer", "extensions": { "KHR_animation_pointer": { "pointer": "/materials/0" } } });
        glb.json["animations"][animation]["channels"][0]["target"] = target;
    }
    assert_eq!(end(&glb, None), Ok(None));
    assert!(end(&glb, Some("scale-LINEAR")).unwrap_err().contains("moves no node; leave out --animation"));
    let alone = Playback { animation: Some("scale-LINEAR"), ..playback(0.5) };
    assert!(posed(&glb, alone).unwrap_err().contains("moves no node; leave out --animation"));
    glb.json["animations"] = json!([]);
    assert_eq!(end(&glb, None), Ok(None));
}

/// All channels share the keys of one accessor, so a small file has many keys.
#[test]
fn the_keys_of_a_file_are_limited() {
    const KEYS: usize = 1 << 16;
    const NODES: usize = 300;
    let times: Vec<f32> = (0..KEYS).map(|k| k as f32).collect();
    let mut glb = animated("scale", "STEP", &times, &[[1.0f32; 3]; KEYS]);
    let target = |node: usize| json!({ "sampler": 0, "target": { "node": node, "path": "scale" } });
    glb.json["animations"][0]["channels"] = (0..NODES).map(target).collect();
    for _ in 1..NODES {
        glb.push("nodes", json!({}));
    }
    let error = posed(&glb, playback(0.5)).unwrap_err();
    assert!(error.contains("the animations have more than 67108864 numbers at the times of"), "{error}");
    glb.json["animations"][0]["channels"].as_array_mut().unwrap().truncate(200);
    assert!(posed(&glb, playback(0.5)).is_ok());
}

#[test]
fn invalid_animations_are_refused_only_if_they_are_played() {
    let keys = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
    let good = || animated("translation", "LINEAR", &[0.0, 1.0], &keys);
    let changed = |change: fn(&mut Value)| {
        let mut glb = good();
        change(&mut glb.json);
        glb
    };
    let cases = [
        (animated("translation", "LINEAR", &[0.0, f32::NAN], &keys), "negative or not finite"),
        (animated("translation", "LINEAR", &[1.0, 0.0], &keys), "not in ascending order"),
        (animated("translation", "LINEAR", &[0.5, 0.5], &keys), "not in ascending order"),
        (
            animated("translation", "LINEAR", &[0.0, 1.0], &[[0.0, 0.0, f32::INFINITY], [0.0; 3]]),
            "value that is not finite",
        ),
        (animated("translation", "LINEAR", &[0.0, 1.0], &[[0.0; 3]; 3]), "has 3 values for 2 times"),
        (animated("translation", "CUBICSPLINE", &[0.0, 1.0], &keys), "has 2 values for 2 times"),
        (animated("weights", "LINEAR", &[0.0, 1.0], &[[0.0]]), "values for 2 times"),
        (animated("translation", "BEZIER", &[0.0, 1.0], &keys), "is not valid"),
        (
            changed(|json| json["animations"][0]["channels"][0]["target"]["node"] = json!(7)),
            "moves node 7, which does not exist",
        ),
        (changed(|json| json["animations"][0]["channels"][0]["sampler"] = json!(3)), "has no sampler 3"),
        (changed(|json| json["animations"][0]["samplers"][0]["input"] = json!(99)), "accessor 99"),
        (changed(|json| json["animations"][0]["channels"][0]["target"]["path"] = json!("pointer")), "move no node"),
        (changed(|json| json["animations"][0] = json!(5)), "is not valid"),
        (
            changed(|json| json["nodes"][0]["matrix"] = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])),
            "has a matrix",
        ),
        (changed(|json| json["animations"] = json!([])), "has no animations"),
    ];
    for (glb, part) in cases {
        let error = posed(&glb, playback(0.5)).unwrap_err();
        assert!(error.contains(part), "{part}: {error}");
        assert!(load_slice(&glb.build(), Path::new("test.glb")).is_ok(), "{part}: refused without a time");
    }
    let repeated = changed(|json| {
        let channels = json["animations"][0]["channels"].as_array_mut().unwrap();
        channels.push(channels[0].clone());
    });
    let error = posed(&repeated, playback(0.5)).unwrap_err();
    assert!(error.contains("animation `translation-LINEAR` moves node `node 0` twice; re-export"), "{error}");
    let error = posed(&good(), playback(1.5)).unwrap_err();
    assert!(error.contains("from 0 s to 1 s, so it has no pose at 1.5 s"), "{error}");
    let mut twice = good();
    add(&mut twice, "translation", "STEP", &[0.0, 1.0], &keys);
    let error = posed(&twice, playback(0.5)).unwrap_err();
    assert!(error.contains("choose one with --animation"), "{error}");
    // The nodes may also keep their transforms in the file.
    let none = Playback { animation: Some("none"), at: None };
    let held = posed(&twice, none).unwrap();
    assert_eq!((held.moving, held.warnings), (None, vec![]));
    let error = posed(&twice, Playback { at: Some(0.5), ..none }).unwrap_err();
    assert!(error.contains("leave out --animation none"), "{error}");
    let other = Playback { animation: Some("walk"), ..playback(0.5) };
    let error = posed(&twice, other).unwrap_err();
    assert!(error.contains("choose one of 'translation-LINEAR', 'translation-STEP'"), "{error}");
}

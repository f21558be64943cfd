use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;
use taugate::internals::generate::{Kind, build, glb};
use taugate::internals::settings::table;

use super::super::message::Request;
use super::*;

fn viewed() -> (tempfile::TempDir, ViewedScene) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.glb");
    std::fs::write(&path, glb::write(&build(Kind::CornellBox))).unwrap();
    let mut start = Experiment { scene: Some(path), ..Experiment::default() };
    named::set(&mut start, "gate", Some("6m..7m")).unwrap();
    (folder, ViewedScene::new(start).unwrap())
}

fn changes(json: &str) -> BTreeMap<String, Change> {
    serde_json::from_str(json).unwrap()
}

#[test]
fn changes_say_what_they_invalidate() {
    let (_folder, mut viewed) = viewed();
    for (json, expected) in [
        (r#"{"gate": "6.2m..6.5m"}"#, Effect::Restart),
        (r#"{"seed": "7"}"#, Effect::Restart),
        (r#"{"look-from": "0,1,3.5"}"#, Effect::Camera),
        (r#"{"estimator": "bdpt"}"#, Effect::Settings),
        (r#"{"resolution": "64x64"}"#, Effect::Settings),
        (r#"{"gates": "6m..7m/4"}"#, Effect::Settings),
        (r#"{"headlamp": "3"}"#, Effect::All),
        (r#"{"look-from": "0,1,3.4"}"#, Effect::CameraAndLights),
        (r#"{"headlamp-offset": "0.1,0,0"}"#, Effect::CameraAndLights),
        (r#"{"headlamp": "4", "estimator": "lcs"}"#, Effect::All),
        (r#"{"visibility": "60m"}"#, Effect::All),
        (r#"{"ortho": "2"}"#, Effect::Camera),
        (r#"{"resolution": "32x64"}"#, Effect::All),
        (r#"{"resolution": "32x64"}"#, Effect::Nothing),
    ] {
        assert_eq!(viewed.change(&changes(json)).unwrap(), expected, "{json}");
    }
}

#[test]
fn values_return_to_those_of_the_start() {
    let (_folder, mut viewed) = viewed();
    let start = viewed.view().settings.clone();
    viewed.change(&changes(r#"{"depth": "1m..2m", "fov": "50"}"#)).unwrap();
    assert!(viewed.view().experiment.gate.gate.is_none());
    viewed.change(&changes(r#"{"gate": false}"#)).unwrap();
    assert!(viewed.view().settings.responses().are_steady());
    viewed.change(&changes(r#"{"gate": null, "fov": null}"#)).unwrap();
    assert!(viewed.view().settings == start);
}

#[test]
fn another_camera_stands_where_the_file_says() {
    let (_folder, viewed) = viewed();
    let of_file = viewed.scene().cameras[0].clone();
    let mut start = viewed.start().clone();
    named::set(&mut start, "ortho", Some("2")).unwrap();
    let mut viewed = ViewedScene::new(start).unwrap();
    // The page sends these removals too, in case an earlier move of the camera still waits to be sent.
    viewed.change(&changes(r#"{"camera": "camera", "look-from": false, "up": false, "fov": false}"#)).unwrap();
    assert_eq!(viewed.scene().cameras[viewed.view().settings.camera()], of_file);
}

#[test]
fn effects_add_up() {
    use Effect::*;
    for (effects, sum) in [
        (&[Nothing, Restart, Settings, Restart][..], Settings),
        (&[Camera, Restart, Camera], Camera),
        (&[Camera, CameraAndLights, Nothing], CameraAndLights),
        (&[Camera, Settings], All),
        (&[Restart, All, Restart], All),
        (&[Nothing, Nothing], Nothing),
    ] {
        assert_eq!(effects.iter().copied().reduce(Effect::and), Some(sum), "{effects:?}");
    }
}

#[test]
fn another_gate_replaces_responses_with_gates_of_their_own() {
    let (_folder, viewed) = viewed();
    for (name, text) in [("response", "gauss:6m..6.5m,5cm"), ("gates", "6m..7m/2")] {
        let mut start = viewed.start().clone();
        named::set(&mut start, "gate", None).unwrap();
        named::set(&mut start, name, Some(text)).unwrap();
        named::set(&mut start, "repeat", Some("50m")).unwrap();
        let mut viewed = ViewedScene::new(start).unwrap();
        let of_start = viewed.view().settings.clone();
        viewed.change(&changes(r#"{"gate": "6.2m..6.4m", "repeat": false}"#)).unwrap();
        let responses = viewed.view().settings.responses();
        assert!(responses.is_single_box() && responses.support().lo == 6.2, "{}", responses.describe());
        viewed.change(&changes(r#"{"gate": false}"#)).unwrap();
        assert!(viewed.view().settings.responses().are_steady());
        viewed.change(&changes(r#"{"gate": null, "repeat": null}"#)).unwrap();
        assert!(viewed.view().settings == of_start, "{name}");
    }
}

#[test]
fn a_refused_change_leaves_everything_as_it_was() {
    let (_folder, mut viewed) = viewed();
    viewed.change(&changes(r#"{"look-from": "0,1,3"}"#)).unwrap();
    let before = (viewed.view().settings.clone(), viewed.scene().cameras.clone(), viewed.changes.clone());
    for json in
        [r#"{"seed": "1", "gate": "x"}"#, r#"{"camera": "nobody"}"#, r#"{"look-at": "0,1,3"}"#, r#"{"sky": "a.exr"}"#]
    {
        viewed.change(&changes(json)).unwrap_err();
        assert!(
            before == (viewed.view().settings.clone(), viewed.scene().cameras.clone(), viewed.changes.clone()),
            "{json}"
        );
    }
}

const MESSAGES: [&str; 12] = [
    r#"{"do":"hello","token":"0123456789abcdef"}"#,
    r#"{"do":"set","changes":{"gate":"6.2m..6.5m","estimator":"lcs"}}"#,
    r#"{"do":"set","changes":{"gates":"4m..10m/30","resolution":"640x480"}}"#,
    r#"{"do":"set","changes":{"look-from":"0,1,3.9","look-at":"-0.5,1e3,0","up":"0,1,0","fov":"40"}}"#,
    r#"{"do":"set","changes":{"ortho":"2.5","headlamp":"100","headlamp-offset":"0.1,-2,0"}}"#,
    r#"{"do":"set","changes":{"visibility":"60m","albedo":"0.9","phase-g":"-0.5","no-medium":true}}"#,
    r#"{"do":"set","changes":{"sigma-s":"0.1,0.2,0.3","cw":"80,60","max-depth":null,"emitters":"light"}}"#,
    r#"{"do":"set","changes":{"camera":"auto","sampling":"uniform","seed":"4294967295","depth":false}}"#,
    r#"{"do":"show","layer":"error","response":3}"#,
    r#"{"do":"pixel","x":10,"y":20}"#,
    r#"{"do":"save","name":"out.exr"}"#,
    r#"{"do":"pause","on":true}"#,
];

/// A message with some bytes replaced, removed, repeated, or taken from another message.
fn mutated(random: &mut Pcg32) -> String {
    let mut below = |n: usize| random.next_u32() as usize % n.max(1);
    let mut bytes = MESSAGES[below(MESSAGES.len())].as_bytes().to_vec();
    for _ in 0..below(6) {
        let at = below(bytes.len());
        match below(4) {
            0 => bytes[at] = b"0123456789.,-+eEmnN/{}[]\":\\ \x00\xff"[below(30)],
            1 => drop(bytes.drain(at..(at + below(8)).min(bytes.len()))),
            2 => {
                let piece = bytes[at..(at + below(12)).min(bytes.len())].to_vec();
                bytes.splice(at..at, piece);
            }
            _ => {
                let other = MESSAGES[below(MESSAGES.len())].as_bytes();
                let from = below(other.len());
                bytes.splice(at..at, other[from..(from + below(20)).min(other.len())].iter().copied());
            }
        }
        bytes.push(b' ');
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[test]
fn malformed_messages_are_survived() {
    let (_folder, mut viewed) = viewed();
    let mut random = Pcg32::new(1, 1);
    let (mut accepted, mut refused, mut unread) = (0, 0, 0);
    for _ in 0..100_000 {
        match Request::parse(&mutated(&mut random)) {
            Ok(Request::Set { changes, .. }) => match viewed.change(&changes) {
                Ok(_) => accepted += 1,
                Err(_) => refused += 1,
            },
            Ok(_) => {}
            Err(message) => {
                assert!(!message.is_empty());
                unread += 1;
            }
        }
    }
    assert!(accepted > 1000 && refused > 1000 && unread > 1000, "{accepted} {refused} {unread}");
    // The viewed scene still works.
    let changeable = table::all().filter(|setting| setting.is_for(Taker::Page));
    viewed.change(&changeable.map(|setting| (setting.name.to_string(), Change::AsAtStart)).collect()).unwrap();
    assert_eq!(named::as_texts(&viewed.view().experiment), named::as_texts(viewed.start()));
}

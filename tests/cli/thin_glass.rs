//! Thin glass as a user meets it: a window before a wall, with flags and extras. Needs a device.

use std::path::Path;

use glam::DVec3;
use serde_json::Value;
use taugate::internals::generate::glb;
use taugate::internals::generate::parts::{add, camera, diffuse, glass, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::scene::{LightKind, Material, Scene};

use crate::{folder, taugate};

/// A wall 4 m before the camera and its lamp, behind a window that is modelled as one plane.
fn write_window(folder: &Path, change: impl Fn(Material) -> Material) {
    let mut scene = Scene::default();
    for (name, look, distance) in [("wall", diffuse("grey", [0.5; 3]), 4.0), ("window", change(glass("pane")), 1.0)] {
        let look = material(&mut scene, look);
        let corner = DVec3::new(-9.0, -9.0, -distance);
        add(&mut scene, name, look, quad(corner, DVec3::X * 18.0, DVec3::Y * 18.0, [1.0; 2]));
    }
    scene.add_light("headlamp", DVec3::ZERO, DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.1, [8, 8]);
    std::fs::write(folder.join("scene.glb"), glb::write(&scene)).unwrap();
}

/// Runs `command`, and returns its result as JSON.
fn json(folder: &Path, command: &[&str]) -> Value {
    let output = taugate(folder, command);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn info_says_which_glass_is_thin_and_how_far_the_wall_behind_it_is() {
    let here = folder();
    write_window(here.path(), |pane| pane);
    let info = |more: &[&str]| json(here.path(), &[&["info", "scene.glb", "--json"], more].concat());
    let seen = info(&["--pixel", "4,4"]);
    assert_eq!(seen["glass"][0]["thin"], true);
    assert_eq!(seen["glass"][0]["why"], "because mesh 'window[0]' is not closed");
    // The pixel shows the wall, not the pane, and the light of the wall is not late.
    let seen = seen.to_string();
    assert!(seen.contains("wall[0]"), "{seen}");
    assert!(!info(&[]).to_string().contains("no strategy forms"));
    let solid = info(&["--thin-glass", "none"]);
    assert_eq!(
        (&solid["glass"][0]["thin"], solid["glass"][0]["why"].as_str()),
        (&Value::Bool(false), Some("as extras.thin or --thin-glass says"))
    );
    write_window(here.path(), |pane| Material { thin: Some(false), ..pane });
    assert_eq!(info(&[])["glass"][0]["thin"], false);
}

/// A lamp without a surface lights the wall aside over a pane at 45 degrees, which shows this wall to the camera. The pane is
/// named.
#[test]
fn thin_glass_that_reflects_twice_is_named() {
    let here = folder();
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
    add(&mut scene, "wall", grey, quad(DVec3::new(4.0, -9.0, 8.0), -18.0 * DVec3::Z, 18.0 * DVec3::Y, [1.0; 2]));
    let clear = material(&mut scene, glass("clear"));
    let along = DVec3::new(1.0, 0.0, -1.0);
    add(&mut scene, "pane", clear, quad(DVec3::new(-0.5, -1.0, -0.5), along, 2.0 * DVec3::Y, [1.0; 2]));
    scene.add_light("lamp", DVec3::ZERO, DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.1, [8, 8]);
    std::fs::write(here.path().join("scene.glb"), glb::write(&scene)).unwrap();
    let reason = "100 % of the pixels miss light of 'lamp'";
    let render = ["render", "scene.glb", "-o", "out.exr", "--spp", "2", "--light-paths", "500", "--estimator", "bdpt"];
    let output = taugate(here.path(), &render);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && message.contains(reason) && message.contains("'pane'"), "{message}");
    // The gate holds the light over the pane alone: 10 m instead of 5 m and the root of 17 m.
    let output = taugate(here.path(), &[&render[..], &["--gate", "9.9m..10.2m"]].concat());
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && message.contains(reason), "{message}");
    let warnings = json(here.path(), &["info", "scene.glb", "--json"])["warnings"].to_string();
    assert!(warnings.contains(reason) && warnings.contains("model the pane as a closed box"), "{warnings}");
}

/// Light that passes the window twice is 0.923^2 of the light without it, and 5 cm of glass delay it by 5 cm in all.
#[test]
fn a_thickness_delays_the_wall_behind_a_window() {
    let here = folder();
    let gates = ["--gates", "7.99m..8.09m/2", "--spp", "16", "--max-depth", "2", "--resolution", "8x8", "-q"];
    let first_gate_share = |thickness: f32| {
        write_window(here.path(), |pane| Material { thickness, ..pane });
        let output = taugate(here.path(), &[&["render", "scene.glb", "-o", "wall.npy"], &gates[..]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let bytes = std::fs::read(here.path().join("wall.npy")).unwrap();
        let start = bytes.len() - 8 * 8 * 2 * 3 * 4;
        let values: Vec<f32> =
            bytes[start..].chunks_exact(4).map(|x| f32::from_le_bytes(x.try_into().unwrap())).collect();
        // The axes are row, column, gate and channel.
        let of_gate = |gate: usize| values.chunks_exact(6).map(|pair| f64::from(pair[3 * gate])).sum::<f64>() / 64.0;
        (of_gate(0), of_gate(1))
    };
    let bare = 0.5 / std::f64::consts::PI / 16.0;
    let passed = bare * (0.96f64 / 1.04).powi(2);
    let (early, late) = first_gate_share(0.0);
    assert!((early / passed - 1.0).abs() < 0.02 && late == 0.0, "{early}, {late}, not {passed}");
    let (early, late) = first_gate_share(0.05);
    assert!((late / passed - 1.0).abs() < 0.02 && early == 0.0, "{early}, {late}, not {passed}");
}

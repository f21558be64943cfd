//! Files of density grids on the command line: each mistake gets one sentence, and nothing is written.

use std::path::Path;

use crate::{fails, folder, names, taugate};

/// A NumPy file with these values of 32 bits.
pub fn npy(descr: &str, shape: &str, values: &[f32]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
    bytes.extend(format!("{header:117}\n").bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

const BOUNDS: &str = "--medium-bounds=-0.5,0.5,-0.5,0.5,1.5,0.5";

fn generate(here: &Path) {
    assert!(taugate(here, &["generate", "cornell-box", "-o", "box.glb"]).status.success());
}

#[test]
fn a_bad_grid_is_named() {
    let here = folder();
    generate(here.path());
    let grey = [0.5; 8];
    let good = npy("<f4", "(2, 2, 2)", &grey);
    let mut nan = grey;
    nan[3] = f32::NAN;
    let files: [(&str, Vec<u8>, &str); 9] = [
        ("empty.npy", vec![], "empty.npy: "),
        ("text.npy", b"density 1\n".to_vec(), "text.npy: "),
        ("short.npy", good[..good.len() - 5].to_vec(), "should have 32 bytes of densities, but has 27"),
        ("huge.npy", npy("<f4", "(100000, 100000, 100000)", &grey), "use fewer voxels"),
        ("complex.npy", npy("<c8", "(2, 2, 2)", &grey), "complex.npy: "),
        ("flat.npy", npy("<f4", "(8,)", &grey), "flat.npy: "),
        ("nan.npy", npy("<f4", "(2, 2, 2)", &nan), "nan.npy: "),
        ("negative.npy", npy("<f4", "(2, 2, 2)", &[-0.5; 8]), "negative.npy: "),
        ("smoke.vdb", good.clone(), "use a .vol or .npy file"),
    ];
    for (name, bytes, part) in files {
        std::fs::write(here.path().join(name), bytes).unwrap();
        let arguments = ["render", "box.glb", "-o", "a.exr", "--sigma-s", "1", BOUNDS, "--density-grid", name];
        let message = fails(here.path(), &arguments, 2, part);
        assert_eq!(message.trim().lines().count(), 1, "{message}");
        std::fs::remove_file(here.path().join(name)).unwrap();
    }
    assert_eq!(names(here.path()), ["box.glb"]);
}

#[test]
fn a_grid_needs_a_box_and_coefficients() {
    let here = folder();
    generate(here.path());
    std::fs::write(here.path().join("a.npy"), npy("<f4", "(2, 2, 2)", &[0.5; 8])).unwrap();
    fn with<'a>(flags: &[&'a str]) -> Vec<&'a str> {
        [&["info", "box.glb", "--density-grid", "a.npy"], flags].concat()
    }
    fails(here.path(), &with(&["--sigma-s", "1"]), 2, "--medium-bounds");
    fails(here.path(), &with(&["--sigma-s", "1", BOUNDS, "--grid-filter", "cubic"]), 2, "linear or nearest");
    fails(here.path(), &with(&["--sigma-s", "1", BOUNDS, "--grid-transform", "1,2"]), 2, "12 numbers");
    let flat = "1,0,0,0,0,0,0,0,0,0,1,0";
    fails(here.path(), &with(&["--sigma-s", "1", BOUNDS, "--grid-transform", flat]), 2, "give an invertible matrix");
    fails(here.path(), &["info", "box.glb", "--sigma-s", "1", "--grid-filter", "linear"], 2, "needs --density-grid");
}

/// A voxel a million times as dense as the others.
#[test]
fn info_shows_the_memory_of_a_grid_and_warns_about_lost_parts() {
    let here = folder();
    generate(here.path());
    let mut density = vec![1e-6; 1 << 18];
    density[0] = 1.0;
    std::fs::write(here.path().join("a.npy"), npy("<f4", "(64, 64, 64)", &density)).unwrap();
    let info = taugate(here.path(), &["info", "box.glb", "--density-grid", "a.npy", "--sigma-s", "1", BOUNDS]);
    let text = String::from_utf8(info.stdout).unwrap();
    for part in [
        // 65 x 65 x 65 cells and 9 x 9 x 9 blocks with 16 bytes each.
        "grid of 64x64x64 voxels (1.0 MiB on the host, 4.2 MiB on the device)",
        "the density grid of medium 1 has parts far thinner than its densest voxel",
    ] {
        assert!(info.status.success() && text.contains(part), "{text}");
    }
}

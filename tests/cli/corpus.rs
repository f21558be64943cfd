//! Renders small glTF files that other programs made. Their sources and licences are in `tests/data/gltf/ATTRIBUTION.md`.

use std::path::{Path, PathBuf};
use std::process::Command;

use taugate::internals::image::exr_file::read_picture;
use taugate::internals::scene::gltf;

/// The glTF files in `tests/data/gltf`, by name.
fn files() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/gltf");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "glb" || extension == "gltf"));
    files.sort();
    files
}

/// Why a render of the file is wrong, if it is.
fn defect(file: &Path, image: &Path) -> Option<String> {
    // `pt` has the fewest kernels, and all estimators evaluate materials with the same functions.
    let arguments =
        ["--camera", "auto", "--headlamp", "--resolution", "32x32", "--spp", "4", "--estimator", "pt", "--quiet", "-o"];
    let output = Command::new(env!("CARGO_BIN_EXE_taugate"))
        .arg("render")
        .arg(file)
        .args(arguments)
        .arg(image)
        .output()
        .expect("taugate starts");
    if !output.status.success() {
        return Some(format!("{}: {}", output.status, String::from_utf8_lossy(&output.stderr)));
    }
    let pixels = read_picture(image).unwrap().rgb;
    if pixels.iter().any(|value| !value.is_finite() || *value < 0.0) {
        return Some("pixels are negative or not finite".into());
    }
    // The view frames the model, so it covers a part of the picture.
    let lit = pixels.iter().filter(|value| **value > 0.0).count() as f64 / pixels.len() as f64;
    (lit < 0.05).then(|| format!("only {:.1} % of the image are lit", 100.0 * lit))
}

/// Renders every fourth file and reads the others. Long runs (`TAUGATE_LONG_TESTS`) render all.
#[test]
fn files_of_other_programs_render() {
    let here = tempfile::tempdir().unwrap();
    let files = files();
    assert!(files.len() >= 27, "only {} files", files.len());
    let image = here.path().join("image.exr");
    // Most files need kernels of their own, which take seconds to compile.
    let mut defects = vec![];
    for (number, file) in files.iter().enumerate() {
        let found = match crate::is_long() || number % 4 == 0 {
            true => defect(file, &image),
            false => gltf::load(file).err().map(|error| error.to_string()),
        };
        defects.extend(found.map(|text| format!("{}: {text}", file.display())));
    }
    assert!(defects.is_empty(), "{}", defects.join("\n"));
}

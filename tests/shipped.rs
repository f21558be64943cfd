//! The scenes in `scenes/` equal those that the generator writes, and the experiment files there can be read.

use std::path::{Path, PathBuf};

use taugate::internals::generate::{Kind, glb_bytes};
use taugate::internals::input::experiment::Experiment;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes")
}

#[test]
fn shipped_scenes_are_what_the_generator_writes() {
    for name in ["cornell-box", "door-ajar", "gated-sphere", "street", "hidden-letter", "windscreen", "pool"] {
        let kind = Kind::parse(name).expect("a kind");
        let path = folder().join(name).with_extension("glb");
        let shipped = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        assert!(
            shipped == glb_bytes(kind),
            "{name}.glb differs: write it again with: cargo run -- generate {name} -o scenes/{name}.glb"
        );
    }
}

#[test]
fn shipped_experiments_can_be_read() {
    let names = [
        "cornell-gated.toml",
        "door-gated.toml",
        "street-drive.toml",
        "street-slices.toml",
        "street-lidar.toml",
        "street-turn.toml",
        "windscreen-lidar.toml",
        "hidden-letter.toml",
    ];
    for name in names {
        let experiment = Experiment::read(&folder().join(name)).unwrap_or_else(|e| panic!("{e}"));
        assert!(experiment.input_files().len() == experiment.input_paths().len(), "{name} must name files that exist");
        assert!(experiment.scene.is_some_and(|s| s.exists()), "{name} must name a scene that exists");
    }
}

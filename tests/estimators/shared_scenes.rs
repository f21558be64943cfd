//! The estimators agree in the benchmark scenes too. These scenes are not in the repository: the tests read them from
//! `../shared/scenes`, or from the folder that `TAUGATE_SHARED_SCENES` names, and skip scenes that are missing.
//! `cargo test --release --test estimators -- --ignored shared_scenes`

use std::path::PathBuf;

use super::agreement::NOTICED;
use super::cells::{Cells, disagreements, renderer, settings};
use taugate::internals::scene::gltf;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Emitters, Estimator};

/// Path of a benchmark scene, or `None` with a printed note if the file is missing.
fn scene_path(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("TAUGATE_SHARED_SCENES")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes"), PathBuf::from);
    let path = folder.join(name).join("scene.glb");
    if !path.exists() {
        println!("skipped: {} is missing", path.display());
        return None;
    }
    Some(path)
}

/// Compares `lcs-paper` and `lcs` with `bdpt` on a small image through one gate.
fn estimators_agree(name: &str, emitters: Emitters, gate: Gate, resolution: [u32; 2]) {
    let Some(path) = scene_path(name) else { return };
    let scene = gltf::load(&path).unwrap_or_else(|e| panic!("{e}"));
    let cells = |estimator, seed| {
        let s =
            settings(estimator, resolution).emitters(emitters.clone()).max_depth(12).light_paths(4000).build().unwrap();
        Cells::measure(&mut renderer(&scene, &s), gate, 16, 1, 8, seed)
    };
    let bdpt = cells(Estimator::Bdpt, 400);
    assert!(bdpt.whole().0 > 0.0);
    for estimator in [Estimator::LcsPaper, Estimator::Lcs] {
        let lcs = cells(estimator, 40);
        println!("{name}: bdpt {:?}, {estimator} {:?}", bdpt.whole(), lcs.whole());
        let wrong = disagreements(&bdpt, &lcs);
        assert!(wrong.is_empty(), "{name}, {estimator}:\n{}", wrong.join("\n"));
        let brighter = disagreements(&bdpt, &lcs.times(NOTICED));
        assert!(!brighter.is_empty(), "{name}, {estimator}: a brighter image is not rejected");
    }
}

#[test]
#[ignore = "needs the benchmark scenes"]
fn staircase_with_its_area_light() {
    estimators_agree("staircase", Emitters::Scene, Gate { lo: 12.7, hi: 13.1 }, [32, 48]);
}

#[test]
#[ignore = "needs the benchmark scenes"]
fn veach_ajar_with_the_beam() {
    let beam = Emitters::Nodes(vec!["beam".into()]);
    estimators_agree("veach-ajar", beam, Gate { lo: 14.2, hi: 14.6 }, [48, 32]);
}

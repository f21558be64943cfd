//! `--rays hardware` where things move, and in scans. Skipped, with a message, on devices without ray queries. Needs a device.

use std::path::Path;

use taugate::internals::image::exr_file::read_picture;

use crate::lidar::write_scene;
use crate::{folder, taugate};

const KINDS: [&str; 2] = ["hardware", "software"];
/// Length of the header of a NumPy array in bytes.
const HEADER: usize = 128;

/// Renders the same with both kinds of rays, to `NAME-hardware...` and `NAME-software...`. Returns whether the device has ray queries.
fn render(here: &Path, [scene, name]: [&str; 2], flags: &[&str]) -> bool {
    for rays in KINDS {
        let common = ["render", scene, "-o", &name.replace('@', rays), "--rays", rays, "--sampling", "uniform", "-q"];
        let output = taugate(here, &[&common, flags].concat());
        let message = String::from_utf8(output.stderr).unwrap();
        if rays == "hardware" && !output.status.success() && message.contains("ray queries") {
            eprintln!("skipped: {message}");
            return false;
        }
        assert!(output.status.success(), "{flags:?}: {message}");
    }
    true
}

/// Images agree bit by bit, but for a few paths that meet an edge.
#[test]
fn what_moves_looks_alike_with_both_kinds_of_rays() {
    let here = folder();
    let here = here.path();
    let street = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/street.glb");
    std::fs::copy(street, here.join("street.glb")).unwrap();
    let small = ["--resolution", "48x24", "--depth", "8m..40m", "--spp", "8"];
    let frames = [&small[..], &["--frames", "0..2", "--fps", "1"]].concat();
    if !render(here, ["street.glb", "frame-@.#.exr"], &frames) {
        return;
    }
    let pixels = |name: &str| read_picture(&here.join(name)).unwrap().rgb;
    let frames = KINDS.map(|rays| [0, 1].map(|frame| pixels(&format!("frame-{rays}.{frame}.exr"))));
    let alike = |a: &[f32], b: &[f32], within: &dyn Fn(usize) -> bool| {
        let all: Vec<usize> = (0..a.len()).filter(|&i| within(i)).collect();
        assert!(all.len() > 50, "{} values", all.len());
        all.iter().filter(|&&i| a[i] == b[i]).count() as f64 / all.len() as f64
    };
    // Where the car was or is: rays that still meet the car of the first frame would change these pixels.
    let moved = |i: usize| frames[1][0][i] != frames[1][1][i];
    for frame in [0, 1] {
        let share = alike(&frames[0][frame], &frames[1][frame], &moved);
        assert!(share > 0.9, "frame {frame}: {share} of the values are equal");
    }
    // Each iteration shows another moment.
    assert!(render(
        here,
        ["street.glb", "open-@.exr"],
        &[&small[..], &["--at", "1s", "--shutter", "0..50ms"]].concat()
    ));
    let share = alike(&pixels("open-hardware.exr"), &pixels("open-software.exr"), &|_| true);
    assert!(share > 0.9, "{share} of the values are equal");
}

#[test]
fn scans_look_alike_with_both_kinds_of_rays() {
    let here = folder();
    let here = here.path();
    write_scene(here, false, "4m..42m/38");
    if !render(here, ["lidar.toml", "scan-@.npy"], &[]) {
        return;
    }
    let [a, b] = KINDS.map(|rays| std::fs::read(here.join(format!("scan-{rays}.npy"))).unwrap());
    assert_eq!(a.len(), b.len());
    // Most bins are dark, so only those with light count.
    let lit: Vec<(&u8, &u8)> = a[HEADER..].iter().zip(&b[HEADER..]).filter(|(a, b)| (**a, **b) != (0, 0)).collect();
    let equal = lit.iter().filter(|(a, b)| a == b).count() as f64 / lit.len() as f64;
    assert!(lit.len() > 20 && equal > 0.99, "{equal} of {} bytes are equal", lit.len());
}

//! Renders with narrow limits on texel buffers.

use std::path::Path;
use std::process::{Command, Output};

use taugate::internals::image::exr_file::read_picture;

/// Runs `taugate` with texel buffers of at most `texels` texels.
fn taugate(folder: &Path, texels: &str, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_taugate"));
    command.args(arguments).current_dir(folder).env("TAUGATE_MAX_TEXELS", texels).output().expect("taugate starts")
}

/// Vulkan guarantees texel buffers of only 65,536 texels. Before there was the fallback to storage buffers, devices with this limit were
/// refused, or gave wrong images without a message.
#[test]
fn arrays_too_large_for_texel_buffers_are_read_as_storage_buffers() {
    let here = tempfile::tempdir().unwrap();
    let run = |texels: &str, arguments: &[&str]| {
        let output = taugate(here.path(), texels, arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    run("", &["generate", "cornell-box", "-o", "box.glb"]);
    run("", &["generate", "zoo-area", "-o", "textured.glb"]);
    // Some arrays are larger than 65,536 texels, the limit that Vulkan guarantees; all arrays are larger than one texel.
    let cases = [("box.glb", "lcs", "65536"), ("textured.glb", "pt", "1"), ("box.glb", "lcs-paper", "1")];
    let tested = if crate::is_long() { &cases[..] } else { &cases[..2] };
    for (scene, estimator, texels) in tested {
        let image = |texels: &str| {
            let settings = ["--resolution", "32x24", "--spp", "4", "--light-paths", "20000", "--gate", "5m..7m"];
            run(texels, &[&["render", scene, "-o", "a.exr", "--estimator", estimator], &settings[..]].concat());
            read_picture(&here.path().join("a.exr")).unwrap().rgb
        };
        let wide = image("");
        assert!(wide.iter().any(|&x| x > 0.0));
        assert!(image(texels) == wide, "{scene}, {estimator}, {texels} texels");
    }
}

#[test]
fn a_limit_on_texels_is_a_number() {
    let output = taugate(Path::new("."), "many", &["devices"]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        !output.status.success() && message.contains("TAUGATE_MAX_TEXELS is many; set it to a number"),
        "{message}"
    );
}

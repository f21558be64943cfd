//! Index checks (`TAUGATE_BOUNDS_CHECKS`): they change no image, and they find indices out of range. The program reads the
//! variable when it compiles kernels, so each case runs in a process of its own.

use std::process::{Command, Output};

use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::Scene;
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::cells::{renderer, settings};
use super::shader_function::{ShaderFunction, contents};
use super::{image, sum};
use taugate::internals::generate::zoo::{Light, zoo};

/// Runs one of the ignored tests below in another process, with or without index checks.
fn run(test: &str, checked: bool) -> Output {
    let mut command = Command::new(std::env::current_exe().expect("the path of this test"));
    command.args(["--ignored", "--exact", "--nocapture", test]);
    match checked {
        true => command.env("TAUGATE_BOUNDS_CHECKS", "1"),
        false => command.env_remove("TAUGATE_BOUNDS_CHECKS"),
    };
    command.output().expect("starting this test again")
}

/// The lines with the bits of images that such a process prints.
fn images(test: &str, checked: bool) -> Vec<String> {
    let output = run(test, checked);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{test}: {text}{}", String::from_utf8_lossy(&output.stderr));
    let lines: Vec<String> = text.lines().filter_map(|line| Some(line.split_once("image ")?.1.to_string())).collect();
    assert!(!lines.is_empty(), "{text}");
    lines
}

/// Renders a small image and prints its bits.
fn print_image(scene: &Scene, estimator: Estimator) {
    let s = settings(estimator, [12, 8]).max_depth(8).light_paths(200).build().unwrap();
    let mut renderer = renderer(scene, &s);
    let image = image(&mut renderer, 3, Gate { lo: 3.0, hi: 12.0 }, 2, 2);
    assert!(sum(&image) > 0.0);
    println!("image {estimator:?} {:?}", image.iter().map(|x| x.to_bits()).collect::<Vec<_>>());
}

#[test]
#[ignore = "helper of index_checks_change_no_bit"]
fn helper_some_images() {
    print_image(&build(Kind::CornellBox), Estimator::LcsPaper);
}

#[test]
#[ignore = "helper of index_checks_change_no_bit_of_any_estimator"]
fn helper_all_images() {
    // Together these renders use every feature of the kernels.
    for light in [Light::Area, Light::Punctual, Light::Beam] {
        for estimator in Estimator::ALL.into_iter().filter(|&e| e != Estimator::Pt || light != Light::Beam) {
            print_image(&zoo(light), estimator);
        }
    }
}

#[test]
fn index_checks_change_no_bit() {
    assert_eq!(images("checks::helper_some_images", false), images("checks::helper_some_images", true));
}

#[test]
#[ignore = "takes a minute"]
fn index_checks_change_no_bit_of_any_estimator() {
    let plain = images("checks::helper_all_images", false);
    assert_eq!(plain.len(), 11);
    assert_eq!(plain, images("checks::helper_all_images", true));
}

/// Runs the shader code `body` with `index`. `buffer` holds two elements of `bytes_each` zero bytes.
fn read(imports: &'static [&'static str], body: &'static str, buffer: &'static str, bytes_each: usize, index: u32) {
    let function = ShaderFunction { imports, input: "index: u32", result: "value: u32", body };
    let _: Vec<u32> = function.run(&[index], &[contents(buffer, &vec![0u8; 2 * bytes_each])]);
}

const TEXELS: (&[&str], &str) = (&["tree"], "result.value = load_tree_node(input.index).left.child;");
const WORDS: (&[&str], &str) = (&["tree"], "result.value = path_offsets[input.index];");
const LOCAL: (&[&str], &str) =
    (&["tree"], "var local = array<u32, 2>(); local[input.index] = path_offsets[0]; result.value = local[0];");

#[test]
#[ignore = "helper of an_index_out_of_range_is_found"]
fn helper_texels_inside() {
    read(TEXELS.0, TEXELS.1, "tree_nodes", 96, 1);
}

#[test]
#[ignore = "helper of an_index_out_of_range_is_found"]
fn helper_texels_outside() {
    read(TEXELS.0, TEXELS.1, "tree_nodes", 96, 2);
}

// A buffer has at least 16 bytes, which are four words, so index 3 is inside.
#[test]
#[ignore = "helper of an_index_out_of_range_is_found"]
fn helper_words_inside() {
    read(WORDS.0, WORDS.1, "path_offsets", 8, 3);
}

#[test]
#[ignore = "helper of an_index_out_of_range_is_found"]
fn helper_words_outside() {
    read(WORDS.0, WORDS.1, "path_offsets", 8, 4);
}

#[test]
#[ignore = "helper of an_index_out_of_range_is_found"]
fn helper_local_inside() {
    read(LOCAL.0, LOCAL.1, "path_offsets", 8, 1);
}

#[test]
#[ignore = "helper of an_index_out_of_range_is_found"]
fn helper_local_outside() {
    read(LOCAL.0, LOCAL.1, "path_offsets", 8, 2);
}

#[test]
fn an_index_out_of_range_is_found() {
    for (kind, place) in
        [("texels", "shaders/shared/tree.wgsl:"), ("words", "shaders/test.wgsl:"), ("local", "shaders/test.wgsl:")]
    {
        let inside = run(&format!("checks::helper_{kind}_inside"), true);
        assert!(inside.status.success(), "{kind}: {}", String::from_utf8_lossy(&inside.stderr));
        let outside = run(&format!("checks::helper_{kind}_outside"), true);
        let message = String::from_utf8_lossy(&outside.stderr).into_owned();
        assert!(!outside.status.success() && message.contains("index out of range at"), "{kind}: {message}");
        assert!(message.contains(place), "{kind}: {message}");
    }
}

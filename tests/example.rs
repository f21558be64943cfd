//! The example in `examples/` renders the image that its comments describe.

#[allow(dead_code, reason = "the test calls `render` alone")]
#[path = "../examples/render_gate.rs"]
mod render_gate;

use taugate::internals::image::exr_file::read_picture;

#[test]
fn the_example_renders_a_ring() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("gate.exr");
    let mean = render_gate::render(&out).unwrap();
    let picture = read_picture(&out).unwrap();
    let lit = picture.rgb.chunks_exact(3).filter(|pixel| pixel[1] > 0.0).count();
    assert!(mean > 0.0 && (1..64 * 64).contains(&lit), "{mean}, {lit} pixels");
    assert_eq!((picture.width, picture.gate), (64, Some([6.2, 6.3])));
}

//! The example in `examples/` renders the image that its comments describe.

#[allow(dead_code, reason = "the test calls `render` alone")]
#[path = "../examples/render_gate.rs"]
mod render_gate;

use taugate::glam::DVec3;
use taugate::internals::image::exr_file::read_picture;
use taugate::{Aim, Camera, Material, Projection, Retroreflector, SkyImage};

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

/// A program can name the types of all public fields.
#[test]
fn a_program_can_fill_in_every_field() {
    let aim = Aim { point: DVec3::NEG_Z, omitted: 0.0 };
    let camera = Camera::looking_at("laser", DVec3::ZERO, DVec3::NEG_Z, 0.8, [1, 1]);
    let camera = Camera { projection: Projection::Aimed { aims: [aim].into(), pixel_fov: 0.0 }, ..camera };
    assert_eq!(camera.direction([1, 1], [0.5; 2]), DVec3::NEG_Z);
    let sign = Retroreflector { share: 0.5, angle: 1.0 };
    assert!(Material { retroreflector: Some(sign), ..Material::diffuse("sign", [0.5; 3]) }.retroreflector.is_some());
    assert_eq!(SkyImage::constant().rgb, [[1.0; 3]]);
}

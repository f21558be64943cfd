//! Renders a wall as a time-gated sensor sees it, and writes the image to an EXR file.

use std::path::Path;
use std::sync::Arc;

use taugate::glam::DVec3;
use taugate::{Camera, Device, Gate, Job, LightKind, Material, Mesh, Scene, Settings};

/// Renders the image, writes it to `out`, and returns its mean radiance.
pub fn render(out: &Path) -> taugate::Result<f64> {
    // A wall 3 m in front of the sensor, and a lamp 1 m beside it.
    let mut scene = Scene::default();
    let white = scene.add_material(Material::diffuse("white", [0.8; 3]));
    let corners = vec![[-2.0, -2.0, -3.0], [2.0, -2.0, -3.0], [2.0, 2.0, -3.0], [-2.0, 2.0, -3.0]];
    scene.add_surface(Mesh::flat("wall", corners, vec![[0, 1, 2], [0, 2, 3]]), white);
    scene.add_light("lamp", DVec3::X, DVec3::NEG_Z, LightKind::Point { intensity: [10.0; 3] });
    scene.add_camera(Camera::looking_at("sensor", DVec3::ZERO, DVec3::NEG_Z, 0.8, [64, 64]));

    // Light with an optical path between 6.2 m and 6.3 m comes from a ring on the wall.
    let settings = Settings::builder().gate(Gate::new(6.2, 6.3)?).resolution([64, 64]).build()?;
    let mut job = Job::of_scene(scene, &settings)?.prepare(&Device::open(None)?)?;
    job.run(&Arc::default(), |_| {})?;
    job.write_exr(out)?;
    Ok(job.film().image_mean().0)
}

fn main() -> taugate::Result<()> {
    let out = std::env::temp_dir().join("gate.exr");
    println!("{}: mean radiance {:.3e}", out.display(), render(&out)?);
    Ok(())
}

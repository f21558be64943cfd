//! The glTF reader: it converts good files to the right scene, and refuses bad files with a message that names the bad part.

#[path = "../common/glb.rs"]
mod glb;
#[cfg(target_os = "linux")]
#[path = "../common/peak.rs"]
mod peak;

mod animation;
mod bounds;
mod cameras;
mod compressed;
mod extensions;
mod flat;
mod good;
mod hostile;
mod images;
mod materials;
mod media;
mod pose;
mod textures;
mod unneeded;

use std::path::Path;

use glam::Vec3;
use glb::{Glb, complete};
use serde_json::{Value, json};
use taugate::Error;
use taugate::internals::scene::Scene;
use taugate::internals::scene::gltf::load_slice;

fn read(glb: &Glb) -> Scene {
    load_slice(&glb.build(), Path::new("test.glb")).unwrap()
}

fn refusal(bytes: &[u8]) -> String {
    match load_slice(bytes, Path::new("test.glb")) {
        Ok(_) => panic!("the file was accepted"),
        Err(Error::Scene { message, .. }) => message,
        Err(other) => panic!("wrong kind of error: {other}"),
    }
}

/// A file with one mesh of one primitive. The members of `extra` are added to the primitive.
fn single(positions: &[[f32; 3]], extra: Value) -> Glb {
    let mut glb = Glb::new();
    let position = glb.floats(positions);
    let mut primitive = json!({ "attributes": { "POSITION": position } });
    primitive.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
    glb.push("meshes", json!({ "primitives": [primitive] }));
    glb.push("nodes", json!({ "mesh": 0 }));
    glb
}

/// Checks the rules that `src/scene/mod.rs` states for every scene.
fn check_invariants(scene: &Scene) {
    assert!(!scene.materials.is_empty());
    for mesh in &scene.meshes {
        assert!(!mesh.triangles.is_empty());
        assert!(mesh.triangles.iter().flatten().all(|&index| (index as usize) < mesh.positions.len()));
        assert!(mesh.positions.iter().flatten().chain(mesh.uvs.iter().flatten()).all(|value| value.is_finite()));
        assert!(mesh.normals.iter().all(|&normal| (Vec3::from(normal).length() - 1.0).abs() < 1e-5));
        assert!(mesh.normals.is_empty() || mesh.normals.len() == mesh.positions.len());
        assert!(mesh.colors.is_empty() || mesh.colors.len() == mesh.positions.len());
        assert!(mesh.tangents.is_empty() || mesh.tangents.len() == mesh.positions.len());
        assert!(mesh.uvs.is_empty() || mesh.uvs.len() == mesh.positions.len());
        assert!((mesh.material as usize) < scene.materials.len());
    }
    for instance in &scene.instances {
        assert!((instance.mesh as usize) < scene.meshes.len());
        assert!(instance.transform.is_finite() && instance.transform.matrix3.determinant() != 0.0);
    }
    for material in &scene.materials {
        let unit = [material.metallic, material.roughness, material.specular, material.transmission];
        let coat = [material.clearcoat, material.clearcoat_roughness];
        assert!(material.base_color.iter().chain(&unit).chain(&coat).all(|value| (0.0..=1.0).contains(value)));
        let colors = material.emission.iter().chain(&material.specular_color);
        assert!(colors.into_iter().all(|value| value.is_finite() && *value >= 0.0) && material.ior >= 1.0);
        assert!(material.textures().all(|texture| (texture as usize) < scene.textures.len()));
    }
    assert!(scene.textures.iter().all(|texture| (texture.image as usize) < scene.images.len()));
    assert!(scene.images.iter().all(|image| image.rgba.len() == image.width as usize * image.height as usize));
    for light in &scene.lights {
        assert!(light.position.is_finite() && (light.direction.length() - 1.0).abs() < 1e-9);
    }
}

/// The complete scene as `.gltf` text, whose buffer is at `uri`.
fn text(uri: &str) -> Vec<u8> {
    let mut glb = complete();
    glb.json["buffers"][0]["uri"] = json!(uri);
    serde_json::to_vec_pretty(&glb.json).unwrap()
}

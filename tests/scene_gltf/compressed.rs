//! Files that other tools quantized and compressed have the same triangles as the plain file. `data/compressed/make.py` makes
//! the files.

use std::path::PathBuf;

use glam::{DVec2, DVec3, Vec2, Vec3};
use taugate::internals::scene::gltf::load;

use super::hostile::{random, survive};
use super::*;

const FILES: [&str; 8] = [
    "quantized",
    "quantized-normalized",
    "meshopt-ext",
    "meshopt-khr",
    "meshopt-floats",
    "meshopt-fallback",
    "draco-edgebreaker",
    "draco-sequential",
];

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/compressed").join(format!("{name}.glb"))
}

/// A corner of a triangle: its position and normal in the world, and its texture coordinates.
#[derive(Clone, Copy)]
struct Corner(DVec3, DVec3, DVec2);

impl Corner {
    /// Whether the corners agree up to the quantization: 14 bits for a position, 8 for a normal, 12 for texture coordinates.
    fn is_near(&self, other: &Corner) -> bool {
        (self.0 - other.0).length() < 4e-4 && (self.1 - other.1).length() < 0.02 && (self.2 - other.2).length() < 1e-3
    }
}

fn triangles(scene: &Scene) -> Vec<[Corner; 3]> {
    let of = |instance: &taugate::internals::scene::Instance| {
        let mesh = &scene.meshes[instance.mesh as usize];
        let corner = |index: u32| {
            let index = index as usize;
            let position = instance.transform.transform_point3(Vec3::from(mesh.positions[index]).as_dvec3());
            let normal = instance.transform.transform_vector3(Vec3::from(mesh.normals[index]).as_dvec3());
            Corner(position, normal.normalize(), Vec2::from(mesh.uvs[index]).as_dvec2())
        };
        mesh.triangles.iter().map(|triangle| triangle.map(corner)).collect::<Vec<_>>()
    };
    scene.instances.iter().flat_map(of).collect()
}

#[test]
fn compressed_files_have_the_triangles_of_the_plain_file() {
    let plain = triangles(&load(&file("torus")).unwrap());
    assert_eq!(plain.len(), 2 * 2 * 16 * 8);
    for name in FILES {
        let scene = load(&file(name)).unwrap();
        check_invariants(&scene);
        assert_eq!((scene.instances.len(), scene.meshes.len()), (2, 1), "{name}");
        assert_eq!(scene.warnings, Vec::<String>::new(), "{name}");
        let mut left = triangles(&scene);
        for triangle in &plain {
            let is_same = |[a, b, c]: &[Corner; 3]| {
                [[a, b, c], [b, c, a], [c, a, b]].iter().any(|turned| (0..3).all(|k| turned[k].is_near(&triangle[k])))
            };
            let found =
                left.iter().position(is_same).unwrap_or_else(|| panic!("{name}: no triangle at {}", triangle[0].0));
            left.swap_remove(found);
        }
        assert!(left.is_empty(), "{name} has {} more triangles", left.len());
    }
}

#[test]
fn a_fallback_buffer_is_not_needed() {
    let folder = tempfile::tempdir().unwrap();
    // The fallback buffer is a .bin file beside the .glb file. It is not copied.
    let path = folder.path().join("alone.glb");
    std::fs::copy(file("meshopt-fallback"), &path).unwrap();
    assert_eq!(triangles(&load(&path).unwrap()).len(), 512);
}

#[test]
fn plain_data_beside_draco_data_is_preferred() {
    let mut glb = complete();
    let garbage = json!({ "bufferView": 0, "attributes": { "POSITION": 0 } });
    glb.json["meshes"][0]["primitives"][0]["extensions"] = json!({ "KHR_draco_mesh_compression": garbage });
    glb.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    assert_eq!(read(&glb).warnings, Vec::<String>::new());
}

/// A damaged file may declare a Draco attribute as single bytes, and use it as indices. The reader must not panic.
#[test]
fn draco_attributes_of_single_bytes_are_read_as_such() {
    let bytes = std::fs::read(file("draco-sequential")).unwrap();
    let (json, bin) = bytes[20..].split_at(u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize);
    let mut glb = Glb { json: serde_json::from_slice(json).unwrap(), bin: bin[8..].to_vec() };
    let primitive = &mut glb.json["meshes"][0]["primitives"];
    let (uv, position) =
        (primitive[0]["attributes"]["TEXCOORD_0"].clone(), primitive[0]["attributes"]["POSITION"].clone());
    primitive.as_array_mut().unwrap().insert(0, json!({ "attributes": { "POSITION": position }, "indices": uv }));
    let uv = &mut glb.json["accessors"][uv.as_u64().unwrap() as usize];
    (uv["type"], uv["componentType"]) = (json!("SCALAR"), json!(5121));
    survive(&glb.build(), || "single bytes".into());
}

#[test]
fn damage_to_compressed_data_is_survived() {
    let mut random = random();
    for name in FILES {
        let bytes = std::fs::read(file(name)).unwrap();
        let json = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let data = 20 + json + 8;
        for round in 0..500 {
            let mut damaged = bytes.clone();
            for _ in 0..1 + random(4) {
                let at = data + random(bytes.len() - data);
                damaged[at] = random(256) as u8;
            }
            survive(&damaged, || format!("{name}, round {round}"));
        }
    }
}

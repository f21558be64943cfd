//! Small glTF files made in memory.

use serde_json::{Value, json};

/// A GLB file with this JSON chunk and this BIN chunk, both padded to multiples of 4 bytes.
pub fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
    let mut text = serde_json::to_vec(json).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut data = bin.to_vec();
    data.resize(data.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    out.extend(2u32.to_le_bytes());
    out.extend((12 + 8 + text.len() as u32 + 8 + data.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &data)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

/// A glTF file under construction. Tests may edit `json`; the methods append data.
#[derive(Clone)]
pub struct Glb {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl Glb {
    pub fn new() -> Self {
        let json = json!({
            "asset": { "version": "2.0" },
            "buffers": [{ "byteLength": 0 }], "bufferViews": [], "accessors": [],
            "meshes": [], "nodes": [],
        });
        Self { json, bin: Vec::new() }
    }

    /// Appends to one of the top-level arrays and returns the index.
    pub fn push(&mut self, kind: &str, value: Value) -> usize {
        let list = self.json.as_object_mut().unwrap().entry(kind).or_insert_with(|| json!([])).as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let offset = self.bin.len();
        self.bin.extend(bytes);
        self.json["buffers"][0]["byteLength"] = json!(self.bin.len());
        self.push("bufferViews", json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }))
    }

    pub fn accessor(&mut self, bytes: &[u8], component: u32, shape: &str, count: usize) -> usize {
        let view = self.view(bytes);
        self.push("accessors", json!({ "bufferView": view, "componentType": component, "type": shape, "count": count }))
    }

    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
        let shape = match N {
            1 => "SCALAR",
            2 => "VEC2",
            3 => "VEC3",
            4 => "VEC4",
            _ => "MAT4",
        };
        self.accessor(&bytes, 5126, shape, values.len())
    }

    pub fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.accessor(&bytes, 5123, "SCALAR", values.len())
    }

    pub fn build(&self) -> Vec<u8> {
        glb(&self.json, &self.bin)
    }
}

/// A PNG with rows of `width` texels.
pub fn png(width: u32, texels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = vec![];
    let mut encoder = png::Encoder::new(&mut bytes, width, texels.len() as u32 / width);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(texels.as_flattened()).unwrap();
    writer.finish().unwrap();
    bytes
}

/// A scene with a textured triangle, a camera, a spot light and a beam. They are children of a root node with a translation.
///
/// Accessors: 0 positions, 1 indices, 2 normals, 3 texture coordinates. Nodes: 0 root, 1 tri, 2 eye, 3 lamp, 4 laser (a beam).
pub fn complete() -> Glb {
    let mut glb = Glb::new();
    let position = glb.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let indices = glb.indices(&[0, 1, 2]);
    let normal = glb.floats(&[[0.0, 0.0, 2.0]; 3]);
    let uv = glb.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let image = glb.view(&png(2, &[[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 128]]));
    glb.push("images", json!({ "name": "Wood", "bufferView": image, "mimeType": "image/png" }));
    glb.push("samplers", json!({ "magFilter": 9728, "wrapS": 33071, "wrapT": 33648 }));
    glb.push("textures", json!({ "source": 0, "sampler": 0 }));
    let paint = json!({
        "name": "Paint", "doubleSided": true, "alphaMode": "MASK", "alphaCutoff": 0.25,
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.25, 1.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.75,
            "baseColorTexture": { "index": 0 },
        },
        "emissiveFactor": [1.0, 0.5, 0.0],
        "extensions": {
            "KHR_materials_emissive_strength": { "emissiveStrength": 4.0 }, "KHR_materials_ior": { "ior": 1.25 },
            "KHR_materials_specular": { "specularFactor": 1.0 },
            "KHR_materials_transmission": { "transmissionFactor": 0.125 },
        },
    });
    glb.push("materials", paint);
    let attributes = json!({ "POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv });
    let primitive = json!({ "attributes": attributes, "indices": indices, "material": 0 });
    glb.push("meshes", json!({ "name": "Tri", "primitives": [primitive] }));
    let perspective = json!({ "yfov": 0.5, "aspectRatio": 2.0, "znear": 0.01 });
    let extras = json!({ "width": 64, "height": 32 });
    glb.push("cameras", json!({ "type": "perspective", "perspective": perspective, "extras": extras }));
    let spot = json!({
        "type": "spot", "color": [1.0, 0.5, 0.25], "intensity": 8.0,
        "spot": { "innerConeAngle": 0.25, "outerConeAngle": 0.5 },
    });
    glb.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [spot] } });
    glb.json["extensionsUsed"] = json!(["KHR_lights_punctual", "KHR_materials_ior"]);
    glb.push("nodes", json!({ "name": "root", "children": [1, 2, 3, 4], "translation": [0.0, 0.0, 10.0] }));
    glb.push("nodes", json!({ "name": "tri", "mesh": 0 }));
    glb.push("nodes", json!({ "name": "eye", "camera": 0, "scale": [2.0, 2.0, 2.0] }));
    let light = json!({ "KHR_lights_punctual": { "light": 0 } });
    glb.push("nodes", json!({ "name": "lamp", "extensions": light }));
    let beam = json!({ "emitter": { "type": "collimated_beam", "radius": 0.5, "power": [1.0, 2.0, 3.0] } });
    glb.push("nodes", json!({ "name": "laser", "extras": beam, "rotation": [0.0, 1.0, 0.0, 0.0] }));
    glb.json["scene"] = json!(0);
    glb.push("scenes", json!({ "nodes": [0] }));
    glb
}

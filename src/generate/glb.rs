//! Writes a [`Scene`] as binary glTF 2.0 for the loader. Media, retroreflectors and the transforms of textures are not written.

use std::collections::BTreeSet;

use glam::{DAffine3, DQuat};
use serde_json::{Map, Value, json};

use crate::scene::{AlphaMode, Camera, Image, Instance, Light, LightKind, Material, Mesh, Projection, Scene, Wrap};

/// A translation of all nodes with this name: an animation with linear interpolation.
pub struct Motion {
    pub node: &'static str,
    /// Seconds, ascending.
    pub times: Vec<f32>,
    /// Position of the node at each time.
    pub positions: Vec<[f32; 3]>,
}

/// The bytes of the file. Its nodes are the instances, then the cameras, then the lights, each in the scene's order. Images
/// become PNG. All textures use TEXCOORD_0. Numbers except the principal point are rounded to f32. Panics for a sky and for an
/// aimed camera.
pub fn write(scene: &Scene) -> Vec<u8> {
    write_moving(scene, None)
}

/// As [`write`], with a motion. Instances that move must have no scale, because glTF forbids a matrix on animated nodes.
pub fn write_moving(scene: &Scene, motion: Option<&Motion>) -> Vec<u8> {
    let mut file = File::default();
    let meshes: Vec<Value> = scene.meshes.iter().map(|m| file.mesh(m)).collect();
    let materials: Vec<Value> = scene.materials.iter().map(|m| file.material(m)).collect();
    let images: Vec<Value> = scene.images.iter().map(|i| file.image(i)).collect();
    let moves = |i: &Instance| motion.is_some_and(|motion| motion.node == i.node);
    let place = |i: &Instance| if moves(i) { pose(&i.transform) } else { matrix(&i.transform) };
    let mut nodes: Vec<Value> =
        scene.instances.iter().map(|i| with(json!({"name": i.node, "mesh": i.mesh}), place(i))).collect();
    for (index, camera) in scene.cameras.iter().enumerate() {
        nodes.push(with(json!({"name": camera.name, "camera": index}), pose(&camera.transform)));
    }
    let mut punctual = Vec::new();
    for light in &scene.lights {
        nodes.push(file.light(light, &mut punctual));
    }
    let has_name = |index: &usize, name: &str| nodes[*index]["name"] == name;
    let moving = |motion: &Motion| (0..nodes.len()).filter(|index| has_name(index, motion.node)).collect::<Vec<_>>();
    let animations: Vec<Value> = motion.map(|motion| file.animation(motion, &moving(motion))).into_iter().collect();

    let mut root = json!({
        "asset": {"version": "2.0", "generator": "taugate generate"},
        "scene": 0,
        "scenes": [{"nodes": (0..nodes.len()).collect::<Vec<_>>()}],
        "nodes": nodes,
        "meshes": meshes,
        "animations": animations,
        "materials": materials,
        "cameras": scene.cameras.iter().map(camera).collect::<Vec<_>>(),
        "accessors": file.accessors,
        "bufferViews": file.views,
        "buffers": [{"byteLength": file.binary.len()}],
    });
    if !images.is_empty() {
        let samplers = scene.textures.iter().map(|t| {
            let filter = if t.linear { 9729 } else { 9728 };
            json!({"magFilter": filter, "minFilter": filter, "wrapS": wrap(t.wrap[0]), "wrapT": wrap(t.wrap[1])})
        });
        root["samplers"] = samplers.collect();
        root["textures"] =
            scene.textures.iter().enumerate().map(|(i, t)| json!({"sampler": i, "source": t.image})).collect();
        root["images"] = images.into();
    }
    if !punctual.is_empty() {
        root["extensions"] = json!({"KHR_lights_punctual": {"lights": punctual}});
    }
    if !file.extensions.is_empty() {
        root["extensionsUsed"] = json!(file.extensions);
    }
    // glTF forbids empty arrays.
    root.as_object_mut().expect("an object").retain(|_, v| v.as_array().is_none_or(|a| !a.is_empty()));
    container(root.to_string().into_bytes(), file.binary)
}

/// The GLB header and the two chunks, each padded to a multiple of four bytes.
fn container(mut json: Vec<u8>, mut binary: Vec<u8>) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let length = 12 + 8 + json.len() + 8 + binary.len();
    let mut bytes = Vec::with_capacity(length);
    bytes.extend(b"glTF");
    for word in [2, length as u32, json.len() as u32] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

#[derive(Default)]
struct File {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    extensions: BTreeSet<&'static str>,
}

impl File {
    fn mesh(&mut self, mesh: &Mesh) -> Value {
        let bound = |fold: fn(f32, f32) -> f32| {
            let axis = |k: usize| number(mesh.positions.iter().map(|p| p[k]).reduce(fold).unwrap_or(0.0));
            json!([axis(0), axis(1), axis(2)])
        };
        let range = json!({"min": bound(f32::min), "max": bound(f32::max)});
        let mut attributes = Map::new();
        let position = self.floats(mesh.positions.as_flattened(), "VEC3", mesh.positions.len());
        self.accessors[position] = with(self.accessors[position].take(), range);
        attributes.insert("POSITION".into(), position.into());
        if !mesh.normals.is_empty() {
            let normal = self.floats(mesh.normals.as_flattened(), "VEC3", mesh.normals.len());
            attributes.insert("NORMAL".into(), normal.into());
        }
        if !mesh.uvs.is_empty() {
            let uv = self.floats(mesh.uvs.as_flattened(), "VEC2", mesh.uvs.len());
            attributes.insert("TEXCOORD_0".into(), uv.into());
        }
        if !mesh.colors.is_empty() {
            let color = self.floats(mesh.colors.as_flattened(), "VEC4", mesh.colors.len());
            attributes.insert("COLOR_0".into(), color.into());
        }
        if !mesh.tangents.is_empty() {
            let tangent = self.floats(mesh.tangents.as_flattened(), "VEC4", mesh.tangents.len());
            attributes.insert("TANGENT".into(), tangent.into());
        }
        let indices = mesh.triangles.as_flattened();
        // Index 65535 is the primitive restart value.
        let small = mesh.positions.len() <= 65_535;
        let bytes: Vec<u8> = if small {
            indices.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect()
        } else {
            indices.iter().flat_map(|&i| i.to_le_bytes()).collect()
        };
        let view = self.view(&bytes, Some(34_963));
        let component = if small { 5123 } else { 5125 };
        let indices = self.accessor(view, component, "SCALAR", indices.len());
        json!({"name": mesh.name,
            "primitives": [{"attributes": attributes, "indices": indices, "material": mesh.material}]})
    }

    /// An animation that moves the nodes `moving`.
    fn animation(&mut self, motion: &Motion, moving: &[usize]) -> Value {
        let input = self.accessor_of(&motion.times, "SCALAR", motion.times.len());
        let end = motion.times.iter().copied().fold(0.0, f32::max);
        let begin = motion.times.iter().copied().fold(end, f32::min);
        self.accessors[input] =
            with(self.accessors[input].take(), json!({"min": [number(begin)], "max": [number(end)]}));
        let output = self.accessor_of(motion.positions.as_flattened(), "VEC3", motion.positions.len());
        let channel = |&node: &usize| json!({"sampler": 0, "target": {"node": node, "path": "translation"}});
        json!({"name": "drive", "channels": moving.iter().map(channel).collect::<Vec<_>>(),
            "samplers": [{"input": input, "output": output, "interpolation": "LINEAR"}]})
    }

    /// An accessor that holds no vertex attribute.
    fn accessor_of(&mut self, values: &[f32], kind: &str, count: usize) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, None);
        self.accessor(view, 5126, kind, count)
    }

    fn floats(&mut self, values: &[f32], kind: &str, count: usize) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(34_962));
        self.accessor(view, 5126, kind, count)
    }

    fn accessor(&mut self, view: usize, component: u32, kind: &str, count: usize) -> usize {
        self.accessors.push(json!({"bufferView": view, "componentType": component, "count": count, "type": kind}));
        self.accessors.len() - 1
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.binary.extend(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    fn image(&mut self, image: &Image) -> Value {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, image.width, image.height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        encoder
            .write_header()
            .and_then(|mut w| w.write_image_data(image.rgba.as_flattened()))
            .expect("writing to memory cannot fail");
        json!({"bufferView": self.view(&bytes, None), "mimeType": "image/png"})
    }

    fn material(&mut self, m: &Material) -> Value {
        let mut pbr = json!({"baseColorFactor": numbers(&m.base_color),
            "metallicFactor": number(m.metallic), "roughnessFactor": number(m.roughness)});
        if let Some(texture) = m.base_color_texture {
            pbr["baseColorTexture"] = json!({"index": texture});
        }
        if let Some(texture) = m.surface_texture {
            pbr["metallicRoughnessTexture"] = json!({"index": texture});
        }
        let mut out = json!({"name": m.name, "pbrMetallicRoughness": pbr, "doubleSided": m.double_sided});
        if let Some(texture) = m.normal_texture {
            out["normalTexture"] = json!({"index": texture, "scale": number(m.normal_scale)});
        }
        match m.alpha_mode {
            AlphaMode::Opaque => {}
            AlphaMode::Mask(cutoff) => {
                out["alphaMode"] = "MASK".into();
                out["alphaCutoff"] = number(cutoff);
            }
            AlphaMode::Blend => out["alphaMode"] = "BLEND".into(),
        }
        let mut extensions = Map::new();
        let mut extend = |name: &'static str, value: Value| {
            self.extensions.insert(name);
            extensions.insert(name.into(), value);
        };
        let strength = m.emission.into_iter().fold(0.0, f32::max);
        if strength > 0.0 {
            out["emissiveFactor"] = numbers(&m.emission.map(|e| e / strength));
            extend("KHR_materials_emissive_strength", json!({"emissiveStrength": number(strength)}));
            if let Some(texture) = m.emission_texture {
                out["emissiveTexture"] = json!({"index": texture});
            }
        }
        let specular_textures =
            [("specularTexture", m.specular_texture), ("specularColorTexture", m.specular_color_texture)];
        let has_textures = specular_textures.iter().any(|(_, texture)| texture.is_some());
        if m.specular != 1.0 || m.specular_color != [1.0; 3] || has_textures {
            let mut specular = json!({"specularFactor": number(m.specular)});
            add_textures(&mut specular, specular_textures);
            if m.specular_color != [1.0; 3] {
                specular["specularColorFactor"] = numbers(&m.specular_color);
            }
            extend("KHR_materials_specular", specular);
        }
        if m.clearcoat != 0.0 {
            let roughness = number(m.clearcoat_roughness);
            let mut coat = json!({"clearcoatFactor": number(m.clearcoat), "clearcoatRoughnessFactor": roughness});
            let textures = [
                ("clearcoatTexture", m.clearcoat_texture),
                ("clearcoatRoughnessTexture", m.clearcoat_roughness_texture),
            ];
            add_textures(&mut coat, textures);
            extend("KHR_materials_clearcoat", coat);
        }
        if m.ior != 1.5 {
            extend("KHR_materials_ior", json!({"ior": number(m.ior)}));
        }
        if m.transmission != 0.0 {
            let mut transmission = json!({"transmissionFactor": number(m.transmission)});
            add_textures(&mut transmission, [("transmissionTexture", m.transmission_texture)]);
            extend("KHR_materials_transmission", transmission);
        }
        if !extensions.is_empty() {
            out["extensions"] = extensions.into();
        }
        if let Some(thin) = m.thin {
            out["extras"]["thin"] = thin.into();
        }
        if m.thickness != 0.0 {
            out["extras"]["thickness"] = number(m.thickness);
        }
        if let Some(index) = m.group_ior {
            out["extras"]["group_ior"] = number(index);
        }
        out
    }

    /// The node of the light. A punctual light is also added to the list of KHR_lights_punctual.
    fn light(&mut self, light: &Light, punctual: &mut Vec<Value>) -> Value {
        let transform = super::parts::look(light.position, light.direction);
        let described = |kind: &str, rgb: [f32; 3]| {
            let peak = rgb.into_iter().fold(0.0, f32::max);
            let color = rgb.map(|c| if peak > 0.0 { c / peak } else { 1.0 });
            json!({"type": kind, "name": light.node, "intensity": number(peak), "color": numbers(&color)})
        };
        let entry = match light.kind {
            LightKind::Beam { power, radius } => {
                let emitter = json!({"type": "collimated_beam", "radius": number(radius), "power": numbers(&power)});
                let node = json!({"name": light.node, "extras": {"emitter": emitter}});
                return with(node, pose(&transform));
            }
            LightKind::Point { intensity } => described("point", intensity),
            LightKind::Directional { irradiance } => described("directional", irradiance),
            LightKind::Sky { .. } => unreachable!("generated scenes have no sky, and glTF has no such light"),
            LightKind::Spot { intensity, inner, outer } => {
                let cone = json!({"innerConeAngle": number(inner), "outerConeAngle": number(outer)});
                with(described("spot", intensity), json!({"spot": cone}))
            }
        };
        self.extensions.insert("KHR_lights_punctual");
        punctual.push(entry);
        let node = json!({"name": light.node,
            "extensions": {"KHR_lights_punctual": {"light": punctual.len() - 1}}});
        with(node, pose(&transform))
    }
}

/// Adds the textures that exist to the JSON of an extension, each under its key.
fn add_textures<const N: usize>(extension: &mut Value, textures: [(&str, Option<u32>); N]) {
    for (key, texture) in textures {
        if let Some(index) = texture {
            extension[key] = json!({"index": index});
        }
    }
}

fn camera(camera: &Camera) -> Value {
    let mut out = match camera.projection {
        Projection::Perspective { yfov } => {
            let mut perspective = json!({"yfov": number(yfov as f32), "znear": 0.01});
            if let Some(aspect) = camera.aspect {
                perspective["aspectRatio"] = number(aspect as f32);
            }
            json!({"type": "perspective", "name": camera.name, "perspective": perspective})
        }
        Projection::Orthographic { height } => {
            let half_width = 0.5 * height * camera.aspect.unwrap_or(1.0);
            // The loader ignores the far plane, but glTF requires one.
            let orthographic = json!({"xmag": number(half_width as f32), "ymag": number(0.5 * height as f32),
                "znear": 0.0, "zfar": 1e6});
            json!({"type": "orthographic", "name": camera.name, "orthographic": orthographic})
        }
        _ => panic!("glTF has no camera like '{}'", camera.name),
    };
    if let Some([width, height]) = camera.resolution {
        out["extras"] = json!({"width": width, "height": height});
    }
    if camera.principal_point != Camera::CENTRED {
        out["extras"]["principal_point"] = json!(camera.principal_point);
    }
    out
}

/// JSON keys for the transform of a node that may scale or shear; none for the identity.
fn matrix(transform: &DAffine3) -> Value {
    if *transform == DAffine3::IDENTITY {
        return json!({});
    }
    let columns = glam::DMat4::from(*transform).to_cols_array();
    json!({"matrix": numbers(&columns.map(|x| x as f32))})
}

/// JSON keys for the transform of a node that only rotates and translates.
fn pose(transform: &DAffine3) -> Value {
    let rotation = DQuat::from_mat3(&transform.matrix3).normalize().to_array().map(|x| x as f32);
    let translation = transform.translation.to_array().map(|x| x as f32);
    json!({"rotation": numbers(&rotation), "translation": numbers(&translation)})
}

fn wrap(wrap: Wrap) -> u32 {
    match wrap {
        Wrap::Repeat => 10_497,
        Wrap::Mirror => 33_648,
        Wrap::Clamp => 33_071,
    }
}

/// The shortest decimal that reads back as the same f32; otherwise 0.4 would print as 0.4000000059604645.
fn number(x: f32) -> Value {
    let shortest: f64 = x.to_string().parse().expect("a printed float parses");
    json!(shortest)
}

fn numbers(xs: &[f32]) -> Value {
    xs.iter().map(|&x| number(x)).collect()
}

/// Merges two JSON objects.
fn with(mut object: Value, more: Value) -> Value {
    if let (Value::Object(object), Value::Object(more)) = (&mut object, more) {
        object.extend(more);
    }
    object
}

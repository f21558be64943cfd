use super::*;

/// Small enough to be quick.
fn kinds() -> [Kind; 4] {
    [
        Kind::CornellBox,
        Kind::GatedSphere { radius: 1.0, subdivisions: 3, albedo: 0.5 },
        Kind::DoorAjar,
        Kind::ClutteredRoom { triangles: 20_000 },
    ]
}

#[test]
fn names_parse_to_their_kind() {
    for name in Kind::NAMES {
        assert_eq!(Kind::parse(name).unwrap().name(), name);
    }
    assert_eq!(Kind::parse("teapot"), None);
}

#[test]
fn header_and_chunks_have_their_sizes() {
    let word = |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    for kind in kinds() {
        let bytes = scene(kind);
        assert_eq!(&bytes[..4], b"glTF");
        assert_eq!((word(&bytes, 4), word(&bytes, 8)), (2, bytes.len()));
        let json = word(&bytes, 12);
        assert_eq!((json % 4, &bytes[16..20]), (0, b"JSON".as_slice()));
        let binary = word(&bytes, 20 + json);
        assert_eq!((binary % 4, &bytes[24 + json..28 + json]), (0, b"BIN\0".as_slice()));
        assert_eq!(28 + json + binary, bytes.len());
    }
}

#[test]
fn the_same_bytes_every_time() {
    for kind in kinds() {
        assert!(scene(kind) == scene(kind), "{}", kind.name());
    }
}

#[test]
fn triangle_counts() {
    assert_eq!(triangle_count(&build(Kind::CornellBox)), 6 * 2 + 2 * 12);
    assert_eq!(triangle_count(&build(Kind::parse("gated-sphere").unwrap())), 81_920);
    let door = triangle_count(&build(Kind::DoorAjar));
    assert!((5_000..=20_000).contains(&door), "{door}");
    for least in [20_000, 200_000] {
        let room = build(Kind::ClutteredRoom { triangles: least });
        let stored: usize = room.meshes.iter().map(|m| m.triangles.len()).sum();
        let count = triangle_count(&room);
        assert!(count >= least as usize && count < 2 * least as usize && stored < count, "{stored} {count}");
    }
}

#[test]
fn the_gltf_crate_reads_what_was_written() {
    for kind in kinds() {
        let plain = build(kind);
        let file = gltf::Gltf::from_slice(&scene(kind)).unwrap();
        assert_eq!(file.meshes().count(), plain.meshes.len());
        assert_eq!(file.materials().count(), plain.materials.len());
        assert_eq!(file.images().count(), plain.images.len());
        assert_eq!(file.nodes().count(), plain.instances.len() + plain.cameras.len() + plain.lights.len());
        let blob = file.blob.as_deref().unwrap();
        for (mesh, plain) in file.meshes().zip(&plain.meshes) {
            let primitive = mesh.primitives().next().unwrap();
            let reader = primitive.reader(|_| Some(blob));
            assert!(reader.read_positions().unwrap().eq(plain.positions.iter().copied()));
            let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
            assert_eq!(indices, plain.triangles.as_flattened());
            assert_eq!(reader.read_normals().map_or(0, |n| n.count()), plain.normals.len());
            assert_eq!(reader.read_tex_coords(0).map_or(0, |t| t.into_f32().count()), plain.uvs.len());
        }
        for (node, instance) in file.nodes().zip(&plain.instances) {
            let [x, y, z] = [0, 1, 2].map(|i| f64::from(node.transform().matrix()[3][i]));
            assert!((instance.transform.translation - glam::DVec3::new(x, y, z)).length() < 1e-6);
        }
        let camera = file.nodes().find(|n| n.name() == Some("camera")).unwrap();
        let extras = camera.camera().unwrap().extras().as_ref().unwrap().get().to_owned();
        let [width, height] = plain.cameras[0].resolution.unwrap();
        assert_eq!(extras, format!("{{\"height\":{height},\"width\":{width}}}"));
    }
}

#[test]
fn images_are_png() {
    let bytes = scene(Kind::DoorAjar);
    let file = gltf::Gltf::from_slice(&bytes).unwrap();
    let plain = build(Kind::DoorAjar);
    for (image, plain) in file.images().zip(&plain.images) {
        let gltf::image::Source::View { view, .. } = image.source() else { panic!("not embedded") };
        let data = &file.blob.as_ref().unwrap()[view.offset()..view.offset() + view.length()];
        let decoded = image::load_from_memory(data).unwrap().to_rgba8();
        assert_eq!(decoded.into_raw(), plain.rgba.as_flattened());
    }
}

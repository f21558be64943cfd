use super::*;

/// Every kind of scene, small enough for quick tests.
fn kinds() -> [Kind; 8] {
    [
        Kind::CornellBox,
        Kind::GatedSphere { radius: 1.0, subdivisions: 3, albedo: 0.5 },
        Kind::DoorAjar,
        Kind::ClutteredRoom { triangles: 20_000 },
        Kind::Zoo(zoo::Light::Area),
        Kind::Zoo(zoo::Light::Punctual),
        Kind::Zoo(zoo::Light::Beam),
        Kind::HundredLamps,
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
        let bytes = glb_bytes(kind);
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
        assert!(glb_bytes(kind) == glb_bytes(kind), "{}", kind.name());
    }
}

#[test]
fn a_divided_box_is_the_same_box() {
    let (plain, divided) = (build(Kind::CornellBox), build(Kind::CornellBox.with(Some(0.2), Some(600)).unwrap()));
    assert!(plain.materials.iter().zip(&divided.materials).all(|(a, b)| a.metallic == 0.0 || b.roughness == 0.2));
    let area = |mesh: &crate::scene::Mesh| -> f64 {
        let corner = |i: u32| glam::Vec3::from(mesh.positions[i as usize]).as_dvec3();
        let area = |t: &[u32; 3]| (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0])).length() / 2.0;
        mesh.triangles.iter().map(area).sum()
    };
    for (a, b) in plain.meshes.iter().zip(&divided.meshes) {
        assert!((area(a) - area(b)).abs() < 1e-6 * area(a), "{}", a.name);
        let facing = |m: &crate::scene::Mesh| {
            let corner = |i: u32| glam::Vec3::from(m.positions[i as usize]);
            m.triangles
                .iter()
                .map(|t| (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0])))
                .sum::<glam::Vec3>()
        };
        assert!((facing(a) - facing(b)).length() < 1e-5, "{}", a.name);
    }
    assert_eq!(glb_bytes(Kind::CornellBox), glb_bytes(Kind::CornellBox.with(Some(0.45), Some(36)).unwrap()));
}

#[test]
fn options_that_a_scene_lacks_are_refused() {
    let wrong = |kind: Kind, roughness, triangles| kind.with(roughness, triangles).unwrap_err();
    assert!(wrong(Kind::DoorAjar, Some(0.5), None).contains("door-ajar has no roughness"));
    assert!(wrong(Kind::DoorAjar, None, Some(5)).contains("door-ajar has no number"));
    assert!(wrong(Kind::CornellBox, Some(1.5), None).contains("from 0 to 1"));
    assert!(wrong(Kind::CornellBox, Some(f32::NAN), None).contains("from 0 to 1"));
    assert!(wrong(Kind::CornellBox, None, Some(u32::MAX)).contains("too many"));
    assert_eq!(Kind::DoorAjar.with(None, None), Ok(Kind::DoorAjar));
}

#[test]
fn triangle_counts() {
    assert_eq!(triangle_count(&build(Kind::CornellBox)), 6 * 2 + 2 * 12);
    assert_eq!(triangle_count(&build(Kind::parse("gated-sphere").unwrap())), 81_920);
    for (requested, actual) in [(0, 36), (36, 36), (37, 138), (2_000, 2_178), (30_000, 34_818)] {
        let scene = build(Kind::CornellBox.with(None, Some(requested)).unwrap());
        assert_eq!(triangle_count(&scene), actual, "{requested} requested");
    }
    let door = triangle_count(&build(Kind::DoorAjar));
    assert!((5_000..=20_000).contains(&door), "{door}");
    for at_least in [20_000, 200_000] {
        let room = build(Kind::ClutteredRoom { triangles: at_least });
        let stored: usize = room.meshes.iter().map(|m| m.triangles.len()).sum();
        let count = triangle_count(&room);
        assert!(count >= at_least as usize && count < 2 * at_least as usize && stored < count, "{stored} {count}");
    }
}

#[test]
fn the_gltf_crate_reads_what_was_written() {
    for kind in kinds() {
        let plain = build(kind);
        let file = gltf::Gltf::from_slice(&glb_bytes(kind)).unwrap();
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
    let bytes = glb_bytes(Kind::DoorAjar);
    let file = gltf::Gltf::from_slice(&bytes).unwrap();
    let plain = build(Kind::DoorAjar);
    for (image, plain) in file.images().zip(&plain.images) {
        let gltf::image::Source::View { view, .. } = image.source() else { panic!("not embedded") };
        let data = &file.blob.as_ref().unwrap()[view.offset()..view.offset() + view.length()];
        let mut reader = png::Decoder::new(std::io::Cursor::new(data)).read_info().unwrap();
        assert_eq!(reader.output_color_type(), (png::ColorType::Rgba, png::BitDepth::Eight));
        let mut rgba = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut rgba).unwrap();
        assert_eq!(rgba, plain.rgba.as_flattened());
    }
}

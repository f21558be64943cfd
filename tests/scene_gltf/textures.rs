//! Textures and their images: formats, sharing, and memory.

use image_webp::ColorType::Rgb8;
use taugate::internals::scene::Material;
use taugate::internals::scene::gltf::load;

use super::images::webp;
use super::*;
#[cfg(target_os = "linux")]
use crate::peak::{helper, peak};

/// The complete scene without images and textures; its material uses texture 0.
fn untextured() -> Glb {
    let mut glb = complete();
    glb.json["images"] = json!([]);
    glb.json["textures"] = json!([]);
    glb
}

/// Adds a material with a triangle of its own that uses texture `texture`.
fn use_texture(glb: &mut Glb, texture: usize) {
    let name = format!("Paint{texture}");
    let material = glb.push(
        "materials",
        json!({ "name": name, "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } }),
    );
    let mut primitive = glb.json["meshes"][0]["primitives"][0].clone();
    primitive["material"] = json!(material);
    glb.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive);
}

/// A 4 x 4 PNG of one colour.
fn plain([r, g, b]: [u8; 3]) -> Vec<u8> {
    glb::png(4, &[[r, g, b, 255]; 16])
}

/// A black PNG with one bit per pixel: `side` x `side` pixels take `side` x `side` / 250,000 bytes.
fn black_png(side: u32) -> Vec<u8> {
    let mut bytes = vec![];
    let mut encoder = png::Encoder::new(&mut bytes, side, side);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::One);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&vec![0; side as usize / 8 * side as usize]).unwrap();
    writer.finish().unwrap();
    bytes
}

#[test]
fn images_with_the_same_data_are_decoded_once() {
    let mut glb = untextured();
    let view = glb.view(&plain([10, 20, 30]));
    let same_bytes = glb.json["bufferViews"][view].clone();
    let copy = glb.push("bufferViews", same_bytes);
    let other = glb.view(&plain([30, 20, 10]));
    for view in [view, view, copy, other] {
        glb.push("images", json!({ "bufferView": view }));
    }
    let clamp = glb.push("samplers", json!({ "wrapS": 33071, "wrapT": 33071 }));
    for (texture, image) in [0, 1, 2, 3, 0].into_iter().enumerate() {
        glb.push("textures", json!({ "source": image }));
        use_texture(&mut glb, texture);
    }
    glb.json["textures"][4]["sampler"] = json!(clamp);
    let scene = read(&glb);
    assert_eq!(scene.textures.iter().map(|texture| texture.image).collect::<Vec<_>>(), [0, 0, 0, 1, 0]);
    assert!(scene.textures[4].wrap != scene.textures[1].wrap);
    let colors: Vec<[u8; 4]> = scene.images.iter().map(|image| image.rgba[0]).collect();
    assert_eq!(colors, [[10, 20, 30, 255], [30, 20, 10, 255]]);

    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("wood.png"), plain([1, 2, 3])).unwrap();
    let mut glb = untextured();
    for texture in 0..2 {
        glb.push("images", json!({ "uri": "wood.png" }));
        glb.push("textures", json!({ "source": texture }));
        use_texture(&mut glb, texture);
    }
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, glb.build()).unwrap();
    assert_eq!(load(&path).unwrap().images.len(), 1);
}

#[test]
fn webp_textures_are_read() {
    let mut glb = untextured();
    let webp = glb.view(&webp(4, Rgb8, &[10, 200, 30].repeat(16)));
    let png = glb.view(&plain([1, 1, 1]));
    glb.push("images", json!({ "bufferView": webp, "mimeType": "image/webp" }));
    glb.push("images", json!({ "bufferView": png }));
    glb.push("textures", json!({ "source": 1, "extensions": { "EXT_texture_webp": { "source": 0 } } }));
    glb.json["extensionsRequired"] = json!(["EXT_texture_webp"]);
    let scene = read(&glb);
    assert_eq!((scene.images.len(), scene.images[0].rgba[5]), (1, [10, 200, 30, 255]));
    assert!(scene.warnings.iter().all(|warning| !warning.contains("webp")), "{:?}", scene.warnings);

    glb.json["textures"][0] = json!({ "extensions": { "EXT_texture_webp": { "source": 7 } } });
    let message = refusal(&glb.build());
    assert!(message.contains("texture 0 (the baseColorTexture of material `Paint`) has no PNG"), "{message}");
}

#[test]
fn other_formats_are_refused_with_a_remedy_unless_there_is_a_second_image() {
    let mut glb = untextured();
    let png = glb.view(&plain([1, 2, 3]));
    let avif = glb.view(b"\0\0\0\x1cftypavif\0\0\0\0mif1miaf");
    let ktx = glb.view(b"\xabKTX 20\xbb\r\n\x1a\n\0\0\0\0");
    for view in [png, avif, ktx] {
        glb.push("images", json!({ "bufferView": view }));
    }
    glb.push("textures", json!({ "source": 0, "extensions": { "KHR_texture_basisu": { "source": 2 } } }));
    let scene = read(&glb);
    assert_eq!(scene.images[0].rgba[0], [1, 2, 3, 255]);
    let fallback = "textures with KHR_texture_basisu show their PNG or JPEG image instead (first: the baseColorTexture";
    assert!(scene.warnings.iter().any(|warning| warning.contains(fallback)), "{:?}", scene.warnings);

    for (texture, words) in [
        (
            json!({ "extensions": { "EXT_texture_avif": { "source": 1 } } }),
            ["has no PNG", "npx @gltf-transform/cli png"],
        ),
        (
            json!({ "source": 1 }),
            ["image `image 1` (the baseColorTexture of material `Paint`)", "AVIF is not read; convert"],
        ),
        (json!({ "source": 2 }), ["image `image 2` (the baseColorTexture of material `Paint`)", "KTX2 is not read; "]),
    ] {
        glb.json["textures"][0] = texture;
        let message = refusal(&glb.build());
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    }
}

#[test]
fn a_missing_or_broken_image_file_is_named_with_its_material() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    let mut glb = complete();
    glb.json["images"][0] = json!({ "name": "Wood", "uri": "wood.png" });
    std::fs::write(&path, glb.build()).unwrap();
    let name = "scene.glb: image `Wood` (the baseColorTexture of material `Paint`)";
    let message = load(&path).unwrap_err().to_string();
    assert!(message.contains(name) && message.contains("`wood.png`, which cannot be opened"), "{message}");
    let whole = plain([1, 2, 3]);
    // The second file has a good header, but ends too early.
    for broken in [&b"no image"[..], &whole[..50]] {
        std::fs::write(folder.path().join("wood.png"), broken).unwrap();
        let message = load(&path).unwrap_err().to_string();
        assert!(message.contains(name) && message.contains("cannot be decoded from `wood.png`"), "{message}");
    }
}

/// Loads the scene in another process. Returns the maximum of its memory in MiB, and the number of images or the error.
#[cfg(target_os = "linux")]
fn peak_of(glb: &Glb) -> (u64, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, glb.build()).unwrap();
    peak("textures::helper_peak", &path)
}

#[cfg(target_os = "linux")]
#[test]
#[ignore = "a helper of the tests below, which start it with a scene"]
fn helper_peak() {
    helper(|path| load(path).map_or_else(|e| e.to_string(), |scene| format!("{} images", scene.images.len())));
}

/// A file of 300 KB with many names for one image once took 4 GiB.
#[cfg(target_os = "linux")]
#[test]
fn an_image_takes_the_memory_of_its_texels_once_however_many_names_it_has() {
    let mut glb = untextured();
    let view = glb.view(&black_png(8192));
    for texture in 0..64 {
        glb.push("images", json!({ "bufferView": view }));
        glb.push("textures", json!({ "source": texture }));
        use_texture(&mut glb, texture);
    }
    // The texels of the image take 256 MiB.
    let (peak, outcome) = peak_of(&glb);
    assert!(outcome == "1 images" && (256..320).contains(&peak), "{peak} MiB: {outcome}");
}

#[cfg(target_os = "linux")]
#[test]
fn images_that_are_too_large_together_are_refused_before_one_is_decoded() {
    let mut glb = untextured();
    for texture in 0..9 {
        let view = glb.view(&black_png(if texture == 3 { 8200 } else { 8192 }));
        glb.push("images", json!({ "name": format!("Night{texture}"), "bufferView": view }));
        glb.push("textures", json!({ "source": texture }));
        use_texture(&mut glb, texture);
    }
    let (peak, outcome) = peak_of(&glb);
    for word in ["need 2.3 GiB", "at most 2 GiB", "`Night3` (the baseColorTexture of material `Paint3`)", "8200 x 8200"]
    {
        assert!(outcome.contains(word), "{outcome}");
    }
    assert!(peak < 64, "{peak} MiB");
}

/// A file of a hundred bytes once took a gigabyte before its end was noticed.
#[test]
fn images_that_are_too_short_for_their_size_are_refused_before_they_are_decoded() {
    let mut file = plain([1, 2, 3]);
    // Width and height are in the header, whose checksum follows.
    file[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x40, 0]);
    let checksum = file[12..29].iter().fold(!0u32, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| sum >> 1 ^ (0xedb8_8320 & (sum & 1).wrapping_neg()))
    });
    file[29..33].copy_from_slice(&(!checksum).to_be_bytes());
    let mut glb = untextured();
    let view = glb.view(&file);
    glb.push("images", json!({ "bufferView": view }));
    glb.push("textures", json!({ "source": 0 }));
    use_texture(&mut glb, 0);
    let message = refusal(&glb.build());
    assert!(message.contains("too few for their 268435456 pixels"), "{message}");
}

/// The decoder keeps a second copy of a lossless image without alpha. A file of 35 bytes once took 320 MB.
#[test]
fn a_large_webp_image_opens_but_not_if_it_is_too_short_for_the_memory_of_its_decoder() {
    let file = webp(8192, Rgb8, &vec![128; 3 * 8192 * 4096]);
    let scene = |bytes: &[u8]| {
        let mut glb = untextured();
        let view = glb.view(bytes);
        glb.push("images", json!({ "bufferView": view }));
        glb.push("textures", json!({ "source": 0 }));
        use_texture(&mut glb, 0);
        glb.build()
    };
    let image = &load_slice(&scene(&file), Path::new("test.glb")).unwrap().images[0];
    assert_eq!((image.width, image.height), (8192, 4096));
    let message = refusal(&scene(&file[..100]));
    assert!(message.contains("too few for their 33554432 pixels"), "{message}");
}

/// A material that kept such an emission would count as a lamp, and the scene would get no headlamp.
#[test]
fn an_emission_texture_without_light_removes_the_emission() {
    for (color, factor, shines) in
        [([0, 0, 0], [1, 1, 1], false), ([9, 0, 0], [0, 1, 1], false), ([0, 1, 0], [0, 1, 1], true)]
    {
        let mut glb = untextured();
        let view = glb.view(&plain(color));
        glb.push("images", json!({ "bufferView": view }));
        glb.push("textures", json!({ "source": 0 }));
        let paint = &mut glb.json["materials"][0];
        paint["emissiveFactor"] = json!(factor);
        paint["emissiveTexture"] = json!({ "index": 0 });
        let scene = read(&glb);
        check_invariants(&scene);
        let Material { emission, emission_texture, .. } = &scene.materials[0];
        assert_eq!((*emission != [0.0; 3], emission_texture.is_some()), (shines, shines), "{color:?} {factor:?}");
    }
}

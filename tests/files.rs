//! Image files: the program reads back the files that it writes, and refuses hostile files before it reserves memory for them.

#[cfg(target_os = "linux")]
#[path = "common/peak.rs"]
mod peak;

use std::path::Path;
use std::time::Duration;

use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Blocks, Compression, Encoding, FlatSamples, Image, IntegerBounds, Layer,
    LayerAttributes, MetaData, SampleType, Vec2, WritableImage, f16,
};
use taugate::internals::generate::{Kind, build};
use taugate::internals::image::exr_file::{self, Merged, Provenance, read_picture};
use taugate::internals::image::exr_header::read_size;
use taugate::internals::image::film::Film;
use taugate::internals::image::layers::{Layers, Plane};
use taugate::internals::image::png_file;
use taugate::internals::image::response_film::ResponseFilm;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::resolve;
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Budget, Crop, Estimator, Responses, Settings};

const SETTINGS: &str = "scene = \"röom.glb\"\n\n[gate]\ngate = \"12.5m..12.8m\"\n";

const MERGED: Merged = Merged { share: 0.25, radius: 1.2 };

/// Writes a film of 6 x 4 pixels, a crop of 10 x 8, with two iterations that differ. Returns the film.
fn write(path: &Path) -> Film {
    let mut film = Film::new(6, 4);
    let image = |scale: f32| -> Vec<f32> { (0..72).map(|i| scale * i as f32).collect() };
    film.add(&image(1.0), 3);
    film.add(&image(2.0), 1);
    let provenance = Provenance {
        resolution: [10, 8],
        crop: Crop { x0: 3, x1: 9, y0: 2, y1: 6 },
        responses: Gate { lo: 12.5, hi: 12.8 }.into(),
        seed: u32::MAX,
        seconds: 1.5,
        settings: SETTINGS.into(),
        merged: Some(MERGED),
    };
    exr_file::write(path, &film, &provenance).unwrap();
    film
}

#[test]
fn an_exr_is_read_back_with_its_metadata() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    let film = write(&path);

    let picture = read_picture(&path).unwrap();
    assert_eq!((picture.width, picture.height), (6, 4));
    assert_eq!(picture.rgb, film.mean());
    assert_eq!(picture.variance, Some(film.variance_of_mean()));
    assert_eq!(picture.merged, Some(MERGED));

    let meta = MetaData::read_from_file(&path, true).unwrap();
    let [header] = &meta.headers[..] else { panic!("one part") };
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    assert_eq!(names, ["B", "G", "R", "Variance.B", "Variance.G", "Variance.R"]);
    let window = header.data_window();
    assert_eq!((window.position.0, window.position.1, window.size.0, window.size.1), (3, 2, 6, 4));
    let display = header.shared_attributes.display_window;
    assert_eq!((display.position.0, display.position.1, display.size.0, display.size.1), (0, 0, 10, 8));

    let value = |name: &str| {
        let found = header.own_attributes.other.iter().find(|(key, _)| key.bytes() == name.as_bytes());
        found.unwrap_or_else(|| panic!("no attribute {name}")).1.clone()
    };
    assert_eq!(value("tof:gateMin_m"), AttributeValue::F64(12.5));
    assert_eq!(value("tof:gateMax_m"), AttributeValue::F64(12.8));
    assert_eq!(value("tof:gateMin_ns"), AttributeValue::F64(12.5 / 0.299792458));
    assert_eq!(value("tof:gateMax_ns"), AttributeValue::F64(12.8 / 0.299792458));
    assert_eq!(value("tof:c_m_per_s"), AttributeValue::F64(299_792_458.0));
    assert_eq!(value("samplesPerPixel"), AttributeValue::I32(4));
    assert_eq!(value("renderTimeSeconds"), AttributeValue::F32(1.5));
    assert_eq!(value("tof:varianceBatches"), AttributeValue::I32(2));
    let text = |name: &str| match value(name) {
        AttributeValue::Text(text) => String::from_utf8(text.bytes().to_vec()).unwrap(),
        other => panic!("{name} is {other:?}"),
    };
    assert_eq!(text("tof:convention"), "optical_path_length");
    assert_eq!(text("tof:seed"), "4294967295");
    assert!(text("tof:version").starts_with("taugate "));
    assert_eq!(text("tof:settings"), SETTINGS);
}

/// Auxiliary layers are channels beside the image, which `compare` reads as before.
#[test]
fn auxiliary_layers_stand_beside_the_image() {
    let folder = tempfile::tempdir().unwrap();
    let [plain, path] = ["plain.exr", "out.exr"].map(|name| folder.path().join(name));
    let film = write(&plain);
    let provenance = Provenance {
        resolution: [10, 8],
        crop: Crop { x0: 3, x1: 9, y0: 2, y1: 6 },
        responses: Gate::OPEN.into(),
        seed: 0,
        seconds: 1.5,
        settings: SETTINGS.into(),
        merged: None,
    };
    let channels = vec![
        ("depth.Z".into(), Plane::Floats((0..24).map(|i| i as f32).collect())),
        ("object.ID".into(), Plane::Ids((0..24).map(|i| i % 3).collect())),
    ];
    let objects = [(1, "Größe \"x\"".to_string()), (2, "wall".into())].into();
    exr_file::write_with_layers(&path, &film, &provenance, &Layers { channels, objects }).unwrap();
    let (with, without) = (read_picture(&path).unwrap(), read_picture(&plain).unwrap());
    assert_eq!((with.rgb, with.variance), (without.rgb, without.variance));

    let meta = MetaData::read_from_file(&path, true).unwrap();
    let header = &meta.headers[0];
    let names: Vec<(String, SampleType)> =
        header.channels.list.iter().map(|c| (c.name.to_string(), c.sample_type)).collect();
    assert_eq!(names[6], ("depth.Z".into(), SampleType::F32));
    assert_eq!(names[7], ("object.ID".into(), SampleType::U32));
    let (_, value) = header.own_attributes.other.iter().find(|(key, _)| key.bytes() == b"tof:objects").unwrap();
    let AttributeValue::Text(text) = value else { panic!("not text: {value:?}") };
    let names: serde_json::Value = serde_json::from_slice(text.bytes()).unwrap();
    assert_eq!(names, serde_json::json!({ "1": "Größe \"x\"", "2": "wall" }));
}

#[test]
fn a_header_that_claims_a_huge_image_is_refused() {
    // An EXR states its size in two windows. Each holds two inclusive corners, as four little-endian integers after its type.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    write(&path);
    let bytes = std::fs::read(&path).unwrap();
    // More pixels than any image may have, and more than these bytes can hold.
    for (last, part) in [(199_999_i32, "200000 x 200000"), (7999, "8000 x 8000 pixels, too many for its")] {
        let mut bytes = bytes.clone();
        for window in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
            let at = bytes.windows(window.len()).position(|w| w == window).unwrap() + window.len() + 4;
            for (i, value) in [0, 0, last, last].into_iter().enumerate() {
                bytes[at + 4 * i..at + 4 * i + 4].copy_from_slice(&value.to_le_bytes());
            }
        }
        std::fs::write(&path, bytes).unwrap();
        let message = read_picture(&path).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
    // The display window of another program's picture alone.
    write_windows(&path, [0, 0], [4, 2], [0, 0]);
    let mut bytes = std::fs::read(&path).unwrap();
    let window = b"displayWindow\0box2i\0";
    let at = bytes.windows(window.len()).position(|w| w == window).unwrap() + window.len() + 12;
    bytes[at..at + 8].copy_from_slice(&[7999i32.to_le_bytes(); 2].concat());
    std::fs::write(&path, bytes).unwrap();
    let message = read_picture(&path).unwrap_err().to_string();
    assert!(message.contains("8000 x 8000 pixels, too many for its"), "{message}");
}

#[test]
fn damaged_files_give_errors_not_panics() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    write(&path);
    let whole = std::fs::read(&path).unwrap();
    let damaged = folder.path().join("damaged.exr");
    for at in 0..whole.len() {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x55;
        std::fs::write(&damaged, &bytes).unwrap();
        let _ = read_picture(&damaged);
        std::fs::write(&damaged, &whole[..at]).unwrap();
        assert!(read_picture(&damaged).is_err(), "a file cut to {at} of {} bytes is accepted", whole.len());
    }
}

/// Writes an image of `side` x `side` pixels.
fn write_channels(path: &Path, side: usize, channels: Vec<(String, FlatSamples)>, blocks: Blocks) {
    let encoding = Encoding { compression: Compression::ZIP16, blocks, ..Encoding::UNCOMPRESSED };
    let channels = channels.into_iter().map(|(name, samples)| AnyChannel::new(name.as_str(), samples)).collect();
    let layer = Layer::new((side, side), LayerAttributes::default(), encoding, AnyChannels::sort(channels));
    Image::from_layer(layer).write().to_file(path).unwrap();
}

/// `count` channels for data that taugate does not need, then R, G and B.
fn with_others(side: usize, count: usize) -> Vec<(String, FlatSamples)> {
    let others = (0..count).map(|c| format!("other.{c:03}"));
    let names = others.chain(["R", "G", "B"].map(String::from));
    names.enumerate().map(|(c, name)| (name, FlatSamples::F32(vec![c as f32; side * side]))).collect()
}

#[test]
fn images_of_other_programs_have_other_types_tiles_and_channels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tiles.exr");
    let side = 37;
    let at = |c: usize| (0..side * side).map(move |i| c * 1000 + i % 500);
    let channels = || {
        vec![
            ("R".to_string(), FlatSamples::F16(at(0).map(|i| f16::from_f32(i as f32)).collect())),
            ("G".to_string(), FlatSamples::U32(at(1).map(|i| i as u32).collect())),
            ("depth".to_string(), FlatSamples::F32(at(9).map(|i| i as f32).collect())),
            ("B".to_string(), FlatSamples::F32(at(2).map(|i| i as f32).collect())),
            ("Variance.R".to_string(), FlatSamples::F32(at(3).map(|i| i as f32).collect())),
            ("Variance.G".to_string(), FlatSamples::F32(at(4).map(|i| i as f32).collect())),
        ]
    };
    let interleaved = |first: usize| -> Vec<f32> {
        (0..side * side).flat_map(|i| [0, 1, 2].map(|c| ((first + c) * 1000 + i % 500) as f32)).collect()
    };
    write_channels(&path, side, channels(), Blocks::Tiles(Vec2(16, 8)));
    let picture = read_picture(&path).unwrap();
    assert!((picture.width, picture.height) == (37, 37) && picture.rgb == interleaved(0));
    // Without the variance of blue, the variance is not known.
    assert!(picture.variance.is_none());
    let mut all = channels();
    all.push(("Variance.B".to_string(), FlatSamples::F32(at(5).map(|i| i as f32).collect())));
    write_channels(&path, side, all, Blocks::ScanLines);
    assert!(read_picture(&path).unwrap().variance == Some(interleaved(3)));

    write_channels(&path, side, with_others(side, 2).split_off(1), Blocks::ScanLines);
    assert!(read_picture(&path).is_ok());
    write_channels(&path, side, with_others(side, 2)[..4].to_vec(), Blocks::ScanLines);
    let message = read_picture(&path).unwrap_err().to_string();
    assert!(message.contains("has no channels R, G, B, only G, R, other.000, other.001;"), "{message}");
}

/// Writes a constant image whose data window begins at `at` and has this size, in a display window of 4 x 2 pixels from `origin`.
fn write_windows(path: &Path, [x, y]: [i32; 2], size: [usize; 2], origin: [i32; 2]) {
    let channels = ["R", "G", "B"].map(|name| AnyChannel::new(name, FlatSamples::F32(vec![3.0; size[0] * size[1]])));
    let attributes = LayerAttributes { layer_position: Vec2(x, y), ..LayerAttributes::default() };
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let mut image = Image::from_layer(Layer::new((size[0], size[1]), attributes, Encoding::UNCOMPRESSED, channels));
    image.attributes.display_window = IntegerBounds::new((origin[0], origin[1]), (4, 2));
    image.write().to_file(path).unwrap();
}

/// Many programs store only the part of a picture that is not black.
#[test]
fn the_picture_of_another_program_is_its_display_window() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("part.exr");
    for (at, size, origin, filled) in [
        ([0, 0], [4, 2], [0, 0], [0..4, 0..2]),
        ([0, 1], [4, 1], [0, 0], [0..4, 1..2]),
        ([2, 0], [1, 2], [0, 0], [2..3, 0..2]),
        // The data reach beyond the display window on all sides.
        ([-3, -1], [9, 4], [0, 0], [0..4, 0..2]),
        ([11, 20], [1, 5], [10, 20], [1..2, 0..2]),
    ] {
        write_windows(&path, at, size, origin);
        let picture = read_picture(&path).unwrap();
        let is_filled = |x: usize, y: usize| filled[0].contains(&x) && filled[1].contains(&y);
        let expected: Vec<f32> = (0..8).flat_map(|i| [if is_filled(i % 4, i / 4) { 3.0 } else { 0.0 }; 3]).collect();
        assert_eq!((picture.width, picture.height, picture.corner), (4, 2, [0, 0]), "{at:?}");
        assert_eq!(picture.rgb, expected, "{at:?}");
        assert_eq!(read_size(&path).unwrap(), [4, 2]);
    }
    // The data lie outside of the display window.
    for (at, size, origin) in [([4, 0], [4, 2], [0, 0]), ([i32::MIN / 4, i32::MIN / 4], [2, 2], [i32::MAX / 4, 0])] {
        write_windows(&path, at, size, origin);
        assert!(read_picture(&path).unwrap_err().to_string().contains("stores no pixel of its display window"));
    }
    // An image of taugate is its data window, because the pixels around a crop are not known.
    write(&path);
    let picture = read_picture(&path).unwrap();
    assert_eq!((picture.width, picture.height, picture.corner), (6, 4, [3, 2]));
    assert_eq!(read_size(&path).unwrap(), [6, 4]);
}

#[test]
fn a_tile_with_too_much_data_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tile.exr");
    write_channels(&path, 1024, with_others(1024, 15), Blocks::Tiles(Vec2(1024, 1024)));
    let message = read_picture(&path).unwrap_err().to_string();
    assert!(message.contains("blocks of 72 MiB") && message.contains("smaller tiles"), "{message}");
}

#[cfg(target_os = "linux")]
#[test]
#[ignore = "a helper of the test below, which starts it with an image"]
fn helper_peak() {
    peak::helper(|path| read_picture(path).map_or_else(|e| e.to_string(), |picture| picture.rgb.len().to_string()));
}

/// All channels of a small file were once decoded, whether taugate needs them or not.
#[cfg(target_os = "linux")]
#[test]
fn channels_that_are_not_needed_take_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("many.exr");
    write_channels(&path, 1024, with_others(1024, 60), Blocks::ScanLines);
    // All channels take 252 MiB, the three that are needed 12 MiB.
    let (peak, report) = peak::peak("helper_peak", &path);
    assert!(report == (3 << 20).to_string() && peak < 100, "{peak} MiB: {report}");
}

#[test]
fn a_png_has_the_size_and_a_black_image_is_black() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.png");
    let decode = |path: &Path| {
        let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        (info.width, info.height, pixels)
    };
    png_file::write(&path, 3, 2, &[0.0; 18], 1.0).unwrap();
    assert_eq!(decode(&path), (3, 2, vec![0; 18]));
    let grey = [1e-9; 18];
    png_file::write(&path, 3, 2, &grey, png_file::exposure(&grey)).unwrap();
    assert_eq!(decode(&path), (3, 2, vec![243; 18]));
    // Half of full white is 188 in sRGB.
    png_file::write(&path, 3, 2, &[0.125; 18], 4.0).unwrap();
    assert_eq!(decode(&path), (3, 2, vec![188; 18]));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// A program that uses the library has no experiment file: `write_exr` stores its settings as the text of such a file.
#[test]
fn write_exr_notes_the_settings_as_an_experiment() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    let settings = Settings::builder()
        .estimator(Estimator::Lcs)
        .gate(Gate { lo: 12.5, hi: 12.8 })
        .resolution([10, 8])
        .crop(Crop { x0: 3, y0: 2, x1: 9, y1: 6 })
        .budget(Budget::Spp(4))
        .build()
        .unwrap();
    taugate::write_exr(&path, &Film::new(6, 4), None, &settings, Duration::from_secs(1)).unwrap();
    let meta = MetaData::read_from_file(&path, true).unwrap();
    let attributes = &meta.headers[0].own_attributes.other;
    let (_, value) = attributes.iter().find(|(key, _)| key.bytes() == b"tof:settings").expect("the attribute");
    let AttributeValue::Text(text) = value else { panic!("not text: {value:?}") };
    let experiment = Experiment::parse(&text.to_string()).unwrap();
    let scene = build(Kind::CornellBox);
    assert_eq!(resolve(&experiment, &scene).unwrap().settings, settings, "{text}");
}

/// The file of several responses once held their sum, labelled with the first gate.
#[test]
fn write_exr_writes_the_image_of_each_response() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    let gates = Responses::from("1m..3m/2".parse::<Gates>().unwrap());
    let settings = Settings::builder().responses(gates).resolution([3, 2]).build().unwrap();
    let (film, time) = (Film::new(3, 2), Duration::ZERO);
    let images = ResponseFilm::new(6, 2, false);
    taugate::write_exr(&path, &film, Some(&images), &settings, time).unwrap();
    let meta = MetaData::read_from_file(&path, true).unwrap();
    let names: Vec<String> = meta.headers[0].channels.list.iter().map(|channel| channel.name.to_string()).collect();
    assert_eq!(names, ["B", "G", "R", "bin1.B", "bin1.G", "bin1.R"]);
    let single = Settings::builder().resolution([3, 2]).build().unwrap();
    let [pixels, responses] = [ResponseFilm::new(5, 2, false), ResponseFilm::new(6, 3, false)];
    for (film, images, settings, part) in [
        (&film, None, &settings, "is 2 in the settings, but 1 in the images"),
        (&film, Some(&responses), &settings, "is 2 in the settings, but 3 in the images"),
        (&film, Some(&images), &single, "is 1 in the settings, but 2 in the images"),
        (&film, Some(&pixels), &settings, "do not have the size of the crop, 3x2"),
        (&Film::new(2, 3), None, &single, "do not have the size of the crop, 3x2"),
    ] {
        let error = taugate::write_exr(&path, film, images, settings, time).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}

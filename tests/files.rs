//! Image files: the program reads back the files that it writes, and refuses hostile files before it reserves memory for them.

use std::path::Path;
use std::time::Duration;

use exr::prelude::{AttributeValue, MetaData};
use taugate::internals::generate::{Kind, build};
use taugate::internals::image::exr_file::{self, Provenance, read_picture};
use taugate::internals::image::film::Film;
use taugate::internals::image::png_file;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::resolve;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Budget, Crop, Estimator, Settings};

const SETTINGS: &str = "scene = \"röom.glb\"\n\n[gate]\ngate = \"12.5m..12.8m\"\n";

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

#[test]
fn a_header_that_claims_a_huge_image_is_refused() {
    // An EXR states its size in two windows. Each holds two inclusive corners, as four little-endian integers after its type.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.exr");
    write(&path);
    let mut bytes = std::fs::read(&path).unwrap();
    for window in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let at = bytes.windows(window.len()).position(|w| w == window).unwrap() + window.len() + 4;
        for (i, value) in [0, 0, 199_999, 199_999_i32].into_iter().enumerate() {
            bytes[at + 4 * i..at + 4 * i + 4].copy_from_slice(&value.to_le_bytes());
        }
    }
    std::fs::write(&path, bytes).unwrap();
    let message = read_picture(&path).unwrap_err().to_string();
    assert!(message.contains("200000 x 200000"), "{message}");
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
    png_file::write(&path, 3, 2, &[0.0; 18]).unwrap();
    assert_eq!(decode(&path), (3, 2, vec![0; 18]));
    png_file::write(&path, 3, 2, &[1e-9; 18]).unwrap();
    assert_eq!(decode(&path), (3, 2, vec![243; 18]));
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
    taugate::write_exr(&path, &Film::new(6, 4), &settings, Duration::from_secs(1)).unwrap();
    let meta = MetaData::read_from_file(&path, true).unwrap();
    let attributes = &meta.headers[0].own_attributes.other;
    let (_, value) = attributes.iter().find(|(key, _)| key.bytes() == b"tof:settings").expect("the attribute");
    let AttributeValue::Text(text) = value else { panic!("not text: {value:?}") };
    let experiment = Experiment::parse(&text.to_string()).unwrap();
    let scene = build(Kind::CornellBox);
    assert_eq!(resolve(&experiment, &scene).unwrap().settings, settings, "{text}");
}

use std::io::{Cursor, Write};

use super::file::{read, read_from, write, write_to};
use super::*;
use crate::image::layers::Plane;
use crate::settings::aov::Aov;
use crate::settings::shard::Shard;

const SETTINGS: &str = "scene = '/a.glb'\n[gate]\ngate = '1m..2m'\n[render]\nspp = 64\nseed = 3\n";

/// Iteration `i` of an image of 3 x 2 pixels: its values and its samples per pixel.
fn iteration(i: u32) -> ([f32; 18], u32) {
    let value =
        |k: usize| if (i as usize + k).is_multiple_of(5) { 0.0 } else { 0.1 + ((i * 37 + 11 * k as u32) % 29) as f32 };
    (std::array::from_fn(value), 1 + i % 4)
}

/// The accumulation of the iterations with these `numbers`, with `count` responses. In iteration i, response t has the values of
/// iteration i + t.
fn accumulation(numbers: impl IntoIterator<Item = u32>, count: usize, has_variance: bool) -> Accumulation {
    let mut film = Film::new(3, 2);
    let mut responses = ResponseFilm::new(6, count, has_variance);
    let mut iterations = Iterations::default();
    let (mut pixels, mut samples_so_far) = (vec![[0.0; 4]; 6], 0.0);
    for i in numbers {
        let (image, samples) = iteration(i);
        film.add(&image, samples);
        for t in 0..count as u32 {
            for (pixel, rgb) in iteration(i + t).0.chunks(3).enumerate() {
                responses.row_mut(pixel as u32).add(t, [rgb[0], rgb[1], rgb[2]].map(f64::from), samples);
            }
        }
        responses.end_iteration(samples);
        pixels.iter_mut().flatten().for_each(|x| *x += f64::from(samples));
        samples_so_far += f64::from(samples);
        iterations.add(i);
    }
    let about = About {
        format: FORMAT,
        version: "taugate 0.1.0".into(),
        renderer: "r".into(),
        scene: "s".into(),
        settings: SETTINGS.into(),
        files: vec![],
        resolution: [8, 8],
        crop: [1, 4, 2, 4],
        responses: (0..count).map(|t| format!("g{t}")).collect(),
        tables: BTreeMap::new(),
        seed: 3,
        merged: None,
        samples_per_pixel: film.samples(),
        dropped: 0,
        seconds: 0.1 * f64::from(film.iterations()),
        next_sample: 4 * iterations.end(),
        iterations,
        shards: vec![Shard::ALL],
        axes: AXES.into(),
    };
    let errors = Some((0..6).map(f64::from).collect());
    let state = AdaptiveState { pixels, samples: samples_so_far, iterations: film.iterations(), errors };
    let adaptive = Some(state).filter(|_| count == 1);
    let layers = Layers::default();
    Accumulation { about, film, responses: (count > 1).then_some(responses), adaptive, layers }
}

fn bytes(accumulation: &Accumulation) -> Vec<u8> {
    let mut file = Cursor::new(vec![]);
    write_to(&mut file, accumulation.parts()).unwrap();
    file.into_inner()
}

fn bits(values: Vec<f32>) -> Vec<u32> {
    values.into_iter().map(f32::to_bits).collect()
}

/// Checks that all results are equal, up to `ulps` units in the last place.
fn close(a: &Accumulation, b: &Accumulation, ulps: u32) {
    let near = |a: Vec<f32>, b: Vec<f32>| {
        assert!(bits(a.clone()).iter().zip(&bits(b.clone())).all(|(a, b)| a.abs_diff(*b) <= ulps), "{a:?} {b:?}");
    };
    near(a.film.mean(), b.film.mean());
    near(a.film.variance_of_mean(), b.film.variance_of_mean());
    assert_eq!(a.responses.is_some(), b.responses.is_some());
    if let (Some(a), Some(b)) = (&a.responses, &b.responses) {
        for t in 0..a.responses() {
            near(a.mean(t), b.mean(t));
            near(a.variance_of_mean(t), b.variance_of_mean(t));
        }
    }
}

#[test]
fn a_file_keeps_every_bit() {
    for (count, has_variance) in [(1, false), (3, false), (3, true)] {
        let mut whole = accumulation(0..50, count, has_variance);
        let mut read = read_from(&mut Cursor::new(bytes(&whole))).unwrap();
        assert_eq!(read.about, whole.about);
        assert_eq!(read.adaptive, whole.adaptive);
        assert_eq!(read.film.cells(), whole.film.cells());
        close(&read, &whole, 0);
        assert_eq!(bytes(&read), bytes(&whole));
        // Further iterations give the same bits, too.
        for film in [&mut read.film, &mut whole.film] {
            (50..90).map(iteration).for_each(|(image, samples)| film.add(&image, samples));
        }
        close(&read, &whole, 0);
        assert_eq!(read.film.image_mean(), whole.film.image_mean());
    }
}

/// Layers of the image of 3 x 2 pixels.
fn layers() -> Layers {
    let arrival = vec![1.5, f32::INFINITY, 0.1, f32::MIN_POSITIVE, 0.0, 7.25];
    let channels = vec![
        ("object.ID".into(), Plane::Ids(vec![0, 1, 2, 1, u32::MAX, 7])),
        ("arrival.Z".into(), Plane::Floats(arrival)),
    ];
    Layers { channels, objects: [(1, "Floor \"1\"".into()), (7, "Wand \u{fc}".into())].into() }
}

#[test]
fn layers_are_kept_and_added_once() {
    let whole = Accumulation { layers: layers(), ..accumulation(0..5, 1, false) };
    assert_eq!(read_from(&mut Cursor::new(bytes(&whole))).unwrap().layers, layers());

    let mut merged = accumulation(5..9, 1, false);
    merged.merge("a.acc", &whole, "b.acc").unwrap();
    merged.merge("a.acc", &Accumulation { layers: layers(), ..accumulation(10..12, 1, false) }, "c.acc").unwrap();
    assert_eq!(merged.layers, layers());

    let mut kept = layers();
    assert_eq!(kept.keep("arrival,depth".parse().unwrap()), Err("depth"));
    assert_eq!(kept, layers());
    kept.keep("arrival".parse().unwrap()).unwrap();
    assert_eq!(kept, Layers { channels: layers().channels[1..].to_vec(), ..Layers::default() });
    assert_eq!(Layers::default().keep(Aov::ALL), Err("depth"));

    // Wrong layers with valid check sums, as another program could write them.
    for (channel, plane) in [("object.ID", [0.5; 6].to_vec()), ("object.ID", vec![-1.0; 6]), ("depth.Z", vec![1.0; 5])]
    {
        let channels = vec![(channel.into(), Plane::Floats(plane))];
        let file = bytes(&Accumulation { layers: Layers { channels, ..layers() }, ..whole.clone() });
        assert!(read_from(&mut Cursor::new(file)).is_err(), "{channel}");
    }
}

#[test]
fn parts_merge_to_the_whole_render() {
    for count in [1, 3] {
        let whole = accumulation(0..60, count, true);
        let parts = [0, 1, 2].map(|i| accumulation((0..60).filter(|n| n % 3 == i), count, true));
        let mut merged = parts[0].clone();
        for part in &parts[1..] {
            merged.merge("a", part, "b").unwrap();
        }
        close(&merged, &whole, if count == 1 { 1 } else { 8 });
        assert_eq!(merged.about.iterations, whole.about.iterations);
        assert_eq!(merged.about.samples_per_pixel, whole.about.samples_per_pixel);
        // Nobody knows the errors without the last iteration of all.
        assert_eq!(merged.adaptive, whole.adaptive.map(|state| AdaptiveState { errors: None, ..state }));
        assert_eq!(read_from(&mut Cursor::new(bytes(&merged))).unwrap().adaptive, merged.adaptive);
        let again = merged.merge("a", &parts[1], "b").unwrap_err().to_string();
        assert!(again.contains("b has iteration 1, which is already in a"), "{again}");
    }
}

#[test]
fn other_renders_are_refused_with_what_differs() {
    let whole = accumulation(0..4, 1, false);
    let refused = |change: fn(&mut About)| {
        let mut other = accumulation(4..8, 1, false);
        change(&mut other.about);
        whole.clone().merge("a.acc", &other, "b.acc").map_err(|e| e.to_string())
    };
    assert!(refused(|_| ()).is_ok());
    assert!(refused(|about| about.settings = about.settings.replace("64", "128").replace("/a.glb", "/b.glb")).is_ok());
    for (change, part) in [
        (
            (|about| about.settings = about.settings.replace("1m..2m", "1m..3m")) as fn(&mut About),
            "gate.gate is \"1m..2m\" in a.acc and is \"1m..3m\" in b.acc",
        ),
        (
            |about| about.settings = about.settings.replace("seed = 3", ""),
            "render.seed is 3 in a.acc and is not set in b.acc",
        ),
        (|about| about.scene = "t".into(), "other contents"),
        (|about| about.renderer = "q".into(), "different versions"),
        (|about| about.resolution = [9, 9], "differ in size"),
    ] {
        let message = refused(change).unwrap_err();
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn the_contents_of_files_decide_and_not_their_paths() {
    let at = |folder: &str, edge: &str| {
        let mut about = accumulation(0..1, 1, false).about;
        about.files = [format!("{folder}/a"), format!("{folder}/a.csv")].into();
        about.settings = format!(
            "{SETTINGS}[medium]\ndensity-grid = '{folder}/a'\n[gate]\nresponse = ['one={folder}/a.csv', 'two=gauss:{edge}']\n"
        )
        .replace("[gate]\ngate = '1m..2m'\n", "");
        about
    };
    let check = |a: &About, b: &About| a.check_same_render("a.acc", b, "b.acc").map_err(|e| e.to_string());
    let here = at("/here", "1m");
    assert_eq!(check(&here, &at("/there", "1m")), Ok(()));
    let message = check(&here, &at("/there", "2m")).unwrap_err();
    assert!(message.contains("one=FILE") && message.contains("gauss:2m"), "{message}");
    let message = check(&here, &About { scene: "t".into(), ..at("/there", "1m") }).unwrap_err();
    assert!(message.contains("those that the settings name, have other contents"), "{message}");
    // Without a list of files, paths are compared like other settings.
    assert!(check(&here, &About { files: vec![], ..at("/there", "1m") }).is_err());
}

/// Some settings affect neither sums nor images. The number of samples affects images alone.
#[test]
fn settings_without_effect_may_differ() {
    let [plain, forced] = ["", "force = true\n"].map(|force| {
        let mut about = accumulation(0..1, 1, false).about;
        about.settings = SETTINGS.replace("[gate]\n", &format!("[gate]\n{force}"));
        about
    });
    assert_ne!(plain.settings, forced.settings);
    assert!(plain.check_same_render("a.acc", &forced, "b.acc").is_ok());
    let of = |settings: &'static str| (settings, &[][..]);
    let two = of("scene = 'a.glb'\n[render]\nspp = 2\ndevice = '0'\n");
    let difference = |other| difference_of_images(("one", two), ("the other", of(other)));
    assert_eq!(difference("scene = 'b.glb'\n[render]\nspp = 2\nstrict = true\n"), None);
    assert_eq!(difference("[render]\nspp = 3\n").unwrap(), "render.spp is 2 in one and is 3 in the other");
}

/// Files of earlier versions have old keys for the settings of a medium.
#[test]
fn old_keys_are_the_same_settings() {
    let difference = |old, new| difference_of_images(("old", (old, &[][..])), ("new", (new, &[][..])));
    assert_eq!(difference("[medium]\ng = 0.5\nior = 1.3\n", "[medium]\nphase-g = 0.5\nmedium-ior = 1.3\n"), None);
    let list = ("[[medium]]\nmor = '1m'\nweight = 1\n", "[[medium]]\nmor = '1m'\nphase-weight = 1\n");
    assert_eq!(difference(list.0, list.1), None);
    let message = difference("[medium]\ng = 0.5\n", "[medium]\nphase-g = 0.6\n").unwrap();
    assert_eq!(message, "medium.phase-g is 0.5 in old and is 0.6 in new");
}

#[test]
fn damaged_files_are_refused() {
    let good = bytes(&accumulation(0..5, 3, true));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.acc");
    let message = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        read(&path).map(drop).unwrap_err().to_string()
    };
    std::fs::write(&path, &good).unwrap();
    assert!(read(&path).is_ok());
    // A file that is cut off is refused at any length. A check sum finds a changed byte of an array.
    for length in (0..good.len()).step_by(97) {
        let message = message(&good[..length]);
        assert!(message.contains("is not an accumulation of taugate (.acc)"), "{length}: {message}");
    }
    let at = good.windows(6).position(|window| window == b"\x93NUMPY").unwrap() + 200;
    let mut changed = good.clone();
    changed[at] ^= 1;
    assert!(message(&changed).contains("Invalid checksum"), "{}", message(&changed));
    assert!(message(b"text").contains("not a zip"));

    // Wrong contents with valid check sums, as another program could write them.
    let mut whole = accumulation(0..5, 1, false);
    whole.about.crop = [0, 9, 0, 2];
    assert!(message(&bytes(&whole)).contains("does not lie in its image"));
    let mut whole = accumulation(0..5, 1, false);
    whole.about.format = 2;
    assert!(message(&bytes(&whole)).contains("reads format 1"));
    let mut whole = accumulation(0..5, 1, false);
    whole.about.crop = [1, 3, 2, 4];
    assert!(message(&bytes(&whole)).contains("does not fit the image"));
    let mut whole = accumulation(0..5, 1, false);
    whole.adaptive.as_mut().unwrap().pixels[2][1] = f64::NAN;
    assert!(message(&bytes(&whole)).contains("not finite"));
    // The device adds squares as f32, which may overflow.
    whole.adaptive.as_mut().unwrap().pixels[2][1] = 1e30;
    whole.adaptive.as_mut().unwrap().pixels[2][2] = f64::INFINITY;
    assert_eq!(read_from(&mut Cursor::new(bytes(&whole))).unwrap().adaptive, whole.adaptive);
    for wrong in [f64::NAN, f64::INFINITY, -1.0] {
        whole.adaptive.as_mut().unwrap().errors.as_mut().unwrap()[3] = wrong;
        assert!(message(&bytes(&whole)).contains("not finite"), "{wrong}");
    }
    let mut whole = accumulation(0..5, 1, false);
    whole.about.samples_per_pixel = 2;
    assert!(message(&bytes(&whole)).contains("contradicts its iterations"));
    assert!(write(&folder.path().join("no/a.acc"), whole.parts()).is_err());
}

#[test]
fn numpy_and_other_tools_see_plain_entries() {
    let good = bytes(&accumulation(0..5, 1, false));
    let mut zip = zip::ZipArchive::new(Cursor::new(&good)).unwrap();
    let names: Vec<String> = zip.file_names().map(|name| name.unwrap().into_owned()).collect();
    for name in
        ["about.json", "sums.npy", "sums_low.npy", "squares.npy", "squares_low.npy", "cells.npy", "adaptive.npy"]
    {
        assert!(names.iter().any(|other| other == name), "{names:?}");
        assert_eq!(zip.by_name(name).unwrap().compression(), zip::CompressionMethod::Stored);
    }
    // A file with a further entry, as a later version may write it, is read.
    let mut writer = zip::ZipWriter::new_append(Cursor::new(good)).unwrap();
    writer
        .start_file(
            "notes.txt",
            zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored),
        )
        .unwrap();
    writer.write_all(b"night of the long render").unwrap();
    assert!(read_from(&mut Cursor::new(writer.finish().unwrap().into_inner())).is_ok());
}

#[test]
fn a_full_disk_is_one_error() {
    /// A disk with room for `left` bytes.
    struct Disk {
        file: Cursor<Vec<u8>>,
        left: usize,
    }
    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            match self.left.checked_sub(bytes.len()) {
                Some(left) => self.left = left,
                None => return Err(std::io::ErrorKind::StorageFull.into()),
            }
            self.file.write(bytes)
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    impl std::io::Seek for Disk {
        fn seek(&mut self, to: std::io::SeekFrom) -> std::io::Result<u64> {
            self.file.seek(to)
        }
    }
    let whole = accumulation(0..5, 3, true);
    let disk = |left| Disk { file: Cursor::new(vec![]), left };
    let mut enough = disk(1 << 20);
    write_to(&mut enough, whole.parts()).unwrap();
    assert!(enough.file.into_inner() == bytes(&whole));
    for left in [0, 100, 1000, 2000, bytes(&whole).len() - 1] {
        let error = write_to(&mut disk(left), whole.parts()).unwrap_err();
        assert_eq!(error.kind(), std::io::ErrorKind::StorageFull, "{left} bytes");
    }
}

//! The examples in `examples/` render the images that their comments describe, and a [`Job`] renders what the program renders.

#[allow(dead_code, reason = "the test calls `render` alone")]
#[path = "../examples/render_gate.rs"]
mod render_gate;

#[allow(dead_code, reason = "the test calls `render` alone")]
#[path = "../examples/render_file.rs"]
mod render_file;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use taugate::glam::DVec3;
use taugate::internals::generate::{Kind, build, glb_bytes};
use taugate::internals::image::exr_file::read_picture;
use taugate::{
    Aim, Budget, Camera, Device, End, Error, ErrorKind, Gate, Job, Material, Projection, Response, Responses,
    Retroreflector, Settings, SkyImage, load_scene,
};

/// A scene in `folder`.
fn room(folder: &Path) -> PathBuf {
    let path = folder.join("room.glb");
    std::fs::write(&path, glb_bytes(Kind::CornellBox)).unwrap();
    path
}

/// The image of `taugate render`.
fn image_of_program(folder: &Path, settings: &[(&str, &str)]) -> Vec<f32> {
    let out = folder.join("program.exr");
    render(&room(folder), &out, settings);
    read_picture(&out).unwrap().rgb
}

/// Calls `taugate render`.
fn render(input: &Path, out: &Path, settings: &[(&str, &str)]) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_taugate"));
    command.args(["render", "--quiet"]).arg(input).arg("-o").arg(out);
    command.args(settings.iter().map(|(name, text)| format!("--{name}={text}")));
    assert!(command.status().unwrap().success());
}

#[test]
fn the_example_renders_a_ring() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("gate.exr");
    let mean = render_gate::render(&out).unwrap();
    let picture = read_picture(&out).unwrap();
    let lit = picture.rgb.chunks_exact(3).filter(|pixel| pixel[1] > 0.0).count();
    assert!(mean > 0.0 && (1..64 * 64).contains(&lit), "{mean}, {lit} pixels");
    assert_eq!((picture.width, picture.gate), (64, Some([6.2, 6.3])));
}

#[test]
fn a_job_that_was_stopped_goes_on_to_the_image_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let settings = [("gate", "6m..9m"), ("resolution", "16x16"), ("spp", "12"), ("estimator", "lcs")];
    let (input, out) = (room(folder.path()), folder.path().join("job.exr"));
    let stop = Arc::new(AtomicBool::new(true));
    let end = render_file::render(&input, &settings, &out, &stop).unwrap();
    assert!(matches!(end, End::Stopped) && !out.exists(), "{end:?}");

    // Another process stops after three iterations.
    let job = Job::open_with(&input, settings).unwrap();
    let device = job.open_device().unwrap();
    let mut job = job.prepare(&device).unwrap();
    job.keep_sums(&out.with_extension("acc"), Duration::from_secs(3600)).unwrap();
    stop.store(false, Ordering::SeqCst);
    let mut seen = vec![];
    let end = job.run(&stop, |progress| {
        seen.push((progress.samples, progress.fraction));
        stop.store(progress.samples >= 6, Ordering::SeqCst);
    });
    assert!(matches!(end, Ok(End::Stopped)), "{end:?}");
    assert_eq!(seen, [(2, 2.0 / 12.0), (4, 4.0 / 12.0), (6, 0.5)]);
    drop(job);

    let mut job = Job::open_with(&input, settings).unwrap().prepare(&device).unwrap();
    job.keep_sums(&out.with_extension("acc"), Duration::from_secs(3600)).unwrap();
    assert_eq!((job.film().samples(), job.film().iterations()), (6, 3));
    drop(job);
    let end = render_file::render(&input, &settings, &out, &Arc::default()).unwrap();
    assert!(matches!(end, End::Complete), "{end:?}");
    assert_eq!(read_picture(&out).unwrap().rgb, image_of_program(folder.path(), &settings));
}

/// A program may load a scene, and give settings as values instead of text.
#[test]
fn a_job_of_a_loaded_scene_renders_the_image_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let scene = load_scene(&room(folder.path())).unwrap();
    let gate = Gate::new(6.0, 9.0).unwrap();
    let estimator = "lcs".parse().unwrap();
    let builder = Settings::builder().gate(gate).resolution([16, 12]).budget(Budget::Spp(6)).estimator(estimator);
    let job = Job::of_scene(scene, &builder.build().unwrap()).unwrap();
    let device = job.open_device().unwrap();
    let mut job = job.prepare(&device).unwrap();
    let out = folder.path().join("job.exr");
    assert_eq!(job.keep_sums(&folder.path().join("job.acc"), Duration::ZERO).unwrap_err().kind(), ErrorKind::Settings);
    let stop = Arc::new(AtomicBool::default());
    let end = job.run(&stop, |progress| stop.store(progress.samples == 2, Ordering::SeqCst));
    assert!(matches!(end, Ok(End::Stopped)), "{end:?}");
    let late = job.keep_sums(&folder.path().join("job.acc"), Duration::ZERO).unwrap_err().to_string();
    assert!(late.contains("the render has begun"), "{late}");
    job.run(&Arc::default(), |_| {}).unwrap();
    job.write_exr(&out).unwrap();
    let settings = [("gate", "6m..9m"), ("resolution", "16x12"), ("spp", "6"), ("estimator", "lcs")];
    assert_eq!(read_picture(&out).unwrap().rgb, image_of_program(folder.path(), &settings));
}

/// Laser and sensor look at three points of the back wall.
const SCAN: &str = "scene = 'room.glb'\n[gate]\ngates = '6m..9m/2'\n[render]\nspp = 4\n\
                    [output]\nvariance = true\n[scan]\nlaser = [0, 1, 3]\npoints = [[0, 1, -0.99], [0.5, 1, -0.99], [0, 0.5, -0.99]]\naccount-first-and-last-bounces = true";

/// The program measures the same array. A scan that was stopped goes on.
#[test]
fn a_job_measures_the_scan_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    room(folder.path());
    let (input, own, theirs) =
        (folder.path().join("scan.toml"), folder.path().join("own.npy"), folder.path().join("theirs.npy"));
    std::fs::write(&input, SCAN).unwrap();
    let job = Job::open(&input).unwrap();
    assert!(job.is_scan());
    let device = job.open_device().unwrap();
    let mut scan = job.prepare_scan(&device).unwrap();
    let stop = Arc::new(AtomicBool::default());
    let end = scan.run(&stop, |progress| stop.store(progress.fraction > 0.0, Ordering::SeqCst));
    assert!(matches!(end, Ok(End::Stopped)), "{end:?}");
    assert_eq!((scan.measured(), scan.points(), scan.is_complete(), scan.dropped()), (1, 3, false, 0));
    let end = scan.run(&Arc::default(), |_| {}).unwrap();
    assert!(matches!(end, End::Complete) && scan.is_complete());
    scan.write_npy(&own).unwrap();
    render(&input, &theirs, &[]);
    for part in ["npy", "variance.npy"] {
        let of = |path: &Path| std::fs::read(path.with_extension(part)).unwrap();
        assert!(of(&own) == of(&theirs), "{part}");
    }
}

/// The frames of a sequence have the images of the program, also those whose renderer rendered another frame before.
#[test]
fn a_job_renders_the_frames_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let settings = [("frames", "3..5"), ("resolution", "16x12"), ("spp", "4"), ("estimator", "bdpt")];
    room(folder.path());
    let input = folder.path().join("frames.toml");
    let gate = "gate-keys = [[3, '6m..7m'], [4, '7m..9m']]";
    std::fs::write(&input, format!("scene = 'room.glb'\n[gate]\n{gate}\n")).unwrap();
    render(&input, &folder.path().join("#.exr"), &settings);
    let device = Device::open(None).unwrap();
    let mut before = None;
    for frame in Job::frames(&input, settings).unwrap() {
        let number = frame.number;
        let mut job = frame.open().unwrap().prepare_after(before.take(), &device).unwrap();
        assert!(matches!(job.run(&Arc::default(), |_| {}).unwrap(), End::Complete));
        let out = folder.path().join("own.exr");
        job.write_exr(&out).unwrap();
        let theirs = read_picture(&folder.path().join(format!("{number}.exr"))).unwrap();
        assert!(theirs.rgb.iter().any(|&x| x > 0.0) && read_picture(&out).unwrap().rgb == theirs.rgb, "{number}");
        before = Some(job);
    }
    assert_eq!(before.unwrap().film().samples(), 4);
}

#[test]
fn a_job_refuses_what_the_program_refuses() {
    let folder = tempfile::tempdir().unwrap();
    let input = room(folder.path());
    let message = |settings: &[(&str, &str)]| {
        let job = Job::open_with(&input, settings.iter().copied());
        let ready = job.and_then(|job| job.open_device().and_then(|device| job.prepare(&device)));
        ready.map(drop).unwrap_err().to_string()
    };
    for (settings, part) in [
        (&[("sp", "4")][..], "there is no setting --sp"),
        (&[("spp", "0")], "--spp is 0; it must be from 1 to"),
        (&[("frames", "0..4"), ("gate", "6m..9m")], "a sequence of frames"),
        (&[("gate", "1m..2m")], "meets no light"),
    ] {
        assert!(message(settings).contains(part), "{}", message(settings));
    }
    let device = Device::open(None).unwrap();
    let scan = folder.path().join("scan.toml");
    std::fs::write(&scan, SCAN).unwrap();
    let image_of_scan = Job::open(&scan).unwrap().prepare(&device).map(drop).unwrap_err().to_string();
    assert!(image_of_scan.contains("is a scan"), "{image_of_scan}");
    let scan_of_image = Job::open(&input).unwrap().prepare_scan(&device).map(drop).unwrap_err().to_string();
    assert!(scan_of_image.contains("is no scan"), "{scan_of_image}");
    let no_sequence = Job::frames(&input, []).map(drop).unwrap_err().to_string();
    assert!(no_sequence.contains("is no sequence"), "{no_sequence}");

    // Only the render finds that this gate is dark.
    let settings = [("gate", "80m..80.1m"), ("spp", "2"), ("resolution", "8x8")];
    let dark = |settings: &[(&str, &str)]| {
        let job = Job::open_with(&input, settings.iter().copied()).unwrap();
        let device = job.open_device().unwrap();
        job.prepare(&device).unwrap().run(&Arc::default(), |_| {})
    };
    let error = dark(&settings).unwrap_err();
    assert!(error.to_string().contains("no sample fell inside"), "{error}");
    assert!(matches!(error, Error::Settings(error) if error.setting() == Some("gate")));
    assert!(matches!(dark(&[&settings[..], &[("force", "true")]].concat()), Ok(End::Complete)));

    let settings = Settings::builder().resolution([8, 8]).build().unwrap();
    let without_camera = taugate::Scene { cameras: vec![], ..build(Kind::CornellBox) };
    let error = Job::of_scene(without_camera, &settings).map(drop).unwrap_err();
    assert!(error.to_string().contains("add a camera to the scene"), "{error}");
}

/// An experiment file could not hold these settings: rows of a table, and the second of two cameras with one name.
#[test]
fn a_job_has_the_settings_of_the_program_that_made_it() {
    let rows = vec![[6.0, 0.0], [7.0, 1.0], [8.0, 0.0]];
    let table = Responses::new(vec![Response::table("pulse", rows, None).unwrap()]).unwrap();
    let mut scene = build(Kind::CornellBox);
    scene.cameras.push(scene.cameras[0].clone());
    for camera in [0, 1] {
        let settings = Settings::builder().responses(table.clone()).camera(camera).resolution([8, 8]).build().unwrap();
        let job = Job::of_scene(scene.clone(), &settings).unwrap();
        assert_eq!(*job.settings(), settings);
        assert_eq!((job.notes().len(), job.warnings().len()), (0, 0), "{:?}", job.warnings());
    }
}

/// A program can name the types of all public fields.
#[test]
fn a_program_can_fill_in_every_field() {
    let aim = Aim { point: DVec3::NEG_Z, uncounted: 0.0 };
    let camera = Camera::looking_at("laser", DVec3::ZERO, DVec3::NEG_Z, 0.8, [1, 1]);
    let camera = Camera { projection: Projection::Aimed { aims: [aim].into(), pixel_fov: 0.0 }, ..camera };
    assert_eq!(camera.direction([1, 1], [0.5; 2]), DVec3::NEG_Z);
    let sign = Retroreflector { share: 0.5, angle: 1.0 };
    assert!(Material { retroreflector: Some(sign), ..Material::diffuse("sign", [0.5; 3]) }.retroreflector.is_some());
    assert_eq!(SkyImage::constant().rgb, [[1.0; 3]]);
}

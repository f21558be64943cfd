//! Exposures: what moves while the shutter is open, against closed forms and against the mean of many moments.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use taugate::Job;
use taugate::internals::generate::glb::{self, Motion};
use taugate::internals::generate::parts::{add, emitter, material, mesh, metal, place};
use taugate::internals::generate::shapes::quad;
use taugate::internals::generate::{Kind, build};
use taugate::internals::image::depth;
use taugate::internals::image::film::Film;
use taugate::internals::job::ready_job::ReadyJob;
use taugate::internals::scene::{Camera, LightKind, Projection, Scene};
use taugate::internals::settings::frequencies::Frequencies;

use super::cells::device;

/// Image size. A pixel is 1 m wide.
const W: u32 = 40;
const H: u32 = 10;
const RADIANCE: f64 = 3.0;
/// Where the square is 1 s after the start, its width and its speed, in metres.
const LEFT: f64 = 8.3;
const SQUARE: f64 = 5.4;
const SPEED: f64 = 90.0;

/// A glowing square that moves to the right in front of a parallel view, 3 m from the sensor.
fn square() -> Scene {
    let mut scene = Scene::default();
    let glow = material(&mut scene, emitter("glow", [RADIANCE as f32; 3]));
    let shape = quad(DVec3::new(0.0, -20.0, 0.0), SQUARE * DVec3::X, 40.0 * DVec3::Y, [1.0; 2]);
    let shape = mesh(&mut scene, "square", glow, shape);
    place(&mut scene, "square", shape, DAffine3::IDENTITY);
    scene.add_camera(Camera {
        projection: Projection::Orthographic { height: f64::from(H) },
        ..Camera::looking_at(
            "parallel",
            DVec3::new(f64::from(W) / 2.0, 0.0, 3.0),
            DVec3::new(f64::from(W) / 2.0, 0.0, 0.0),
            1.0,
            [W, H],
        )
    });
    scene
}

/// Writes the scene, in which `node` moves from `a` at 0 s to `b` at 2 s.
fn moving(folder: &Path, scene: &Scene, node: &'static str, [a, b]: [DVec3; 2]) -> PathBuf {
    let positions = [a, b].map(|place| place.as_vec3().to_array()).to_vec();
    let motion = Motion { node, times: vec![0.0, 2.0], positions };
    let path = folder.join("scene.glb");
    std::fs::write(&path, glb::write_moving(scene, Some(&motion))).unwrap();
    path
}

fn rendered(path: &Path, settings: &[(&str, &str)]) -> ReadyJob {
    let job = Job::open_with(path, settings.iter().copied()).unwrap_or_else(|e| panic!("{settings:?}: {e}"));
    let mut job = job.prepare(&device()).unwrap_or_else(|e| panic!("{settings:?}: {e}"));
    job.run(&Arc::default(), |_| {}).unwrap_or_else(|e| panic!("{settings:?}: {e}"));
    job
}

fn green(film: &Film) -> Vec<f64> {
    film.mean().chunks(3).map(|rgb| f64::from(rgb[1])).collect()
}

/// Radiance of each pixel of a row, if the left edge of the square moves from `from` to `to` while the row is exposed.
fn trapezoid(from: f64, to: f64) -> Vec<f64> {
    // Integral over the edge of the length of [edge, edge + SQUARE] below `x`.
    let integral = |x: f64| {
        let below = |edge: f64| {
            let covered = (x - edge).clamp(0.0, SQUARE);
            // The antiderivative of the clamped length.
            -(0.5 * covered * covered + (x - edge - SQUARE).max(0.0) * SQUARE)
        };
        below(to) - below(from)
    };
    let mean = |x: f64| integral(x) / (to - from);
    (0..W).map(|x| RADIANCE * (mean(f64::from(x) + 1.0) - mean(f64::from(x)))).collect()
}

/// The largest difference of a pixel to the closed form, relative to the radiance of the square.
fn difference(found: &[f64], expected: impl Fn(u32) -> Vec<f64>) -> f64 {
    let rows = (0..H).zip(found.chunks(W as usize));
    let of_row = |(row, found): (u32, &[f64])| {
        expected(row).iter().zip(found).map(|(a, b)| (a - b).abs() / RADIANCE).fold(0.0, f64::max)
    };
    rows.map(of_row).fold(0.0, f64::max)
}

/// The edges of a moving square become trapezoids, all its light stays, and the rows of a rolling shutter follow each other.
#[test]
fn a_moving_square_has_the_profile_of_a_trapezoid() {
    let folder = tempfile::tempdir().unwrap();
    let x = |time: f64| LEFT + SPEED * (time - 1.0);
    let path = moving(folder.path(), &square(), "square", [0.0, 2.0].map(|time| DVec3::X * x(time)));
    let edges = |first: f64, last: f64| trapezoid(x(first), x(last));
    let base = [("estimator", "pt"), ("at", "1s"), ("shutter", "-10ms..100ms"), ("spp", "512")];
    let found = green(rendered(&path, &base).film());
    let error = difference(&found, |_| edges(0.99, 1.1));
    let energy = found.iter().sum::<f64>() / (RADIANCE * SQUARE * f64::from(H)) - 1.0;
    eprintln!("error {error:.4}, energy {energy:.5}");
    assert!(error < 0.02 && energy.abs() < 0.002, "error {error}, energy {energy}");
    // Siblings: another begin, another duration, and the still image.
    for wrong in [edges(1.0, 1.11), edges(0.99, 1.09), edges(1.0449, 1.0451)] {
        assert!(difference(&found, |_| wrong.clone()) > 0.05);
    }

    // Readout takes 0.5, 1.8 and 7.2 times the exposure.
    for (line, shutter, duration) in [(2e-3, "0..40ms", 0.04), (4e-3, "0..22ms", 0.022), (8e-3, "0..11ms", 0.011)] {
        let rolling = line.to_string();
        let flags = [("estimator", "pt"), ("at", "1s"), ("shutter", shutter), ("rolling", &rolling), ("spp", "512")];
        let found = green(rendered(&path, &flags).film());
        let row_edges = |line: f64| {
            move |row: u32| {
                let begin = 1.0 + line * f64::from(row);
                edges(begin, begin + duration)
            }
        };
        let error = difference(&found, row_edges(line));
        let [none, faster] = [0.0, 1.3 * line].map(|line| difference(&found, row_edges(line)));
        eprintln!("{line} s per row: error {error:.4}, siblings {none:.3} and {faster:.3}");
        assert!(error < 0.03 && none > 0.1 && faster > 0.1, "{line} s per row");
    }
}

/// A crop of a rolling exposure shows its rows at their times in the whole image.
#[test]
fn a_crop_has_the_rows_of_the_whole_image() {
    let folder = tempfile::tempdir().unwrap();
    let ends = [0.0, 2.0].map(|time| DVec3::X * (LEFT + SPEED * (time - 1.0)));
    let path = moving(folder.path(), &square(), "square", ends);
    let base = [
        ("estimator", "pt"),
        ("at", "1s"),
        ("shutter", "0..10ms"),
        ("rolling", "7ms"),
        ("spp", "32"),
        ("sampling", "uniform"),
    ];
    let whole = green(rendered(&path, &base).film());
    let part = green(rendered(&path, &[&base[..], &[("crop", "4,39,3,8")]].concat()).film());
    let expected: Vec<f64> = (3..8).flat_map(|y| whole[40 * y + 4..40 * y + 39].to_vec()).collect();
    assert!(part == expected);
}

/// A surface that recedes lies in each of four gates for a quarter of the exposure: responses see the moments, too.
#[test]
fn gates_see_a_surface_while_it_is_at_their_range() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = square();
    scene.instances[0].transform = DAffine3::IDENTITY;
    let path = moving(folder.path(), &scene, "square", [DVec3::new(LEFT, 0.0, 0.0), DVec3::new(LEFT, 0.0, -8.0)]);
    for rolling in [None, Some("40ms")] {
        let base = [("estimator", "bdpt"), ("shutter", "0.5..1.5"), ("gates", "5m..9m/4"), ("spp", "256")];
        let rolling = rolling.map(|time| ("rolling", time));
        let job = rendered(&path, &base.into_iter().chain(rolling).collect::<Vec<_>>());
        let images = job.responses().unwrap().unwrap();
        // The distance is 5 m to 9 m while the first row is exposed. Each row begins 0.16 m later than the row above.
        for row in 0..H {
            let shift = if rolling.is_some() { 0.16 * f64::from(row) } else { 0.0 };
            for gate in 0..4u32 {
                let [lo, hi] = [5.0, 6.0].map(|x| x + f64::from(gate));
                let share = (hi.min(9.0 + shift) - lo.max(5.0 + shift)).max(0.0) / 4.0;
                let found = f64::from(images.mean(gate as usize)[3 * (row * W + 10) as usize + 1]) / RADIANCE;
                assert!((found - share).abs() < 0.012, "row {row}, gate {gate}: {found}, expected {share}");
            }
        }
    }
}

/// A camera and its lamp drive through a room: the exposure is the mean of many moments, whether the renderer follows or is made anew.
#[test]
fn an_exposure_is_the_mean_of_its_moments() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = build(Kind::CornellBox);
    scene.cameras[0].name = "rig".into();
    let begin = scene.cameras[0].transform.translation;
    scene.add_light("rig", begin, DVec3::NEG_Z, LightKind::Point { intensity: [9.0; 3] });
    // A long way needs a new render space.
    for (way, gate) in [(0.6, "7m..8.5m"), (3.0, "4m..7m")] {
        let path = moving(folder.path(), &scene, "rig", [begin, begin - DVec3::Z * way]);
        let base =
            [("estimator", "lcs"), ("gate", gate), ("resolution", "24x24"), ("emitters", "rig"), ("force", "true")];
        let exposed = rendered(&path, &[&base[..], &[("shutter", "0..2s"), ("spp", "256")]].concat());
        let count = 40;
        let mut mean = vec![0.0; 24 * 24];
        for moment in 0..count {
            let (at, seed) = (((f64::from(moment) + 0.5) * 2.0 / f64::from(count)).to_string(), moment.to_string());
            let flags = [&base[..], &[("at", &at[..]), ("seed", &seed), ("spp", "16")]].concat();
            let still = green(rendered(&path, &flags).film());
            mean.iter_mut().zip(still).for_each(|(sum, x)| *sum += x / f64::from(count));
        }
        let found = green(exposed.film());
        let cells = |image: &[f64]| -> Vec<f64> {
            let cell =
                |i: usize| (0..36).map(|k| image[24 * (6 * (i / 4) + k / 6) + 6 * (i % 4) + k % 6]).sum::<f64>() / 36.0;
            (0..16).map(cell).collect()
        };
        let (found, expected) = (cells(&found), cells(&mean));
        let scale = expected.iter().sum::<f64>() / 16.0;
        let worst_of =
            |image: &[f64]| image.iter().zip(&expected).map(|(a, b)| (a - b).abs() / scale).fold(0.0, f64::max);
        let worst = worst_of(&found);
        let whole = found.iter().sum::<f64>() / (16.0 * scale) - 1.0;
        eprintln!("{way} m: whole {whole:.4}, worst cell {worst:.4}");
        assert!(scale > 0.0 && whole.abs() < 0.02, "{way} m: whole {whole}, worst cell {worst}");
        let still = cells(&green(rendered(&path, &[&base[..], &[("at", "0"), ("spp", "64")]].concat()).film()));
        eprintln!("the first moment alone: {:.3}", worst_of(&still));
        assert!(worst < 0.2 * worst_of(&still), "{way} m");
    }
}

/// A wide glowing wall behind the sensor, which it sees in a mirror.
fn mirrored() -> Scene {
    let mut scene = square();
    scene.instances.clear();
    let smooth = material(&mut scene, metal("smooth", [1.0; 3], 0.0));
    let corner = DVec3::new(-100.0, -100.0, 0.0);
    let shape = quad(corner, 200.0 * DVec3::X, 200.0 * DVec3::Y, [1.0; 2]);
    let shape = mesh(&mut scene, "mirror", smooth, shape);
    place(&mut scene, "mirror", shape, DAffine3::IDENTITY);
    let wall = quad(corner + 5.0 * DVec3::Z, 200.0 * DVec3::Y, 200.0 * DVec3::X, [1.0; 2]);
    add(&mut scene, "wall", 0, wall);
    scene
}

/// A glowing surface or a mirror recedes from a heterodyne sensor: each of its images is the mean over the exposure of a wave whose phase
/// turns by the difference of the frequencies and by the Doppler shift. A mirror shifts twice, once before and once after the reflection.
#[test]
fn a_heterodyne_sensor_sees_the_doppler_shift() {
    let folder = tempfile::tempdir().unwrap();
    let (speed, duration, begin, megahertz) = (7.0, 0.8, 0.5, 20.0);
    let period = Frequencies::period(megahertz);
    // The sensor is at z = 3.
    for (scene, node, x, first, rate) in
        [(square(), "square", LEFT, 3.0, speed), (mirrored(), "mirror", 0.0, 8.0, 2.0 * speed)]
    {
        let path = moving(folder.path(), &scene, node, [0.0, 2.0].map(|time| DVec3::new(x, 0.0, -speed * time)));
        for (hertz, shown) in [(1.25, "1.25"), (-2.0, "-2Hz"), (0.4, "0.4")] {
            let flags =
                [("estimator", "bdpt"), ("shutter", "0.5..1.3"), ("cw", "20"), ("heterodyne", shown), ("spp", "512")];
            let job = rendered(&path, &flags);
            let images = job.responses().unwrap().unwrap();
            let found: Vec<f64> =
                (0..4).map(|k| f64::from(images.mean(k)[3 * (4 * W + 10) as usize + 1]) / RADIANCE).collect();
            let expected = |rate: f64, hertz: f64| -> Vec<f64> {
                let turning = TAU * (rate / period + hertz);
                let image = |k: u32| {
                    let first = TAU * ((first + rate * begin) / period + 0.25 * f64::from(k));
                    0.5 + 0.5 * ((first + turning * duration).sin() - first.sin()) / (turning * duration)
                };
                (0..4).map(image).collect()
            };
            let error = |expected: &[f64]| found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let [right, half, reversed] =
                [(rate, hertz), (0.5 * rate, hertz), (rate, -hertz)].map(|(rate, f)| error(&expected(rate, f)));
            eprintln!("{node}, {hertz} Hz: error {right:.4}, half the shift {half:.3}, reversed {reversed:.3}");
            assert!(right < 0.01 && half > 0.03 && reversed > 0.03, "{node}, {hertz} Hz: {found:?}");
            // Its phases are none of travel times.
            let planes = depth::planes(images, job.ready.settings.responses());
            assert!(planes.iter().map(|(name, _)| &name[..]).eq(["cw20MHz.phase", "cw20MHz.amplitude"]));
        }
    }
}

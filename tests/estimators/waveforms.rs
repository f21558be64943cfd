//! The waveform of a LiDAR in fog: single scattering along each beam, and the echo of a wall. Closed forms.

use std::f64::consts::PI;

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, glass, light, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::render::{MemoryPlan, PreparedScene, Renderer};
use taugate::internals::scene::{Aim, LightKind, Medium, Projection, Scene};
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Settings};

use super::cells::{device, renderer, seeds, settings, threshold};

const WALL: f64 = 10.07;
const ALBEDO: f64 = 0.4;
const INTENSITY: f64 = 1000.0;
const SCATTERING: f64 = 0.02;
const EXTINCTION: f64 = 0.025;
/// Half of the laser's divergence in radians.
const HALF: f64 = 2e-3;
const GATE: Gate = Gate { lo: 1.0, hi: 24.0 };
const BINS: u32 = 115;

/// A laser and a pixel of the angle `pixel_fov` at the origin, which look at a wall in fog.
fn scene(pixel_fov: f64) -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("wall", [ALBEDO as f32; 3]));
    add(&mut scene, "wall", grey, quad(DVec3::new(-8.0, -8.0, -WALL), 16.0 * DVec3::X, 16.0 * DVec3::Y, [1.0; 2]));
    scene.media = vec![Medium { sigma_s: [SCATTERING; 3], sigma_a: [EXTINCTION - SCATTERING; 3], ..Medium::default() }];
    light(
        &mut scene,
        "laser",
        DVec3::ZERO,
        DVec3::NEG_Z,
        LightKind::spot([INTENSITY as f32; 3], HALF as f32, HALF as f32),
    );
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1.0, [1, 1]);
    let aim = Aim { point: DVec3::new(0.0, 0.0, -WALL), uncounted: 0.0 };
    scene.cameras[0].projection = Projection::Aimed { aims: [aim].into(), pixel_fov };
    scene
}

fn of(estimator: Estimator) -> Settings {
    let gates = Gates::new(GATE, BINS).unwrap();
    settings(estimator, [1, 1]).max_depth(2).light_paths(100).responses(gates).build().unwrap()
}

/// Radiance in each bin, averaged over a pixel of which the laser lights `share`.
fn truth(share: f64) -> Vec<f64> {
    let width = (GATE.hi - GATE.lo) / f64::from(BINS);
    let steps = 1000;
    let of_bin = |bin: u32| {
        let lo = GATE.lo + width * f64::from(bin);
        let step = 0.5 * width / f64::from(steps);
        let places = (0..steps).map(|k| 0.5 * lo + step * (f64::from(k) + 0.5)).filter(|s| *s < WALL);
        let fog: f64 = places.map(|s| step * SCATTERING / (4.0 * PI) * (-2.0 * EXTINCTION * s).exp() / (s * s)).sum();
        let echo = ALBEDO / PI * (-2.0 * EXTINCTION * WALL).exp() / (WALL * WALL);
        let has_echo = (lo..lo + width).contains(&(2.0 * WALL));
        share * INTENSITY * (fog + if has_echo { echo } else { 0.0 })
    };
    (0..BINS).map(of_bin).collect()
}

fn bins(renderer: &Renderer) -> Vec<f64> {
    renderer.responses().unwrap().unwrap().means_of(0).step_by(3).map(f64::from).collect()
}

/// 64 samples of a beam with a render of its kind: each bin is right within 1 %, whether the laser is as wide as the pixel, wider or
/// narrower.
#[test]
fn a_waveform_in_fog_has_the_closed_form_in_each_bin() {
    for (pixel_fov, share) in [(2.0 * HALF, PI / 4.0), (8.0 * HALF, PI / 64.0), (HALF, 1.0), (0.0, 1.0)] {
        let (scene, settings) = (scene(pixel_fov), of(Estimator::Lcs));
        let prepared = PreparedScene::new(&scene, &settings).unwrap().with_own_lasers(&[1]);
        let memory = MemoryPlan::new(&scene, &settings, &prepared, Some(device().info())).unwrap();
        let mut renderer = Renderer::from_memory_plan(&device(), memory, &scene, &prepared).unwrap();
        (0..4).for_each(|_| renderer.iterate(16).unwrap());
        for (bin, (found, truth)) in bins(&renderer).into_iter().zip(truth(share)).enumerate() {
            assert!((found - truth).abs() <= 0.01 * truth, "{pixel_fov}, bin {bin}: {found}, not {truth}");
        }
    }
}

/// A scene with `panes` of glass near the sensor, whose normals make this angle with the beam, and the share of the light that passes them
/// there and back.
fn behind(panes: usize, angle: f64) -> (Scene, f64) {
    let mut scene = scene(HALF);
    let glass = material(&mut scene, glass("pane"));
    let up = 2.0 * DVec3::new(0.0, angle.cos(), angle.sin());
    for pane in 0..panes {
        let centre = DVec3::new(0.0, 0.0, -0.1 * (pane + 2) as f64);
        add(
            &mut scene,
            &format!("pane {pane}"),
            glass,
            quad(centre - DVec3::X - 0.5 * up, 2.0 * DVec3::X, up, [1.0; 2]),
        );
    }
    let (out, inside) = (angle.cos(), (1.0 - (angle.sin() / 1.5).powi(2)).sqrt());
    let [s, p] = [(out - 1.5 * inside) / (out + 1.5 * inside), (inside - 1.5 * out) / (inside + 1.5 * out)];
    let face = 0.5 * (s * s + p * p);
    (scene, ((1.0 - face) / (1.0 + face)).powi(2 * panes as i32))
}

/// Clear glass near the sensor dims all bins alike, whatever the length of an iteration, and however many panes there are.
#[test]
fn a_waveform_is_dimmed_by_panes() {
    for (panes, angle, samples) in [(1, 0.0, 3), (1, 0.0, 6), (1, 0.0, 16), (2, 1.1, 16), (3, 1.1, 3)] {
        let (scene, passed) = behind(panes, angle);
        let settings = of(Estimator::Lcs);
        let prepared = PreparedScene::new(&scene, &settings).unwrap().with_own_lasers(&[1]);
        let memory = MemoryPlan::new(&scene, &settings, &prepared, Some(device().info())).unwrap();
        let mut renderer = Renderer::from_memory_plan(&device(), memory, &scene, &prepared).unwrap();
        (0..16).for_each(|_| renderer.iterate(samples).unwrap());
        for (bin, (found, truth)) in bins(&renderer).into_iter().zip(truth(1.0)).enumerate() {
            let truth = passed * truth;
            assert!(
                (found - truth).abs() <= 0.01 * truth,
                "{panes} panes, {samples} samples, bin {bin}: {found}, not {truth}"
            );
        }
    }
}

/// Subpaths that scatter at random, as with more than two segments: the mean over many seeds is right in each bin.
#[test]
fn the_mean_of_a_waveform_is_right_if_subpaths_scatter() {
    let scene = scene(HALF);
    let settings = of(Estimator::Lcs);
    let mut renderer = renderer(&scene, &settings);
    let mut found = vec![vec![]; BINS as usize];
    for seed in 0..seeds() {
        renderer.restart(seed + 1, settings.responses().clone()).unwrap();
        renderer.iterate(16).unwrap();
        found.iter_mut().zip(bins(&renderer)).for_each(|(all, bin)| all.push(bin));
    }
    for (bin, (all, truth)) in found.iter().zip(truth(1.0)).enumerate() {
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let squares = all.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
        let error = (squares / (all.len() * (all.len() - 1)) as f64).sqrt();
        let off = ((mean - truth).abs() - 2e-3 * truth).max(0.0);
        assert!(off <= threshold(BINS as usize) * error, "bin {bin}: {mean} +- {error}, not {truth}");
        assert!(bin as f64 * 0.2 + 1.0 > 2.0 * WALL - 0.3 || error < 0.03 * truth, "bin {bin}: {mean} +- {error}");
    }
}

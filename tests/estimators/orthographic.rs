//! Orthographic cameras: the estimators against a closed form and the oracle, with the strategies that connect light vertices to
//! the sensor plane (t = 1).

use glam::{DAffine3, DVec3};
use taugate::internals::generate::parts::{add, light, material, metal};
use taugate::internals::generate::shapes::quad;
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::generate::{Kind, build};
use taugate::internals::render::Renderer;
use taugate::internals::scene::{Camera, LightKind, Projection, Scene};
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Strategies};

use super::agreement::{assert_none, feature_against_oracle, whole_images};
use super::cells::{Cells, pool, renderer, settings, threshold};
use super::closed_form::{GATES, RESOLUTION, floor, gated_pixels};

const CELL: usize = 4;
const TRACERS: [Estimator; 3] = [Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs];

/// The scene with an orthographic view of this height in metres, from the place of its camera. The axis is not in the centre of the
/// image.
fn orthographic(mut scene: Scene, height: f64) -> Scene {
    let camera = &mut scene.cameras[0];
    (camera.projection, camera.principal_point) = (Projection::Orthographic { height }, [0.45, 0.55]);
    scene
}

#[test]
#[ignore = "takes ten seconds; a room seen in parallel is compared with the oracle always"]
fn a_lit_floor_has_the_radiance_of_the_closed_form() {
    for estimator in Estimator::ALL {
        let mut renderer = renderer(&floor(), &settings(estimator, RESOLUTION).build().unwrap());
        for (lo, hi) in GATES {
            let cells = Cells::measure(&mut renderer, Gate { lo, hi }, CELL, 1, 8, 100);
            let grey = |gate| gated_pixels(gate).iter().flat_map(|&x| [x as f32; 3]).collect::<Vec<f32>>();
            let pooled = |gate| pool(&grey(gate), RESOLUTION[0] as usize, CELL);
            let truth = pooled((lo, hi));
            let brightest = truth.iter().copied().fold(0.0, f64::max);
            let wrong = |truth: &[f64]| {
                // A cell with less than a hundredth of the brightest cell's light has too few paths for a test.
                let tested = (0..truth.len()).filter(|&i| truth[i] > 0.01 * brightest);
                let z = |i: usize| ((cells.mean(i) - truth[i]).abs() - 1e-3 * brightest) / cells.variance(i).sqrt();
                tested.filter(|&i| z(i) > threshold(truth.len() * GATES.len())).collect::<Vec<_>>()
            };
            let means = [cells.whole().0, truth.iter().sum::<f64>() / truth.len() as f64];
            eprintln!("{estimator} [{lo}, {hi}): {means:?}");
            assert!(means[0] > 0.0 && wrong(&truth).is_empty(), "{estimator} [{lo}, {hi}): cells {:?}", wrong(&truth));
            // Negative control: gates that are 10 cm too late.
            assert!(hi.is_infinite() || !wrong(&pooled((lo + 0.1, hi + 0.1))).is_empty(), "{estimator} [{lo}, {hi})");
        }
    }
}

/// The floor in the light of a thin beam. Only the strategy t = 1 finds the spot of the beam. The mean of the image and the travel
/// time of the spot have closed forms. A mirror above the floor reflects a second beam down to the floor.
#[test]
fn the_spot_of_a_thin_beam_is_found_by_connections_to_the_sensor() {
    let mut scene = floor();
    scene.lights.clear();
    let mirror = material(&mut scene, metal("mirror", [1.0; 3], 0.0));
    add(&mut scene, "mirror", mirror, quad(DVec3::new(3.0, -0.5, 0.5), DVec3::Y, DVec3::new(-0.5, 0.0, 0.5), [1.0; 2]));
    let axis = DVec3::new(0.1, 0.6, -0.8).normalize();
    let (near, mirrored) = (DVec3::new(0.3, 0.2, 0.0), DVec3::new(2.75, 0.0, 0.0));
    let kind = LightKind::Beam { power: [2.0; 3], radius: 0.0 };
    light(&mut scene, "near", near + DVec3::Z, DVec3::NEG_Z, kind);
    // This beam meets the mirror at (2.75, 0, 0.75), and the mirror turns the beam down.
    light(&mut scene, "mirrored", DVec3::new(0.75, 0.0, 0.75), DVec3::X, kind);
    let truth = 0.6 * 2.0 / std::f64::consts::PI * -axis.z / (4.0 * 6.0);
    for (node, spot, before) in [("near", near, 1.0), ("mirrored", mirrored, 2.75)] {
        let tau = before + 3.0 + axis.dot(spot);
        for estimator in TRACERS {
            let emitters = taugate::internals::settings::Emitters::Nodes(vec![node.into()]);
            let s = settings(estimator, RESOLUTION).emitters(emitters).max_depth(3);
            let mut all = renderer(&scene, &s.clone().build().unwrap());
            for (lo, hi, part) in [(0.0, f64::INFINITY, 1.0), (tau - 1e-4, tau + 1e-4, 1.0), (0.0, tau - 1e-4, 0.0)] {
                all.restart(1, Gate { lo, hi }).unwrap();
                all.iterate(4).unwrap_or_else(|e| panic!("{e}"));
                let image = all.film().mean();
                let mean = image.iter().map(|&x| f64::from(x)).sum::<f64>() / image.len() as f64;
                assert!((mean - part * truth).abs() < 1e-4 * truth, "{node} {estimator} [{lo}, {hi}): {mean}, {truth}");
            }
            // Without t = 1, the spot is invisible.
            let mut paper = renderer(&scene, &s.strategies(Strategies::Paper).build().unwrap());
            paper.iterate(4).unwrap_or_else(|e| panic!("{e}"));
            assert!(paper.film().mean().iter().all(|&x| x == 0.0), "{node} {estimator}");
        }
    }
}

#[test]
fn a_room_seen_in_parallel_agrees_with_the_oracle() {
    let cornell = orthographic(build(Kind::CornellBox), 2.2);
    let gates = [(6.5, 7.0), (8.0, 8.3), (0.0, f64::INFINITY)];
    assert_none(feature_against_oracle("cornell", &cornell, &gates, [24, 24]));
}

/// The long version, with more rooms and smaller errors:
/// `cargo test --release --test estimators -- --ignored --nocapture whole_images_in_parallel`
#[test]
#[ignore = "takes minutes"]
fn whole_images_in_parallel_agree_with_the_oracle() {
    whole_images("parallel cornell", &orthographic(build(Kind::CornellBox), 2.2), 6.5);
    for (name, kind, lo) in [("lamp", Light::Area, 5.0), ("punctual", Light::Punctual, 5.0), ("beam", Light::Beam, 6.5)]
    {
        whole_images(&format!("parallel {name}"), &orthographic(zoo(kind), 1.7), lo);
    }
}

/// Sunlight and parallel camera rays together: both kinds of subpaths start with parallel rays.
#[test]
fn a_sun_seen_in_parallel_agrees_with_the_oracle() {
    let mut scene = orthographic(build(Kind::CornellBox), 2.2);
    light(&mut scene, "sun", DVec3::ZERO, DVec3::new(0.3, -0.5, -0.8), LightKind::Directional { irradiance: [6.0; 3] });
    assert_none(feature_against_oracle("sun", &scene, &[(0.0, f64::INFINITY)], [24, 16]));
}

fn image(renderer: &mut Renderer, gate: Gate) -> Vec<f32> {
    renderer.restart(5, gate).unwrap();
    renderer.iterate(4).unwrap_or_else(|e| panic!("{e}"));
    renderer.film().mean()
}

/// A light subpath is culled only if its light is too late for the gate even at the nearest point of the sensor.
#[test]
fn culling_removes_no_light() {
    let gate = Gate { lo: 2.7, hi: 3.0 };
    for scene in [floor(), orthographic(build(Kind::CornellBox), 2.2)] {
        let gate = if scene.lights.is_empty() { Gate { lo: 6.0, hi: 7.0 } } else { gate };
        let s = settings(Estimator::Bdpt, RESOLUTION).gate(gate);
        let with_no_cull =
            |no_cull: bool| image(&mut renderer(&scene, &s.clone().no_cull(no_cull).build().unwrap()), gate);
        let culled = with_no_cull(false);
        assert!(culled.iter().any(|&x| x > 0.0) && culled == with_no_cull(true));
    }
}

/// A renderer accepts a camera that turned, moved and changed its height of view. It then renders the same image as a new
/// renderer. A renderer rejects a camera with another kind of projection.
#[test]
fn a_moved_camera_gives_the_image_of_a_new_renderer() {
    let scene = orthographic(build(Kind::CornellBox), 1.5);
    let s = settings(Estimator::Bdpt, RESOLUTION).max_depth(6).build().unwrap();
    let mut moved = scene.cameras[0].clone();
    moved.transform =
        DAffine3::from_translation(DVec3::new(0.1, -0.05, 0.2)) * moved.transform * DAffine3::from_rotation_x(-0.05);
    moved.projection = Projection::Orthographic { height: 1.9 };
    let gate = Gate { lo: 6.0, hi: 8.0 };
    let mut turned = renderer(&scene, &s);
    assert!(turned.set_camera(&moved).unwrap());
    let there = image(&mut renderer(&Scene { cameras: vec![moved.clone()], ..scene.clone() }, &s), gate);
    let turned = image(&mut turned, gate);
    let sum = |values: &[f32]| values.iter().map(|&x| f64::from(x)).sum::<f64>();
    let differences: Vec<f32> = turned.iter().zip(&there).map(|(a, b)| (a - b).abs()).collect();
    // A path may round to the other side of an edge.
    assert!(sum(&there) > 0.0 && sum(&differences) < 2e-3 * sum(&there), "{}", sum(&differences) / sum(&there));

    let pinhole = Camera { projection: Projection::Perspective { yfov: 0.6 }, ..moved.clone() };
    assert!(!renderer(&scene, &s).set_camera(&pinhole).unwrap());
    let seen = Scene { cameras: vec![pinhole], ..scene };
    assert!(!renderer(&seen, &s).set_camera(&moved).unwrap());
}

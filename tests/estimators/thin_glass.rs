//! Thin glass: light passes straight on, with the transmittance of both faces and all reflections between them. Closed forms.

use std::f64::consts::PI;

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, glass, light, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::scene::{AlphaMode, LightKind, Material, Medium, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::cells::{Cells, renderer, settings, threshold};

const ALL: [Estimator; 5] = [Estimator::Pt, Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs, Estimator::Epc];
const INDEX: f64 = 1.5;
/// Distance of the wall, and intensity of the lamp at the pinhole.
const WALL: f64 = 4.0;
const INTENSITY: f64 = 10.0;
const ALBEDO: f64 = 0.8;

/// Cosine of the angle inside of the glass.
fn cosine_inside(angle: f64) -> f64 {
    (1.0 - (angle.sin() / INDEX).powi(2)).sqrt()
}

/// Fresnel reflectance of one face for light without polarisation.
fn face(angle: f64) -> f64 {
    let (c, t) = (angle.cos(), cosine_inside(angle));
    let s = ((c - INDEX * t) / (c + INDEX * t)).powi(2);
    let p = ((INDEX * c - t) / (INDEX * c + t)).powi(2);
    0.5 * (s + p)
}

/// Transmittance of a sheet.
fn transmittance(angle: f64) -> f64 {
    (1.0 - face(angle)) / (1.0 + face(angle))
}

/// A sheet of 4 m that is turned by `angle` about y, `distance` in front of the camera.
fn sheet(scene: &mut Scene, look: Material, distance: f64, angle: f64) {
    let look = material(scene, look);
    let along = DVec3::new(angle.cos(), 0.0, -angle.sin());
    let centre = DVec3::new(0.0, 0.0, -distance);
    add(scene, "sheet", look, quad(centre - 2.0 * along - DVec3::Y * 2.0, 4.0 * along, DVec3::Y * 4.0, [1.0; 2]));
}

/// A wall and, in front of it, whatever `sheets` adds. Camera and lamp are at the origin; the view is narrow.
fn wall_behind(sheets: impl FnOnce(&mut Scene)) -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("wall", [ALBEDO as f32; 3]));
    let corner = DVec3::new(-8.0, -8.0, -WALL);
    add(&mut scene, "wall", grey, quad(corner, DVec3::X * 16.0, DVec3::Y * 16.0, [1.0; 2]));
    sheets(&mut scene);
    light(&mut scene, "lamp", DVec3::ZERO, DVec3::NEG_Z, LightKind::Point { intensity: [INTENSITY as f32; 3] });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1e-3, [4, 4]);
    scene
}

/// Radiance of the wall without glass.
fn bare() -> f64 {
    ALBEDO / PI * INTENSITY / (WALL * WALL)
}

fn mean(scene: &Scene, estimator: Estimator, max_depth: u32, (lo, hi): (f64, f64)) -> (f64, f64) {
    let s = settings(estimator, [4, 4]).max_depth(max_depth).light_paths(200).splat_paths(50).build().unwrap();
    Cells::measure(&mut renderer(scene, &s), Gate { lo, hi }, 4, 2, 16, 100).whole()
}

/// Asserts that the estimators find `truth` in a gate around `tau`, and nothing in the gate before it. Glass that transmits 2 % less must
/// be noticed.
fn arrives(name: &str, estimators: &[Estimator], scene: &Scene, truth: f64, tau: f64) {
    for &estimator in estimators {
        let (found, error) = mean(scene, estimator, 2, (tau - 0.002, tau + 0.002));
        eprintln!("{name}, {estimator}: {found:.6} +- {error:.1e}, expected {truth:.6}");
        let off = |truth: f64| ((found - truth).abs() - 2e-3 * truth).max(0.0) / error.max(1e-9);
        assert!(off(truth) < threshold(1), "{name}, {estimator}: {found} +- {error}, not {truth}");
        assert!(off(0.98 * truth) > threshold(1), "{name}, {estimator}: {found} +- {error} could be {}", 0.98 * truth);
        assert_eq!(mean(scene, estimator, 2, (tau - 0.5, tau - 0.003)).0, 0.0, "{name}, {estimator}: early light");
    }
}

#[test]
fn a_wall_behind_a_sheet_is_dimmed_and_not_delayed() {
    for degrees in [0.0f64, 30.0, 60.0] {
        let angle = degrees.to_radians();
        let scene = wall_behind(|scene| sheet(scene, glass("pane"), 1.0, angle));
        let estimators = if degrees == 60.0 { &ALL[..] } else { &[Estimator::Bdpt] };
        arrives(&format!("{degrees} degrees"), estimators, &scene, bare() * transmittance(angle).powi(2), 2.0 * WALL);
    }
}

/// All samples that pass a sheet are worth the same, and none of them is lost.
#[test]
fn a_clear_sheet_adds_no_noise() {
    for estimator in [Estimator::Pt, Estimator::Lcs] {
        let of = |scene: &Scene| mean(scene, estimator, 2, (7.9, 8.1));
        let (bare, behind) =
            (of(&wall_behind(|_| {})), of(&wall_behind(|scene| sheet(scene, glass("pane"), 1.0, 1.0))));
        let noise = |(mean, error): (f64, f64)| error / mean;
        eprintln!("{estimator}: {:.1e} without a sheet, {:.1e} with it", noise(bare), noise(behind));
        assert!(noise(behind) < 1.5 * noise(bare) + 1e-4, "{estimator}: {behind:?}, {bare:?}");
    }
}

#[test]
fn two_tinted_sheets_multiply() {
    let tint = |name, [r, g, b]: [f32; 3]| Material { base_color: [r, g, b, 1.0], ..glass(name) };
    let scene = wall_behind(|scene| {
        sheet(scene, tint("first", [0.5; 3]), 1.0, 0.5);
        sheet(scene, tint("second", [0.9; 3]), 2.5, -0.8);
    });
    let once = 0.5 * 0.9 * transmittance(0.5) * transmittance(0.8);
    arrives("two sheets", &[Estimator::Pt, Estimator::Lcs], &scene, bare() * once * once, 2.0 * WALL);
}

/// Each time that light passes glass of thickness d, it is delayed by d (n cos theta' - cos theta). Glass that absorbs does so along
/// d / cos theta'.
#[test]
fn thick_sheets_delay_light() {
    let (angle, thickness) = (0.6f64, 0.05);
    let absorbing = Medium { sigma_a: [3.0; 3], ..Medium::default() };
    let look = Material { thickness: thickness as f32, interior: Some(absorbing), thin: Some(true), ..glass("pane") };
    let scene = wall_behind(|scene| sheet(scene, look, 1.0, angle));
    let delay = thickness * (INDEX * cosine_inside(angle) - angle.cos());
    let passed = transmittance(angle) * (-3.0 * thickness / cosine_inside(angle)).exp();
    arrives("thick sheet", &ALL, &scene, bare() * passed * passed, 2.0 * (WALL + delay));
}

/// Glass with a coverage of 0.6, of which 0.7 transmits and 0.3 is a white diffuse surface. It passes light, and it is seen itself.
#[test]
fn glass_with_alpha_and_partial_transmission_is_also_a_surface() {
    let look = Material {
        base_color: [1.0, 1.0, 1.0, 0.6],
        alpha_mode: AlphaMode::Blend,
        transmission: 0.7,
        specular: 0.0,
        ..glass("frosted")
    };
    let scene = wall_behind(|scene| sheet(scene, look, 1.0, 0.0));
    let passed = 0.4 + 0.6 * 0.7 * transmittance(0.0);
    for estimator in [Estimator::Pt, Estimator::Bdpt, Estimator::Lcs] {
        for (tau, truth) in [(8.0, bare() * passed * passed), (2.0, 0.6 * 0.3 / PI * INTENSITY)] {
            let (found, error) = mean(&scene, estimator, 2, (tau - 0.01, tau + 0.01));
            eprintln!("{estimator}: {found:.6} +- {error:.1e}, expected {truth:.6}");
            let off = ((found - truth).abs() - 2e-3 * truth).max(0.0) / error.max(1e-9);
            assert!(off < threshold(1) && error < 0.02 * truth, "{estimator}: {found} +- {error}, not {truth}");
        }
    }
}

/// A lamp behind the camera, seen in the sheet, and a lamp behind the sheet. Both are found by s = 0 alone, from either side of the sheet.
#[test]
fn a_sheet_reflects_the_rest_from_both_sides() {
    for turn in [0.0, PI] {
        let mut scene = Scene::default();
        sheet(&mut scene, glass("pane"), 1.0, turn);
        let [near, far] = [2.0f32, 5.0].map(|radiance| material(&mut scene, emitter("lamp", [radiance; 3])));
        let (x, y) = (DVec3::X * 4.0, DVec3::Y * 4.0);
        add(&mut scene, "behind the camera", near, quad(DVec3::new(2.0, -2.0, 1.0), -x, y, [1.0; 2]));
        add(&mut scene, "behind the sheet", far, quad(DVec3::new(-2.0, -2.0, -3.0), x, y, [1.0; 2]));
        camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1e-3, [4, 4]);
        let truth = 5.0 * transmittance(0.0) + 2.0 * (1.0 - transmittance(0.0));
        let (found, error) = mean(&scene, Estimator::Bdpt, 2, (2.9, 3.1));
        assert!((found - truth).abs() < 4.5 * error + 1e-3 * truth, "{found} +- {error}, not {truth}");
    }
}

/// Light that fog scatters once, before and behind a sheet. Lamp and pinhole are in one place, so light that returns after tau has
/// scattered at tau / 2. Behind a thick sheet, it was delayed twice.
#[test]
fn fog_is_seen_through_a_sheet() {
    fog_behind(0.0, 1.0, 1.0);
    fog_behind(0.02, 1.0, 1.0);
}

#[test]
fn fog_is_seen_through_tinted_glass_with_alpha() {
    fog_behind(0.0, 0.5, 1.0);
    fog_behind(0.0, 0.5, 0.6);
}

fn fog_behind(thickness: f64, tint: f64, alpha: f64) {
    let (sigma_s, sigma_t) = (0.1, 0.2);
    let alpha_mode = if alpha < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque };
    let base_color = [tint, tint, tint, alpha].map(|x| x as f32);
    let look = Material { thickness: thickness as f32, base_color, alpha_mode, ..glass("pane") };
    let mut scene = Scene::default();
    sheet(&mut scene, look, 2.0, 0.0);
    light(&mut scene, "lamp", DVec3::ZERO, DVec3::NEG_Z, LightKind::Point { intensity: [INTENSITY as f32; 3] });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1e-3, [4, 4]);
    scene.media.push(Medium { sigma_s: [sigma_s; 3], sigma_a: [sigma_t - sigma_s; 3], ..Medium::default() });
    let integral = |from: f64, to: f64| {
        let steps = 10_000;
        let width = (to - from) / f64::from(steps);
        let at = |k: i32| from + (f64::from(k) + 0.5) * width;
        (0..steps)
            .map(|k| sigma_s * INTENSITY / (4.0 * PI) * (-2.0 * sigma_t * at(k)).exp() / at(k).powi(2) * width)
            .sum::<f64>()
    };
    let delay = thickness * (INDEX - 1.0);
    let passed = (1.0 - alpha + alpha * tint * transmittance(0.0)).powi(2);
    for (gate, truth) in [
        ((2.0, 3.0), integral(1.0, 1.5)),
        ((3.0, 6.0), integral(1.5, 2.0) + passed * integral(2.0, 3.0 - delay)),
        ((5.0, 5.2), passed * integral(2.5 - delay, 2.6 - delay)),
    ] {
        for estimator in [Estimator::Bdpt, Estimator::Lcs] {
            let (found, error) = mean(&scene, estimator, 2, gate);
            eprintln!(
                "{thickness}, {tint}, {alpha}, {gate:?}, {estimator}: {found:.6} +- {error:.1e}, expected {truth:.6}"
            );
            let off = |truth: f64| ((found - truth).abs() - 2e-3 * truth).max(0.0) / error.max(1e-9);
            assert!(off(truth) < threshold(1), "{gate:?}, {estimator}: {found} +- {error}, not {truth}");
            // Through a thick sheet, no events are drawn in the gate.
            let is_drawn = estimator == Estimator::Lcs && thickness == 0.0 && (tint == 1.0 || gate.1 < 5.5);
            assert!(!is_drawn || off(0.98 * truth) > threshold(1), "{gate:?}, {estimator}: {error} is too large");
        }
    }
}

/// A laser without a width shines through fog and a sheet. `lcs` draws events on the beam, `bdpt` leaves them to chance.
#[test]
fn a_laser_in_fog_is_seen_before_and_behind_a_sheet() {
    for transmission in [1.0f32, 0.5] {
        let look = Material { transmission, base_color: [0.6, 0.6, 0.6, 1.0], ..glass("pane") };
        let mut scene = wall_behind(|scene| sheet(scene, look, 1.5, 0.0));
        scene.lights.clear();
        let power = LightKind::Beam { power: [INTENSITY as f32; 3], radius: 0.0 };
        light(&mut scene, "laser", DVec3::new(0.3, 0.0, 0.0), DVec3::NEG_Z, power);
        scene.cameras.clear();
        camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.9, [4, 4]);
        scene.media.push(Medium { sigma_s: [0.3; 3], ..Medium::default() });
        for gate in [(1.0, 2.5), (1.0, 12.0), (4.0, 5.0)] {
            let [a, b] = [Estimator::Bdpt, Estimator::Lcs].map(|estimator| mean(&scene, estimator, 2, gate));
            eprintln!("{transmission}, {gate:?}: bdpt {:.6} +- {:.1e}, lcs {:.6} +- {:.1e}", a.0, a.1, b.0, b.1);
            let off = |factor: f64| (factor * a.0 - b.0).abs() / a.1.hypot(b.1);
            assert!(off(1.0) < threshold(1), "{transmission}, {gate:?}: {a:?} and {b:?} differ");
        }
    }
}

/// A laser without a width shines through a sheet. Its spot on the wall is a vertex without chance, dimmed once by the sheet; the camera
/// sees it through the sheet as well.
#[test]
fn the_spot_of_a_laser_behind_a_sheet_is_dimmed() {
    for transmission in [1.0f32, 0.5] {
        let look = Material { transmission, specular: 0.0, ..glass("pane") };
        let mut scene = wall_behind(|scene| sheet(scene, look, 1.0, 0.0));
        scene.lights.clear();
        let power = LightKind::Beam { power: [INTENSITY as f32; 3], radius: 0.0 };
        light(&mut scene, "laser", DVec3::new(0.3, 0.0, 0.0), DVec3::NEG_Z, power);
        // The spot lights a second wall beside the camera: what the camera sees there has a closed form.
        scene.cameras.clear();
        camera(&mut scene, DVec3::ZERO, DVec3::new(1.0, 0.0, 0.0), 1e-3, [4, 4]);
        let screen = material(&mut scene, diffuse("screen", [ALBEDO as f32; 3]));
        let corner = DVec3::new(1.0, -2.0, 1.0);
        add(&mut scene, "screen", screen, quad(corner, DVec3::Z * -1.5, DVec3::Y * 4.0, [1.0; 2]));
        let spot = DVec3::new(0.3, 0.0, -WALL);
        let seen = DVec3::new(1.0, 0.0, 0.0);
        let way = seen - spot;
        let distance = way.length();
        let (at_spot, at_screen) = (way.z / distance, way.x / distance);
        let dimmed = f64::from(transmission).powi(2) * transmittance(0.0) * transmittance(at_spot.acos());
        let truth = dimmed * ALBEDO / PI * INTENSITY * at_spot * at_screen / distance.powi(2) * ALBEDO / PI;
        let tau = WALL + distance + 1.0;
        for estimator in [Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs] {
            let (found, error) = mean(&scene, estimator, 3, (tau - 0.01, tau + 0.01));
            eprintln!("{transmission}, {estimator}: {found:.6} +- {error:.1e}, expected {truth:.6}");
            let off = |truth: f64| ((found - truth).abs() - 2e-3 * truth).max(0.0) / error.max(1e-9);
            assert!(off(truth) < threshold(1), "{transmission}, {estimator}: {found} +- {error}, not {truth}");
            assert!(transmission < 1.0 || off(0.98 * truth) > threshold(1), "{estimator}: {error} is too large");
        }
    }
}

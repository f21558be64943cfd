//! Compares the oracle's path tracer in media with closed forms, and media with each other. Seeds are fixed; the tolerance is 4
//! standard errors, and these are at most 0.5 % (0.8 % for differences of two images).

use std::f64::consts::PI;

use glam::{DAffine3, DVec3};
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, glass, light, material};
use taugate::internals::generate::shapes::{cuboid, quad};
use taugate::internals::scene::{DensityGrid, GridFilter, LightKind, Material, Medium, PhaseFunction, Scene};
use taugate::internals::self_check::fog::{Coefficients, gated_single_scattering, integrate};
use taugate::internals::settings::Emitters;
use taugate_oracle::fog::first_scatter_fluence;
use taugate_oracle::path_tracer::{Film, Settings, render};
use taugate_oracle::phase::Phase;

const STEADY: (f64, f64) = (0.0, f64::INFINITY);
const HG: PhaseFunction = PhaseFunction::HenyeyGreenstein { g: 0.6 };

fn settings(resolution: [u32; 2], spp: u32, max_depth: u32, bins: &[(f64, f64)]) -> Settings {
    Settings { camera: 0, resolution, spp, seed: 1, max_depth, bins: bins.to_vec(), emitters: Emitters::Scene }
}

fn medium(sigma_s: f64, sigma_a: f64, phase: PhaseFunction) -> Medium {
    Medium { sigma_s: [sigma_s; 3], sigma_a: [sigma_a; 3], phase, ..Medium::default() }
}

/// A scene without surfaces: a camera at the origin that looks along -z, and the medium.
fn foggy(medium: Medium, yfov: f64) -> Scene {
    let mut scene = Scene { media: vec![medium], ..Scene::default() };
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, yfov, [1, 1]);
    scene
}

/// Mean of a channel over the image, weighted by `weight` of the pixel's index, and its standard error.
fn weighted(film: &Film, bin: usize, channel: usize, weight: impl Fn(usize) -> f64) -> (f64, f64) {
    let (mut mean, mut variance) = (0.0, 0.0);
    for (i, pixel) in film.bins[bin].iter().enumerate() {
        mean += weight(i) * pixel.mean[channel];
        variance += weight(i).powi(2) * pixel.variance[channel];
    }
    (mean, variance.sqrt())
}

fn average(film: &Film, bin: usize, channel: usize) -> (f64, f64) {
    let n = film.bins[bin].len() as f64;
    weighted(film, bin, channel, |_| 1.0 / n)
}

/// Panics unless the estimate agrees with `truth` within 4 standard errors, is precise to 0.5 %, and disagrees with `wrong`.
fn assert_is((mean, error): (f64, f64), truth: f64, wrong: f64, what: &str) {
    let off = |value: f64| ((mean - value).abs() - 1e-6 * value.abs()).max(0.0) / error.max(1e-300);
    println!("{what}: {mean:.6e} +- {:.2} %, truth {truth:.6e}, {:.1} errors off", 100.0 * error / mean, off(truth));
    assert!(off(truth) < 4.0, "{what}: {mean} +- {error} and not {truth}");
    assert!(error < 0.005 * mean, "{what}: the error {error} of {mean} is too large to tell");
    assert!(off(wrong) > 4.0, "{what}: the wrong truth {wrong} passes with {mean} +- {error}");
}

/// Panics unless two independent estimates agree within 4 standard errors, and their difference is precise to 0.8 %.
fn assert_same(a: (f64, f64), b: (f64, f64), what: &str) {
    let error = a.1.hypot(b.1);
    println!("{what}: {:.6e} and {:.6e}, {:.1} errors apart", a.0, b.0, (a.0 - b.0).abs() / error);
    assert!(error < 0.008 * a.0 && (a.0 - b.0).abs() < 4.0 * error, "{what}: {a:?} and {b:?}");
    assert!((a.0 - 1.04 * b.0).abs() > 4.0 * error, "{what}: 4 % would not be seen");
}

/// Radiance along -z by the closed form, for the fog of [`single_scattering_of_a_point_light`].
fn scattered_once(sigma_s: f64, phase: &PhaseFunction, source: DVec3, gate: (f64, f64)) -> f64 {
    let phase = Phase::new(phase);
    let fog = Coefficients { sigma_s, sigma_t: 0.05 };
    gated_single_scattering(fog, |cos| phase.density(cos), 2.0, source, DVec3::NEG_Z, [gate.0, gate.1])
}

#[test]
fn single_scattering_of_a_point_light() {
    let table = PhaseFunction::Table { cosines: vec![-1.0, -0.9, 0.0, 1.0], values: vec![0.4, 0.1, 0.05, 1.0] };
    let droplets = PhaseFunction::HenyeyGreensteinDraine { g: 0.9, g_draine: 0.5, alpha: 20.0, weight_draine: 0.6 };
    let source = DVec3::new(3.0, 1.0, -4.0);
    let gates = [(6.0, 8.0), (8.0, 12.0), (12.0, 20.0), (20.0, 40.0)];
    for phase in [PhaseFunction::Isotropic, HG, droplets, table] {
        let mut scene = foggy(medium(0.04, 0.01, phase.clone()), 1e-3);
        light(&mut scene, "lamp", source, DVec3::Z, LightKind::Point { intensity: [2.0; 3] });
        let film = render(&scene, &settings([8, 8], 15_000, 2, &gates));
        for (bin, gate) in gates.into_iter().enumerate() {
            let truth = |sigma_s| scattered_once(sigma_s, &phase, source, gate);
            assert_is(average(&film, bin, 0), truth(0.04), truth(0.04 * 1.03), &format!("{phase:?}, gate {gate:?}"));
        }
    }
}

#[test]
fn single_scattering_beside_the_sensor() {
    let mut scene = foggy(medium(0.04, 0.01, PhaseFunction::Isotropic), 1e-3);
    light(&mut scene, "lamp", DVec3::ZERO, DVec3::Z, LightKind::Point { intensity: [1.0; 3] });
    let film = render(&scene, &settings([8, 8], 20_000, 2, &[(40.0, 50.0)]));
    // sigma_s / (4 pi) times the integral of exp(-2 sigma_t r) / r^2 over r from 20 m to 25 m.
    assert_is(average(&film, 0, 0), 3.45304e-6, 3.45304e-6 * 1.03, "collocated");
}

#[test]
fn single_scattering_of_a_beam() {
    // The beam crosses the view of the camera about 6 m away.
    let (source, direction) = (DVec3::new(-2.0, -1.0, -6.0), DVec3::new(1.0, 0.4, 0.3).normalize());
    let gates = [(7.5, 8.0), (8.0, 9.0), (9.0, 12.0)];
    let mut scene = foggy(medium(0.04, 0.01, HG), 1.9);
    light(&mut scene, "beam", source, direction, LightKind::Beam { power: [2.0; 3], radius: 0.0 });
    const SIDE: usize = 64;
    let film = render(&scene, &settings([SIDE as u32; 2], 600, 2, &gates));
    let half = 0.95f64.tan();
    let solid_angle = |i: usize| {
        let on_plane = |k: usize| ((k as f64 + 0.5) / SIDE as f64 * 2.0 - 1.0) * half;
        let (x, y) = (on_plane(i % SIDE), on_plane(i / SIDE));
        (2.0 * half / SIDE as f64).powi(2) / (1.0 + x * x + y * y).powf(1.5)
    };
    for (bin, gate) in gates.into_iter().enumerate() {
        let phase = Phase::new(&HG);
        // The fluence at the sensor. By reciprocity, it equals the radiance along the beam of a point light at the sensor.
        let truth = |sigma_s| {
            let fog = Coefficients { sigma_s, sigma_t: 0.05 };
            gated_single_scattering(fog, |cos| phase.density(cos), 2.0, -source, direction, [gate.0, gate.1])
        };
        let fluence = weighted(&film, bin, 0, solid_angle);
        assert_is(fluence, truth(0.04), truth(0.04 * 1.03), &format!("beam, gate {gate:?}"));
    }
}

/// A beam in a box of fog; the camera is outside. With a mirror, everything but the camera is reflected in the plane
/// x + z = -0.3, in which the mirror lies.
fn beam_in_a_box(radius: f32, mirrored: bool) -> Film {
    let place = |p: DVec3| if mirrored { DVec3::new(-p.z - 0.3, p.y, -p.x - 0.3) } else { p };
    let [a, b] = [DVec3::new(-1.0, -1.0, -4.0), DVec3::new(1.0, 1.0, -2.0)].map(place);
    let mut scene = foggy(Medium { bounds: Some([a.min(b), a.max(b)]), ..medium(1.0, 0.1, HG) }, 0.8);
    let (source, target) = (place(DVec3::new(-2.0, 0.2, -2.6)), place(DVec3::new(0.0, 0.1, -3.0)));
    light(&mut scene, "beam", source, target - source, LightKind::Beam { power: [2.0; 3], radius });
    if mirrored {
        let mirror = material(&mut scene, Material::metal("mirror", [1.0; 3], 0.0));
        let corner = DVec3::new(-0.4, -0.6, 0.1);
        add(&mut scene, "mirror", mirror, quad(corner, DVec3::new(0.8, 0.0, -0.8), DVec3::Y * 1.2, [1.0; 2]));
    }
    let (spp, max_depth) = if mirrored { (60_000, 3) } else { (4_000, 2) };
    render(&scene, &settings([8, 8], spp, max_depth, &[STEADY, (4.5, 6.0)]))
}

#[test]
fn a_wide_beam_in_fog_is_as_bright_as_a_thin_one() {
    assert_same_images(&beam_in_a_box(0.0, false), &beam_in_a_box(0.05, false), "thin and wide");
}

#[test]
#[ignore = "takes five seconds; beams in fog without mirrors are tested always"]
fn a_mirror_shows_a_beam_in_fog() {
    // Behind the mirror, only sensor paths that enter the beam by chance find it.
    assert_same_images(&beam_in_a_box(0.4, false), &beam_in_a_box(0.4, true), "mirror");
}

/// Cameras in the six directions of a cube at the origin, and the weights of their pixels in the mean over all directions.
fn around(scene: &mut Scene, side: u32) -> impl Fn(usize) -> f64 + use<> {
    scene.cameras.clear();
    for axis in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z] {
        camera(scene, DVec3::ZERO, axis, PI / 2.0, [side; 2]);
    }
    // Solid angle of the rectangle between the centre of a view and (x, y), on the plane at distance 1.
    let corner = |x: f64, y: f64| (x * y / (1.0 + x * x + y * y).sqrt()).atan();
    let edge = move |i: u32| 2.0 * f64::from(i) / f64::from(side) - 1.0;
    move |i| {
        let (x, y) = (i as u32 % side, i as u32 / side);
        let (x0, x1, y0, y1) = (edge(x), edge(x + 1), edge(y), edge(y + 1));
        corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)
    }
}

#[test]
fn fluence_of_light_that_was_scattered_once() {
    let mut scene = foggy(medium(0.3, 0.1, PhaseFunction::Isotropic), 1.0);
    let intensity = [0.25 / PI as f32; 3];
    light(&mut scene, "lamp", DVec3::new(0.0, 0.6, 0.8), DVec3::Z, LightKind::Point { intensity });
    let weight = around(&mut scene, 8);
    let gates = [(1.3, 2.0), (2.0, 3.0), (3.0, 6.0)];
    let films: Vec<Film> =
        (0..6).map(|side| render(&scene, &Settings { camera: side, ..settings([8, 8], 4_000, 2, &gates) })).collect();
    for (bin, gate) in gates.into_iter().enumerate() {
        let sides = films.iter().map(|film| weighted(film, bin, 0, &weight));
        let (mean, variance) = sides.fold((0.0, 0.0), |(m, v), (mean, error)| (m + mean, v + error * error));
        let truth = |sigma_s: f64| {
            let fog = Coefficients { sigma_s, sigma_t: 0.4 };
            integrate(gate.0, gate.1, |tau| first_scatter_fluence(fog, 1.0, tau))
        };
        assert_is((mean, variance.sqrt()), truth(0.3), truth(0.3 * 1.03), &format!("fluence, gate {gate:?}"));
    }
}

/// A grey room of 3 m with a ceiling that shines, seen from `eye`, with these media. It has no point light: near one, the variance
/// of light scattered in a medium is infinite.
fn room(media: Vec<Medium>, eye: DVec3) -> Scene {
    let mut scene = Scene { media, ..Scene::default() };
    let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
    add(&mut scene, "room", grey, cuboid(DVec3::splat(-1.5), DVec3::splat(1.5)));
    let shine = material(&mut scene, emitter("shine", [1.0; 3]));
    let corner = DVec3::new(-1.4, 1.4, -1.4);
    add(&mut scene, "ceiling", shine, quad(corner, DVec3::X * 2.8, DVec3::Z * 2.8, [1.0; 2]));
    camera(&mut scene, eye, DVec3::ZERO, 0.9, [1, 1]);
    scene
}

const OUTSIDE: DVec3 = DVec3::new(0.1, 0.2, 1.4);
/// The corners of the media in the room.
const BOX: [DVec3; 2] = [DVec3::new(-0.8, -0.9, -0.8), DVec3::new(0.8, 0.8, 0.9)];
const IN_ROOM: [(f64, f64); 3] = [STEADY, (0.0, 3.0), (3.0, 6.0)];

#[test]
#[ignore = "takes five seconds; single scattering has a closed form that is tested always"]
fn absorption_factorises() {
    // In a gate of 0.1 m, the transmittance varies by less than 1 %, nearly symmetrically.
    let gates: Vec<(f64, f64)> = (0..30).map(|i| (2.0 + 0.1 * f64::from(i), 2.1 + 0.1 * f64::from(i))).collect();
    let film = |sigma_a, seed| {
        let scene = room(vec![medium(0.3, sigma_a, HG)], OUTSIDE);
        render(&scene, &Settings { seed, ..settings([8, 8], 5_000, 8, &gates) })
    };
    let (clear, dark) = (film(0.0, 1), film(0.1, 2));
    let total = |film: &Film, factor: &dyn Fn(f64) -> f64| {
        let bins = gates.iter().enumerate().map(|(bin, gate)| {
            let (mean, error) = average(film, bin, 1);
            let factor = factor((gate.0 + gate.1) / 2.0);
            (factor * mean, factor * error)
        });
        let (mean, variance) = bins.fold((0.0, 0.0), |(m, v), (mean, error)| (m + mean, v + error * error));
        (mean, variance.sqrt())
    };
    assert_same(total(&dark, &|_| 1.0), total(&clear, &|tau| (-0.1 * tau).exp()), "absorption");
}

/// A grid whose voxels are all equal to 0.5 inside of `bounds`. The grid is denser outside of `bounds`, so that most
/// collisions inside are null collisions.
fn even_grid(bounds: [DVec3; 2], filter: GridFilter) -> DensityGrid {
    let resolution = [6u32, 6, 6];
    let is_edge = |i: u32| i == 0 || i == 5;
    let voxels = (0..216u32).map(|i| [i % 6, i / 6 % 6, i / 36]);
    let density = voxels.map(|v| if v.into_iter().any(is_edge) { 2.0 } else { 0.5 }).collect();
    // The bounds cover the two middle voxels, so a linear filter does not see the edge either.
    let voxel = (bounds[1] - bounds[0]) / 2.0;
    let transform = DAffine3::from_translation(bounds[0] - 2.0 * voxel) * DAffine3::from_scale(voxel);
    DensityGrid { resolution, density, bounds: [DVec3::ZERO, DVec3::splat(6.0)], transform, filter }
}

/// Image of the room. Images of different seeds are independent.
fn in_room(media: Vec<Medium>, seed: u64) -> Film {
    render(&room(media, OUTSIDE), &Settings { seed, ..settings([8, 8], 8_000, 6, &IN_ROOM) })
}

fn assert_same_images(a: &Film, b: &Film, what: &str) {
    for bin in 0..a.bins.len() {
        assert_same(average(a, bin, 0), average(b, bin, 0), &format!("{what}, bin {bin}"));
    }
}

#[test]
#[ignore = "takes five seconds; a grid of two halves is tested always"]
fn an_even_grid_is_a_homogeneous_medium() {
    let fog = Medium { bounds: Some(BOX), ..medium(1.0, 0.2, HG) };
    let even = in_room(vec![fog.clone()], 1);
    for filter in [GridFilter::Linear, GridFilter::Nearest] {
        // Twice the coefficients at half the density.
        let grid = Medium { sigma_s: [2.0; 3], sigma_a: [0.4; 3], grid: Some(even_grid(BOX, filter)), ..fog.clone() };
        assert_same_images(&even, &in_room(vec![grid], 2), &format!("grid, {filter:?}"));
    }
}

#[test]
fn a_grid_of_two_halves_is_two_boxes() {
    let [lo, hi] = BOX;
    let thin = Medium { bounds: Some([lo, DVec3::new(0.0, hi.y, hi.z)]), ..medium(0.2, 0.1, HG) };
    let thick = Medium { bounds: Some([DVec3::new(0.0, lo.y, lo.z), hi]), ..medium(2.0, 1.0, HG) };
    let (bounds, transform) = (BOX, DAffine3::IDENTITY);
    let (resolution, density) = ([2, 1, 1], vec![1.0, 10.0]);
    let grid = DensityGrid { resolution, density, bounds, transform, filter: GridFilter::Nearest };
    let grid = Medium { grid: Some(grid), ..medium(0.2, 0.1, HG) };
    assert_same_images(&in_room(vec![thin, thick], 1), &in_room(vec![grid], 2), "halves");
}

#[test]
#[ignore = "takes ten seconds; the null boundaries of the renderer are tested always"]
fn a_null_boundary_bounds_a_medium_as_a_box_does() {
    for eye in [OUTSIDE, DVec3::new(0.2, 0.1, 0.7)] {
        let fog = medium(1.0, 0.2, HG);
        let boxed = room(vec![Medium { bounds: Some(BOX), ..fog.clone() }], eye);
        let mut meshed = room(vec![], eye);
        let null = material(&mut meshed, Material { interior: Some(fog), ior: 1.0, ..glass("null") });
        add(&mut meshed, "fog", null, cuboid(BOX[0], BOX[1]));
        meshed.check().expect("a good scene");
        let [boxed, meshed] = [(boxed, 1), (meshed, 2)]
            .map(|(scene, seed)| render(&scene, &Settings { seed, ..settings([8, 8], 8_000, 6, &IN_ROOM) }));
        assert_same_images(&boxed, &meshed, &format!("null boundary, eye {eye}"));
    }
}

#[test]
fn a_furnace_with_white_fog_stays_a_furnace() {
    // Walls that shine with radiance 1 and reflect nothing: every path that ends on a wall returns 1.
    let walls = Material { double_sided: true, ..emitter("walls", [1.0; 3]) };
    let mut scene = foggy(medium(0.0, 0.0, HG), 1.0);
    scene.media[0].sigma_s = [0.2, 0.4, 0.8];
    let walls = material(&mut scene, walls);
    add(&mut scene, "room", walls, cuboid(DVec3::splat(-1.5), DVec3::splat(1.5)));
    let film = render(&scene, &settings([8, 8], 2_000, 60, &[STEADY]));
    for channel in 0..3 {
        assert_is(average(&film, 0, channel), 1.0, 1.03, &format!("furnace, channel {channel}"));
    }
}

/// A shining wall 3 m in front of the camera, behind half a metre of glass with a medium inside, in water with this index.
fn window(interior: Option<Medium>, ior: f32, group_ior: f32, bins: &[(f64, f64)]) -> Film {
    let mut scene = foggy(Medium { ior, group_ior, ..Medium::default() }, 0.01);
    let shine = material(&mut scene, emitter("shine", [1.0; 3]));
    let corner = DVec3::new(-5.0, -5.0, -3.0);
    add(&mut scene, "wall", shine, quad(corner, DVec3::X * 10.0, DVec3::Y * 10.0, [1.0; 2]));
    let pane = material(&mut scene, Material { interior, ..glass("pane") });
    add(&mut scene, "pane", pane, cuboid(DVec3::new(-4.0, -4.0, -1.5), DVec3::new(4.0, 4.0, -1.0)));
    render(&scene, &settings([2, 2], 100_000, 8, bins))
}

#[test]
fn coloured_absorption_in_glass() {
    let blue = Medium { sigma_a: [2.0, 1.0, 0.1], ..Medium::default() };
    let film = window(Some(blue), 1.0, 1.0, &[(3.2499, 3.251)]);
    for (channel, sigma_a) in [2.0f64, 1.0, 0.1].into_iter().enumerate() {
        let truth = |sigma_a: f64| 0.96f64.powi(2) * (-0.5 * sigma_a).exp();
        // A slab that is 0.03 m thicker, or 0.3 m for the clearest channel, is rejected.
        let wrong = truth(sigma_a * if channel == 2 { 1.6 } else { 1.06 });
        assert_is(average(&film, 0, channel), truth(sigma_a), wrong, &format!("glass, channel {channel}"));
    }
}

#[test]
fn water_has_its_phase_index_at_boundaries_and_its_group_index_in_time() {
    // 2.5 m of water and 0.5 m of glass. The ratio of the indices determines what the two faces reflect.
    let arrival = 2.5 * 1.4 + 0.5 * 1.5;
    let film = window(None, 1.33, 1.4, &[(arrival - 1e-3, arrival + 1e-3), STEADY]);
    let passed = |ior: f64| 1.0 - ((1.5 - ior) / (1.5 + ior)).powi(2);
    assert_is(average(&film, 0, 0), passed(1.33).powi(2), passed(1.0).powi(2), "water");
}

/// A box of fog that only scatters, under a sky of radiance 1. Every path ends in the sky, so every pixel is 1.
#[test]
fn white_fog_vanishes_under_an_even_sky() {
    for eye in [DVec3::new(0.0, 0.0, 2.5), DVec3::ZERO] {
        let mut scene = foggy(Medium { bounds: Some(BOX), ..medium(1.5, 0.0, HG) }, 0.4);
        scene.cameras.clear();
        camera(&mut scene, eye, DVec3::new(0.1, 0.0, -1.0), 0.4, [1, 1]);
        light(&mut scene, "sky", DVec3::ZERO, DVec3::Z, LightKind::Sky { radiance: [1.0; 3] });
        let film = render(&scene, &settings([8, 8], 2_000, 80, &[STEADY]));
        assert_is(average(&film, 0, 0), 1.0, 1.03, &format!("sky, eye {eye}"));
    }
}

#[test]
fn a_sun_shines_through_a_slab() {
    // Two slabs of absorption, above and to the side of a white floor. Rays to the sun only meet the slab above.
    let slab = |lo: DVec3, hi: DVec3| Medium { bounds: Some([lo, hi]), ..medium(0.0, 0.5, HG) };
    let far = 1e3;
    let mut scene = foggy(slab(DVec3::new(-far, 300.0, -far), DVec3::new(far, 301.0, far)), 0.1);
    scene.media.push(slab(DVec3::new(10.0, 0.0, -far), DVec3::new(far, 100.0, far)));
    let white = material(&mut scene, diffuse("white", [1.0; 3]));
    add(&mut scene, "floor", white, quad(DVec3::new(-2.0, 0.0, 2.0), DVec3::X * 4.0, DVec3::Z * -4.0, [1.0; 2]));
    scene.cameras.clear();
    camera(&mut scene, DVec3::new(0.0, 1.0, 1.0), DVec3::ZERO, 0.1, [1, 1]);
    let sun = DVec3::new(0.6, -0.8, 0.0);
    light(&mut scene, "sun", DVec3::ZERO, sun, LightKind::Directional { irradiance: [PI as f32; 3] });
    let radiance = |scene: &Scene| average(&render(scene, &settings([2, 2], 100, 3, &[STEADY])), 0, 0);
    let truth = |length: f64| 0.8 * (-0.5 * length).exp();
    assert_is(radiance(&scene), truth(1.0 / 0.8), truth(1.03 / 0.8), "slab");
    // Fog without bounds absorbs all light of a sun.
    scene.media.push(medium(0.0, 1e-6, HG));
    assert_eq!(radiance(&scene).0, 0.0);
}

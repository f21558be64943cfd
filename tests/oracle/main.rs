//! Compares the oracle's path tracer with closed forms. Seeds are fixed; the tolerance is 4 standard errors.

mod fog;
#[path = "../common/orthographic.rs"]
mod orthographic;

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, glass, light, material, metal, plastic};
use taugate::internals::generate::shapes::{cuboid, icosphere, inside_out, quad};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::{LightKind, Material, Scene};
use taugate::internals::self_check::sphere::gated_radiance;
use taugate::internals::settings::Emitters;
use taugate_oracle::path_tracer::{Film, Settings, render};

const STEADY: (f64, f64) = (0.0, f64::INFINITY);

fn settings(resolution: [u32; 2], spp: u32, max_depth: u32, bins: &[(f64, f64)]) -> Settings {
    Settings { camera: 0, resolution, spp, seed: 1, max_depth, bins: bins.to_vec(), emitters: Emitters::Scene }
}

/// Mean of the first channel over the image, and its standard error. Pixels are independent of each other.
fn average(film: &Film, bin: usize) -> (f64, f64) {
    let pixels = &film.bins[bin];
    let n = pixels.len() as f64;
    let mean = pixels.iter().map(|p| p.mean[0]).sum::<f64>() / n;
    let variance = pixels.iter().map(|p| p.variance[0]).sum::<f64>() / (n * n);
    (mean, variance.sqrt())
}

/// Distance from the truth in standard errors, after subtracting a relative 1e-6 for rounding to f32.
fn z((mean, error): (f64, f64), truth: f64) -> f64 {
    ((mean - truth).abs() - 1e-6 * truth.abs()).max(0.0) / error.max(1e-300)
}

const GATES: [(f64, f64); 3] = [(2.5, 3.0), (3.5, 4.0), (4.0, 5.0)];

/// Gates whose edges are 2 % too late.
fn late((lo, hi): (f64, f64)) -> (f64, f64) {
    (1.02 * lo, 1.02 * hi)
}

#[test]
fn gated_sphere_with_a_point_light() {
    let scene = build(Kind::parse("gated-sphere").unwrap());
    let mut bins = GATES.to_vec();
    bins.push((1.99, 2.01));
    let film = render(&scene, &settings([8, 8], 300, 18, &bins));
    // Every sample finds the direct return, so its image has no noise.
    assert!((average(&film, 3).0 / 0.5 - 1.0).abs() < 2e-3);
    let mut control: f64 = 0.0;
    for (bin, gate) in GATES.into_iter().enumerate() {
        let got = average(&film, bin);
        let distance = |(lo, hi)| z(got, gated_radiance(1.0, 0.5, lo, hi));
        assert!(distance(gate) < 4.0, "gate {gate:?}: {got:?} is {} errors off", distance(gate));
        control = control.max(distance(late(gate)));
    }
    assert!(control > 4.0, "a gate that is off by 2 % passes with {control} errors");
}

/// A beam from the centre of the sphere, with the view averaged over all directions. After its first hit, the light follows the
/// chords of the closed form. So every order of reflection beyond the first returns P / (4 pi^2 R^2) times the closed form.
fn beam_in_a_sphere(radius: f32) {
    let mut scene = build(Kind::GatedSphere { radius: 1.0, subdivisions: 6, albedo: 0.5 });
    let kind = LightKind::Beam { power: [3.0; 3], radius };
    scene.lights.clear();
    light(&mut scene, "beam", DVec3::ZERO, DVec3::new(0.1, 0.2, 1.0), kind);
    scene.cameras.clear();
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        camera(&mut scene, DVec3::ZERO, axis, std::f64::consts::FRAC_PI_2, [SIDE, SIDE]);
        camera(&mut scene, DVec3::ZERO, -axis, std::f64::consts::FRAC_PI_2, [SIDE, SIDE]);
    }
    let films: Vec<Film> = (0..6)
        .map(|side| render(&scene, &Settings { camera: side, ..settings([SIDE, SIDE], 30, 16, &GATES) }))
        .collect();
    let scale = 3.0 / (4.0 * std::f64::consts::PI.powi(2));
    let mut control: f64 = 0.0;
    for (bin, gate) in GATES.into_iter().enumerate() {
        let got = over_all_directions(&films, bin);
        let distance = |(lo, hi)| z(got, scale * gated_radiance(1.0, 0.5, lo, hi));
        assert!(distance(gate) < 4.0, "gate {gate:?}: {got:?} is {} errors off", distance(gate));
        control = control.max(distance(late(gate)));
    }
    assert!(control > 4.0, "a gate that is off by 2 % passes with {control} errors");
}

const SIDE: u32 = 16;

/// Mean over all directions, from six square views with a field of view of 90 degrees, and its standard error.
fn over_all_directions(films: &[Film], bin: usize) -> (f64, f64) {
    // Solid angle of the rectangle between the centre of a view and (x, y), on the plane at distance 1.
    let corner = |x: f64, y: f64| (x * y / (1.0 + x * x + y * y).sqrt()).atan();
    let edge = |i: usize| 2.0 * i as f64 / f64::from(SIDE) - 1.0;
    let (mut mean, mut variance) = (0.0, 0.0);
    for (i, pixel) in films.iter().flat_map(|f| f.bins[bin].iter().enumerate()) {
        let (column, row) = (i % SIDE as usize, i / SIDE as usize);
        let (x0, x1, y0, y1) = (edge(column), edge(column + 1), edge(row), edge(row + 1));
        let angle = corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0);
        let weight = angle / (4.0 * std::f64::consts::PI);
        mean += weight * pixel.mean[0];
        variance += weight * weight * pixel.variance[0];
    }
    (mean, variance.sqrt())
}

#[test]
fn gated_sphere_with_a_thin_beam() {
    beam_in_a_sphere(0.0);
}

#[test]
fn gated_sphere_with_a_wide_beam() {
    beam_in_a_sphere(0.1);
}

/// A wall at z = -2, seen by a camera at the origin and lit by a beam that starts between them, 0.3 m beside the axis.
fn beam_on_a_wall(radius: f32, aim: DVec3) -> Film {
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [0.6; 3]));
    add(&mut scene, "wall", white, quad(DVec3::new(-5.0, -5.0, -2.0), DVec3::X * 10.0, DVec3::Y * 10.0, [1.0; 2]));
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1.0, [16, 16]);
    let source = DVec3::new(0.3, 0.0, -0.5);
    light(&mut scene, "beam", source, aim - source, LightKind::Beam { power: [2.0; 3], radius });
    render(&scene, &settings([16, 16], 2_500, 6, &[STEADY, (0.0, 3.4), (3.4, 3.8), (3.8, 9.0)]))
}

#[test]
fn the_spot_of_a_beam_as_the_camera_sees_it() {
    // The wall is parallel to the image, so the image's mean is (rho / pi) P divided by the area of the wall in view.
    let truth = 0.6 * 2.0 / std::f64::consts::PI / (4.0 * 4.0 * 0.5f64.tan().powi(2));
    for radius in [0.0, 0.2] {
        for aim in [DVec3::new(0.3, 0.0, -2.0), DVec3::new(-0.2, 0.3, -2.0)] {
            let film = beam_on_a_wall(radius, aim);
            let got = average(&film, 0);
            assert!(z(got, truth) < 4.0, "radius {radius}: {got:?} and not {truth}");
            assert!(radius == 0.0 || z(got, 1.05 * truth) > 4.0);
            // All light is in the bin [3.4, 3.8): 1.5 to 1.7 m to the wall, about 2.0 m back.
            assert_eq!(average(&film, 2), got);
        }
    }
}

/// Compares every pixel through each gate. The orthographic camera sees the floor at an angle.
#[test]
fn an_orthographic_camera_sees_the_closed_form() {
    use orthographic::{GATES, RESOLUTION, floor, gated_pixels};
    let film = render(&floor(), &settings(RESOLUTION, 1_000, 2, &GATES));
    for (bin, gate) in GATES.into_iter().enumerate() {
        let truth = gated_pixels(gate);
        let brightest = truth.iter().copied().fold(0.0, f64::max);
        let wrong = |truth: &[f64]| {
            let pixels = film.bins[bin].iter().zip(truth);
            let off = pixels.filter(|(p, t)| ((p.mean[0] - **t).abs() - 1e-3 * brightest) > 4.5 * p.variance[0].sqrt());
            off.count()
        };
        assert_eq!(wrong(&truth), 0, "gate {gate:?}");
        // Negative control: gates that are 5 cm too late.
        let late = gated_pixels((gate.0 + 0.05, gate.1 + 0.05));
        assert!(gate.1.is_infinite() || wrong(&late) > 5, "gate {gate:?}");
    }
}

/// The spot of a thin beam, seen by an orthographic camera at an angle. The spot is in one pixel, so the image's mean is rho / pi
/// times the beam's power, times the cosine of the viewing angle, divided by the area of the sensor.
#[test]
fn the_spot_of_a_beam_as_an_orthographic_camera_sees_it() {
    let mut scene = orthographic::floor();
    scene.lights.clear();
    light(
        &mut scene,
        "beam",
        DVec3::new(0.3, 0.2, 1.0),
        DVec3::NEG_Z,
        LightKind::Beam { power: [2.0; 3], radius: 0.0 },
    );
    let axis = DVec3::new(0.1, 0.6, -0.8).normalize();
    // 1 m to the floor, then to the sensor plane, which is 3 m away from the origin.
    let tau = 1.0 + 3.0 + axis.dot(DVec3::new(0.3, 0.2, 0.0));
    let film = render(&scene, &settings(orthographic::RESOLUTION, 4, 2, &[STEADY, (tau - 1e-6, tau + 1e-6)]));
    let truth = 0.6 * 2.0 / std::f64::consts::PI * -axis.z / (4.0 * 6.0);
    for bin in [0, 1] {
        assert!((average(&film, bin).0 / truth - 1.0).abs() < 1e-6, "{:?} and not {truth}", average(&film, bin));
    }
    // The point is `x` metres right of the axis and `y` metres above it, in a view that is 4 m high.
    let right = axis.cross(DVec3::Y).normalize();
    let (x, y) = (right.dot(DVec3::new(0.3, 0.2, 0.0)), right.cross(axis).dot(DVec3::new(0.3, 0.2, 0.0)));
    let (column, row) = ((0.3 * 24.0 + x * 4.0).floor() as usize, (0.6 * 16.0 - y * 4.0).floor() as usize);
    assert!(film.bins[0].iter().enumerate().all(|(i, p)| (p.mean[0] > 0.0) == (i == row * 24 + column)));
}

/// An object of the material `inner`, if any, in a room with the material `walls`. The radiance in the room should be 1.
fn room_that_shines(inner: Option<Material>, walls: Material) -> Scene {
    let mut scene = Scene::default();
    let walls = material(&mut scene, walls);
    add(&mut scene, "room", walls, inside_out(cuboid(DVec3::splat(-2.0), DVec3::splat(2.0))));
    if let Some(inner) = inner {
        let inner = material(&mut scene, inner);
        // Glass objects are blocks: light that enters a block can leave it. The facets of a ball would trap some light for many
        // reflections.
        let block = scene.materials[inner as usize].transmission > 0.0;
        let half = DVec3::splat(0.6);
        add(&mut scene, "ball", inner, if block { cuboid(-half, half) } else { icosphere(0.8, 2) });
    }
    camera(&mut scene, DVec3::new(0.0, 0.0, 1.9), DVec3::ZERO, 0.9, [8, 8]);
    scene
}

#[test]
fn furnace() {
    let walls = Material { emission: [0.5; 3], ..diffuse("walls", [0.5; 3]) };
    let scene = room_that_shines(None, walls);
    let film = render(&scene, &settings([8, 8], 300, 24, &[STEADY]));
    let got = average(&film, 0);
    assert!(z(got, 1.0) < 4.0 && got.1 < 0.01, "{got:?}");
    assert!(z(got, 1.05) > 4.0);
}

#[test]
fn white_things_vanish_in_a_room_that_shines() {
    let white = [1.0; 3];
    let kinds =
        [diffuse("", white), plastic("", white, 0.3), plastic("", white, 0.0), metal("", white, 0.0), glass("")];
    for inner in kinds {
        let name = format!("metallic {}, roughness {}", inner.metallic, inner.roughness);
        let scene = room_that_shines(Some(inner), emitter("walls", white));
        let film = render(&scene, &settings([8, 8], 300, 40, &[STEADY]));
        let got = average(&film, 0);
        assert!(z(got, 1.0) < 4.0 || (got.0 - 1.0).abs() < 1e-3, "{name}: {got:?}");
        assert!(got.1 < 0.01, "{name}: {got:?}");
    }
}

/// An emitting wall 3 m in front of the camera, behind half a metre of glass. `turned`: the wall's back faces the camera.
fn window(double_sided: bool, turned: bool) -> Film {
    let mut scene = Scene::default();
    let shine = material(&mut scene, Material { double_sided, ..emitter("shine", [1.0; 3]) });
    let (corner, x, y) = (DVec3::new(-5.0, -5.0, -3.0), DVec3::X * 10.0, DVec3::Y * 10.0);
    let wall = quad(corner, x, y, [1.0; 2]);
    add(&mut scene, "wall", shine, if turned { inside_out(wall) } else { wall });
    let pane = material(&mut scene, glass("pane"));
    add(&mut scene, "pane", pane, cuboid(DVec3::new(-4.0, -4.0, -1.5), DVec3::new(4.0, 4.0, -1.0)));
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.01, [1, 1]);
    render(&scene, &settings([1, 1], 200_000, 8, &[(3.2499, 3.251), (4.7499, 4.751), STEADY]))
}

#[test]
fn glass_slows_light_and_loses_some() {
    let film = window(false, false);
    let once = 0.96f64.powi(2);
    // The direct path: 2.5 m of air and 0.5 m of glass take 3.25 m. Two reflections inside the glass add 1.5 m.
    assert!(z(average(&film, 0), once) < 4.0);
    assert!(z(average(&film, 1), once * 0.04f64.powi(2)) < 4.0);
    assert!(z(average(&film, 0), 0.97 * once) > 4.0);
    // A one-sided emitter is dark when seen from behind.
    assert_eq!(average(&window(false, true), 2).0, 0.0);
    assert!(average(&window(true, true), 2).0 > 0.9);
}

#[test]
fn same_seed_same_bits_and_bins_partition() {
    let scene = build(Kind::CornellBox);
    let film = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| render(&scene, &settings([16, 16], 8, 6, &[STEADY, (0.0, 9.0), (9.0, 11.0), (11.0, 1e9)])))
    };
    let (one, two) = (film(1), film(2));
    assert_eq!(one.bins, two.bins);
    let parts: f64 = (1..4).map(|bin| one.average(bin)).sum();
    assert!((parts / one.average(0) - 1.0).abs() < 1e-12 && parts > 0.05);
}

#[test]
fn emitters_can_be_chosen_by_node() {
    let scene = build(Kind::CornellBox);
    let with = |node: &str| {
        let emitters = Emitters::Nodes(vec![node.to_owned()]);
        render(&scene, &Settings { emitters, ..settings([8, 8], 8, 4, &[STEADY]) }).average(0)
    };
    assert!(with("light") > 0.05);
    assert_eq!(with("floor"), 0.0);
}

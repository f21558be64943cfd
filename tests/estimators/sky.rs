//! The sky: light from infinitely far away, from all directions, in renders without a gate.

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, glass, light, material, metal, plastic};
use taugate::internals::generate::shapes::{cuboid, inside_out, quad};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::{LightKind, Material, Mesh, Scene, SkyImage};
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Edge, Estimator, Response, Responses};

use super::agreement::{against, assert_none, oracle, oracle_samples, unlike_estimators};
use super::cells::{Cells, renderer, settings};

const STEADY: (f64, f64) = (0.0, f64::INFINITY);
const RADIANCE: f32 = 3.0;

fn sky(scene: &mut Scene, radiance: [f32; 3]) {
    light(scene, "sky", DVec3::ZERO, DVec3::NEG_Z, LightKind::Sky { radiance });
}

/// A scene under a white sky, with a camera at `from` that looks at the origin.
fn under_the_sky(shapes: Vec<(Material, Mesh)>, from: DVec3, yfov: f64) -> Scene {
    let mut scene = Scene::default();
    for (i, (look, shape)) in shapes.into_iter().enumerate() {
        let look = material(&mut scene, look);
        add(&mut scene, &format!("shape {i}"), look, shape);
    }
    camera(&mut scene, from, DVec3::ZERO, yfov, [8, 8]);
    sky(&mut scene, [RADIANCE; 3]);
    scene
}

/// Mean and standard error of the radiance over the image.
fn radiance(estimator: Estimator, scene: &Scene, max_depth: u32) -> (f64, f64) {
    let settings = settings(estimator, [8, 8]).max_depth(max_depth).light_paths(4000).build().unwrap();
    Cells::measure(&mut renderer(scene, &settings), Gate::OPEN, 8, 1, 8, 100).whole()
}

/// Asserts that the estimators see the radiance `truth`, and that the test would notice an error of 5 %.
fn sees(name: &str, scene: &Scene, max_depth: u32, truth: f64) {
    for estimator in unlike_estimators(scene) {
        let (mean, error) = radiance(estimator, scene, max_depth);
        eprintln!("{name}, {estimator}: {mean:.6} +- {error:.6}, closed form {truth:.6}");
        let tolerance = 4.5 * error + 2e-5 * truth;
        assert!((mean - truth).abs() <= tolerance, "{name}, {estimator}: {mean} +- {error}, not {truth}");
        assert!(tolerance < 0.05 * truth, "{name}, {estimator}: the test is too weak, {error}");
    }
}

/// The middle of the view is a block, the corners are background.
#[test]
#[ignore = "takes five seconds; responses and skies are tested always, one by one"]
fn responses_without_an_end_hold_the_sky() {
    let grey = (diffuse("grey", [0.6; 3]), cuboid(DVec3::splat(-1.0), DVec3::splat(1.0)));
    let scene = under_the_sky(vec![grey], DVec3::new(0.0, 0.0, 6.0), 1.0);
    let open = |name: &str| Response::new(name, Gate::OPEN, Edge::Sharp);
    let responses = Responses::new(vec![open("a"), open("b")]).unwrap();
    let settings = settings(Estimator::Lcs, [8, 8]).responses(responses).light_paths(4000).build().unwrap();
    let mut renderer = renderer(&scene, &settings);
    (0..8).for_each(|_| renderer.iterate(16).unwrap());
    let film = renderer.responses().unwrap().unwrap();
    for k in 0..2 {
        let image = film.mean(k);
        let pixel = |x: usize, y: usize| f64::from(image[3 * (8 * y + x)]);
        let (block, background) = (pixel(4, 4), pixel(0, 0));
        assert!((block / (0.6 * f64::from(RADIANCE)) - 1.0).abs() < 0.1, "{block}");
        assert!((background / f64::from(RADIANCE) - 1.0).abs() < 1e-5, "{background}");
    }
}

/// A point of a convex body sees the sky in all directions of its hemisphere, so its radiance is albedo times that of the sky.
#[test]
#[ignore = "takes five seconds; the image of a sky is compared with the oracle always"]
fn a_convex_body_has_its_albedo_times_the_radiance_of_the_sky() {
    for (scale, away) in [(1.0, 0.0), (1e4, 0.0), (1e-4, 1.0)] {
        let centre = DVec3::X * away;
        let half = DVec3::splat(scale);
        let grey = (diffuse("grey", [0.6; 3]), cuboid(centre - half, centre + half));
        let mut scene = under_the_sky(vec![grey], centre + DVec3::new(0.3, 0.4, 3.0) * scale, 0.3);
        scene.cameras[0].transform.translation = centre + DVec3::new(0.0, 0.0, 3.0) * scale;
        scene.cameras[0].transform.matrix3 = glam::DMat3::IDENTITY;
        sees(&format!("block of {scale} m"), &scene, 10, f64::from(RADIANCE) * f64::from(0.6f32));
    }
}

/// A white furnace: objects that absorb nothing look like the sky behind them, whether they are concave, mirrors or
/// glass. Light is lost only where paths reach the maximum depth. Faces are flat, because shading normals lose light.
#[test]
#[ignore = "takes five seconds; the image of a sky is compared with the oracle always"]
fn objects_that_absorb_nothing_vanish_under_a_white_sky() {
    let white = || diffuse("white", [1.0; 3]);
    let cup = {
        let mut walls = inside_out(cuboid(DVec3::splat(-1.0), DVec3::splat(1.0)));
        // Without the face at +z, which is the second of six.
        walls.triangles.drain(2..4);
        walls
    };
    let double_sided = |m: Material| Material { double_sided: true, ..m };
    let from = DVec3::new(0.5, 0.6, 5.0);
    let scenes = [
        ("cup", vec![(double_sided(white()), cup)]),
        (
            "mirror over a floor",
            vec![
                (metal("mirror", [1.0; 3], 0.0), cuboid(DVec3::splat(-0.6), DVec3::splat(0.6))),
                (
                    double_sided(white()),
                    quad(DVec3::new(-1.5, -0.9, 1.5), DVec3::X * 3.0, DVec3::NEG_Z * 3.0, [1.0; 2]),
                ),
            ],
        ),
        (
            "glass over a floor",
            vec![
                (glass("glass"), cuboid(DVec3::splat(-0.6), DVec3::splat(0.6))),
                (
                    double_sided(white()),
                    quad(DVec3::new(-1.5, -0.9, 1.5), DVec3::X * 3.0, DVec3::NEG_Z * 3.0, [1.0; 2]),
                ),
            ],
        ),
    ];
    for (name, shapes) in scenes {
        sees(name, &under_the_sky(shapes, from, 0.6), 120, RADIANCE.into());
    }
}

/// With the upper half of the sky bright, a floor sees all of it, a wall half of it, and a ceiling nothing.
#[test]
fn the_upper_half_of_the_sky_lights_walls_half_as_much_as_floors() {
    let albedo = 0.6f32;
    let whole = f64::from(albedo) * f64::from(RADIANCE);
    for (name, normal, truth) in
        [("floor", DVec3::Y, whole), ("wall", DVec3::X, whole / 2.0), ("ceiling", DVec3::NEG_Y, 0.0)]
    {
        let u = normal.any_orthonormal_vector() * 4.0;
        let v = normal.cross(u);
        let plane = quad(-0.5 * (u + v), u, v, [1.0; 2]);
        let mut scene = under_the_sky(vec![(diffuse("grey", [albedo; 3]), plane)], normal + u * 0.01, 0.4);
        // With several columns, the floor also tests azimuths: the bright texels have twice the radiance.
        let (bright, dark) = ([2.0, 2.0, 2.0], [0.0; 3]);
        let rgb = [bright, dark, bright, dark, dark, dark, dark, dark].to_vec();
        scene.sky = Some(SkyImage { width: 4, height: 2, rgb });
        match truth > 0.0 {
            true => sees(name, &scene, 10, truth),
            false => Estimator::ALL.iter().for_each(|&e| assert_eq!(radiance(e, &scene, 10), (0.0, 0.0), "{name} {e}")),
        }
    }
}

/// The image of a sky with a bright spot, colours and a dark half.
fn sky_with_a_sun() -> SkyImage {
    let (width, height) = (16u32, 9u32);
    let texel = |i: u32| {
        let (x, y) = (i % width, i / width);
        match (x, y) {
            (13, 2) => [60.0, 50.0, 30.0],
            (_, 0..5) => [0.3, 0.5, 0.5 + 0.1 * x as f32],
            _ => [0.0; 3],
        }
    };
    SkyImage { width, height, rgb: (0..width * height).map(texel).collect() }
}

/// The Cornell box with a glossy block, under the sky. Light of the sky falls in from the open side.
fn open_box(image: Option<SkyImage>) -> Scene {
    let mut scene = build(Kind::CornellBox);
    let gloss = material(&mut scene, plastic("gloss", [0.4, 0.5, 0.4], 0.4));
    add(&mut scene, "gloss", gloss, cuboid(DVec3::new(-0.9, 0.0, 0.4), DVec3::new(-0.5, 0.3, 0.8)));
    scene.sky = image;
    sky(&mut scene, [1.5, 1.0, 2.0]);
    scene
}

fn agrees(name: &str, scene: &Scene) {
    assert_none(against(
        name,
        &unlike_estimators(scene),
        scene,
        &[STEADY],
        &oracle(scene, &[STEADY], [24, 16], oracle_samples()),
    ));
}

#[test]
#[ignore = "takes ten seconds; a sky with an image is tested always"]
fn estimators_agree_with_the_oracle_under_the_sky() {
    agrees("sky and lamp", &open_box(None));
    let mut dark = open_box(None);
    dark.materials.iter_mut().for_each(|material| material.emission = [0.0; 3]);
    agrees("sky alone", &dark);
}

#[test]
fn estimators_agree_with_the_oracle_under_the_image_of_a_sky() {
    agrees("image", &open_box(Some(sky_with_a_sun())));
}

/// The light of the sky has no travel time, so a renderer of a scene with a sky rejects gates.
#[test]
fn a_renderer_with_a_sky_takes_no_gate() {
    let mut renderer = renderer(&open_box(None), &settings(Estimator::Bdpt, [8, 8]).build().unwrap());
    let error = renderer.restart(1, Gate { lo: 1.0, hi: 2.0 }).unwrap_err().to_string();
    assert!(error.contains("infinitely far away"), "{error}");
    assert!(renderer.restart(1, Gate::OPEN).is_ok());
}

/// Thin glass under a white sky: what it does not transmit, it reflects. Rough thin glass loses a little between its facets.
#[test]
fn thin_glass_vanishes_under_a_white_sky() {
    let pane = || quad(DVec3::new(-3.0, -3.0, 0.0), DVec3::X * 6.0, DVec3::Y * 6.0, [1.0; 2]);
    let of = |roughness: f32, transmission: f32| {
        let look = Material { roughness, transmission, specular: 0.0, ..glass("pane") };
        under_the_sky(vec![(look, pane())], DVec3::new(1.0, 0.5, 2.0), 0.3)
    };
    sees("smooth", &of(0.0, 1.0), 4, RADIANCE.into());
    sees("partial", &of(0.0, 0.5), 4, RADIANCE.into());
    for estimator in unlike_estimators(&of(0.3, 1.0)) {
        let (mean, error) = radiance(estimator, &of(0.3, 1.0), 4);
        let share = mean / f64::from(RADIANCE);
        assert!((0.97..1.0 + 4.5 * error).contains(&share), "{estimator}: {share} +- {error}");
    }
}

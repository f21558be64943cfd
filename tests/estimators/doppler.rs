//! Images that record velocities, compared with closed forms.

use glam::{DAffine3, DQuat, DVec3};
use taugate::Job;
use taugate::internals::generate::glb::{self, Motion};
use taugate::internals::generate::parts::{add, diffuse, light, material, metal};
use taugate::internals::generate::shapes::quad;
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::{Camera, Instance, LightKind, Medium, PhaseFunction, Scene, Velocities};
use taugate::internals::settings::doppler::Doppler;
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Responses};

use super::cells::{renderer, settings};

/// The speed that saturates the colours, in m/s.
const SPEED: f64 = 4.0;

const SIZE: [u32; 2] = [20, 14];

/// The scene with these velocities of its points.
pub fn moving(mut scene: Scene, of_point: impl Fn(DVec3) -> DVec3) -> Scene {
    // A linear field, so three points and the origin give the map.
    let origin = of_point(DVec3::ZERO);
    let rate = DAffine3::from_cols(
        of_point(DVec3::X) - origin,
        of_point(DVec3::Y) - origin,
        of_point(DVec3::Z) - origin,
        origin,
    );
    scene.velocities = Some(Velocities {
        cameras: scene.cameras.iter().map(|camera| of_point(camera.transform.translation)).collect(),
        lights: scene.lights.iter().map(|light| of_point(light.position)).collect(),
        instances: vec![Some(rate); scene.instances.len()],
    });
    scene
}

/// For each gate, the light of each pixel, and its mean velocity and deviation in m/s.
fn velocities(scene: &Scene, estimator: Estimator, responses: &Responses) -> Vec<Vec<(f64, [f64; 2])>> {
    let speed: Doppler = format!("{SPEED}").parse().unwrap();
    let settings = settings(estimator, SIZE).doppler(speed).responses(responses.clone()).build().unwrap();
    let mut renderer = renderer(scene, &settings);
    [2, 2, 4].iter().for_each(|&samples| renderer.iterate(samples).unwrap());
    let image = |rgb: Vec<f32>| {
        let pixels = rgb.chunks(3).map(|pixel| [0, 1, 2].map(|k| f64::from(pixel[k])));
        pixels.map(|pixel| (pixel[0] + 2.0 * pixel[1] + pixel[2], Doppler::decode(SPEED, pixel))).collect()
    };
    match renderer.responses().unwrap() {
        Some(images) => (0..responses.len()).map(|k| image(images.mean(k))).collect(),
        None => vec![image(renderer.film().mean())],
    }
}

/// If everything grows by a factor of 1 + k t, each path grows by k times its length, whatever it meets: mirrors, glass, gloss, or several
/// surfaces. So all light in a gate has half of k times a travel time in the gate as its velocity. Returns the number of lit pixels and gates
/// whose velocity is not in this range.
fn wrong_in_growing_scene(scene: &Scene, estimator: Estimator, gates: Gates) -> (usize, usize) {
    const RATE: f64 = 0.7;
    let scene = if scene.velocities.is_none() { moving(scene.clone(), |p| RATE * p) } else { scene.clone() };
    let (mut lit, mut wrong) = (0, 0);
    for (k, image) in velocities(&scene, estimator, &gates.into()).into_iter().enumerate() {
        let Gate { lo, hi } = gates.gate(k as u32);
        for (light, [mean, deviation]) in image {
            if light > 0.0 {
                lit += 1;
                let slack = 2e-4;
                let is_right = mean > 0.5 * RATE * lo - slack && mean < 0.5 * RATE * hi + slack;
                wrong += usize::from(!is_right || deviation > 0.25 * RATE * (hi - lo) + 5e-3);
            }
        }
    }
    (lit, wrong)
}

fn gates(lo: f64, hi: f64, count: u32) -> Gates {
    Gates::new(Gate { lo, hi }, count).unwrap()
}

#[test]
fn paths_of_a_scene_that_grows_become_longer_by_their_length() {
    for (light, name) in [(Light::Area, "area"), (Light::Punctual, "point and spot"), (Light::Beam, "beam")] {
        let scene = zoo(light);
        for estimator in [Estimator::Pt, Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs] {
            if estimator == Estimator::Pt && light == Light::Beam {
                continue;
            }
            let (lit, wrong) = wrong_in_growing_scene(&scene, estimator, gates(2.0, 12.0, 40));
            assert!(lit > 500 && wrong == 0, "{name}, {estimator}: {wrong} of {lit} are wrong");
        }
    }
    // Negative controls: a camera, a lamp or a surface at rest.
    let scene = moving(zoo(Light::Punctual), |p| 0.7 * p);
    let change = |change: fn(&mut Velocities)| {
        let mut scene = scene.clone();
        change(scene.velocities.as_mut().unwrap());
        scene
    };
    let resting = [
        change(|velocities| velocities.cameras[0] = DVec3::ZERO),
        change(|velocities| velocities.lights[0] = DVec3::ZERO),
        change(|velocities| velocities.instances[0] = Some(DAffine3::ZERO)),
    ];
    for (number, scene) in resting.iter().enumerate() {
        let (lit, wrong) = wrong_in_growing_scene(scene, Estimator::Lcs, gates(2.0, 12.0, 40));
        assert!(wrong > lit / 50, "negative control {number}: {wrong} of {lit}");
    }
}

/// The spots of beams without width are stored once, for all subpaths. Each knows its own object: another object is at rest.
#[test]
fn the_spot_of_a_beam_moves_with_its_object() {
    // Without alpha, where a beam passes surfaces at random.
    let mut scene = build(Kind::CornellBox);
    let kind = LightKind::Beam { power: [50.0; 3], radius: 0.0 };
    light(&mut scene, "beam", DVec3::new(-0.3, 1.5, 0.7), DVec3::new(0.1, 0.05, -1.0).normalize(), kind);
    let far = DAffine3::from_scale_rotation_translation(DVec3::splat(1e-3), DQuat::IDENTITY, 30.0 * DVec3::Y);
    let resting = Instance { transform: far, ..scene.instances[0].clone() };
    scene.instances.insert(0, resting);
    let mut scene = moving(scene, |p| 0.7 * p);
    scene.velocities.as_mut().unwrap().instances[0] = Some(DAffine3::ZERO);
    for estimator in [Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs] {
        let (lit, wrong) = wrong_in_growing_scene(&scene, estimator, gates(2.0, 12.0, 40));
        assert!(lit > 500 && wrong == 0, "{estimator}: {wrong} of {lit} are wrong");
    }
}

/// Without a gate, in thin gates with short histograms, and with light that was reflected often.
#[test]
fn nothing_changes_its_length_if_all_moves_alike() {
    let velocity = DVec3::new(0.4, -1.1, 0.8);
    let scene = moving(build(Kind::CornellBox), |_| velocity);
    for responses in [Responses::default(), Gate { lo: 6.0, hi: 6.3 }.into(), gates(6.0, 6.1, 4).into()] {
        for estimator in [Estimator::Pt, Estimator::Bdpt, Estimator::Lcs] {
            for image in velocities(&scene, estimator, &responses) {
                let lit: Vec<_> = image.into_iter().filter(|(light, _)| *light > 0.0).collect();
                assert!(lit.len() > 10, "{estimator}: {} pixels", lit.len());
                let worst =
                    lit.iter().map(|(_, [mean, deviation])| mean.abs().max(0.1 * deviation)).fold(0.0, f64::max);
                assert!(worst < 1e-3, "{estimator}: {worst} m/s");
            }
        }
    }
}

/// A pinhole at the origin that looks along -Z, with a lamp 1 mm beside it.
fn pinhole() -> Scene {
    let mut scene = Scene::default();
    light(&mut scene, "lamp", DVec3::new(0.0, 1e-3, 0.0), DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
    scene.add_camera(Camera::looking_at("pinhole", DVec3::ZERO, DVec3::NEG_Z, 2.0 * HALF_FIELD, SIZE));
    scene
}

/// Half of the vertical field of view of the pinhole.
const HALF_FIELD: f64 = 0.45;

/// Unit direction in which the centre of a pixel looks.
fn direction(pixel: usize) -> DVec3 {
    let [width, height] = SIZE.map(f64::from);
    let (x, y) = ((pixel % SIZE[0] as usize) as f64 + 0.5, (pixel / SIZE[0] as usize) as f64 + 0.5);
    let half = HALF_FIELD.tan();
    DVec3::new((2.0 * x / width - 1.0) * half * width / height, (1.0 - 2.0 * y / height) * half, -1.0).normalize()
}

/// A wall that recedes, from a file with an animation: each pixel has the velocity of its point along the line of sight. A mirror in its
/// place shows a lit wall behind the camera. The image of this wall recedes twice as fast as the mirror, but the light goes only back
/// from it, so it has the velocity of the mirror.
#[test]
fn a_receding_wall_and_a_receding_mirror_have_their_speed() {
    let folder = tempfile::tempdir().unwrap();
    let speed = 3.0;
    for is_mirror in [false, true] {
        let mut scene = pinhole();
        let surface = if is_mirror { metal("mirror", [0.9; 3], 0.0) } else { diffuse("wall", [0.5; 3]) };
        let surface = material(&mut scene, surface);
        let corner = DVec3::new(-6.0, -6.0, 0.0);
        add(&mut scene, "wall", surface, quad(corner, 12.0 * DVec3::X, 12.0 * DVec3::Y, [1.0; 2]));
        if is_mirror {
            // What the mirror shows.
            let white = material(&mut scene, diffuse("white", [0.5; 3]));
            let corner = DVec3::new(-30.0, -30.0, 10.0);
            add(&mut scene, "back", white, quad(corner, 60.0 * DVec3::Y, 60.0 * DVec3::X, [1.0; 2]));
        }
        let positions = [-4.0, -4.0 - 2.0 * speed].map(|z| [0.0, 0.0, z as f32]).to_vec();
        let motion = Motion { node: "wall", times: vec![0.0, 2.0], positions };
        let path = folder.path().join("scene.glb");
        std::fs::write(&path, glb::write_moving(&scene, Some(&motion))).unwrap();
        let size = format!("{}x{}", SIZE[0], SIZE[1]);
        let settings = [
            ("at", "1s"),
            ("doppler", "4m/s"),
            ("resolution", &size),
            ("spp", "64"),
            ("max-depth", "3"),
            ("estimator", "bdpt"),
        ];
        let mut job = Job::open_with(&path, settings).unwrap().prepare(&super::cells::device()).unwrap();
        job.run(&Default::default(), |_| {}).unwrap();
        let mut lit = 0;
        for (pixel, rgb) in job.film().mean().chunks(3).enumerate() {
            let colour = [0, 1, 2].map(|k| f64::from(rgb[k]));
            let [mean, deviation] = Doppler::decode(SPEED, colour);
            if mean.is_nan() {
                continue;
            }
            lit += 1;
            let expected = -speed * direction(pixel).z;
            let error = (mean - expected).abs();
            assert!(
                error < 0.03 && deviation < 0.03,
                "mirror {is_mirror}: {mean} +- {deviation} instead of {expected}"
            );
        }
        assert!(lit == 280, "mirror {is_mirror}: {lit} pixels");
    }
}

/// The place of an automatic camera depends on the objects, but it does not move with them.
#[test]
fn an_automatic_camera_stands_still() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = pinhole();
    scene.cameras.clear();
    let white = material(&mut scene, diffuse("white", [0.5; 3]));
    add(&mut scene, "car", white, quad(DVec3::ZERO, DVec3::X, DVec3::Y, [1.0; 2]));
    add(&mut scene, "wall", white, quad(DVec3::NEG_Z, 3.0 * DVec3::X, 3.0 * DVec3::Y, [1.0; 2]));
    let motion = Motion { node: "car", times: vec![0.0, 2.0], positions: vec![[0.0; 3], [40.0, 0.0, 0.0]] };
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, glb::write_moving(&scene, Some(&motion))).unwrap();
    let job = Job::open_with(&path, [("at", "1s"), ("doppler", "4m/s"), ("headlamp", "5")]).unwrap();
    let velocities = job.scene().velocities.clone().unwrap();
    let still = velocities.cameras.iter().chain(&velocities.lights).all(|velocity| velocity.length() < 1e-6);
    assert!(still && !velocities.cameras.is_empty(), "{velocities:?}");
    let car = velocities.of(0, DVec3::ZERO);
    assert!(car.distance(20.0 * DVec3::X) < 1e-2, "{car}");
}

/// A disc that turns about an axis through its centre.
#[test]
fn one_side_of_a_turning_disc_approaches() {
    let mut scene = pinhole();
    let surface = material(&mut scene, diffuse("disc", [0.5; 3]));
    let corner = DVec3::new(-6.0, -6.0, -5.0);
    add(&mut scene, "disc", surface, quad(corner, 12.0 * DVec3::X, 12.0 * DVec3::Y, [1.0; 2]));
    let (centre, omega) = (DVec3::new(0.5, 0.0, -5.0), DVec3::new(0.0, 0.9, 0.3));
    let field = |p: DVec3| omega.cross(p - centre);
    let mut scene = moving(scene, field);
    let velocities = scene.velocities.as_mut().unwrap();
    (velocities.cameras[0], velocities.lights[0]) = (DVec3::ZERO, DVec3::ZERO);
    let image = &self::velocities(&scene, Estimator::Bdpt, &Responses::default())[0];
    let wrong = |omega: DVec3| {
        let of_pixel = |(pixel, (_, [mean, _])): (usize, &(f64, [f64; 2]))| {
            let direction = direction(pixel);
            let point = direction * (5.0 / -direction.z);
            (mean - omega.cross(point - centre).dot(direction)).abs()
        };
        image.iter().enumerate().map(of_pixel).fold(0.0, f64::max)
    };
    // A pixel is 0.34 m wide on the disc.
    assert!(wrong(omega) < 0.12, "{}", wrong(omega));
    assert!(wrong(omega * 1.1) > 0.2 && wrong(-omega) > 1.0);
}

/// A car in fog that drives towards the view, with its headlamp at the camera: light that is scattered once near the axis approaches as fast
/// as the car drives.
#[test]
fn fog_approaches_a_camera_that_drives() {
    let mut scene = pinhole();
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.3 };
    scene.media = vec![Medium { sigma_s: [0.02; 3], sigma_a: [0.001; 3], phase, ..Medium::default() }];
    let speed = 2.5;
    let scene = moving(scene, |_| DVec3::new(0.0, 0.0, -speed));
    let responses: Responses = gates(10.0, 14.0, 2).into();
    for estimator in [Estimator::Bdpt, Estimator::Lcs] {
        let speed_of_colours: Doppler = format!("{SPEED}").parse().unwrap();
        let settings = settings(estimator, SIZE)
            .doppler(speed_of_colours)
            .max_depth(2)
            .responses(responses.clone())
            .build()
            .unwrap();
        let mut renderer = renderer(&scene, &settings);
        (0..8).for_each(|_| renderer.iterate(8).unwrap());
        for k in 0..2 {
            let rgb = renderer.responses().unwrap().unwrap().mean(k);
            let mut lit = 0;
            for (pixel, rgb) in rgb.chunks(3).enumerate() {
                let cosine = -direction(pixel).z;
                let colour = [0, 1, 2].map(|k| f64::from(rgb[k]));
                if colour.iter().sum::<f64>() > 0.0 {
                    lit += 1;
                    let [mean, _] = Doppler::decode(SPEED, colour);
                    // A pixel is 0.07 wide.
                    assert!(
                        (mean + speed * cosine).abs() < 0.05,
                        "{estimator}: {mean} m/s instead of {}",
                        -speed * cosine
                    );
                }
            }
            assert!(lit > if estimator == Estimator::Lcs { 279 } else { 20 }, "{estimator}: {lit} pixels");
        }
    }
}

/// A laser and a camera that move by themselves in fog. Light that is scattered once on the beam has one velocity in a thin gate.
#[test]
fn light_of_a_moving_laser_has_the_velocity_of_both_of_its_segments() {
    let (source, along) = (DVec3::new(-2.0, -1.0, -6.0), DVec3::new(1.0, 0.4, 0.3).normalize());
    let (of_laser, of_camera) = (DVec3::new(2.0, -1.0, 0.5), DVec3::new(-0.5, 1.0, 2.5));
    let mut scene = pinhole();
    scene.lights.clear();
    light(&mut scene, "laser", source, along, LightKind::Beam { power: [1.0; 3], radius: 0.0 });
    scene.media = vec![Medium { sigma_s: [0.05; 3], ..Medium::default() }];
    let (cameras, lights) = (vec![of_camera], vec![of_laser]);
    scene.velocities = Some(Velocities { cameras, lights, instances: vec![] });
    // The point of the beam from which light arrives after 8.6 m.
    let arrival = |s: f64| s + (source + s * along).length();
    let (mut near, mut far) = (0.0, 8.6);
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        if arrival(middle) < 8.6 { near = middle } else { far = middle }
    }
    let to_camera = -(source + near * along).normalize();
    let expected = 0.5 * (to_camera.dot(of_camera) - along.dot(of_laser));
    for estimator in [Estimator::Bdpt, Estimator::Lcs] {
        let gate = Gate { lo: 8.58, hi: 8.62 };
        let settings = settings(estimator, [64, 64])
            .doppler("4".parse::<Doppler>().unwrap())
            .max_depth(2)
            .gate(gate)
            .build()
            .unwrap();
        let mut renderer = renderer(&scene, &settings);
        (0..8).for_each(|_| renderer.iterate(8).unwrap());
        let sum =
            renderer.film().mean().chunks(3).fold([0.0; 3], |sum, rgb| [0, 1, 2].map(|k| sum[k] + f64::from(rgb[k])));
        let [mean, deviation] = Doppler::decode(SPEED, sum);
        assert!(
            (mean - expected).abs() < 0.01 && deviation < 0.03,
            "{estimator}: {mean} +- {deviation} instead of {expected}"
        );
    }
    assert!((expected - 0.5 * to_camera.dot(of_camera)).abs() > 0.1);
}

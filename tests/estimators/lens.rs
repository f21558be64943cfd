//! Lenses of calibrated cameras against closed forms, with camera rays and with connections of light vertices to the camera (t = 1). The
//! models are written down here once more, as OpenCV documents them.

use glam::{DVec2, DVec3, dvec2};
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, light, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::scene::{Distortion, Lens, LightKind, Projection, Scene, Vignetting};
use taugate::internals::settings::{Emitters, Estimator, Sampling};

use super::cells::{renderer, settings};

const SIZE: [u32; 2] = [96, 72];
/// fx, fy, cx, cy in OpenCV's pixels, whose centres are whole numbers.
const MATRIX: [f64; 4] = [60.0, 66.0, 50.3, 33.1];
const DISTANCE: f64 = 4.0;
const ALBEDO: f64 = 0.6;

fn lenses() -> [(&'static str, Distortion); 3] {
    let rational =
        Distortion::Rational { radial: [-0.28, 0.09, -0.012, 0.02, -0.01, 0.001], tangential: [1.2e-3, -8e-4] };
    [("none", Distortion::None), ("rational", rational), ("fisheye", Distortion::Fisheye([0.03, -0.012, 0.004, -7e-4]))]
}

/// The image of the direction (X right, Y down, Z along the view) in our pixels, whose corners are whole numbers.
fn pixel(lens: &Distortion, to: DVec3) -> DVec2 {
    let (x, y) = (to.x / to.z, to.y / to.z);
    let (x, y) = match *lens {
        Distortion::None => (x, y),
        Distortion::Rational { radial: [k1, k2, k3, k4, k5, k6], tangential: [p1, p2] } => {
            let r = (x * x + y * y).sqrt();
            let f = (1.0 + k1 * r.powi(2) + k2 * r.powi(4) + k3 * r.powi(6))
                / (1.0 + k4 * r.powi(2) + k5 * r.powi(4) + k6 * r.powi(6));
            (
                x * f + 2.0 * p1 * x * y + p2 * (r * r + 2.0 * x * x),
                y * f + p1 * (r * r + 2.0 * y * y) + 2.0 * p2 * x * y,
            )
        }
        Distortion::Fisheye([k1, k2, k3, k4]) => {
            let r = (x * x + y * y).sqrt();
            let a = r.atan();
            let d = a * (1.0 + k1 * a.powi(2) + k2 * a.powi(4) + k3 * a.powi(6) + k4 * a.powi(8));
            (x * d / r, y * d / r)
        }
    };
    dvec2(MATRIX[0] * x + MATRIX[2] + 0.5, MATRIX[1] * y + MATRIX[3] + 0.5)
}

/// A camera with this lens at the origin that looks at -Z.
fn scene(distortion: Distortion) -> Scene {
    let mut scene = Scene::default();
    let [width, height] = SIZE.map(f64::from);
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1.0, SIZE);
    let camera = &mut scene.cameras[0];
    camera.projection = Projection::Perspective { yfov: 2.0 * (0.5 * height / MATRIX[1]).atan() };
    camera.lens = Lens { pixel_aspect: MATRIX[1] / MATRIX[0], distortion, ..Lens::PINHOLE };
    camera.principal_point = [(MATRIX[2] + 0.5) / width, (MATRIX[3] + 0.5) / height];
    scene
}

/// A kind of vignetting, and its share as a function of the direction.
type Shading = (&'static str, Vignetting, fn(DVec3) -> f64);

fn vignettings(distortion: &Distortion) -> Vec<Shading> {
    let rows = [[0.0, 1.0], [10.0, 0.9], [25.0, 0.7], [40.0, 0.2], [80.0, 0.1]];
    let table = rows.iter().map(|&[degrees, share]: &[f64; 2]| [degrees.to_radians(), share]).collect();
    // The lines through the rows, written down.
    let share = |to: DVec3| match to.truncate().length().atan2(to.z).to_degrees() {
        a if a < 10.0 => 1.0 - 0.01 * a,
        a if a < 25.0 => 0.9 - 0.2 * (a - 10.0) / 15.0,
        a if a < 40.0 => 0.7 - 0.5 * (a - 25.0) / 15.0,
        a => 0.2 - 0.0025 * (a - 40.0),
    };
    let mut all: Vec<Shading> =
        vec![("no vignetting", Vignetting::None, |_| 1.0), ("table", Vignetting::Table(table), share)];
    if !matches!(distortion, Distortion::Fisheye(_)) {
        all.push(("cos4", Vignetting::Cos4, |to| (to.z / to.length()).powi(4)));
    }
    all
}

/// The direction towards the point (x, y) of the wall, y up, in the axes of [`pixel`].
fn towards(x: f64, y: f64) -> DVec3 {
    DVec3::new(x, -y, DISTANCE)
}

/// A thin beam makes a spot on the wall, which t = 1 alone finds. Its pixel and radiance follow from the map of the lens.
#[test]
fn the_spot_of_a_beam_is_in_its_pixel_with_its_radiance() {
    for (name, lens) in lenses() {
        let places = [(0.3, 0.2), (-2.4, 1.5), (2.0, -1.9), (-0.4, -1.2)];
        let cases = vignettings(&lens).into_iter().flat_map(|case| places.map(|place| (case.clone(), place)));
        for ((kind, vignetting, share), (x, y)) in cases {
            let name = format!("{name}, {kind}");
            let mut scene = scene(lens);
            scene.cameras[0].lens.vignetting = vignetting;
            let wall = material(&mut scene, diffuse("wall", [ALBEDO as f32; 3]));
            add(
                &mut scene,
                "wall",
                wall,
                quad(DVec3::new(-20.0, -20.0, -DISTANCE), 40.0 * DVec3::X, 40.0 * DVec3::Y, [1.0; 2]),
            );
            let kind = LightKind::Beam { power: [2.0; 3], radius: 0.0 };
            light(&mut scene, "beam", DVec3::new(x, y, -1.0), DVec3::NEG_Z, kind);
            let to = towards(x, y);
            let at = pixel(&lens, to);
            // Pixels per solid angle, from differences along two directions across the line of sight.
            let (d, h) = (to.length(), 1e-5);
            let across = to.cross(DVec3::Y).normalize();
            let step = |v: DVec3| (pixel(&lens, to / d + h * v) - pixel(&lens, to / d - h * v)) / (2.0 * h);
            let spread = step(across).perp_dot(step(across.cross(to / d))).abs();
            let truth = share(to) * ALBEDO / std::f64::consts::PI * 2.0 * (DISTANCE / d) * spread / (d * d);
            let settings = settings(Estimator::Bdpt, SIZE).emitters(Emitters::Nodes(vec!["beam".into()])).max_depth(2);
            let mut renderer = renderer(&scene, &settings.build().unwrap());
            renderer.iterate(2).unwrap_or_else(|e| panic!("{e}"));
            let image = renderer.film().mean();
            let lit: Vec<usize> = (0..image.len() / 3).filter(|i| image[3 * i] > 0.0).collect();
            let index = at.y as usize * SIZE[0] as usize + at.x as usize;
            assert_eq!(lit, [index], "{name}: the spot at ({x}, {y}) has its image at {at}");
            let found = f64::from(image[3 * index]);
            let is_near = |truth: f64| (found / truth - 1.0).abs() < 1e-4;
            assert!(is_near(truth), "{name} ({x}, {y}): {found} instead of {truth}");
            // Negative control: the density of a pinhole's rays.
            let pinhole = truth / spread * MATRIX[0] * MATRIX[1] * (d / DISTANCE).powi(3);
            assert_eq!(is_near(pinhole), lens == Distortion::None, "{name} ({x}, {y}): {found}, {pinhole}");
        }
    }
}

/// The edge of a bright panel, seen by camera rays: in each row of pixels, the lit part ends where the map of the lens says.
#[test]
fn edges_are_where_the_map_of_the_lens_has_them() {
    for (name, lens) in lenses() {
        let mut scene = scene(lens);
        let (edge, low) = (-1.1, -30.0);
        let panel = material(&mut scene, emitter("panel", [1.0; 3]));
        add(
            &mut scene,
            "panel",
            panel,
            quad(DVec3::new(edge, low, -DISTANCE), 60.0 * DVec3::X, 60.0 * DVec3::Y, [1.0; 2]),
        );
        let settings = settings(Estimator::Pt, SIZE).sampling(Sampling::Uniform).max_depth(1).build().unwrap();
        let mut renderer = renderer(&scene, &settings);
        (0..32).for_each(|_| renderer.iterate(16).unwrap_or_else(|e| panic!("{e}")));
        let image = renderer.film().mean();
        let width = SIZE[0] as usize;
        // The mean column of the edge in a row of pixels.
        let mut sums = vec![(0.0, 0u32); SIZE[1] as usize];
        for k in 0..200_000 {
            let at = pixel(&lens, towards(edge, -4.0 + 8.0 * f64::from(k) / 2e5));
            if at.y >= 0.0 && at.y < f64::from(SIZE[1]) {
                let (sum, count) = &mut sums[at.y as usize];
                (*sum, *count) = (*sum + at.x, *count + 1);
            }
        }
        let mut worst: f64 = 0.0;
        for (row, &(sum, count)) in sums.iter().enumerate() {
            let lit: f64 = (0..width).map(|column| f64::from(image[3 * (row * width + column)])).sum();
            assert!(count > 100, "{name}: the edge misses row {row}");
            worst = worst.max((lit - (width as f64 - sum / f64::from(count))).abs());
        }
        eprintln!("{name}: the edge is off by at most {worst:.4} pixels");
        assert!(worst < 0.05, "{name}: {worst} pixels");
    }
}

/// A panel of radiance 1 that fills the image: each pixel has the share of the light that the vignetting leaves, averaged over the pixel.
#[test]
fn camera_rays_lose_the_light_of_the_vignetting() {
    for (lens_name, lens) in lenses() {
        for (kind, vignetting, share) in vignettings(&lens) {
            let mut scene = scene(lens);
            scene.cameras[0].lens.vignetting = vignetting;
            let panel = material(&mut scene, emitter("panel", [1.0; 3]));
            let corner = DVec3::new(-200.0, -200.0, -DISTANCE);
            add(&mut scene, "panel", panel, quad(corner, 400.0 * DVec3::X, 400.0 * DVec3::Y, [1.0; 2]));
            let settings = settings(Estimator::Pt, SIZE).sampling(Sampling::Uniform).max_depth(1).build().unwrap();
            let mut renderer = renderer(&scene, &settings);
            (0..4).for_each(|_| renderer.iterate(16).unwrap_or_else(|e| panic!("{e}")));
            let image = renderer.film().mean();
            let view = scene.cameras[0].transform.inverse();
            let truth = |index: usize| {
                let [column, row] = [index % SIZE[0] as usize, index / SIZE[0] as usize].map(|x| x as f64);
                let points =
                    (0..16).map(|k| [column + f64::from(k % 4) / 4.0 + 0.125, row + f64::from(k / 4) / 4.0 + 0.125]);
                let shares = points.map(|film| {
                    let d = view.transform_vector3(scene.cameras[0].direction(SIZE, film));
                    share(DVec3::new(d.x, -d.y, -d.z))
                });
                shares.sum::<f64>() / 16.0
            };
            let off = (0..image.len() / 3).map(|i| (f64::from(image[3 * i]) - truth(i)).abs()).fold(0.0, f64::max);
            eprintln!("{lens_name}, {kind}: off by at most {off:.1e}");
            assert!(off < 1e-3, "{lens_name}, {kind}: {off}");
            // Negative control: an image without vignetting.
            let pinhole = (0..image.len() / 3).map(|i| (1.0 - truth(i)).abs()).fold(0.0, f64::max);
            assert!(kind == "no vignetting" || pinhole > 0.3, "{lens_name}, {kind}: {pinhole}");
        }
    }
}

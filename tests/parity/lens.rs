//! `shared/lens.wgsl`: camera rays through a lens, the pixel that sees a direction, and the density of a pixel's rays, against the host's
//! model in f64.

use glam::{DVec2, DVec3, dvec2};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::scene::Distortion;
use taugate::internals::wgsl::layout::{Frame, NONE};

use crate::shader_function::ShaderFunction;
use crate::values::frame;

pub const KERNELS: &[&ShaderFunction] = &[&RAY, &BEYOND, &FOCUSED];

const RAY: ShaderFunction = ShaderFunction {
    imports: &["camera"],
    input: "p: vec2<f32>, pad: vec2<f32>",
    result: "d: vec3<f32>, pdf: f32, pixel: u32, pad0: u32, pad1: u32, pad2: u32",
    body: "result.d = normalize(camera_ray(vec2<u32>(0u), input.p).direction); result.pdf = pixel_pdf(-result.d.z, result.d);
        result.pixel = pixel_of(3.0 * result.d);",
};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
/// Half the size of the image, in focal lengths.
const EXTENT: [f64; 2] = [0.8, 0.6];

fn place(f: &mut Frame, lens: &Distortion, extent: [f64; 2]) {
    (f.right, f.up, f.forward) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]);
    (f.width, f.height, f.crop_width, f.crop_height) = (WIDTH, HEIGHT, WIDTH, HEIGHT);
    f.extent = extent.map(|x| x as f32);
    f.pixel_area = (4.0 * extent[0] * extent[1] / f64::from(WIDTH * HEIGHT)) as f32;
    f.lens_limit = 3.05;
    match *lens {
        Distortion::Rational { radial: [k1, k2, k3, k4, k5, k6], tangential: [p1, p2] } => {
            f.lens_radial = [k1, k2, k3, k4].map(|k| k as f32);
            f.lens_rest = [k5, k6, p1, p2].map(|k| k as f32);
        }
        Distortion::Fisheye(k) => f.lens_radial = k.map(|k| k as f32),
        Distortion::None => unreachable!("a lens"),
    }
}

#[test]
fn rays_through_a_lens_are_those_of_the_model() {
    let rational =
        Distortion::Rational { radial: [-0.28, 0.09, -0.012, 0.02, -0.01, 0.001], tangential: [1.2e-3, -8e-4] };
    let fisheye = Distortion::Fisheye([0.03, -0.012, 0.004, -0.0007]);
    // The image of the fisheye reaches beyond 90 degrees, behind the camera.
    let cases = [(rational, "HAS_DISTORTION", EXTENT), (fisheye, "HAS_FISHEYE", EXTENT.map(|x| 1.9 * x))];
    for (lens, constant, extent) in cases {
        let mut pcg = Pcg::new(117);
        let inputs: Vec<[f32; 4]> = (0..20_000)
            .map(|_| [pcg.range(0.0, WIDTH.into()) as f32, pcg.range(0.0, HEIGHT.into()) as f32, 0.0, 0.0])
            .collect();
        let kernel = RAY.compile(&[(constant, 1.0)]);
        let results: Vec<[u32; 8]> = kernel.run(&inputs, &[frame(|f| place(f, &lens, extent))]);
        let image_of = |p: DVec2| {
            dvec2((2.0 * p.x / f64::from(WIDTH) - 1.0) * extent[0], (2.0 * p.y / f64::from(HEIGHT) - 1.0) * extent[1])
        };
        let mut behind = 0;
        for (input, r) in inputs.iter().zip(&results) {
            let film = dvec2(input[0].into(), input[1].into());
            let to = lens.direction(image_of(film)).normalize();
            let found = DVec3::from([r[0], r[1], r[2]].map(|bits| f64::from(f32::from_bits(bits))));
            assert!((found - DVec3::new(to.x, -to.y, -to.z)).length() < 2e-6, "{constant} {film}: {found} {to}");
            behind += u32::from(to.z < 0.0);
            // Image area per solid angle, from differences across the direction.
            let h = 1e-5;
            let across = to.any_orthonormal_vector();
            let step = |v: DVec3| (lens.image(to + h * v).unwrap() - lens.image(to - h * v).unwrap()) / (2.0 * h);
            let spread = step(across).perp_dot(step(across.cross(to))).abs();
            let area = 4.0 * extent[0] * extent[1] / f64::from(WIDTH * HEIGHT);
            let pdf = f64::from(f32::from_bits(r[3]));
            assert!((pdf * area / spread - 1.0).abs() < 2e-4, "{constant} {film}: {pdf} instead of {}", spread / area);
            // On the border of two pixels, both are right.
            if (film - film.round()).abs().min_element() > 1e-3 {
                assert_eq!(r[4], film.y as u32 * WIDTH + film.x as u32, "{constant} {film}");
            }
        }
        assert_eq!(behind > 0, constant == "HAS_FISHEYE");
    }
}

/// A point outside of the lens's limit has no pixel, even if the polynomial folds it into the image.
#[test]
fn directions_beyond_the_limit_have_no_pixel() {
    // x (1 - r^2 / 3) is 0 at r = 1.73 again.
    let lens = Distortion::Rational { radial: [-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0, 0.0], tangential: [0.0; 2] };
    let kernel = BEYOND.compile(&[("HAS_DISTORTION", 1.0)]);
    let change = |f: &mut Frame| {
        place(f, &lens, EXTENT.map(|x| 0.5 * x));
        f.lens_limit = 0.6;
    };
    let results: Vec<[u32; 4]> = kernel.run(&[[0.3f32, 0.0, 0.0, 0.0], [1.7, 0.0, 0.0, 0.0]], &[frame(change)]);
    assert!(results[0][0] != NONE && results[1][0] == NONE, "{results:?}");
}

const BEYOND: ShaderFunction = ShaderFunction {
    imports: &["camera"],
    input: "x: f32, pad0: f32, pad1: f32, pad2: f32",
    result: "pixel: u32, pad0: u32, pad1: u32, pad2: u32",
    body: "result.pixel = pixel_of(vec3<f32>(input.x, 0.0, -1.0));",
};

const FOCUSED: ShaderFunction = ShaderFunction {
    imports: &["lens"],
    input: "chief: vec2<f32>, u: vec2<f32>",
    result: "at: vec2<f32>, path: f32, off: f32",
    body: "result.at = aperture_point(input.u); let chief = vec3<f32>(input.chief, 1.0);
        result.path = lens_path(chief, result.at);
        result.off = length(chief_ray(focused_ray(chief, result.at), result.at) - chief);",
};

/// With the way from the aperture to the point in focus, a ray takes as long as the one through the centre of the lens.
#[test]
fn points_in_focus_have_the_travel_time_of_a_pinhole() {
    let mut pcg = Pcg::new(118);
    let inputs: Vec<[f32; 4]> = (0..20_000)
        .map(|_| {
            [pcg.range(-0.8, 0.8), pcg.range(-0.6, 0.6), pcg.range(0.0, 1.0), pcg.range(0.0, 1.0)].map(|x| x as f32)
        })
        .collect();
    let kernel = FOCUSED.compile(&[("HAS_APERTURE", 1.0)]);
    for (radius, focus, blades) in [(0.05, 2.0, 0), (0.4, 1.0, 6), (0.01, 80.0, 0), (0.1, f64::INFINITY, 5)] {
        let change = |f: &mut Frame| {
            (f.lens_radius, f.inverse_focus, f.blades) = (radius as f32, (1.0 / focus) as f32, blades);
        };
        let results: Vec<[f32; 4]> = kernel.run(&inputs, &[frame(change)]);
        let (mut worst, mut without): (f64, f64) = (0.0, 0.0);
        for (input, &[x, y, path, off]) in inputs.iter().zip(&results) {
            let chief = DVec3::new(input[0].into(), input[1].into(), 1.0);
            let at = DVec3::new(x.into(), y.into(), 0.0);
            assert!(at.length() <= radius * 1.000_001 && off < 1e-6, "{at} {off}");
            let length = match focus.is_finite() {
                true => (focus * chief).length() - (focus * chief - at).length(),
                // The limit of the difference.
                false => at.dot(chief.normalize()),
            };
            let scale = if focus.is_finite() { (focus * chief).length() } else { 1.0 };
            worst = worst.max((f64::from(path) - length).abs() / scale);
            without = without.max(length.abs() / scale);
        }
        eprintln!("radius {radius} m, focus {focus} m: times off by at most {worst:.1e} of the way");
        assert!(worst < 1e-6, "radius {radius}, focus {focus}: {worst}");
        // Negative control: rays without this length.
        assert!(without > 2e-5, "radius {radius}, focus {focus}: {without}");
    }
}

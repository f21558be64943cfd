//! `shared/camera.wgsl`: camera rays of film positions, the pixel that sees a point, and the density of a pixel's camera rays.

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::wgsl::layout::{Frame, NONE};

use crate::shader_function::{ShaderFunction, contents};
use crate::values::{direction, dvec, frame, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&FILM, &TO_SENSOR, &AIMED];

const FILM: ShaderFunction = ShaderFunction {
    imports: &["camera"],
    input: "p: vec2<f32>, scale: f32, pad: f32",
    result: "d: vec3<f32>, pdf: f32, pixel: u32, behind: u32, pad: vec2<u32>",
    body: "result.d = camera_ray(vec2<u32>(0u), input.p).direction;
        result.pdf = pixel_pdf(dot(normalize(result.d), frame.forward), normalize(result.d));
        result.pixel = pixel_of(input.scale * result.d); result.behind = pixel_of(-result.d);",
};

/// An orthographic camera: the ray through a film point, the point at `distance` on this ray, and how the sensor sees it.
const TO_SENSOR: ShaderFunction = ShaderFunction {
    imports: &["camera"],
    input: "p: vec2<f32>, distance: f32, pad: f32",
    result: "origin: vec3<f32>, length: f32, direction: vec3<f32>, pdf: f32, end: vec3<f32>, pixel: u32, nearest: vec3<f32>, pad: u32",
    body: "let ray = camera_ray(vec2<u32>(0u), input.p); let point = ray.origin + input.distance * ray.direction;
        let to_sensor = segment_to_sensor(point, vec2<f32>(0.0));
        result.origin = ray.origin; result.direction = to_sensor.direction; result.length = to_sensor.length;
        result.end = to_sensor.end; result.nearest = nearest_sensor_point(point); result.pdf = pixel_pdf(0.5, frame.forward);
        result.pixel = pixel_of(point - frame.sensor);",
};

/// A scanning sensor of one row.
const AIMED: ShaderFunction = ShaderFunction {
    imports: &["camera"],
    input: "u: vec2<f32>, column: u32, pad: u32",
    result: "d: vec3<f32>, pad: f32",
    body: "result.d = camera_ray(vec2<u32>(input.column, 0u), input.u).direction;",
};

fn camera(f: &mut Frame) {
    let forward = DVec3::new(0.3, -0.5, 0.8).normalize();
    let right = forward.cross(DVec3::Y).normalize();
    (f.forward, f.right, f.up) = (vec3(forward), vec3(right), vec3(right.cross(forward)));
    (f.width, f.height, f.extent) = (61, 37, [0.9, 0.9 * 37.0 / 61.0]);
    f.pixel_area = 4.0 * f.extent[0] * f.extent[1] / (61.0 * 37.0);
    f.principal_offset = [6.25, -3.5];
    (f.crop_x, f.crop_y, f.crop_width, f.crop_height) = (7, 3, 40, 21);
}

#[test]
fn pixels_invert_the_film() {
    let mut pcg = Pcg::new(111);
    let inputs: Vec<[f32; 4]> = (0..20_000)
        .map(|_| [pcg.range(-5.0, 66.0) as f32, pcg.range(-5.0, 42.0) as f32, pcg.range(0.01, 100.0) as f32, 0.0])
        .collect();
    let results: Vec<[u32; 8]> = FILM.run(&inputs, &[frame(camera)]);
    let mut f: Frame = bytemuck::Zeroable::zeroed();
    camera(&mut f);
    let (mut on, mut off) = (0, 0);
    for (g, r) in inputs.iter().zip(&results) {
        let [px, py] = [f64::from(g[0]), f64::from(g[1])];
        let (x, y) = (
            (2.0 * (px - 6.25) / 61.0 - 1.0) * f64::from(f.extent[0]),
            (1.0 - 2.0 * (py + 3.5) / 37.0) * f64::from(f.extent[1]),
        );
        let expected = dvec(&f.forward) + x * dvec(&f.right) + y * dvec(&f.up);
        let d = dvec(&[r[0], r[1], r[2]].map(f32::from_bits));
        assert!((d - expected).length() < 1e-6, "{g:?}: {d} {expected}");
        let cosine = expected.normalize().dot(dvec(&f.forward));
        let pdf = f64::from(f32::from_bits(r[3]));
        assert!((pdf * f64::from(f.pixel_area) * cosine.powi(3) - 1.0).abs() < 2e-6);
        assert_eq!(r[5], NONE, "a direction behind the sensor has a pixel");
        // On the border of two pixels, both are right.
        if (px - px.round()).abs() < 1e-3 || (py - py.round()).abs() < 1e-3 {
            continue;
        }
        let (column, row) = (px.floor() as i64 - 7, py.floor() as i64 - 3);
        let inside = (0..40).contains(&column) && (0..21).contains(&row);
        assert_eq!(r[4], if inside { (row * 40 + column) as u32 } else { NONE }, "{g:?}");
        if inside { on += 1 } else { off += 1 }
    }
    assert!(on > 3000 && off > 3000);
}

/// The density of a pixel's directions integrates to 1 over the solid angle of the pixel, which is divided into small
/// triangles.
#[test]
fn the_density_of_a_pixel_integrates_to_one() {
    const N: usize = 16;
    let mut f: Frame = bytemuck::Zeroable::zeroed();
    camera(&mut f);
    for (column, row) in [(0.0, 0.0), (30.0, 18.0), (60.0, 36.0)] {
        let centre = |i: usize| (i as f64 + 0.5) / N as f64;
        let inputs: Vec<[f32; 4]> =
            (0..N * N).map(|i| [(column + centre(i % N)) as f32, (row + centre(i / N)) as f32, 1.0, 0.0]).collect();
        let results: Vec<[u32; 8]> = FILM.run(&inputs, &[frame(camera)]);
        let corner = |i: usize, j: usize| {
            let (px, py) = (column + i as f64 / N as f64, row + j as f64 / N as f64);
            let (x, y) =
                ((2.0 * (px - 6.25) / 61.0 - 1.0) * 0.9, (1.0 - 2.0 * (py + 3.5) / 37.0) * f64::from(f.extent[1]));
            DVec3::new(x, y, 1.0).normalize()
        };
        let sum: f64 = (0..N * N)
            .map(|k| {
                let (i, j) = (k % N, k / N);
                let quad = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                let area = solid_angle(quad[0], quad[1], quad[2]) + solid_angle(quad[0], quad[2], quad[3]);
                area * f64::from(f32::from_bits(results[k][3]))
            })
            .sum();
        assert!((sum - 1.0).abs() < 1e-4, "{sum}");
    }
}

/// Solid angle of a triangle of unit vectors (Van Oosterom and Strackee 1983).
fn solid_angle(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    2.0 * (a.dot(b.cross(c)).abs() / (1.0 + a.dot(b) + b.dot(c) + c.dot(a))).atan()
}

/// The sensor sees every point on a camera ray in the pixel from which the ray starts. The nearest point of the film is the film
/// point of the ray, clamped to the edges of the film.
#[test]
fn parallel_rays_invert_the_film() {
    let sensor = DVec3::new(0.3, -0.2, 0.1);
    let place = |f: &mut Frame| {
        camera(f);
        f.sensor = vec3(sensor);
    };
    let mut f: Frame = bytemuck::Zeroable::zeroed();
    place(&mut f);
    let [forward, right, up] = [f.forward, f.right, f.up].map(|axis| dvec(&axis));
    let mut pcg = Pcg::new(112);
    let inputs: Vec<[f32; 4]> = (0..20_000)
        .map(|_| [pcg.range(-5.0, 66.0) as f32, pcg.range(-5.0, 42.0) as f32, pcg.range(-2.0, 20.0) as f32, 0.0])
        .collect();
    let kernel = TO_SENSOR.compile(&[("HAS_ORTHOGRAPHIC", 1.0)]);
    let results: Vec<[u32; 16]> = kernel.run(&inputs, &[frame(place)]);
    let edges =
        |size: f64, offset: f64, extent: f32| [-1.0, 1.0].map(|e| (e - 2.0 * offset / size) * f64::from(extent));
    let (x_edges, y_edges) = (edges(61.0, 6.25, f.extent[0]), edges(37.0, 3.5, f.extent[1]));
    let mut on = 0;
    for (g, r) in inputs.iter().zip(&results) {
        let floats = r.map(f32::from_bits);
        let vector = |from: usize| dvec(&[floats[from], floats[from + 1], floats[from + 2]]);
        let [px, py, distance] = [0, 1, 2].map(|k| f64::from(g[k]));
        let x = (2.0 * (px - 6.25) / 61.0 - 1.0) * f64::from(f.extent[0]);
        let y = (1.0 - 2.0 * (py + 3.5) / 37.0) * f64::from(f.extent[1]);
        let origin = sensor + x * right + y * up;
        assert!((vector(0) - origin).length() < 1e-6, "{g:?}: {} {origin}", vector(0));
        assert!((vector(8) - origin).length() < 1e-5 && (f64::from(floats[3]) - distance).abs() < 1e-5, "{g:?}");
        assert_eq!(vector(4), -forward);
        assert!((f64::from(floats[7] * f.pixel_area) - 1.0).abs() < 1e-6);
        let nearest = sensor + x.clamp(x_edges[0], x_edges[1]) * right + y.clamp(y_edges[0], y_edges[1]) * up;
        assert!((vector(12) - nearest).length() < 1e-5, "{g:?}: {} {nearest}", vector(12));
        // On the border of two pixels, both pixels are right. In the sensor plane, a pixel and NONE are both right.
        if (px - px.round()).abs() < 1e-3 || (py - py.round()).abs() < 1e-3 || distance.abs() < 1e-5 {
            continue;
        }
        let (column, row) = (px.floor() as i64 - 7, py.floor() as i64 - 3);
        let inside = distance > 0.0 && (0..40).contains(&column) && (0..21).contains(&row);
        assert_eq!(r[11], if inside { (row * 40 + column) as u32 } else { NONE }, "{g:?}");
        on += usize::from(inside);
    }
    assert!(on > 3000 && results.len() - on > 3000);
}

/// All rays of a pixel lie in its square field of view. In f32, a large column plus a number just below 1 rounds to the next column.
#[test]
fn rays_of_an_aimed_pixel_stay_in_its_field_of_view() {
    const COLUMNS: u32 = 65_535;
    const EXTENT: f32 = 0.01;
    let mut pcg = Pcg::new(113);
    let aims: Vec<[f32; 4]> = (0..COLUMNS)
        .map(|_| {
            let [x, y, z] = vec3(direction(&mut pcg));
            [x, y, z, 1.0]
        })
        .collect();
    let place = |f: &mut Frame| (f.width, f.height, f.extent) = (COLUMNS, 1, [EXTENT; 2]);
    let below_one = 1.0f32.next_down().to_bits();
    let inputs: Vec<[u32; 4]> = (0..COLUMNS)
        .map(|column| [[0, below_one][pcg.below(2)], (pcg.uniform() as f32).to_bits(), column, 0])
        .collect();
    let kernel = AIMED.compile(&[("HAS_AIMS", 1.0)]);
    let results: Vec<[f32; 4]> = kernel.run(&inputs, &[frame(place), contents("aims", &aims)]);
    for ((input, r), [x, y, z, _]) in inputs.iter().zip(&results).zip(aims) {
        let (d, axis) = (dvec(&[r[0], r[1], r[2]]), dvec(&[x, y, z]));
        // The first coordinate is at an edge of the field of view; the second one is anywhere.
        let v = f64::from(f32::from_bits(input[1]));
        let aside = f64::from(EXTENT) * (1.0 + (2.0 * v - 1.0).powi(2)).sqrt();
        assert!(
            (d.dot(axis) - 1.0).abs() < 1e-6 && ((d - axis).length() - aside).abs() < 1e-5,
            "{input:?}: {d} {axis}"
        );
    }
}

//! Rays by ray queries of the device: images agree with those of kernels, closed meshes do not leak, and demands that the device cannot
//! meet are refused. The tests are skipped, with a message, on devices without ray queries.

#[path = "common/device.rs"]
mod device;

use bytemuck::{Pod, Zeroable};
use device::device;
use glam::{DVec3, Vec3};
use taugate::internals::compare::statistics::{normal_score, sidak_threshold};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::zoo::Light;
use taugate::internals::generate::{Kind, build, parts, shapes};
use taugate::internals::gpu::shader::HARDWARE_RAYS;
use taugate::internals::gpu::{Buffer, Device, Kernel, RaySupport, Recorder, TriangleGroup};
use taugate::internals::render::Renderer;
use taugate::internals::scene::{Material, Medium, Scene};
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Budget, Estimator, Rays, Sampling, Settings};
use taugate::internals::wgsl::layout::{Dispatch, NONE};

/// Significance level of a test over all its cells together.
const SIGNIFICANCE: f64 = 1e-3;
const SEEDS: u32 = 16;
const SIZE: [u32; 2] = [16, 16];
/// Side of the cells of pixels whose means are compared.
const CELL: usize = 4;

/// The device, if it has ray queries.
fn with_ray_queries() -> Option<Device> {
    let device = device();
    if device.info().quirks.rays == RaySupport::Absent {
        eprintln!("skipped: {} has no ray queries", device.info().name);
        return None;
    }
    Some(device)
}

fn renderer(device: &Device, scene: &Scene, estimator: Estimator, rays: Rays) -> Renderer {
    let settings = Settings::builder().estimator(estimator).resolution(SIZE).budget(Budget::Spp(1));
    let settings = settings.light_paths(2000).sampling(Sampling::Uniform).rays(rays).build().unwrap();
    Renderer::new(device, scene, &settings).unwrap_or_else(|e| panic!("{e}"))
}

/// For each cell, the mean of every seed.
fn cells(renderer: &mut Renderer, gate: Gate, first_seed: u32) -> Vec<Vec<f64>> {
    let per_row = SIZE[0] as usize / CELL;
    let mut cells = vec![vec![]; per_row * SIZE[1] as usize / CELL];
    for seed in first_seed..first_seed + SEEDS {
        renderer.restart(seed, gate).unwrap();
        for _ in 0..2 {
            renderer.iterate(8).unwrap();
        }
        let mut sums = vec![0.0; cells.len()];
        for (i, rgb) in renderer.film().mean().chunks(3).enumerate() {
            let (x, y) = (i % SIZE[0] as usize, i / SIZE[0] as usize);
            sums[y / CELL * per_row + x / CELL] += rgb.iter().map(|&c| f64::from(c)).sum::<f64>();
        }
        cells.iter_mut().zip(sums).for_each(|(cell, sum)| cell.push(sum));
    }
    cells
}

/// The largest score of the difference of two means, over all cells; `scale` multiplies the second one.
fn worst(a: &[Vec<f64>], b: &[Vec<f64>], scale: f64) -> f64 {
    let n = f64::from(SEEDS);
    let mean = |x: &[f64]| x.iter().sum::<f64>() / n;
    let variance = |x: &[f64], mean: f64| x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0) / n;
    let score = |(a, b): (&Vec<f64>, &Vec<f64>)| {
        let (ma, mb) = (mean(a), mean(b));
        let error = (variance(a, ma) + scale * scale * variance(b, mb)).sqrt();
        let difference = ma - scale * mb;
        if difference == 0.0 { 0.0 } else { normal_score(difference / error, 2.0 * n - 2.0).abs() }
    };
    a.iter().zip(b).map(score).fold(0.0, f64::max)
}

fn assert_same_means(scene: &Scene, estimator: Estimator, gate: Gate) {
    let Some(device) = with_ray_queries() else { return };
    let of = |rays, seed| cells(&mut renderer(&device, scene, estimator, rays), gate, seed);
    let software = of(Rays::Software, 1);
    let hardware = of(Rays::Hardware, 1001);
    let total = |cells: &[Vec<f64>]| cells.iter().flatten().sum::<f64>();
    assert!(total(&software) > 0.0, "a black image proves nothing");
    let threshold = sidak_threshold(SIGNIFICANCE, software.len());
    let score = worst(&software, &hardware, 1.0);
    println!(
        "{estimator:?}: score {score:.2}, threshold {threshold:.2}, ratio {}",
        total(&hardware) / total(&software)
    );
    assert!(score < threshold, "{estimator:?}: {score} is above {threshold}");
    assert!(worst(&software, &hardware, 1.5) > threshold, "an image that is brighter by half must be noticed");
}

#[test]
fn images_of_opaque_surfaces_agree() {
    let scene = build(Kind::CornellBox);
    assert_same_means(&scene, Estimator::Lcs, Gate { lo: 7.0, hi: 9.0 });
}

/// The zoo has surfaces with alpha, solid glass and thin glass.
#[test]
fn images_of_surfaces_that_let_rays_pass_agree() {
    assert_same_means(&build(Kind::Zoo(Light::Area)), Estimator::Bdpt, Gate::OPEN);
}

/// Fog in a mesh in the room: rays pass its boundary, and look for it behind the surfaces that they hit.
#[test]
fn images_of_null_boundaries_agree() {
    let mut scene = build(Kind::Zoo(Light::Punctual));
    let fog = Medium { sigma_s: [0.6; 3], sigma_a: [0.1; 3], ..Medium::default() };
    let null = Material { interior: Some(fog), ior: 1.0, ..parts::glass("null") };
    let null = parts::material(&mut scene, null);
    let mesh = shapes::cuboid(DVec3::new(-0.9, 0.2, -0.95), DVec3::new(0.95, 2.1, 0.8));
    parts::add(&mut scene, "fog", null, mesh);
    assert_same_means(&scene, Estimator::Bdpt, Gate { lo: 5.0, hi: 8.0 });
}

/// A device without ray queries refuses them in one sentence, and renders with `auto`.
#[test]
fn a_device_without_ray_queries_refuses_them() {
    let device = device();
    if device.info().quirks.rays != RaySupport::Absent {
        eprintln!("skipped: {} has ray queries", device.info().name);
        return;
    }
    let settings = Settings::builder().resolution(SIZE).rays(Rays::Hardware).build().unwrap();
    let error = Renderer::new(&device, &build(Kind::CornellBox), &settings).err().expect("no ray queries");
    assert!(error.to_string().contains("give --rays software"), "{error}");
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Ray {
    origin: [f32; 3],
    pad: f32,
    direction: [f32; 3],
    any_hit: u32,
}

const LEAKS: &str = "#import visibility
#import frame
struct Ray { origin: vec3<f32>, pad: f32, direction: vec3<f32>, any_hit: u32 }
@group(2) @binding(0) var<storage, read> rays: array<Ray>;
@group(2) @binding(1) var<storage, read_write> hits: array<u32>;
@compute @workgroup_size(64)
fn leaks(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= dispatch.count) { return; }
    let ray = rays[id.x];
    hits[id.x] = trace(ray.origin, ray.direction, 3e38, ray.any_hit != 0u, NONE, vec4<u32>(0u)).triangle;
}
";

/// The number of `rays` that leave the mesh of `corners`, which contains their origins.
fn leaks(device: &Device, corners: &[[f32; 3]], rays: &[Ray]) -> usize {
    let opaque = ["HAS_ALPHA", "HAS_SHEETS", "HAS_NULL_BOUNDARIES", "HAS_MEDIA"].map(|name| (name, 0.0));
    let constants = [&opaque[..], &[(HARDWARE_RAYS, 1.0)]].concat();
    let kernel = Kernel::from_source(device, "leaks", LEAKS, "leaks", &constants).unwrap();
    let group = TriangleGroup { corners: corners.to_vec(), is_opaque: true, mask: 1 };
    let structure = Buffer::acceleration_structure(device, "structure", &[group]).unwrap();
    let input = Buffer::from_slice(device, "rays", rays, "").unwrap();
    let hits = Buffer::new::<u32>(device, "hits", rays.len(), "").unwrap();
    let bindings = kernel.bind(&[("ray_structure", &structure), ("rays", &input), ("hits", &hits)]).unwrap();
    let mut recorder = Recorder::new(device).unwrap();
    let dispatch = Dispatch { count: rays.len() as u32, ..Zeroable::zeroed() };
    recorder.dispatch("leaks", &kernel, &bindings, &dispatch, kernel.groups(rays.len())).unwrap();
    recorder.submit().unwrap();
    let found = hits.to_vec::<u32>(rays.len()).unwrap();
    assert!(found.iter().all(|&hit| hit == NONE || (hit as usize) < corners.len() / 3));
    found.iter().filter(|&&hit| hit == NONE).count()
}

/// Rays from inside a closed sphere hit it: in random directions, and aimed at edges and corners. Of the latter a device may lose a few.
#[test]
fn closed_meshes_do_not_leak() {
    let Some(device) = with_ray_queries() else { return };
    let scene = build(Kind::GatedSphere { radius: 1.0, subdivisions: 4, albedo: 0.5 });
    let mesh = &scene.meshes[0];
    let corners: Vec<[f32; 3]> =
        mesh.triangles.iter().flat_map(|t| t.map(|corner| mesh.positions[corner as usize])).collect();
    let mut random = Pcg::new(3);
    let mut uniform = || random.uniform() as f32;
    let ray = |any_hit, to: Vec3, origin: Vec3| {
        let [origin, direction] = [origin, to - origin].map(|v| v.to_array());
        Ray { origin, pad: 0.0, direction, any_hit }
    };
    let counts = [0u32, 1].map(|any_hit| {
        let mut aimed = [vec![], vec![], vec![]];
        for triangle in corners.chunks(3).cycle().take(100_000) {
            let origin = Vec3::new(uniform() - 0.5, uniform() - 0.5, uniform() - 0.5);
            let [a, b, c] = [0, 1, 2].map(|i| Vec3::from(triangle[i]));
            let (u, v) = (uniform(), uniform());
            aimed[0].push(ray(any_hit, a + (b - a) * u * (1.0 - v) + (c - a) * v, origin));
            aimed[1].push(ray(any_hit, a + (b - a) * u, origin));
            aimed[2].push(ray(any_hit, a, origin));
        }
        aimed.map(|rays| leaks(&device, &corners, &rays))
    });
    println!("leaks of 100,000 rays at faces, edges, corners: closest {:?}, shadow {:?}", counts[0], counts[1]);
    for [faces, edges, corners] in counts {
        assert!(faces <= 5 && edges <= 200 && corners <= 5000, "{counts:?}");
    }
    // The test sees a hole.
    let rays: Vec<Ray> = corners
        .chunks(3)
        .map(|t| {
            ray(0, Vec3::from(t[0]) + (Vec3::from(t[1]) + Vec3::from(t[2]) - 2.0 * Vec3::from(t[0])) / 3.0, Vec3::ZERO)
        })
        .collect();
    assert_eq!(leaks(&device, &corners[3..], &rays), 1);
}

//! Rays where geometry is at its worst: aimed at shared edges and corners of closed meshes from inside, along slivers, through
//! coincident and empty triangles, and leaving a surface at every scale.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DVec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::{shapes, stage};
use taugate::internals::scene::{Mesh, Scene};

use crate::shader_function::{CompiledFunction, Contents, ShaderFunction};
use crate::trace::buffers;
use crate::values::{direction, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&BOUNCE];

/// The first hit, and what a ray that leaves it along `next` hits.
const BOUNCE: ShaderFunction = ShaderFunction {
    imports: &["visibility"],
    input: "o: vec3<f32>, pad: f32, d: vec3<f32>, pad2: f32, next: vec3<f32>, pad3: f32",
    result: "position: vec3<f32>, first: u32, geometric: vec3<f32>, second: u32, normal: vec3<f32>, pad: f32",
    body: "var o = input.o;
        var d = input.d;
        result.first = NONE;
        result.second = NONE;
        for (var i = 0u; i < 2u; i++) {
            let hit = trace(o, d, 3e38, false, result.first, vec4<u32>(id.x, i, 2u, 3u));
            result.second = hit.triangle;
            if (hit.triangle == NONE) { break; }
            if (i == 0u) {
                let s = surface_at(hit.triangle, hit.u, hit.v);
                result.first = hit.triangle; result.position = s.position; result.geometric = s.geometric;
                result.normal = s.normal;
                o = offset_origin(s.position, s.geometric, s.offset, input.next);
                d = input.next;
            }
        }",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Input {
    o: [f32; 3],
    pad: f32,
    d: [f32; 3],
    pad2: f32,
    next: [f32; 3],
    pad3: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Got {
    position: [f32; 3],
    first: u32,
    geometric: [f32; 3],
    second: u32,
    normal: [f32; 3],
    pad: f32,
}

const NONE: u32 = u32::MAX;

/// Every triangle with corners of its own.
fn unwelded(mesh: &Mesh) -> Mesh {
    let positions: Vec<[f32; 3]> = mesh.triangles.iter().flatten().map(|&c| mesh.positions[c as usize]).collect();
    let triangles = (0..mesh.triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Mesh { positions, triangles, ..Mesh::default() }
}

/// A sliver along the first edge of every triangle, its width 1e-6 of its length; the mesh stays closed.
fn slivered(mesh: &Mesh) -> Mesh {
    let mut out = Mesh { positions: mesh.positions.clone(), ..Mesh::default() };
    for &[a, b, c] in &mesh.triangles {
        let at = |i: u32| DVec3::from(mesh.positions[i as usize].map(f64::from));
        let middle = 0.5 * (at(a) + at(b));
        let inner = middle + 1e-6 * (at(c) - middle);
        let m = out.positions.len() as u32;
        out.positions.push(vec3(inner));
        out.triangles.extend([[a, b, m], [a, m, c], [m, b, c]]);
    }
    out
}

/// Closed convex meshes about the origin, of size 1.
fn closed() -> Vec<(&'static str, Mesh)> {
    let ball = shapes::icosphere(1.0, 3);
    let mut flat = ball.clone();
    flat.positions.iter_mut().for_each(|p| p[2] *= 1e-4);
    let mut needle = shapes::ball(1.0, 24, 16);
    needle.positions.iter_mut().for_each(|p| (p[0], p[1]) = (1e-3 * p[0], 1e-3 * p[1]));
    vec![
        ("unwelded", unwelded(&ball)),
        ("slivered", slivered(&ball)),
        ("ball", ball),
        ("flat", flat),
        ("needle", needle),
        ("cuboid", shapes::cuboid(DVec3::splat(-1.0), DVec3::ONE)),
    ]
}

const SCALES: [f64; 4] = [1e-3, 1.0, 1e3, 1e6];

/// A mesh at a scale, the sensor a few sizes away, and its corners as the device has them.
struct Placed {
    buffers: Vec<Contents>,
    corners: Vec<[DVec3; 3]>,
    centre: DVec3,
}

fn placed(mesh: &Mesh, scale: f64) -> Placed {
    let mut scene = Scene::default();
    let white = stage::material(&mut scene, stage::diffuse("white", [1.0; 3]));
    let centre = scale * DVec3::new(2.0, -3.0, 1.5);
    let number = stage::mesh(&mut scene, "mesh", white, mesh.clone());
    stage::place(
        &mut scene,
        "mesh",
        number,
        DAffine3::from_scale_rotation_translation(DVec3::splat(scale), Default::default(), centre),
    );
    let world = |c: u32| (centre + scale * DVec3::from(mesh.positions[c as usize].map(f64::from))).as_vec3().as_dvec3();
    let corners = mesh.triangles.iter().map(|t| t.map(world)).collect();
    Placed { buffers: buffers(&scene, DVec3::ZERO), corners, centre }
}

/// Rays from inside towards shared corners, edges and faces, in turn.
fn aimed(placed: &Placed, n: usize, pcg: &mut Pcg) -> Vec<Input> {
    (0..n)
        .map(|i| {
            let [a, b, c] = placed.corners[pcg.below(placed.corners.len())];
            let (s, t) = (pcg.uniform(), pcg.uniform());
            let target = match i % 3 {
                0 => a,
                1 => a + s * (b - a),
                _ => a + s * (1.0 - t) * (b - a) + s * t * (c - a),
            };
            // Between the centre and a corner: inside, as the mesh is convex about its centre.
            let far = placed.corners[pcg.below(placed.corners.len())][0];
            let o = placed.centre + 0.5 * pcg.uniform() * (far - placed.centre);
            let mut next = direction(pcg);
            if pcg.below(3) == 0 {
                // Nearly along the face.
                let normal = (b - a).cross(c - a).normalize_or(DVec3::Z);
                next = (next - next.dot(normal) * normal + 1e-3 * pcg.range(-1.0, 1.0) * normal).normalize();
            }
            Input { o: vec3(o), d: vec3((target - o).normalize_or(DVec3::X)), next: vec3(next), ..Zeroable::zeroed() }
        })
        .collect()
}

/// Rays that left a closed mesh, and rays that left a surface and hit it again.
fn faults(kernel: &CompiledFunction, rays: usize, seed: u64) -> Vec<String> {
    let mut pcg = Pcg::new(seed);
    let mut wrong = vec![];
    for (name, mesh) in closed() {
        for scale in SCALES {
            let placed = placed(&mesh, scale);
            let inputs = aimed(&placed, rays, &mut pcg);
            let results: Vec<Got> = kernel.run(&inputs, &placed.buffers);
            let lost = inputs.iter().zip(&results).find(|(_, r)| r.first == NONE).map(|(g, _)| g);
            let leaks = results.iter().filter(|r| r.first == NONE).count();
            let finite = |r: &Got| [r.position, r.geometric, r.normal].iter().flatten().all(|x| x.is_finite());
            let broken = results.iter().filter(|r| r.first != NONE && !finite(r)).count();
            let again = results.iter().filter(|r| r.first != NONE && r.second == r.first).count();
            if leaks + broken + again > 0 {
                wrong.push(format!(
                    "{name} at {scale}: {leaks} leaks, {broken} not finite, {again} self-hits of {rays}; {lost:?}"
                ));
            }
        }
    }
    wrong
}

#[test]
fn closed_meshes_do_not_leak_and_surfaces_do_not_hit_themselves() {
    let wrong = faults(&BOUNCE.compile(&[]), 12_000, 181);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// `cargo test --release --test parity -- --ignored a_million_rays`: 42,000 each for six meshes at four scales.
#[test]
#[ignore = "takes a minute"]
fn a_million_rays_do_not_leak() {
    let wrong = faults(&BOUNCE.compile(&[]), 42_000, 182);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The sibling that must fail: without forty of its 1280 triangles a mesh leaks.
#[test]
fn missing_triangles_are_noticed() {
    let mut mesh = shapes::icosphere(1.0, 3);
    mesh.triangles.truncate(mesh.triangles.len() - 40);
    let placed = placed(&mesh, 1.0);
    let results: Vec<Got> = BOUNCE.run(&aimed(&placed, 20_000, &mut Pcg::new(183)), &placed.buffers);
    assert!(results.iter().any(|r| r.first == NONE));
}

/// Coincident sheets are one surface to every ray; a triangle without area is none, and hides nothing.
#[test]
fn coincident_and_empty_triangles() {
    let quad = shapes::quad(DVec3::new(-1.0, -1.0, 3.0), 2.0 * DVec3::X, 2.0 * DVec3::Y, [1.0, 1.0]);
    let mut mesh = Mesh::default();
    for _ in 0..5 {
        shapes::append(&mut mesh, &quad, DAffine3::IDENTITY);
    }
    let solid = mesh.triangles.len();
    let empty = [[0.3, 0.1, 2.0], [0.3, 0.1, 2.0], [0.3, 0.1, 2.0], [-0.9, 0.0, 2.5], [0.0, 0.0, 2.5], [0.9, 0.0, 2.5]];
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(empty);
    mesh.triangles.extend([[first, first + 1, first + 2], [first + 3, first + 4, first + 5]]);
    mesh.uvs.clear();
    let mut scene = Scene::default();
    let white = stage::material(&mut scene, stage::diffuse("white", [1.0; 3]));
    stage::add(&mut scene, "sheets", white, mesh);
    let mut pcg = Pcg::new(184);
    let inputs: Vec<Input> = (0..20_000)
        .map(|i| {
            // Half of them at what has no area, the rest at the sheets.
            let target = match i % 4 {
                0 => DVec3::new(0.3, 0.1, 2.0),
                1 => DVec3::new(pcg.range(-0.7, 0.7), 0.0, 2.5),
                _ => DVec3::new(pcg.range(-0.9, 0.9), pcg.range(-0.9, 0.9), 3.0),
            };
            let next = [0.0, 0.0, if i % 2 == 0 { 1.0 } else { -1.0 }];
            Input { o: [0.0; 3], d: vec3(target.normalize()), next, ..Zeroable::zeroed() }
        })
        .collect();
    let results: Vec<Got> = BOUNCE.run(&inputs, &buffers(&scene, DVec3::ZERO));
    assert_eq!(solid, 10);
    for (g, r) in inputs.iter().zip(&results) {
        assert!(r.first != NONE && (r.position[2] - 3.0).abs() < 1e-5, "{g:?} {r:?}");
        assert!(r.geometric[2].abs() > 0.999 && r.second == NONE, "{g:?} {r:?}");
    }
}

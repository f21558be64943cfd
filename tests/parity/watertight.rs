//! Rays against difficult geometry: shared edges and corners of closed meshes, slivers, coincident triangles, and triangles
//! without area. Closed meshes do not leak, and rays that leave a surface do not hit it again, at scales from 1 mm to 1000
//! km.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DVec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::{parts, shapes};
use taugate::internals::scene::{Mesh, Scene};

use crate::shader_function::{CompiledFunction, Contents, ShaderFunction};
use crate::trace::buffers;
use crate::values::{direction, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&BOUNCE];

/// Finds the first hit of a ray, then the first hit of a second ray that leaves the surface along `next`.
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

/// The same mesh with no shared corners: every triangle has its own.
fn unwelded(mesh: &Mesh) -> Mesh {
    let positions: Vec<[f32; 3]> = mesh.triangles.iter().flatten().map(|&c| mesh.positions[c as usize]).collect();
    let triangles = (0..mesh.triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Mesh { positions, triangles, ..Mesh::default() }
}

/// Divides every triangle into three. One is a sliver along the first edge, about 1e-6 times as wide as long. The mesh stays
/// closed.
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

/// Closed convex meshes around the origin, with a radius of about 1.
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

/// A scaled mesh at a few times its size from the sensor, and its corners as the device stores them.
struct Placed {
    buffers: Vec<Contents>,
    corners: Vec<[DVec3; 3]>,
    centre: DVec3,
}

fn placed(mesh: &Mesh, scale: f64) -> Placed {
    let mut scene = Scene::default();
    let white = parts::material(&mut scene, parts::diffuse("white", [1.0; 3]));
    let centre = scale * DVec3::new(2.0, -3.0, 1.5);
    let number = parts::mesh(&mut scene, "mesh", white, mesh.clone());
    parts::place(
        &mut scene,
        "mesh",
        number,
        DAffine3::from_scale_rotation_translation(DVec3::splat(scale), Default::default(), centre),
    );
    let world = |c: u32| (centre + scale * DVec3::from(mesh.positions[c as usize].map(f64::from))).as_vec3().as_dvec3();
    let corners = mesh.triangles.iter().map(|t| t.map(world)).collect();
    Placed { buffers: buffers(&scene, DVec3::ZERO), corners, centre }
}

/// Rays from inside a closed mesh. Their targets are in turn a shared corner, a shared edge and a face.
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
            // The origin lies between the centre and a corner. It is inside, because the mesh is convex.
            let far = placed.corners[pcg.below(placed.corners.len())][0];
            let o = placed.centre + 0.5 * pcg.uniform() * (far - placed.centre);
            let mut next = direction(pcg);
            if pcg.below(3) == 0 {
                // The second ray leaves almost parallel to the face.
                let normal = (b - a).cross(c - a).normalize_or(DVec3::Z);
                next = (next - next.dot(normal) * normal + 1e-3 * pcg.range(-1.0, 1.0) * normal).normalize();
            }
            Input { o: vec3(o), d: vec3((target - o).normalize_or(DVec3::X)), next: vec3(next), ..Zeroable::zeroed() }
        })
        .collect()
}

/// One line per mesh and scale with faults: rays that leave a closed mesh, hits that are not finite, and rays that leave a
/// triangle and hit it again.
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

/// 42,000 rays for each of six meshes at four scales. `cargo test --release --test parity -- --ignored a_million_rays`
#[test]
#[ignore = "takes a minute"]
fn a_million_rays_do_not_leak() {
    let wrong = faults(&BOUNCE.compile(&[]), 42_000, 182);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The test above would detect leaks: a mesh without 40 of its 1280 triangles leaks.
#[test]
fn missing_triangles_are_noticed() {
    let mut mesh = shapes::icosphere(1.0, 3);
    mesh.triangles.truncate(mesh.triangles.len() - 40);
    let placed = placed(&mesh, 1.0);
    let results: Vec<Got> = BOUNCE.run(&aimed(&placed, 20_000, &mut Pcg::new(183)), &placed.buffers);
    assert!(results.iter().any(|r| r.first == NONE));
}

/// Five coincident sheets act as one surface. Triangles without area hide nothing.
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
    let white = parts::material(&mut scene, parts::diffuse("white", [1.0; 3]));
    parts::add(&mut scene, "sheets", white, mesh);
    let mut pcg = Pcg::new(184);
    let inputs: Vec<Input> = (0..20_000)
        .map(|i| {
            // Half of the rays aim at triangles without area, the other half at the sheets.
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

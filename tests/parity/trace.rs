//! Rays through the wide BVH, and the surfaces that they hit, against the oracle's exhaustive search in f64.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DMat3, DVec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::{parts, shapes};
use taugate::internals::render::albedo::AlbedoTable;
use taugate::internals::render::geometry::Geometry;
use taugate::internals::render::space::RenderSpace;
use taugate::internals::scene::{AlphaMode, Material, Mesh, Scene};
use taugate::internals::settings::Emitters;
use taugate::internals::wgsl::layout::VertexDetails;
use taugate_oracle::geometry::{Geometry as Exact, Ray};

use crate::shader_function::{CompiledFunction, Contents, ShaderFunction, contents};
use crate::values::{direction, directions, dvec, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&TRACE, &AGAIN];

const TRACE: ShaderFunction = ShaderFunction {
    imports: &["visibility"],
    input: "o: vec3<f32>, t_max: f32, d: vec3<f32>, any: u32",
    result: "t: f32, hit: u32, offset: f32, material: u32, position: vec3<f32>, pad: f32, geometric: vec3<f32>,
        left: f32, normal: vec3<f32>, pad2: f32, uv: vec2<f32>, pad3: vec2<f32>",
    body: "let hit = trace(input.o, input.d, input.t_max, input.any == 1u, NONE, vec4<u32>(id.x, 1u, 2u, 3u));
        result.hit = u32(hit.triangle != NONE);
        if (hit.triangle != NONE) {
            let s = surface_at(hit.triangle, hit.u, hit.v);
            result.t = hit.t; result.offset = s.offset; result.position = s.position; result.geometric = s.geometric;
            result.normal = s.normal; result.uv = s.uv; result.material = s.material;
            result.left = dot(offset_origin(s.position, s.geometric, s.offset, -input.d) - s.position, -input.d);
        }",
};

/// Traces a ray from `o + aside`, then intersects the triangle that it hit with a ray from `o`.
const AGAIN: ShaderFunction = ShaderFunction {
    imports: &["visibility"],
    input: "o: vec3<f32>, pad: f32, d: vec3<f32>, pad2: f32, aside: vec3<f32>, pad3: f32",
    result: "first: vec3<f32>, hit: u32, again: vec3<f32>, t: f32",
    body: "let hit = trace(input.o + input.aside, input.d, 3e38, false, NONE, vec4<u32>(id.x, 1u, 2u, 3u));
        result.hit = u32(hit.triangle != NONE);
        if (hit.triangle != NONE) {
            let met = reintersect(hit, input.o, input.d);
            result.first = surface_at(hit.triangle, hit.u, hit.v).position;
            result.again = surface_at(met.triangle, met.u, met.v).position;
            result.t = met.t;
        }",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Aside {
    o: [f32; 3],
    pad: f32,
    d: [f32; 3],
    pad2: f32,
    aside: [f32; 3],
    pad3: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Again {
    first: [f32; 3],
    hit: u32,
    again: [f32; 3],
    t: f32,
}

#[test]
fn offset_rays_are_reintersected_from_their_vertex() {
    let mut pcg = Pcg::new(134);
    let inputs: Vec<Aside> = directions(135, 6000)
        .into_iter()
        .map(|d| {
            let (o, aside) = (6.0 * direction(&mut pcg), 0.02 * direction(&mut pcg));
            Aside { o: vec3(o), d: vec3(d), aside: vec3(aside), ..Aside::zeroed() }
        })
        .collect();
    let results: Vec<Again> = AGAIN.run(&inputs, &buffers(&scene(), DVec3::ZERO));
    let (mut met, mut kept, mut aside) = (0, 0, 0);
    for (g, r) in inputs.iter().zip(&results).filter(|(_, r)| r.hit == 1) {
        let (o, d) = (dvec(&g.o), dvec(&g.d));
        let off = |p: &[f32; 3]| (dvec(p) - o).cross(d).length();
        aside += usize::from(off(&r.first) > 1e-3);
        if r.again == r.first {
            kept += 1;
            continue;
        }
        met += 1;
        assert!(off(&r.again) < 1e-4, "{g:?} {r:?}");
        assert!(r.t > 0.0 && (o + f64::from(r.t) * d - dvec(&r.again)).length() < 1e-4, "{g:?} {r:?}");
    }
    // Most first hits are beside the ray from `o`. Only hits within 0.02 m of an edge may keep their position.
    assert!(
        met > 800 && kept * 4 < met && aside * 10 > 9 * met,
        "{met} hits corrected, {kept} kept, {aside} were beside the ray from o"
    );
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Input {
    o: [f32; 3],
    t_max: f32,
    d: [f32; 3],
    any: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Got {
    t: f32,
    hit: u32,
    offset: f32,
    material: u32,
    position: [f32; 3],
    pad: f32,
    geometric: [f32; 3],
    left: f32,
    normal: [f32; 3],
    pad2: f32,
    uv: [f32; 2],
    pad3: [f32; 2],
}

/// The same mesh with its shading normals reversed.
fn opposed(mut mesh: Mesh) -> Mesh {
    mesh.normals.iter_mut().for_each(|n| *n = n.map(|x| -x));
    mesh
}

/// Smooth and flat shapes at random places, scaled, rotated and mirrored. Some have reversed shading normals.
pub fn scene() -> Scene {
    let mut pcg = Pcg::new(131);
    let mut scene = Scene::default();
    let material = parts::material(&mut scene, parts::diffuse("white", [1.0; 3]));
    for i in 0..24 {
        let shape = match i % 4 {
            0 => shapes::ball(0.7, 12, 8),
            1 => shapes::torus(0.8, 0.3, 16, 8),
            2 => shapes::cuboid(DVec3::splat(-0.6), DVec3::splat(0.6)),
            _ => shapes::quad(DVec3::NEG_ONE, 2.0 * DVec3::X, 2.0 * DVec3::Y, [1.0, 2.0]),
        };
        let shape = if i % 5 == 0 { opposed(shape) } else { shape };
        let squeeze = DVec3::new(pcg.range(0.5, 2.0), pcg.range(0.5, 2.0), if i % 3 == 0 { -1.0 } else { 1.0 });
        let turn = parts::about(direction(&mut pcg), pcg.range(0.0, 3.0)) * DMat3::from_diagonal(squeeze);
        let place = DAffine3::from_mat3_translation(turn, 5.0 * direction(&mut pcg));
        let mesh = parts::mesh(&mut scene, "shape", material, shape);
        parts::place(&mut scene, "node", mesh, place);
    }
    scene
}

/// The buffers of a scene. Coordinates are in metres, relative to `origin`.
pub fn buffers(scene: &Scene, origin: DVec3) -> Vec<Contents> {
    buffers_in(scene, &RenderSpace::metres(origin))
}

/// As [`buffers`], in the coordinates of `space`.
pub fn buffers_in(scene: &Scene, space: &RenderSpace) -> Vec<Contents> {
    let g = Geometry::new(scene, space, &Emitters::Scene, &AlbedoTable::new());
    // A buffer needs at least one element to be bound.
    let padded = |list: &[u32]| if list.is_empty() { vec![0] } else { list.to_vec() };
    let details = if g.details.is_empty() { vec![VertexDetails::zeroed()] } else { g.details.clone() };
    vec![
        contents("bvh_nodes", &g.bvh.nodes),
        contents("triangles", &g.triangles),
        contents("corners", &padded(&g.corners)),
        contents("attributes", &g.attributes),
        contents("details", &details),
        contents("instances", &g.instances),
        contents("materials", &g.materials),
        contents("textures", &g.textures),
        crate::texture::texels(scene, &g),
    ]
}

/// Traces rays with an origin, a direction and a maximum distance. `any`: a shadow ray, which stops at any hit.
fn trace(kernel: &CompiledFunction, rays: &[(DVec3, DVec3, f32)], any: bool, buffers: &[Contents]) -> Vec<Got> {
    let inputs: Vec<Input> =
        rays.iter().map(|(o, d, t_max)| Input { o: vec3(*o), t_max: *t_max, d: vec3(*d), any: any.into() }).collect();
    kernel.run(&inputs, buffers)
}

#[test]
fn closest_hits_and_surfaces_agree_with_exhaustion() {
    let (scene, origin) = (scene(), DVec3::new(100.0, -50.0, 20.0));
    // Device coordinates are relative to the sensor. Moving the sensor and the scene together must not change the hits.
    let mut moved = scene.clone();
    moved.instances.iter_mut().for_each(|i| i.transform.translation += origin);
    let exact = Exact::new(&scene);
    let buffers = buffers(&moved, origin);
    let mut pcg = Pcg::new(132);
    let rays: Vec<(DVec3, DVec3, f32)> = directions(133, 6000)
        .into_iter()
        .map(|d| (DVec3::from(vec3(6.0 * direction(&mut pcg)).map(f64::from)), d, 3e38))
        .collect();
    let kernel = TRACE.compile(&[]);
    let results = trace(&kernel, &rays, false, &buffers);
    let (mut hits, mut smooth, mut at_edges) = (0, 0, 0);
    let mut shortened = vec![];
    for ((o, d, _), r) in rays.iter().zip(&results) {
        // By default, rays of the oracle ignore hits near their origin. These rays start in the air, so 0 is right.
        let ray = Ray { t_min: 0.0, ..Ray::new(*o, *d) };
        let expected = exact.closest_by_exhaustion(&ray);
        let Some(hit) = expected.filter(|_| r.hit == 1) else {
            // Close to a silhouette, rounding decides whether a ray hits.
            at_edges += usize::from(expected.is_some() || r.hit == 1);
            continue;
        };
        if (f64::from(r.t) - hit.t).abs() > 1e-4 {
            at_edges += 1;
            continue;
        }
        hits += 1;
        let s = exact.surface(&hit);
        assert!((dvec(&r.position) - s.position).length() < 1e-4, "{r:?} {s:?}");
        // The normals of thin triangles at the poles of balls have an error of 1e-4.
        let geometric = dvec(&r.geometric);
        assert!((geometric - s.geometric).length() < 2e-4, "{r:?} {s:?}");
        assert!((dvec(&r.normal) - s.shading).length() < 1e-3, "{r:?} {s:?}");
        smooth += usize::from((s.shading - s.geometric).length() > 0.01);
        assert!((f64::from(r.uv[0]) - s.uv.x).abs() + (f64::from(r.uv[1]) - s.uv.y).abs() < 1e-3, "{r:?} {s:?}");
        assert!(r.offset > 0.0 && r.offset < 1e-4 && r.left >= 0.0);
        shortened.extend([(*o, *d, r.t * 0.999), (*o, *d, r.t * 1.001)]);
    }
    assert!(
        hits > 1000 && smooth > 300 && at_edges <= 6,
        "{hits} hits, {smooth} on smooth surfaces, {at_edges} differ at edges"
    );
    // Shadow rays that end just before and just behind the closest hit.
    let shadows = trace(&kernel, &shortened, true, &buffers);
    assert!(shadows.iter().enumerate().all(|(i, r)| r.hit == i as u32 % 2));
}

#[test]
fn alpha_lets_its_share_of_rays_through() {
    const N: usize = 40_000;
    let mut scene = Scene::default();
    let veil =
        Material { base_color: [1.0, 1.0, 1.0, 0.3], alpha_mode: AlphaMode::Blend, ..parts::diffuse("veil", [1.0; 3]) };
    let material = parts::material(&mut scene, veil);
    for z in [1.0, 2.0] {
        let quad: Mesh = shapes::quad(DVec3::new(-1.0, -1.0, z), 2.0 * DVec3::X, 2.0 * DVec3::Y, [1.0, 1.0]);
        parts::add(&mut scene, "veil", material, quad);
    }
    let rays = vec![(DVec3::new(0.3, 0.1, 0.0), DVec3::Z, 3e38); N];
    let results = trace(&TRACE.compile(&[("HAS_TEXTURES", 0.0)]), &rays, false, &buffers(&scene, DVec3::ZERO));
    let share = |test: fn(&Got) -> bool| results.iter().filter(|r| test(r)).count() as f64 / N as f64;
    // 4.5 standard errors of a share.
    let error = 4.5 * 0.5 / (N as f64).sqrt();
    assert!((share(|r| r.hit == 1 && r.t < 1.5) - 0.3).abs() < error);
    assert!((share(|r| r.hit == 1 && r.t > 1.5) - 0.7 * 0.3).abs() < error);
    assert!((share(|r| r.hit == 0) - 0.49).abs() < error);
}

//! Normal maps and vertex colours: the surfaces that rays hit, against the oracle.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DMat3, DVec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::{parts, shapes};
use taugate::internals::scene::{Image, Material, Mesh, Scene};
use taugate_oracle::geometry::{Geometry as Exact, Ray};

use crate::shader_function::ShaderFunction;
use crate::trace::buffers;
use crate::values::{direction, dvec, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&BUMP];

const BUMP: ShaderFunction = ShaderFunction {
    imports: &["visibility"],
    input: "o: vec3<f32>, pad: f32, d: vec3<f32>, pad2: f32",
    result: "bumped: vec3<f32>, hit: u32, normal: vec3<f32>, coverage: f32, color: vec4<f32>",
    body: "let hit = trace(input.o, input.d, 3e38, false, NONE, vec4<u32>(id.x, 1u, 2u, 3u));
        result.hit = u32(hit.triangle != NONE);
        if (hit.triangle != NONE) {
            let s = surface_at(hit.triangle, hit.u, hit.v);
            result.bumped = bumped_normal(s); result.normal = s.normal; result.color = base_color(s);
            result.coverage = coverage(s);
        }",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Got {
    bumped: [f32; 3],
    hit: u32,
    normal: [f32; 3],
    coverage: f32,
    color: [f32; 4],
}

/// Smooth rings and flat quads in instances that turn, stretch and mirror. All have vertex colours and a normal map. `side`: 1, or -1
/// for rings whose normals oppose their winding.
fn scene(texel: impl Fn(&mut Pcg) -> [u8; 4], scale: f32, side: f32) -> Scene {
    let mut pcg = Pcg::new(301);
    let mut scene = Scene::default();
    let image = Image { width: 4, height: 4, rgba: (0..16).map(|_| texel(&mut pcg)).collect() };
    let texture = parts::texture(&mut scene, image);
    let rock = Material { normal_texture: Some(texture), normal_scale: scale, ..parts::diffuse("rock", [0.9; 3]) };
    let rock = parts::material(&mut scene, rock);
    let quad = shapes::quad(DVec3::new(-0.5, -0.5, 0.0), DVec3::X, DVec3::Y * 1.2, [2.0, -3.0]);
    for shape in [shapes::torus(0.5, 0.2, 12, 8), Mesh { normals: vec![], ..quad }] {
        let mut mesh = Mesh { name: "rock".into(), material: rock, ..shape };
        mesh.colors = mesh.positions.iter().map(|_| [0; 4].map(|_| pcg.uniform() as f32)).collect();
        mesh.normals.iter_mut().flatten().for_each(|x| *x *= side);
        mesh.add_tangents().unwrap();
        let mesh = scene.add_mesh(mesh);
        for i in 0..4 {
            let stretch = DMat3::from_diagonal(DVec3::new(1.0, if i < 2 { 1.0 } else { -0.7 }, 1.3));
            let turn = DMat3::from_axis_angle(direction(&mut pcg), pcg.range(0.0, 6.0));
            let place = DVec3::new(2.0 * f64::from(i), 2.0 * f64::from(mesh), 0.0);
            scene.place("rock", mesh, DAffine3::from_mat3_translation(turn * stretch, place));
        }
    }
    scene.check().unwrap();
    scene
}

/// Compares `count` rays with the oracle. Returns the number of hits and of normals that the map turns.
fn compare(scene: &Scene, count: usize) -> (usize, usize) {
    let exact = Exact::new(scene);
    let mut pcg = Pcg::new(302);
    let rays: Vec<[[f32; 4]; 2]> = (0..count)
        .map(|_| {
            let target = DVec3::new(2.0 * pcg.below(4) as f64, 2.0 * pcg.below(2) as f64, 0.0);
            let aim = target + 0.6 * direction(&mut pcg);
            let o = vec3(target + 1.5 * direction(&mut pcg));
            let d = vec3((aim - dvec(&o)).normalize());
            [[o[0], o[1], o[2], 0.0], [d[0], d[1], d[2], 0.0]]
        })
        .collect();
    let results: Vec<Got> = BUMP.run(&rays, &buffers(scene, DVec3::ZERO));
    let (mut hits, mut turned) = (0, 0);
    for (g, r) in rays.iter().zip(&results) {
        let ray = Ray::new(dvec(&g[0]), dvec(&g[1]).normalize());
        let Some(hit) = exact.closest(&ray).filter(|_| r.hit == 1) else { continue };
        let surface = exact.surface(&hit);
        // Where a normal lies almost in the surface, rounding decides to which side it is flipped. At silhouettes, rounding decides
        // which triangle a ray hits.
        if surface.shading.dot(surface.geometric) < 0.05 || (dvec(&r.normal) - surface.shading).length() > 1e-3 {
            continue;
        }
        hits += 1;
        let expected = surface.bumped(scene);
        // Octahedral tangents are off by up to 1e-4.
        assert!((dvec(&r.bumped) - expected).length() < 2e-3, "{g:?}: {r:?} {expected}");
        turned += usize::from((expected - surface.shading).length() > 0.05);
        let colors = [0, 1, 2, 3].map(|k| surface.color[k] * if k < 3 { 0.9 } else { 1.0 });
        assert!((0..4).all(|k| (f64::from(r.color[k]) - colors[k]).abs() < 1e-4), "{g:?}: {r:?} {colors:?}");
        assert_eq!(r.coverage, 1.0, "alpha of an opaque material has no effect");
        if expected == surface.shading {
            assert_eq!(r.bumped, r.normal, "{g:?}");
        }
    }
    (hits, turned)
}

#[test]
fn normal_maps_and_vertex_colours_agree_with_the_oracle() {
    // Normals tilted by up to about 50 degrees and, with a scale, by up to the limit of 84 degrees.
    let random = |pcg: &mut Pcg| [40 + pcg.below(176) as u8, 40 + pcg.below(176) as u8, 200, 255];
    for (scale, side) in [(1.0, 1.0), (-0.5, 1.0), (30.0, 1.0), (1.0, -1.0)] {
        let (hits, turned) = compare(&scene(random, scale, side), 20_000);
        assert!(hits > 8000 && turned > hits / 2, "{hits} hits, {turned} turned");
    }
}

/// A map of (128, 128, 255) keeps every bit of the normals.
#[test]
fn a_flat_normal_map_changes_nothing() {
    let (hits, turned) = compare(&scene(|_| [128, 128, 255, 255], 1.0, 1.0), 5000);
    assert!(hits > 2000 && turned == 0, "{hits} hits, {turned} turned");
}

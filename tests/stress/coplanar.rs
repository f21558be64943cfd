//! Coincident surfaces: doubled walls, walls that lie within rounding of each other, a wall that two rooms share, a lamp in the
//! plane of the ceiling. No light may leak or get lost, and no contribution may be infinite.

use glam::{DAffine3, DVec3};
use taugate::internals::generate::parts::{about, add, camera, diffuse, emitter, material};
use taugate::internals::generate::shapes::{cuboid, inside_out, quad};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::{AlphaMode, Instance, Material, Mesh, Scene};
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Emitters, Estimator};
use taugate_oracle::path_tracer;

use super::cells::{Cells, disagreements, renderer, settings};
use super::{image, sum};

const GATE: Gate = Gate { lo: 6.0, hi: 9.0 };

/// The scene rotated about the origin. No plane is parallel to an axis then, and coordinates give the planes of triangles only up
/// to rounding.
fn turned(mut scene: Scene) -> Scene {
    let turn = DAffine3::from_mat3(about(DVec3::new(0.48, 0.6, 0.64), 0.7));
    scene.instances.iter_mut().for_each(|i| i.transform = turn * i.transform);
    scene.cameras.iter_mut().for_each(|c| c.transform = turn * c.transform);
    scene
}

/// The same surface with its quads split along the other diagonal, and with the opposite winding.
fn recut(mesh: &Mesh) -> Mesh {
    let pairs = mesh.triangles.chunks_exact(2);
    let triangles = pairs.flat_map(|p| [[p[0][0], p[1][2], p[0][1]], [p[0][1], p[1][2], p[1][1]]]).collect();
    Mesh { triangles, ..mesh.clone() }
}

/// Adds a copy of every surface except the lamp. `change` edits the copy, and `shift` moves it along the normal of its first
/// triangle, in metres.
fn doubled(mut scene: Scene, change: impl Fn(&Mesh) -> Mesh, shift: f64) -> Scene {
    for i in 0..scene.instances.len() {
        let Instance { mesh, transform, node } = scene.instances[i].clone();
        if node == "light" {
            continue;
        }
        let other = change(&scene.meshes[mesh as usize]);
        let at = |k: usize| DVec3::from(other.positions[other.triangles[0][k] as usize].map(f64::from));
        let normal = (at(1) - at(0)).cross(at(2) - at(0)).normalize();
        scene.meshes.push(other);
        let transform = transform * DAffine3::from_translation(shift * normal);
        scene.instances.push(Instance {
            mesh: scene.meshes.len() as u32 - 1,
            transform,
            node: format!("{node} again"),
        });
    }
    scene
}

fn render(scene: &Scene, estimator: Estimator, gate: Gate) -> Vec<f32> {
    // Few queries: with many, the candidates of a shade point are so similar that the last bit decides which one is chosen.
    let s = settings(estimator, [24, 24])
        .max_depth(6)
        .light_paths(500)
        .queries(estimator.default_queries().min(4))
        .build()
        .unwrap();
    let mut renderer = renderer(scene, &s);
    let out = image(&mut renderer, 3, gate, 2, 4);
    assert_eq!(renderer.stats().dropped, 0, "{estimator}: contributions that are not finite");
    assert!(out.iter().all(|x| x.is_finite() && *x >= 0.0));
    out
}

/// Sum of the absolute differences of `a` and `b`, relative to the sum of `a`.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(x, y)| f64::from((x - y).abs())).sum::<f64>() / sum(a)
}

#[test]
fn every_wall_twice_is_the_same_image() {
    let same: fn(&Mesh) -> Mesh = Mesh::clone;
    let changes = [
        ("the same", same, 0.0),
        ("cut and turned over", recut, 0.0),
        ("1e-8 before", same, 1e-8),
        ("1e-7 behind", same, -1e-7),
        ("1e-6 behind, turned over", recut, -1e-6),
        ("1e-5 before", same, 1e-5),
    ];
    // lcs chooses among candidates by their contribution. If two contributions are nearly equal, the last bit of a position
    // decides, so lcs is allowed a larger change.
    for (estimator, changes, moves) in [(Estimator::Bdpt, &changes[..], 2e-4), (Estimator::Lcs, &changes[..2], 2e-2)] {
        let usual = render(&turned(build(Kind::CornellBox)), estimator, GATE);
        for &(name, change, shift) in changes {
            let twice = render(&turned(doubled(build(Kind::CornellBox), change, shift)), estimator, GATE);
            let (moved, gain) = (difference(&usual, &twice), sum(&twice) / sum(&usual) - 1.0);
            println!("{estimator}, {name}: {moved:.1e} moved, {gain:+.1e} in all");
            assert!(moved < moves && gain.abs() < 2e-3, "{estimator}, {name}: {moved:e} moved, {gain:e} in all");
        }
    }
    // Negative control: the copies are a millimetre away.
    let apart = render(&turned(doubled(build(Kind::CornellBox), same, 1e-3)), Estimator::Bdpt, GATE);
    assert!(difference(&render(&turned(build(Kind::CornellBox)), Estimator::Bdpt, GATE), &apart) > 2e-4);
}

/// CAD programs export each face twice, once turned over, with a material that is not double-sided.
#[test]
fn a_face_with_a_turned_copy_is_double_sided() {
    let sides = |double_sided: bool, copies: bool| {
        let mut scene = build(Kind::CornellBox);
        scene.materials.iter_mut().filter(|m| m.emission == [0.0; 3]).for_each(|m| m.double_sided = double_sided);
        for mesh in scene.meshes.iter_mut().filter(|mesh| copies && mesh.name != "light") {
            let turned: Vec<[u32; 3]> = mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
            mesh.triangles.splice(0..0, turned);
        }
        render(&turned(scene), Estimator::Bdpt, GATE)
    };
    let wanted = sides(true, false);
    let difference = difference(&wanted, &sides(false, true));
    println!("{difference:e}");
    assert!(difference < 1e-4, "{difference:e}");
}

/// Two adjacent rooms whose walls at x = 1 coincide. The lamp is in one room, the pinhole in the other. `door`: these two
/// walls are missing.
fn two_rooms(door: bool) -> Scene {
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [0.9; 3]));
    let lamp = material(&mut scene, emitter("lamp", [100.0; 3]));
    // Faces of a cuboid come in the order -z, +z, -x, +x, -y, +y.
    for (name, x, shared) in [("near", 0.0, 3), ("far", 1.0, 2)] {
        let mut room = inside_out(cuboid(DVec3::X * x, DVec3::new(x + 1.0, 1.0, 1.0)));
        if door {
            room.triangles.drain(2 * shared..2 * shared + 2);
        }
        add(&mut scene, name, white, room);
    }
    add(&mut scene, "lamp", lamp, quad(DVec3::new(1.2, 0.9, 0.3), DVec3::X * 0.4, DVec3::Z * 0.4, [1.0; 2]));
    camera(&mut scene, DVec3::splat(0.5), DVec3::new(1.0, 0.5, 0.4), 1.8, [24, 24]);
    turned(scene)
}

/// Light that may come through a closed wall, relative to the light without the wall. Two points in the plane of a wall, one on each
/// side, see each other under cosines that are 0 up to rounding. The square of this rounding error is the most that a connection
/// between them may carry.
const MAX_LEAK: f64 = 1e-14;

#[test]
fn a_wall_that_two_rooms_share_does_not_leak() {
    for estimator in Estimator::ALL {
        let light = |door: bool| sum(&render(&two_rooms(door), estimator, Gate::OPEN));
        let (closed, open) = (light(false), light(true));
        assert!(open > 1.0 && closed <= MAX_LEAK * open, "{estimator}: {closed:e} of {open:e}");
    }
}

/// A closed room with the pinhole inside and a lamp outside, behind the wall at x = 1. Translucent decals lie in the plane of
/// this wall. `hole`: the wall is missing, and only the decals are between lamp and pinhole.
fn room_with_decals(decals: usize, hole: bool) -> Scene {
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [0.9; 3]));
    let lamp = material(&mut scene, emitter("lamp", [100.0; 3]));
    let film =
        Material { base_color: [0.9, 0.9, 0.9, 0.3], alpha_mode: AlphaMode::Blend, ..diffuse("decal", [0.9; 3]) };
    let decal = material(&mut scene, film);
    let mut room = inside_out(cuboid(DVec3::ZERO, DVec3::ONE));
    if hole {
        room.triangles.drain(6..8);
    }
    for k in 0..decals {
        let low = 0.1 + 0.02 * k as f64;
        let surface = quad(DVec3::new(1.0, low, low), DVec3::Y * 0.7, DVec3::Z * 0.7, [1.0; 2]);
        add(&mut scene, "decal", decal, surface);
    }
    add(&mut scene, "room", white, room);
    add(&mut scene, "lamp", lamp, quad(DVec3::new(1.5, 0.0, 1.0), DVec3::Y, -DVec3::Z, [1.0; 2]));
    camera(&mut scene, DVec3::splat(0.5), DVec3::new(1.0, 0.5, 0.4), 1.8, [24, 24]);
    scene
}

/// A ray that passes through decals must still hit the wall, which is at the same distance as the decals.
#[test]
fn decals_in_the_plane_of_a_wall_do_not_leak() {
    // Negative control: a room without the wall.
    let open = room_with_decals(1, true);
    let unblocked = sum(&render(&open, Estimator::Lcs, Gate::OPEN));
    assert!(unblocked > 1.0 && by_oracle(&open) > 0.0);
    for decals in [1, 3] {
        let closed = room_with_decals(decals, false);
        for (name, scene) in [("along the axes", closed.clone()), ("turned", turned(closed))] {
            for estimator in Estimator::ALL {
                let light = sum(&render(&scene, estimator, Gate::OPEN));
                assert!(
                    light <= MAX_LEAK * unblocked,
                    "{decals} decals {name}, {estimator}: {light:e} of {unblocked:e}"
                );
            }
            assert_eq!(by_oracle(&scene), 0.0, "{decals} decals {name}, by the oracle");
        }
    }
}

/// Sum over the pixels and channels of the image that the oracle renders.
fn by_oracle(scene: &Scene) -> f64 {
    let settings = path_tracer::Settings {
        resolution: [24, 24],
        spp: 8,
        max_depth: 6,
        camera: 0,
        seed: 7,
        bins: vec![(0.0, f64::INFINITY)],
        emitters: Emitters::Scene,
    };
    let film = path_tracer::render(scene, &settings);
    film.bins[0].iter().map(|pixel| pixel.mean.iter().sum::<f64>()).sum()
}

/// If the lamp is exactly in the plane of the ceiling, rounding decides which of them a ray hits. The lamp must still light the
/// room.
#[test]
fn a_lamp_in_the_plane_of_the_ceiling_shines() {
    let lit = |height: f64, estimator, seed| {
        let mut scene = build(Kind::CornellBox);
        let lamp = scene.instances.iter_mut().find(|i| i.node == "light").expect("the lamp of the box");
        lamp.transform = DAffine3::from_translation(DVec3::Y * (height - 1.99));
        let s = settings(estimator, [24, 24]).max_depth(6).light_paths(2000).build().unwrap();
        Cells::measure(&mut renderer(&turned(scene), &s), GATE, 8, 1, 8, seed)
    };
    let below = lit(1.9999, Estimator::Bdpt, 3).whole();
    let bdpt = lit(2.0, Estimator::Bdpt, 3);
    let lcs = lit(2.0, Estimator::Lcs, 300);
    println!("a tenth of a millimetre below {below:?}, in the plane {:?}, lcs {:?}", bdpt.whole(), lcs.whole());
    // The lamp reflects no light. Rays that hit the ceiling in its place reflect some, so a small gain is allowed.
    assert!((bdpt.whole().0 / below.0 - 1.0).abs() < 0.03);
    assert!(disagreements(&bdpt, &lcs).is_empty());
}

/// The scene with every triangle of the named node listed `times` times.
fn listed(mut scene: Scene, node: &str, times: usize) -> Scene {
    let instance = scene.instances.iter().find(|i| i.node == node).expect("the node is in the scene");
    let mesh = &mut scene.meshes[instance.mesh as usize];
    mesh.triangles = mesh.triangles.repeat(times);
    scene
}

/// If the scene kept duplicates of a lamp, emitter sampling would count each of them and a ray only one: `pt` and `bdpt` would
/// disagree.
#[test]
fn a_lamp_listed_twice_shines_once() {
    for estimator in Estimator::ALL {
        let [once, twice] =
            [1, 2].map(|times| render(&listed(build(Kind::CornellBox), "light", times), estimator, GATE));
        assert!(sum(&once) > 0.0 && once == twice, "{estimator}: {} {}", sum(&once), sum(&twice));
    }
}

/// Some glTF files list one primitive thousands of times.
#[test]
fn a_wall_listed_thirty_thousand_times_is_one_wall() {
    let once = render(&build(Kind::CornellBox), Estimator::Lcs, GATE);
    let often = render(&listed(build(Kind::CornellBox), "ceiling", 30_000), Estimator::Lcs, GATE);
    assert!(sum(&once) > 0.0 && once == often);
}

/// Walls that are no exact copies, but so close to each other that no BVH can separate them.
#[test]
fn a_thousand_walls_within_rounding_are_one_wall() {
    let usual = render(&turned(build(Kind::CornellBox)), Estimator::Bdpt, GATE);
    let mut scene = build(Kind::CornellBox);
    let at = scene.instances.iter().position(|i| i.node == "ceiling").expect("the box has a ceiling");
    for k in 0..1000 {
        let mut another = scene.instances[at].clone();
        another.transform.translation.y += 1e-10 * f64::from(k - 500);
        scene.instances.push(another);
    }
    let stacked = render(&turned(scene), Estimator::Bdpt, GATE);
    let (moved, gain) = (difference(&usual, &stacked), sum(&stacked) / sum(&usual) - 1.0);
    assert!(moved < 2e-4 && gain.abs() < 2e-3, "{moved:e} moved, {gain:e} in all");
}

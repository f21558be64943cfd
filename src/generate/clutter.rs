//! `cluttered-room`: shelves, a table and a floor full of instanced shapes in many materials, under one area light.

use std::f64::consts::TAU;

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::numbers::Pcg;
use super::parts::{about, add, camera, diffuse, emitter, glass, material, mesh, metal, place, plastic};
use super::shapes::{append, ball, cuboid, cylinder, quad, torus};
use crate::scene::{Mesh, Scene};

/// A horizontal rectangle on which objects stand, the number of these objects, and the range of their sizes in metres.
struct Ground {
    min: DVec3,
    max: DVec3,
    count: usize,
    size: [f64; 2],
}

/// An object whose tessellation is not known yet; its size is the radius of its bounding sphere.
struct Item {
    shape: usize,
    size: f64,
    turn: DMat3,
    at: DVec3,
}

const SHAPES: usize = 4;

/// A shape inside the unit sphere; a higher `level` gives more triangles.
fn shape(kind: usize, level: u32) -> Mesh {
    match kind {
        0 => ball(1.0, 8 * level, 4 * level),
        1 => torus(0.7, 0.3, 12 * level, 6 * level),
        2 => {
            let mut centred = Mesh::default();
            let down = DAffine3::from_translation(DVec3::new(0.0, -0.8, 0.0));
            append(&mut centred, &cylinder(0.6, 1.6, 8 * level), down);
            centred
        }
        _ => cuboid(DVec3::new(-0.65, -0.45, -0.6), DVec3::new(0.65, 0.45, 0.6)),
    }
}

pub fn build(triangles: u32) -> Scene {
    let mut scene = Scene::default();
    shell(&mut scene);
    let grounds = furniture(&mut scene);
    let mut pcg = Pcg::new(2024);
    let items: Vec<Item> = grounds.iter().flat_map(|g| scatter(g, &mut pcg)).collect();

    // Refine until there are enough triangles. The placement does not depend on the level.
    let room = super::triangle_count(&scene);
    let enough = |level: u32| {
        let each: Vec<usize> = (0..SHAPES).map(|k| shape(k, level).triangles.len()).collect();
        room + items.iter().map(|i| each[i.shape]).sum::<usize>() >= triangles as usize
    };
    let level = (2..).find(|&level| enough(level)).expect("some level has enough");

    let paints = [
        plastic("plastic yellow", [0.80, 0.55, 0.08], 0.25),
        metal("gold", [0.95, 0.70, 0.30], 0.3),
        diffuse("clay", [0.62, 0.30, 0.20]),
        glass("glass"),
        plastic("plastic blue", [0.08, 0.20, 0.60], 0.4),
        metal("steel", [0.72, 0.73, 0.75], 0.5),
        diffuse("chalk", [0.75, 0.74, 0.70]),
        metal("mirror", [0.92, 0.92, 0.92], 0.0),
        plastic("plastic green", [0.10, 0.45, 0.18], 0.15),
        diffuse("plum", [0.35, 0.12, 0.30]),
    ];
    let paints: Vec<u32> = paints.into_iter().map(|m| material(&mut scene, m)).collect();
    // One mesh per shape and material, added on first use.
    let shapes: Vec<Mesh> = (0..SHAPES).map(|k| shape(k, level)).collect();
    let mut meshes = vec![[None; SHAPES]; paints.len()];
    for (n, item) in items.iter().enumerate() {
        let paint = pcg.below(paints.len());
        let index = *meshes[paint][item.shape].get_or_insert_with(|| {
            let name = format!("{} {}", ["ball", "ring", "drum", "block"][item.shape], paint);
            mesh(&mut scene, &name, paints[paint], shapes[item.shape].clone())
        });
        let turn = item.turn * item.size;
        let low = |p: &[f32; 3]| (turn * Vec3::from_array(*p).as_dvec3()).y;
        let lowest = shapes[item.shape].positions.iter().map(low).fold(f64::INFINITY, f64::min);
        // 1 mm above the surface, so that faces never coincide.
        let at = item.at + DVec3::Y * (0.001 - lowest);
        place(&mut scene, &format!("item {n}"), index, DAffine3::from_mat3_translation(turn, at));
    }
    camera(&mut scene, DVec3::new(-2.55, 1.75, 2.15), DVec3::new(0.55, 0.7, -0.75), 0.86, [320, 180]);
    scene
}

/// Walls, floor, ceiling and the light.
fn shell(scene: &mut Scene) {
    let wall = material(scene, diffuse("wall", [0.72, 0.70, 0.66]));
    let accent = material(scene, diffuse("accent wall", [0.30, 0.42, 0.48]));
    let floor = material(scene, plastic("floor", [0.42, 0.30, 0.20], 0.45));
    let light = material(scene, emitter("light", [16.0, 14.0, 11.0]));
    let (x, y, z) = (DVec3::X * 6.0, DVec3::Y * 3.0, DVec3::Z * 5.0);
    let (low, high) = (DVec3::new(-3.0, 0.0, -2.5), DVec3::new(3.0, 3.0, 2.5));
    add(scene, "floor", floor, quad(low, z, x, [1.0, 1.0]));
    add(scene, "ceiling", wall, quad(low + y, x, z, [1.0, 1.0]));
    add(scene, "back wall", accent, quad(low, x, y, [1.0, 1.0]));
    add(scene, "front wall", wall, quad(low + x + z, -x, y, [1.0, 1.0]));
    add(scene, "left wall", wall, quad(low + z, -z, y, [1.0, 1.0]));
    add(scene, "right wall", wall, quad(high - y - z, z, y, [1.0, 1.0]));
    let corner = DVec3::new(-0.7, 2.97, -0.6);
    add(scene, "light", light, quad(corner, DVec3::X * 1.4, DVec3::Z * 1.2, [1.0, 1.0]));
}

/// Adds shelves on the back and right walls and a table. Returns the surfaces on which objects may stand.
fn furniture(scene: &mut Scene) -> Vec<Ground> {
    let oak = material(scene, plastic("oak", [0.50, 0.34, 0.18], 0.5));
    let white = material(scene, diffuse("lacquer", [0.70, 0.70, 0.70]));
    let mut grounds = vec![Ground {
        min: DVec3::new(-2.0, 0.0, -1.8),
        max: DVec3::new(2.4, 0.0, 2.2),
        count: 46,
        size: [0.10, 0.26],
    }];
    let block = |scene: &mut Scene, name: &str, material, min: [f64; 3], max: [f64; 3]| {
        add(scene, name, material, cuboid(DVec3::from_array(min), DVec3::from_array(max)));
    };
    for x in [-2.6, -1.0, 0.6, 2.2] {
        block(scene, "shelf side", oak, [x - 0.02, 0.001, -2.49], [x + 0.02, 2.25, -2.12]);
    }
    for level in 0..5 {
        let y = 0.1 + 0.52 * f64::from(level);
        block(scene, "shelf", oak, [-2.6, y - 0.03, -2.485], [2.2, y, -2.115]);
        for x in [-2.6, -1.0, 0.6] {
            let (min, max) = (DVec3::new(x + 0.13, y, -2.38), DVec3::new(x + 1.47, y, -2.22));
            grounds.push(Ground { min, max, count: 5, size: [0.08, 0.15] });
        }
    }
    for level in 0..3 {
        let y = 0.5 + 0.62 * f64::from(level);
        block(scene, "board", white, [2.62, y - 0.03, -1.8], [2.995, y, 1.6]);
        let (min, max) = (DVec3::new(2.76, y, -1.65), DVec3::new(2.84, y, 1.45));
        grounds.push(Ground { min, max, count: 9, size: [0.08, 0.15] });
    }
    block(scene, "table", oak, [-0.55, 0.70, -0.75], [1.25, 0.75, 0.25]);
    for (x, z) in [(-0.5, -0.7), (1.2, -0.7), (-0.5, 0.2), (1.2, 0.2)] {
        block(scene, "leg", oak, [x - 0.03, 0.001, z - 0.03], [x + 0.03, 0.70, z + 0.03]);
    }
    let (min, max) = (DVec3::new(-0.42, 0.75, -0.62), DVec3::new(1.12, 0.75, 0.12));
    grounds.push(Ground { min, max, count: 12, size: [0.09, 0.18] });
    grounds
}

/// Places objects on a rectangle so that their bounding circles do not overlap. If the rectangle is full, it returns fewer
/// objects than `ground.count`.
fn scatter(ground: &Ground, pcg: &mut Pcg) -> Vec<Item> {
    let mut items: Vec<Item> = Vec::new();
    for _ in 0..60 * ground.count {
        if items.len() == ground.count {
            break;
        }
        let size = pcg.range(ground.size[0], ground.size[1]);
        let at = DVec3::new(pcg.range(ground.min.x, ground.max.x), ground.min.y, pcg.range(ground.min.z, ground.max.z));
        let shape = pcg.below(SHAPES);
        let lean = if shape == 1 || pcg.uniform() < 0.35 { pcg.range(0.3, 1.4) } else { 0.0 };
        let turn = about(DVec3::Y, pcg.range(0.0, TAU)) * about(DVec3::X, lean);
        // No objects on the floor below the table.
        let under_table = ground.min.y == 0.0 && at.x > -0.9 && at.x < 1.6 && at.z > -1.1 && at.z < 0.6;
        if !under_table && items.iter().all(|o| (o.at - at).length() > o.size + size) {
            items.push(Item { shape, size, turn, at });
        }
    }
    items
}

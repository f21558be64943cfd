//! `door-ajar`: a beam shines in the far room, and only light through the gap of a door reaches the camera's room. The idea is
//! that of Veach's scene; the geometry is our own.
//!
//! Camera room: x in [-2.4, 2.4], z in [-2, 3]. Far room: z in [-5, -2.12]. The door is in the wall between them. All in metres.

use glam::{DAffine3, DVec3};

use super::paint;
use super::parts::{about, add, camera, diffuse, light, material, mesh, metal, place, plastic, texture, turned};
use super::shapes::{append, ball, cuboid, cylinder, lathe, quad, torus};
use crate::scene::{LightKind, Material, Mesh, Scene};

/// Opening angle of the door in radians.
const AJAR: f64 = 0.62;

pub fn build() -> Scene {
    let mut scene = Scene::default();
    rooms(&mut scene);
    door(&mut scene);
    table(&mut scene);
    pots(&mut scene);
    furnish(&mut scene);
    // The spot of the beam on the far room's wall is visible from the table through the gap.
    let (source, spot) = (DVec3::new(-1.7, 1.7, -4.2), DVec3::new(2.4, 1.75, -3.0));
    light(&mut scene, "beam", source, spot - source, LightKind::Beam { power: [1.0; 3], radius: 0.02 });
    camera(&mut scene, DVec3::new(0.15, 1.42, 2.75), DVec3::new(-0.12, 0.92, -1.5), 0.74, [320, 180]);
    scene
}

fn block(min: [f64; 3], max: [f64; 3]) -> Mesh {
    cuboid(DVec3::from_array(min), DVec3::from_array(max))
}

/// Adds several boxes as one mesh.
fn blocks(scene: &mut Scene, name: &str, material: u32, parts: &[([f64; 3], [f64; 3])]) {
    let mut whole = Mesh::default();
    parts.iter().for_each(|&(min, max)| append(&mut whole, &block(min, max), DAffine3::IDENTITY));
    add(scene, name, material, whole);
}

fn rooms(scene: &mut Scene) {
    let tiles = texture(scene, paint::tiles(128, [214, 204, 186], [132, 96, 78]));
    let floor = plastic("floor tiles", [1.0; 3], 0.35);
    let floor = material(scene, Material { base_color_texture: Some(tiles), ..floor });
    let wall = material(scene, diffuse("wall", [0.74, 0.70, 0.62]));
    let far = material(scene, diffuse("far wall", [0.82, 0.78, 0.70]));
    let ceiling = material(scene, diffuse("ceiling", [0.80, 0.80, 0.78]));
    let paint = material(scene, plastic("white paint", [0.78, 0.77, 0.74], 0.4));

    let (x, y, z) = (DVec3::X * 4.8, DVec3::Y * 2.7, DVec3::Z * 8.0);
    let low = DVec3::new(-2.4, 0.0, -5.0);
    // Tiles of 60 cm: one image covers two by two of them.
    add(scene, "floor", floor, quad(low, z, x, [8.0 / 1.2, 4.0]));
    add(scene, "ceiling", ceiling, quad(low + y, x, z, [1.0, 1.0]));
    add(scene, "left wall", wall, quad(low + z, -z, y, [1.0, 1.0]));
    add(scene, "right wall", wall, quad(low + x, z, y, [1.0, 1.0]));
    add(scene, "front wall", wall, quad(low + x + z, -x, y, [1.0, 1.0]));
    add(scene, "far wall", far, quad(low, x, y, [1.0, 1.0]));
    let parts = [
        ([-2.4, 0.0, -2.12], [0.55, 2.7, -2.0]),
        ([1.45, 0.0, -2.12], [2.4, 2.7, -2.0]),
        ([0.55, 2.1, -2.12], [1.45, 2.7, -2.0]),
    ];
    blocks(scene, "wall with door", wall, &parts);
    let trim = [
        ([0.45, 0.0, -2.14], [0.57, 2.12, -1.97]),
        ([1.43, 0.0, -2.14], [1.55, 2.12, -1.97]),
        ([0.45, 2.08, -2.14], [1.55, 2.2, -1.97]),
        ([-2.4, 0.0, -2.0], [0.45, 0.1, -1.98]),
        ([1.55, 0.0, -2.0], [2.4, 0.1, -1.98]),
        ([-2.4, 0.0, -1.98], [-2.38, 0.1, 3.0]),
        ([2.38, 0.0, -1.98], [2.4, 0.1, 3.0]),
    ];
    blocks(scene, "frame and skirting", paint, &trim);
}

/// The door, hinged on the right, opens towards the camera. In its own space the hinge is at the origin and the door extends
/// along -x.
fn door(scene: &mut Scene) {
    let paint = material(scene, plastic("door paint", [0.36, 0.47, 0.45], 0.3));
    let brass = material(scene, metal("brass", [0.88, 0.68, 0.36], 0.3));
    let at = turned(DVec3::new(1.425, 0.0, -1.965), AJAR);
    let mut leaf = block([-0.85, 0.012, 0.0], [0.0, 2.07, 0.04]);
    for (y0, y1) in [(0.18, 0.92), (1.10, 1.92)] {
        for (x0, x1) in [(-0.76, -0.46), (-0.39, -0.09)] {
            append(&mut leaf, &block([x0, y0, -0.012], [x1, y1, 0.052]), DAffine3::IDENTITY);
            append(&mut leaf, &block([x0 + 0.05, y0 + 0.05, -0.02], [x1 - 0.05, y1 - 0.05, 0.06]), DAffine3::IDENTITY);
        }
    }
    let leaf = mesh(scene, "door", paint, leaf);
    place(scene, "door", leaf, at);
    let mut knob = Mesh::default();
    let forwards = DAffine3::from_mat3(about(DVec3::X, std::f64::consts::FRAC_PI_2));
    append(&mut knob, &cylinder(0.012, 0.16, 16), DAffine3::from_translation(DVec3::Z * -0.06) * forwards);
    for z in [-0.07, 0.11] {
        append(&mut knob, &ball(0.028, 24, 12), DAffine3::from_translation(DVec3::Z * z));
    }
    let knob = mesh(scene, "knob", brass, knob);
    place(scene, "knob", knob, at * DAffine3::from_translation(DVec3::new(-0.79, 1.02, 0.0)));
}

fn table(scene: &mut Scene) {
    let grain = texture(scene, paint::wood(128, [168, 112, 66]));
    let wood = plastic("table wood", [1.0; 3], 0.3);
    let wood = material(scene, Material { base_color_texture: Some(grain), ..wood });
    let mut parts = vec![([-1.75, 0.70, -0.75], [0.15, 0.74, 0.2]), ([-1.65, 0.60, -0.65], [0.05, 0.70, 0.1])];
    for (x, z) in [(-1.65, -0.65), (-0.01, -0.65), (-1.65, 0.04), (-0.01, 0.04)] {
        parts.push(([x, 0.0, z], [x + 0.06, 0.60, z + 0.06]));
    }
    blocks(scene, "table", wood, &parts);
}

/// A metal teapot, a glazed vase and a clay bowl of oranges on the table.
fn pots(scene: &mut Scene) {
    let silver = material(scene, metal("silver", [0.90, 0.88, 0.85], 0.32));
    let glaze = material(scene, plastic("glaze", [0.05, 0.22, 0.36], 0.18));
    let clay = material(scene, diffuse("clay", [0.66, 0.36, 0.22]));
    let orange = material(scene, plastic("orange", [0.85, 0.36, 0.04], 0.45));

    let mut pot = lathe(&smooth(&TEAPOT, 3), 48);
    let spout = [[0.034, 0.0], [0.026, 0.05], [0.018, 0.11], [0.015, 0.16]];
    let lean = DAffine3::from_mat3_translation(about(DVec3::Z, -0.75), DVec3::new(0.095, 0.06, 0.0));
    append(&mut pot, &lathe(&smooth(&spout, 3), 24), lean);
    let handle =
        DAffine3::from_mat3_translation(about(DVec3::X, std::f64::consts::FRAC_PI_2), DVec3::new(-0.135, 0.105, 0.0));
    append(&mut pot, &torus(0.062, 0.011, 32, 12), handle);
    let pot = mesh(scene, "teapot", silver, pot);
    place(scene, "teapot", pot, turned(DVec3::new(-0.72, 0.7405, -0.18), 0.35));

    let vase = mesh(scene, "vase", glaze, lathe(&smooth(&VASE, 3), 48));
    place(scene, "vase", vase, DAffine3::from_translation(DVec3::new(-1.36, 0.7405, -0.34)));

    let bowl = mesh(scene, "bowl", clay, lathe(&smooth(&BOWL, 3), 48));
    place(scene, "bowl", bowl, DAffine3::from_translation(DVec3::new(-0.2, 0.7405, -0.3)));
    let fruit = mesh(scene, "orange", orange, ball(0.043, 32, 16));
    for (n, (x, y, z)) in
        [(-0.045, 0.07, 0.02), (0.048, 0.072, 0.012), (0.0, 0.071, -0.06), (0.0, 0.13, -0.008)].into_iter().enumerate()
    {
        place(
            scene,
            &format!("orange {n}"),
            fruit,
            DAffine3::from_translation(DVec3::new(x - 0.2, y + 0.7405, z - 0.3)),
        );
    }
}

/// A framed landscape, a rug, a stool with a ball on it, and books on a wall shelf.
fn furnish(scene: &mut Scene) {
    let view = texture(scene, paint::landscape(192, 128));
    let canvas = Material { base_color_texture: Some(view), ..diffuse("canvas", [1.0; 3]) };
    let canvas = material(scene, canvas);
    let gilt = material(scene, metal("gilt", [0.83, 0.64, 0.32], 0.4));
    let (width, height) = (DVec3::X * 1.05, DVec3::Y * 0.7);
    let corner = DVec3::new(-1.5, 1.3, -1.975);
    add(scene, "picture", canvas, quad(corner, width, height, [1.0, 1.0]));
    let bars = [
        ([-1.56, 1.24, -2.0], [-1.5, 2.06, -1.95]),
        ([-0.45, 1.24, -2.0], [-0.39, 2.06, -1.95]),
        ([-1.5, 1.24, -2.0], [-0.45, 1.3, -1.95]),
        ([-1.5, 2.0, -2.0], [-0.45, 2.06, -1.95]),
    ];
    blocks(scene, "picture frame", gilt, &bars);

    let wool = material(scene, diffuse("wool", [0.42, 0.10, 0.10]));
    add(scene, "rug", wool, block([-1.9, 0.0, -1.2], [0.5, 0.012, 0.7]));

    let lacquer = material(scene, plastic("lacquer", [0.10, 0.10, 0.11], 0.25));
    let mut stool = cylinder(0.19, 0.04, 48);
    stool.positions.iter_mut().for_each(|p| p[1] += 0.46);
    for turn in 0..3 {
        let angle = f64::from(turn) * std::f64::consts::TAU / 3.0 + 0.4;
        let foot = DAffine3::from_mat3(about(DVec3::Y, angle))
            * DAffine3::from_mat3_translation(about(DVec3::X, -0.14), DVec3::new(0.0, 0.002, 0.17));
        append(&mut stool, &cylinder(0.014, 0.465, 16), foot);
    }
    let stool = mesh(scene, "stool", lacquer, stool);
    place(scene, "stool", stool, DAffine3::from_translation(DVec3::new(1.45, 0.0, -0.1)));
    let mirror = material(scene, metal("chrome", [0.86, 0.87, 0.88], 0.1));
    let globe = mesh(scene, "globe", mirror, ball(0.13, 48, 24));
    place(scene, "globe", globe, DAffine3::from_translation(DVec3::new(1.45, 0.631, -0.1)));

    let board = material(scene, diffuse("board", [0.46, 0.30, 0.18]));
    add(scene, "board", board, block([2.12, 1.30, -1.5], [2.4, 1.33, -0.2]));
    let spines = [[0.50, 0.13, 0.10], [0.12, 0.24, 0.40], [0.66, 0.54, 0.26], [0.16, 0.34, 0.20]];
    let spines = spines.map(|rgb| material(scene, plastic("book", rgb, 0.5)));
    let mut z = -1.42;
    for book in 0..14 {
        let (thick, tall) = (0.028 + 0.009 * f64::from(book * 7 % 5), 0.19 + 0.012 * f64::from(book * 5 % 7));
        let shape = block([2.16, 1.331, z], [2.36, 1.331 + tall, z + thick]);
        add(scene, &format!("book {book}"), spines[(book * 3 % 4) as usize], shape);
        z += thick + 0.002;
    }
}

/// Profiles for [`lathe`]: (radius, y) in metres; a point given twice is a crease.
const TEAPOT: [[f64; 2]; 14] = [
    [0.0, 0.0],
    [0.07, 0.0],
    [0.07, 0.0],
    [0.105, 0.04],
    [0.122, 0.09],
    [0.112, 0.14],
    [0.078, 0.172],
    [0.078, 0.172],
    [0.07, 0.186],
    [0.02, 0.2],
    [0.012, 0.206],
    [0.021, 0.222],
    [0.012, 0.236],
    [0.0, 0.24],
];
const VASE: [[f64; 2]; 11] = [
    [0.0, 0.0],
    [0.075, 0.0],
    [0.075, 0.0],
    [0.125, 0.09],
    [0.14, 0.19],
    [0.11, 0.30],
    [0.055, 0.38],
    [0.045, 0.43],
    [0.075, 0.48],
    [0.065, 0.48],
    [0.0, 0.30],
];
const BOWL: [[f64; 2]; 9] = [
    [0.0, 0.0],
    [0.06, 0.0],
    [0.06, 0.0],
    [0.125, 0.045],
    [0.155, 0.105],
    [0.147, 0.105],
    [0.118, 0.05],
    [0.06, 0.025],
    [0.0, 0.02],
];

/// Catmull-Rom spline through a profile, with `steps` points per segment. It keeps creases.
fn smooth(profile: &[[f64; 2]], steps: u32) -> Vec<[f64; 2]> {
    let last = profile.len() - 1;
    let mut fine = vec![profile[0]];
    for i in 0..last {
        let (b, c) = (profile[i], profile[i + 1]);
        if b == c {
            fine.push(b);
            continue;
        }
        // Beyond an end or a crease the control points continue in a straight line.
        let beyond = |p: [f64; 2], q: [f64; 2]| [2.0 * p[0] - q[0], 2.0 * p[1] - q[1]];
        let a = if i > 0 && profile[i - 1] != b { profile[i - 1] } else { beyond(b, c) };
        let d = if i + 2 <= last && profile[i + 2] != c { profile[i + 2] } else { beyond(c, b) };
        for step in 1..=steps {
            let t = f64::from(step) / f64::from(steps);
            let at = |k: usize| {
                let (a, b, c, d) = (a[k], b[k], c[k], d[k]);
                b + t * 0.5 * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
            };
            fine.push(if step == steps { c } else { [at(0).max(0.0005), at(1)] });
        }
    }
    fine
}

//! `windscreen`: the street, seen through the windscreen of a car. Camera and lamp are behind it.

use glam::DVec3;

use super::parts::{add, camera, glass, light, material};
use super::{numbers::sin_cos, street};
use crate::scene::{LightKind, Mesh, Scene};

/// Thickness of the glass, radius of its curve from left to right, and height along the glass, in metres.
const THICKNESS: f64 = 0.005;
const RADIUS: f64 = 3.0;
const HEIGHT: f64 = 0.9;
/// Half of the width as an angle, and the angle between the glass and the vertical, in radians.
const HALF_ANGLE: f64 = 0.25;
const RAKE: f64 = 1.0;
/// Facets from left to right, and from bottom to top.
const FACETS: [u32; 2] = [46, 16];

pub fn build() -> Scene {
    let mut scene = street::build();
    (scene.cameras, scene.lights) = (vec![], vec![]);
    let pane = material(&mut scene, glass("windscreen"));
    add(&mut scene, "windscreen", pane, windscreen(DVec3::new(0.0, 1.38, -0.6)));
    camera(&mut scene, DVec3::new(0.0, 1.4, 0.0), DVec3::new(0.0, 1.2, -30.0), 0.4, [320, 180]);
    let lamp = LightKind::Spot { intensity: [400.0; 3], inner: 0.3, outer: 0.5 };
    light(&mut scene, "lamp", DVec3::new(0.15, 1.35, 0.0), DVec3::NEG_Z, lamp);
    scene
}

/// A closed mesh of two curved faces with smooth normals, and a rim, around `centre`.
fn windscreen(centre: DVec3) -> Mesh {
    let [across, up] = FACETS;
    let [sine_rake, cosine_rake] = pair(RAKE);
    let angle = |column: u32| pair(HALF_ANGLE * (2.0 * f64::from(column) / f64::from(across) - 1.0));
    // Face 1 is the outer one, towards -z.
    let corner = |face: u32, [column, row]: [u32; 2]| {
        let [sine, cosine] = angle(column);
        let height = HEIGHT * (f64::from(row) / f64::from(up) - 0.5);
        let radius = RADIUS + THICKNESS / cosine_rake * f64::from(face);
        let bulge = radius * cosine - RADIUS;
        centre + DVec3::new(radius * sine, height * cosine_rake, height * sine_rake - bulge)
    };
    let mut mesh = Mesh::default();
    let mut patch = |corners: [DVec3; 4], normals: [DVec3; 4]| {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(corners.map(|p| p.as_vec3().to_array()));
        mesh.normals.extend(normals.map(|n| n.normalize().as_vec3().to_array()));
        mesh.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|k| first + k)));
    };
    for (row, column) in (0..up).flat_map(|row| (0..across).map(move |column| (row, column))) {
        let ring = [[column, row], [column + 1, row], [column + 1, row + 1], [column, row + 1]];
        let inwards = ring.map(|[column, _]| {
            let [sine, cosine] = angle(column);
            DVec3::new(-sine * cosine_rake, -cosine * sine_rake, cosine * cosine_rake)
        });
        patch(ring.map(|place| corner(0, place)), inwards);
        let [a, b, c, d] = ring.map(|place| corner(1, place));
        let [na, nb, nc, nd] = inwards.map(|normal| -normal);
        patch([d, c, b, a], [nd, nc, nb, na]);
    }
    let mut rim = |from: [u32; 2], to: [u32; 2]| {
        let corners = [corner(0, from), corner(1, from), corner(1, to), corner(0, to)];
        patch(corners, [(corners[1] - corners[0]).cross(corners[3] - corners[0]); 4]);
    };
    for column in 0..across {
        rim([column, 0], [column + 1, 0]);
        rim([column + 1, up], [column, up]);
    }
    for row in 0..up {
        rim([0, row + 1], [0, row]);
        rim([across, row], [across, row + 1]);
    }
    mesh
}

/// Sine and cosine.
fn pair(angle: f64) -> [f64; 2] {
    let (sine, cosine) = sin_cos(angle);
    [sine, cosine]
}

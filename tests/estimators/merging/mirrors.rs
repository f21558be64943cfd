//! A wall that is lit and seen over the same mirror. Closed forms.

use std::f64::consts::PI;

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, light, material, metal};
use taugate::internals::generate::shapes::quad;
use taugate::internals::scene::{Image, LightKind, Material, Mesh, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::{ALBEDO, INTENSITY, SIDE, finds};

/// Reflectance of the mirror, and the gate around the light of the wall that it shows.
const REFLECTANCE: f64 = 0.9;
const GATE: Gate = Gate { lo: 5.99, hi: 6.01 };
/// Radiance of the wall in the middle of the view, without the mirror's reflectance. The lamp is 3 m away along the light's path.
const BARE: f64 = ALBEDO / PI * INTENSITY / 9.0;
const POINT: LightKind = LightKind::Point { intensity: [INTENSITY as f32; 3] };

fn silver() -> Material {
    metal("mirror", [REFLECTANCE as f32; 3], 0.0)
}

/// Lamp and camera see a wall in a mirror at 45 degrees: the unfolded way has a length of 1 m and 2 m.
fn scene(lamp: LightKind, view: f64, mirror: impl Fn(&mut Scene) -> Material) -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("wall", [ALBEDO as f32; 3]));
    add(&mut scene, "wall", grey, quad(DVec3::new(2.0, -4.0, -5.0), 8.0 * DVec3::Z, 8.0 * DVec3::Y, [1.0; 2]));
    let mirror = mirror(&mut scene);
    let mirror = material(&mut scene, mirror);
    let along = DVec3::new(1.0, 0.0, -1.0).normalize();
    let centre = DVec3::new(0.0, 0.0, -1.0);
    let mirror_at = centre - 0.5 * along - 0.5 * DVec3::Y;
    add(&mut scene, "mirror", mirror, quad(mirror_at, along, DVec3::Y, [1.0; 2]));
    light(&mut scene, "lamp", DVec3::ZERO, DVec3::NEG_Z, lamp);
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, view, [SIDE, SIDE]);
    scene
}

#[test]
fn a_wall_is_seen_in_the_mirror_that_lights_it() {
    let in_a_mirror = |lamp: LightKind, bare: f64, view: f64| {
        let truth = REFLECTANCE * REFLECTANCE * bare;
        finds("mirror", &scene(lamp, view, |_| silver()), Estimator::Lcs, GATE, truth);
    };
    in_a_mirror(POINT, BARE, 1e-3);
    let spot = LightKind::Spot { intensity: [INTENSITY as f32; 3], inner: 0.1, outer: 0.2 };
    in_a_mirror(spot, BARE, 1e-3);
    // A beam with the spot of a radius of 0.1 m, in a view that sees nothing else.
    let area = PI * 0.1 * 0.1;
    in_a_mirror(LightKind::Beam { power: [INTENSITY as f32; 3], radius: 0.1 }, ALBEDO / PI * INTENSITY / area, 0.02);
}

/// Adds a texture with one row of these roughnesses. Metalness and coats are 1.
fn roughness(scene: &mut Scene, bytes: &[u8]) -> Option<u32> {
    let rgba = bytes.iter().map(|&byte| [255, byte, 255, 255]).collect();
    Some(scene.add_texture(Image { width: bytes.len() as u32, height: 1, rgba }))
}

/// A texture may make the mirror, or the clear coat of a black surface, smooth everywhere or in a strip in the middle.
#[test]
fn a_mirror_whose_roughness_is_a_texture_shows_the_wall_that_it_lights() {
    let mirror = REFLECTANCE * REFLECTANCE * BARE;
    for bytes in [&[0, 0][..], &[128, 0, 0, 128]] {
        let textured =
            |scene: &mut Scene| Material { roughness: 1.0, surface_texture: roughness(scene, bytes), ..silver() };
        finds(&format!("mirror {bytes:?}"), &scene(POINT, 1e-3, textured), Estimator::Bdpt, GATE, mirror);
        // Schlick's formula at 45 degrees.
        let coat = 0.04 + 0.96 * (1.0 - 0.5f64.sqrt()).powi(5);
        let coated = |scene: &mut Scene| Material {
            clearcoat: 1.0,
            clearcoat_roughness: 1.0,
            clearcoat_roughness_texture: roughness(scene, bytes),
            ..diffuse("coat", [0.0; 3])
        };
        finds(&format!("coat {bytes:?}"), &scene(POINT, 1e-3, coated), Estimator::Bdpt, GATE, coat * coat * BARE);
    }
}

/// Divides a quad into 2 `count`^2 triangles.
fn grid(corner: DVec3, u: DVec3, v: DVec3, count: u32) -> Mesh {
    let at = |k: u32| f64::from(k) / f64::from(count);
    let place = |row: u32, column: u32| (corner + at(column) * u + at(row) * v).as_vec3().to_array();
    let corners = (0..=count).flat_map(|row| (0..=count).map(move |column| (row, column)));
    let number = |row: u32, column: u32| row * (count + 1) + column;
    let cells = (0..count).flat_map(|row| (0..count).map(move |column| (row, column)));
    let triangles = cells.flat_map(|(row, column)| {
        let [a, b] = [number(row, column), number(row + 1, column + 1)];
        [[a, number(row, column + 1), b], [a, b, number(row + 1, column)]]
    });
    Mesh {
        positions: corners.map(|(row, column)| place(row, column)).collect(),
        triangles: triangles.collect(),
        ..Mesh::default()
    }
}

/// Twelve lamps at one place and 180,000 triangles: too many pairs to aim at each. The light is that of one lamp and two triangles, with
/// about as much noise.
#[test]
fn a_mirror_of_many_triangles_and_many_lamps_shows_the_same() {
    let mut scene = scene(POINT, 1e-3, |_| silver());
    let mirror = scene.meshes.iter_mut().find(|mesh| mesh.name == "mirror").unwrap();
    let [a, b, c] = [0, 1, 2].map(|k| DVec3::from(mirror.positions[k].map(f64::from)));
    *mirror = Mesh { name: "mirror".into(), material: mirror.material, ..grid(a, b - a, c - b, 300) };
    let lamps = 12;
    scene.lights.clear();
    let kind = LightKind::Point { intensity: [(INTENSITY / f64::from(lamps)) as f32; 3] };
    (0..lamps).for_each(|k| light(&mut scene, &format!("lamp {k}"), DVec3::ZERO, DVec3::NEG_Z, kind));
    finds("many triangles", &scene, Estimator::Bdpt, GATE, REFLECTANCE * REFLECTANCE * BARE);
}

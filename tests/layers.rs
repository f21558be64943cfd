//! Auxiliary layers: the first surface that each pixel shows, and the first arrival of light. Needs a device.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use taugate::internals::generate::{Kind, build, zoo};
use taugate::internals::gpu::Device;
use taugate::internals::image::layers::{Layers, Plane};
use taugate::internals::render::{FirstSurface, PreparedScene, first_arrivals, first_surfaces, layers, object_ids};
use taugate::internals::scene::{AlphaMode, Camera, LightKind, Material, Mesh, Projection, Scene};
use taugate::internals::settings::aov::Aov;
use taugate::internals::settings::{Crop, Settings};
use taugate_oracle::geometry::{Geometry, Ray, Surface};
use taugate_oracle::texture;

fn device() -> Device {
    Device::open(None).unwrap_or_else(|e| panic!("this test needs a Vulkan device: {e}"))
}

fn settings(resolution: [u32; 2]) -> Settings {
    Settings::builder().resolution(resolution).build().unwrap()
}

/// The first surface of each pixel of the crop, row by row.
fn surfaces(scene: &Scene, settings: &Settings) -> Vec<Option<FirstSurface>> {
    let prepared = PreparedScene::new(scene, settings).unwrap();
    let mut found = vec![None; (settings.crop().width() * settings.crop().height()) as usize];
    first_surfaces(&device(), scene, settings, &prepared, &mut |pixel, surface| found[pixel] = Some(surface)).unwrap();
    found
}

/// Base colour and alpha in f64.
fn base(scene: &Scene, surface: &Surface) -> [f64; 4] {
    let material = &scene.materials[surface.material as usize];
    let texel = texture::sample(scene, material.base_color_texture, surface.uv);
    [0, 1, 2, 3].map(|k| texel[k] * f64::from(material.base_color[k]))
}

/// The first surface along a ray, and its distance, by the oracle. Surfaces whose alpha is below the cutoff (0.5 for blending) are passed.
fn expected(scene: &Scene, geometry: &Geometry, ray: &Ray) -> Option<(f64, Surface)> {
    let mut passed = vec![];
    loop {
        let hit = geometry.closest_but(ray, &passed)?;
        let surface = geometry.surface(&hit);
        let alpha = base(scene, &surface)[3];
        let is_there = match scene.materials[surface.material as usize].alpha_mode {
            AlphaMode::Opaque => true,
            AlphaMode::Mask(cutoff) => alpha >= f64::from(cutoff),
            AlphaMode::Blend => alpha >= 0.5,
        };
        if is_there {
            return Some((hit.t, surface));
        }
        passed.push(hit.triangle);
    }
}

/// The zoo has alpha, textures, smooth normals, mirrored instances and glass. At an edge, f32 and f64 may see different surfaces.
/// A wall of the zoo crosses the sensor plane of the orthographic camera.
#[test]
fn first_surfaces_are_those_of_the_oracle() {
    let resolution = [96, 72];
    let pinhole = build(Kind::CornellBox).cameras[0].projection.clone();
    let kinds = [Kind::Zoo(zoo::Light::Punctual), Kind::CornellBox];
    for (kind, projection) in
        kinds.map(|k| [pinhole.clone(), Projection::Orthographic { height: 1.7 }].map(|p| (k, p))).concat()
    {
        let mut scene = build(kind);
        scene.cameras[0].principal_point = [0.6, 0.47];
        scene.cameras[0].projection = projection.clone();
        let geometry = Geometry::new(&scene);
        let camera = &scene.cameras[0];
        let found = surfaces(&scene, &settings(resolution));
        let mut different = vec![];
        for (pixel, found) in found.iter().enumerate() {
            let [x, y] = [pixel % 96, pixel / 96].map(|i| i as f64 + 0.5);
            let ray = Ray::new(camera.origin(resolution, [x, y]), camera.direction(resolution, [x, y]));
            let agree = match (found, expected(&scene, &geometry, &ray)) {
                (Some(found), Some((distance, surface))) => {
                    let front = surface.geometric.dot(ray.direction) <= 0.0;
                    let normal = if front { surface.shading } else { -surface.shading };
                    let material = &scene.materials[surface.material as usize];
                    let black = !front && !material.double_sided && material.transmission == 0.0;
                    let albedo = base(&scene, &surface).map(|c| if black { 0.0 } else { c });
                    let close = |a: f32, b: f64| (f64::from(a) - b).abs() < 2e-3;
                    found.instance == surface.instance
                        && (f64::from(found.distance) - distance).abs() < 1e-5 * distance.max(0.1)
                        && Vec3::from(found.normal).as_dvec3().dot(normal) > 1.0 - 1e-6
                        && (0..3).all(|k| close(found.albedo[k], albedo[k]))
                }
                (None, None) => true,
                _ => false,
            };
            if !agree {
                different.push((x, y));
            }
        }
        assert!(
            different.len() <= 5,
            "{} {projection:?}: {} pixels differ: {different:?}",
            kind.name(),
            different.len()
        );
    }
}

/// A wall behind two panes. A pane with alpha below 0.5 does not count as a surface; a pane with alpha 0.5 does.
#[test]
fn a_pane_counts_from_half_coverage_on() {
    let mut scene = Scene::default();
    for (node, z, alpha) in [("thin", -1.0f32, 0.4), ("half", -2.0, 0.5), ("wall", -3.0, 1.0)] {
        let base_color = [0.8, 0.8, 0.8, alpha];
        let material = scene.add_material(Material {
            alpha_mode: AlphaMode::Blend,
            base_color,
            ..Material::diffuse(node, [0.8; 3])
        });
        let corners = [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]];
        let mesh = Mesh::flat(node, corners.map(|[x, y]| [x, y, z]).into(), vec![[0, 1, 2], [0, 2, 3]]);
        scene.add_surface(mesh, material);
    }
    scene.add_camera(Camera::looking_at("camera", DVec3::ZERO, DVec3::NEG_Z, 1.0, [8, 8]));
    scene.add_light("lamp", DVec3::ZERO, DVec3::X, LightKind::Point { intensity: [1.0; 3] });
    let found = surfaces(&scene, &settings([9, 9]))[40].expect("a surface");
    assert_eq!((scene.instances[found.instance as usize].node.as_str(), found.distance), ("half", 2.0));
    assert_eq!(found.normal, [0.0, 0.0, 1.0]);
}

/// The pinhole is in the centre of a sphere of 1 m, and so is the lamp: every ray is 1 m long, and light arrives after 2 m.
#[test]
fn a_sphere_has_one_distance_and_one_arrival() {
    let mut scene = build(Kind::GatedSphere { radius: 1.0, subdivisions: 5, albedo: 0.5 });
    let settings = settings([24, 24]);
    let found = surfaces(&scene, &settings);
    for surface in &found {
        let surface = surface.expect("the sphere is closed");
        // The facets are flat, so their distances and normals differ a little from those of the sphere.
        assert!((surface.distance - 1.0).abs() < 1e-3 && surface.albedo == [0.5; 3], "{surface:?}");
        assert!((Vec3::from(surface.normal).length() - 1.0).abs() < 1e-6);
    }
    let centre = found[24 * 12 + 12].unwrap().normal;
    assert!(Vec3::from(centre).dot(Vec3::Z) > 0.99, "{centre:?} faces the camera, which looks along -Z");
    let prepared = PreparedScene::new(&scene, &settings).unwrap();
    let arrivals = first_arrivals(&device(), &scene, &settings, &prepared).unwrap();
    for (tau, surface) in arrivals.iter().zip(&found) {
        let exact = 2.0 * surface.unwrap().distance;
        assert!((tau - exact).abs() < 2e-3, "{tau} m, the pixel's centre has {exact} m");
    }
    // A lamp outside of the closed sphere lights nothing.
    scene.lights[0].position = DVec3::X * 3.0;
    let prepared = PreparedScene::new(&scene, &settings).unwrap();
    let dark = first_arrivals(&device(), &scene, &settings, &prepared).unwrap();
    assert!(dark.iter().all(|&tau| tau == 0.0));
}

#[test]
fn a_crop_has_the_layers_of_the_whole_image() {
    let scene = build(Kind::CornellBox);
    let whole = settings([20, 16]);
    let crop = Crop { x0: 3, x1: 17, y0: 5, y1: 12 };
    let part = whole.change().crop(crop).build().unwrap();
    let surfaces_only = Aov { arrival: false, ..Aov::ALL };
    let of = |settings: &Settings| -> Layers {
        let prepared = PreparedScene::new(&scene, settings).unwrap();
        layers(&device(), &scene, settings, &prepared, surfaces_only).unwrap()
    };
    let (whole, part) = (of(&whole), of(&part));
    let names = ["depth.Z", "normal.X", "normal.Y", "normal.Z", "albedo.R", "albedo.G", "albedo.B", "object.ID"];
    assert_eq!(part.channels.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), names);
    fn cut<T: Copy>(values: &[T], crop: Crop) -> Vec<T> {
        let row = |y: u32| &values[(y * 20 + crop.x0) as usize..(y * 20 + crop.x1) as usize];
        (crop.y0..crop.y1).flat_map(row).copied().collect()
    }
    for ((name, whole), (_, part)) in whole.channels.iter().zip(&part.channels) {
        let expected = match whole {
            Plane::Floats(values) => Plane::Floats(cut(values, crop)),
            Plane::Ids(ids) => Plane::Ids(cut(ids, crop)),
        };
        assert_eq!(*part, expected, "{name}");
    }
    assert!(part.objects.iter().all(|(id, node)| whole.objects[id] == *node) && part.objects.len() >= 3);
}

#[test]
fn nodes_are_numbered_from_1_and_one_name_has_one_number() {
    let mut scene = build(Kind::CornellBox);
    let twice = scene.instances[0].clone();
    scene.instances.push(twice);
    let ids = object_ids(&scene);
    let names: BTreeMap<u32, &str> = ids.iter().copied().zip(scene.instances.iter().map(|i| i.node.as_str())).collect();
    assert_eq!((ids[0], ids.last()), (1, Some(&1)));
    assert_eq!(names.keys().copied().collect::<Vec<_>>(), (1..=names.len() as u32).collect::<Vec<_>>());
}

//! Each property of a material switches on the features of the kernels that evaluate it, and no others.

use glam::{DAffine2, DVec2, DVec3};

use super::*;
use crate::generate::shapes::quad;
use crate::scene::{Image, Material, Retroreflector};

/// The features of a scene with one surface of the material that `change` makes from a white Lambertian one. It gets the index of a
/// texture. `color` is the colour of all vertices.
fn features(
    change: impl Fn(Material, u32) -> Material,
    color: Option<[f32; 4]>,
    transform: DAffine2,
) -> Vec<&'static str> {
    let mut scene = Scene::default();
    let texture = scene.add_texture(Image { width: 1, height: 1, rgba: vec![[200; 4]] });
    scene.textures[texture as usize].transform = transform;
    let material = scene.add_material(change(Material::diffuse("material", [1.0; 3]), texture));
    let mut mesh = quad(DVec3::ZERO, DVec3::X, DVec3::Y, [1.0; 2]);
    mesh.add_tangents().unwrap();
    mesh.colors = color.map_or(vec![], |color| vec![color; mesh.positions.len()]);
    scene.add_surface(mesh, material);
    let (emitters, albedo) = (Emitters::Scene, AlbedoTable::new());
    let mut set = MaterialSet::new(&scene, &emitters, &albedo, 1.0);
    set.number(&scene.instances[0]);
    set.features.constants().into_iter().filter(|(_, on)| *on == 1.0).map(|(name, _)| name).collect()
}

/// As [`features`], without vertex colours and transforms.
fn of(change: impl Fn(Material, u32) -> Material) -> Vec<&'static str> {
    features(change, None, DAffine2::IDENTITY)
}

#[test]
fn a_lambertian_surface_needs_nothing() {
    assert!(of(|m, _| m).is_empty());
}

#[test]
fn lobes_and_transparency_switch_on_their_features() {
    assert_eq!(of(|m, _| Material { metallic: 0.5, ..m }), ["HAS_GLOSSY"]);
    assert_eq!(of(|m, _| Material { specular: 0.5, ..m }), ["HAS_GLOSSY"]);
    let coloured = |m| Material { specular: 0.5, specular_color: [0.5, 1.0, 1.0], ..m };
    assert_eq!(of(|m, _| coloured(m)), ["HAS_GLOSSY", "HAS_SPECULAR_COLORS"]);
    assert_eq!(of(|m, _| Material { clearcoat: 0.1, ..m }), ["HAS_GLOSSY", "HAS_CLEARCOAT"]);
    let retroreflector = Some(Retroreflector { share: 0.5, angle: 1.0 });
    assert_eq!(of(|m, _| Material { retroreflector, ..m }), ["HAS_GLOSSY", "HAS_RETROREFLECTORS"]);
    let solid = Material { thin: Some(false), ..Material::glass("glass") };
    assert_eq!(of(|_, _| solid.clone()), ["HAS_GLOSSY", "HAS_TRANSMISSION"]);
    // One plane bounds no solid.
    assert_eq!(
        of(|_, _| Material::glass("glass")),
        ["HAS_GLOSSY", "HAS_TRANSMISSION", "HAS_SHEETS", "SPLITS_AT_SHEETS"]
    );
    let rough = Material { roughness: 0.5, ..Material::glass("glass") };
    assert_eq!(of(|_, _| rough.clone()), ["HAS_GLOSSY", "HAS_TRANSMISSION", "HAS_SHEETS"]);
    let thick = Material { thickness: 0.01, ..Material::glass("glass") };
    assert_eq!(
        of(|_, _| thick.clone()),
        ["HAS_GLOSSY", "HAS_TRANSMISSION", "HAS_SHEETS", "SPLITS_AT_SHEETS", "HAS_DELAYS"]
    );
    let translucent = |m| Material { base_color: [1.0, 1.0, 1.0, 0.5], alpha_mode: AlphaMode::Blend, ..m };
    assert_eq!(of(|m, _| translucent(m)), ["HAS_ALPHA"]);
}

#[test]
fn textures_switch_on_their_features() {
    let textures = ["HAS_TEXTURES"];
    assert_eq!(of(|m, t| Material { base_color_texture: Some(t), ..m }), textures);
    assert_eq!(of(|m, t| Material { emission: [1.0; 3], emission_texture: Some(t), ..m }), textures);
    assert_eq!(of(|m, t| Material { normal_texture: Some(t), ..m }), ["HAS_TEXTURES", "HAS_NORMAL_MAPS"]);
    let varying = ["HAS_TEXTURES", "HAS_SURFACE_TEXTURES", "HAS_GLOSSY"];
    assert_eq!(of(|m, t| Material { metallic: 1.0, surface_texture: Some(t), ..m }), varying);
    let coats = ["HAS_TEXTURES", "HAS_SURFACE_TEXTURES", "HAS_COAT_TEXTURES", "HAS_GLOSSY"];
    assert_eq!(of(|m, t| Material { specular: 1.0, specular_texture: Some(t), ..m }), coats);
    let coloured = |m, t| Material { specular: 1.0, specular_color_texture: Some(t), ..m };
    assert_eq!(of(coloured), [&coats[..], &["HAS_SPECULAR_COLORS"]].concat());
    for change in [
        |m, t| Material { clearcoat: 1.0, clearcoat_texture: Some(t), ..m },
        |m, t| Material { clearcoat: 1.0, clearcoat_roughness_texture: Some(t), ..m },
    ] {
        assert_eq!(of(change), [&coats[..], &["HAS_CLEARCOAT"]].concat());
    }
    let pane = |_, t| Material { transmission_texture: Some(t), ..Material::glass("pane") };
    let expected =
        [&varying[..], &["HAS_TRANSMISSION", "HAS_TRANSMISSION_TEXTURES", "HAS_SHEETS", "SPLITS_AT_SHEETS"]].concat();
    assert_eq!(of(pane), expected);
    let moved = DAffine2::from_translation(DVec2::X);
    let textured = |m, t| Material { base_color_texture: Some(t), ..m };
    assert_eq!(features(textured, None, moved), ["HAS_TEXTURES", "HAS_TEXTURE_TRANSFORMS"]);
}

#[test]
fn vertex_colours_switch_on_their_features() {
    let colours = |m: Material, alpha| features(|_, _| m.clone(), Some([0.5, 0.5, 0.5, alpha]), DAffine2::IDENTITY);
    let white = Material::diffuse("white", [1.0; 3]);
    assert_eq!(colours(white.clone(), 0.5), ["HAS_VERTEX_COLORS"]);
    let translucent = Material { alpha_mode: AlphaMode::Blend, ..white };
    assert_eq!(colours(translucent, 0.5), ["HAS_VERTEX_COLORS", "HAS_ALPHA"]);
}

//! Warnings about solids of glass: turned ones, nested ones, ones that touch, ones with an alpha below 1, and nearly smooth ones.

use std::collections::{BTreeMap, BTreeSet};

use super::coplanar;
use super::geometry::Geometry;
use super::solids::Solids;
use super::solids::nested::Sharing;
use super::space::RenderSpace;
use crate::scene::{Instance, Material, Scene};
use crate::wgsl::layout::Triangle;

/// Maximum number of warnings of each kind.
const MAX_REPORTED: usize = 10;
/// Roughness of glass that counts as nearly smooth: rough for the renderer, but with lobes so narrow that connections seldom find them.
const NEARLY_SMOOTH: std::ops::Range<f32> = 0.032..0.145;
/// Distance that separates two solids in all cases, relative to the size of the scene.
const APART: f64 = 1e-4;

/// One warning, with the remedy, per mesh or pair of meshes. `is_timed`: whether the image depends on travel times or on media.
pub fn warnings(
    scene: &Scene,
    geometry: &Geometry,
    solids: &Solids,
    space: &RenderSpace,
    is_timed: bool,
) -> Vec<String> {
    if solids.is_empty() {
        return vec![];
    }
    let node = |instance: u32| scene.instances[instance as usize].node.as_str();
    let names = |instances: &mut dyn Iterator<Item = u32>| -> BTreeSet<&str> { instances.map(node).collect() };
    let turned = names(&mut geometry.orientation.turned()).into_iter().map(|name| {
        format!(
            "the triangles of the glass '{name}' face inwards; a closed mesh has an inside, so they are turned around; export the mesh with \
             triangles that face outwards"
        )
    });
    let kept = names(&mut geometry.orientation.kept()).into_iter().map(|name| {
        format!(
            "the triangles of the glass '{name}' face inwards, and it is around all other objects, so it stays: all space beyond its \
             surface counts as glass; if its inside is glass, turn its triangles around"
        )
    });
    let in_itself = names(&mut geometry.glass.nested_in_themselves(scene).into_iter()).into_iter().map(|name| {
        format!(
            "the glass '{name}' has a closed surface inside of another, and both face outwards: light between them travels as in air, so it \
             is bent wrongly and arrives too early; turn the inner surface around if it bounds a cavity, or remove it"
        )
    });
    let with_holes = names(&mut solids.with_holes().filter(|_| is_timed)).into_iter().map(|name| {
        format!(
            "the glass '{name}' has an alpha below 1: a ray that its surface lets pass does not know that it is inside of the glass, so travel \
             times and media there are wrong, and differ between estimators; set alphaMode to OPAQUE"
        )
    });
    let distance = APART * space.unit;
    let pairs: BTreeMap<(&str, &str), Sharing> =
        sharing(geometry, solids).into_iter().map(|((a, b), sharing)| ((node(a), node(b)), sharing)).collect();
    let pairs = pairs.into_iter().map(|((a, b), sharing)| match sharing {
        Sharing::Nested => format!(
            "the glass '{a}' is inside of the glass '{b}': light between their surfaces travels as in air, so it is bent wrongly and arrives \
             too early; give '{b}' an inner surface that faces '{a}', with a thin gap between the two"
        ),
        Sharing::Overlapping => format!(
            "the glass '{a}' and the glass '{b}' overlap: light near the surface of one inside of the other travels as in air, so it is bent \
             wrongly and arrives too early; leave a thin gap between the two"
        ),
        Sharing::Touching => format!(
            "the glass '{a}' touches the glass '{b}': a ray hits either surface by chance and may travel in one of them as in air, so it is \
             bent wrongly and arrives too early or too late; leave a gap of {distance:.0e} m between the two"
        ),
    });
    let nearly = names(&mut nearly_smooth(scene)).into_iter().map(|name| {
        format!(
            "the glass '{name}' is nearly smooth: connections seldom find its narrow lobes, so what lamps without a surface light behind it \
             is noisy or black; use a roughness of 0, or one of at least 0.15"
        )
    });
    let kinds = [
        turned.collect(),
        nearly.collect(),
        kept.collect(),
        in_itself.collect(),
        pairs.collect(),
        with_holes.collect(),
    ];
    kinds.into_iter().flat_map(limited).collect()
}

/// Instances of solid glass that are nearly smooth at most of their points, if there are lamps without a surface.
fn nearly_smooth(scene: &Scene) -> impl Iterator<Item = u32> {
    let is_near = |&(_, instance): &(u32, &Instance)| {
        let mesh = &scene.meshes[instance.mesh as usize];
        let material = &scene.materials[mesh.material as usize];
        let bends = material.transmits() && !material.is_sheet(mesh);
        bends && is_nearly_smooth(scene, material)
    };
    let all = if scene.lights.is_empty() { &[][..] } else { &scene.instances };
    (0..).zip(all).filter(is_near).map(|(number, _)| number)
}

/// Whether most points of the material, or most texels of its roughness, are nearly smooth.
fn is_nearly_smooth(scene: &Scene, material: &Material) -> bool {
    let is_near = |factor: f32| NEARLY_SMOOTH.contains(&(factor * material.roughness));
    let Some(texture) = material.surface_texture else { return is_near(1.0) };
    let texels = &scene.images[scene.textures[texture as usize].image as usize].rgba;
    let is_near: [bool; 256] = std::array::from_fn(|byte| is_near(byte as f32 / 255.0));
    2 * texels.iter().filter(|texel| is_near[usize::from(texel[1])]).count() > texels.len()
}

/// The first of some sentences; a last one counts the others.
fn limited(mut sentences: Vec<String>) -> Vec<String> {
    let more = sentences.len().saturating_sub(MAX_REPORTED);
    if more > 0 {
        sentences.truncate(MAX_REPORTED);
        sentences.push(format!("and {more} more meshes of glass like these"));
    }
    sentences
}

/// The pairs of instances of glass that share space or a plane.
fn sharing(geometry: &Geometry, solids: &Solids) -> BTreeMap<(u32, u32), Sharing> {
    let material = |number: u32| &geometry.materials[number as usize];
    let indices = |number: u32| (material(number).ior, material(number).group_index, material(number).interior);
    let is_like = |a: u32, b: u32| indices(a) == indices(b);
    let mut pairs = solids.nested(is_like);
    let close = solids.close();
    for (a, b) in coplanar::instances_in_one_plane(geometry, |t: &Triangle| close.contains(&t.instance)) {
        if !pairs.contains_key(&(a, b)) && !pairs.contains_key(&(b, a)) {
            pairs.insert((a, b), Sharing::Touching);
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use crate::generate::parts::{add, camera, diffuse, glass, material};
    use crate::generate::shapes::{append, cuboid, icosphere, inside_out, quad};
    use crate::render::PreparedScene;
    use crate::scene::{AlphaMode, Image, LightKind, Material, Mesh, Scene};
    use crate::settings::Settings;
    use crate::settings::units::Gate;

    /// The warnings about pieces of glass over a floor of 20 m in `scene`, through a gate or without one.
    fn warnings_of(mut scene: Scene, pieces: Vec<(&str, Mesh, Material)>, gate: Gate) -> Vec<String> {
        for (name, shape, kind) in pieces {
            let kind = material(&mut scene, kind);
            add(&mut scene, name, kind, shape);
        }
        let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
        add(&mut scene, "floor", grey, quad(DVec3::splat(-10.0), 20.0 * DVec3::Z, 20.0 * DVec3::X, [1.0; 2]));
        camera(&mut scene, DVec3::Z * 9.0, DVec3::ZERO, 0.5, [8, 8]);
        scene.add_light("lamp", DVec3::Y * 9.0, DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
        let settings = Settings::builder().gate(gate).build().unwrap();
        PreparedScene::new(&scene, &settings).unwrap().scene_warnings(&scene, &settings)
    }

    /// The warnings must be one with all `parts`, or none if there are no parts.
    fn expect(pieces: Vec<(&str, Mesh, Material)>, parts: &[&str]) {
        expect_in(Scene::default(), pieces, parts);
    }

    /// As [`expect`], in a scene that contains textures.
    fn expect_in(scene: Scene, pieces: Vec<(&str, Mesh, Material)>, parts: &[&str]) {
        let found = warnings_of(scene, pieces, Gate::OPEN);
        assert_eq!(found.len(), usize::from(!parts.is_empty()), "{parts:?}: {found:?}");
        assert!(parts.iter().all(|part| found[0].contains(part)), "{parts:?}: {found:?}");
    }

    fn water() -> Material {
        Material { ior: 1.33, ..glass("water") }
    }

    fn cube(lo: f64, hi: f64) -> Mesh {
        cuboid(DVec3::splat(lo), DVec3::splat(hi))
    }

    #[test]
    fn nearly_smooth_glass_is_named() {
        let of = |roughness| vec![("pane", cuboid(DVec3::ZERO, DVec3::ONE), Material { roughness, ..glass("glass") })];
        expect(of(0.08), &["'pane' is nearly smooth"]);
        expect(of(0.0), &[]);
        expect(of(0.2), &[]);
        // A texture of the roughness: most texels count.
        for (bytes, parts) in [([20, 20, 0], &["'pane' is nearly smooth"][..]), ([0, 20, 255], &[])] {
            let mut scene = Scene::default();
            let rgba = bytes.map(|byte| [255, byte, 0, 255]).to_vec();
            let texture = scene.add_texture(Image { width: 3, height: 1, rgba });
            let kind = Material { roughness: 1.0, surface_texture: Some(texture), ..glass("glass") };
            let pane = ("pane", cuboid(DVec3::ZERO, DVec3::ONE), kind);
            expect_in(scene, vec![pane], parts);
        }
    }

    #[test]
    fn nested_solids_are_named() {
        let piece = |name, shape| (name, shape, glass(name));
        expect(
            vec![piece("glass", cube(-1.0, 1.0)), ("water", cube(-0.5, 0.5), water())],
            &["'water' is inside of the glass 'glass'"],
        );
        // With an inner surface and a gap, in one mesh or in two.
        let mut hollow = cube(-1.0, 1.0);
        append(&mut hollow, &inside_out(cube(-0.51, 0.51)), DAffine3::IDENTITY);
        expect(vec![piece("glass", hollow), ("water", cube(-0.5, 0.5), water())], &[]);
        let inner = piece("inner", inside_out(cube(-0.51, 0.51)));
        expect(vec![piece("glass", cube(-1.0, 1.0)), inner, ("water", cube(-0.5, 0.5), water())], &[]);
        // The inner surface faces outwards.
        let mut wrong = icosphere(1.0, 1);
        append(&mut wrong, &icosphere(0.5, 1), DAffine3::IDENTITY);
        expect(vec![piece("wrong", wrong)], &["'wrong' has a closed surface inside of another"]);
        expect(vec![piece("one", cube(-1.0, 1.0)), piece("two", cube(2.0, 3.0))], &[]);
    }

    #[test]
    fn solids_that_touch_or_overlap_are_named() {
        let pair = |lo, hi| vec![("glass", cube(0.0, 1.0), glass("glass")), ("water", cuboid(lo, hi), water())];
        expect(
            pair(DVec3::new(0.0, 1.0, 0.0), DVec3::new(1.0, 2.0, 1.0)),
            &["'glass' touches the glass 'water'", "leave a gap"],
        );
        expect(pair(DVec3::new(0.0, 1.001, 0.0), DVec3::new(1.0, 2.0, 1.0)), &[]);
        expect(pair(DVec3::new(0.2, 0.8, 0.2), DVec3::new(0.8, 2.0, 0.8)), &["'water' and the glass 'glass' overlap"]);
    }

    #[test]
    fn solids_that_face_inwards_are_named() {
        expect(vec![("pane", inside_out(cube(-1.0, 1.0)), glass("glass"))], &["'pane' face inwards", "turned around"]);
        expect(
            vec![("room", inside_out(cube(-20.0, 20.0)), glass("glass"))],
            &["'room' face inwards", "around all other objects"],
        );
    }

    #[test]
    fn alpha_of_solids_is_named_where_times_count() {
        let half = || Material { alpha_mode: AlphaMode::Blend, base_color: [1.0, 1.0, 1.0, 0.5], ..glass("half") };
        let piece = || vec![("ball", icosphere(1.0, 1), half())];
        let found = warnings_of(Scene::default(), piece(), Gate { lo: 5.0, hi: 8.0 });
        assert!(found.len() == 1 && found[0].contains("'ball' has an alpha below 1"), "{found:?}");
        assert_eq!(warnings_of(Scene::default(), piece(), Gate::OPEN), Vec::<String>::new());
    }
}

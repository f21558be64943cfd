//! Warnings about objects that are so far away that 32-bit MIS weights cannot cover both them and the nearest surfaces.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use super::geometry::Geometry;
use super::oversized::max_coordinate;
use super::space::{FARTHEST, RenderSpace};
use crate::scene::Scene;

/// Returns a warning, with the remedy, if objects are more than [`FARTHEST`] squared times as far away as the nearest triangle.
/// Distances are along an axis, from the origin of render space. `powers`: powers of the emitters in use, by name.
pub fn warnings(
    scene: &Scene,
    geometry: &Geometry,
    space: &RenderSpace,
    powers: &BTreeMap<String, f64>,
) -> Option<String> {
    let near = geometry.triangles.iter().map(max_coordinate).fold(f32::INFINITY, f32::min);
    let is_far = |distance: f32| f64::from(distance) > f64::from(near) * FARTHEST.powi(2);
    let triangles = geometry.triangles.iter().filter(|t| is_far(max_coordinate(t)));
    let lights = scene.lights.iter().filter(|light| !light.kind.is_distant() && powers.contains_key(&light.node));
    let lights = lights.filter(|light| is_far(space.point(light.position).abs().max_element()));
    let reaches_far = |corners: [DVec3; 2]| corners.iter().any(|&p| is_far(space.point(p).abs().max_element()));
    let media = scene.media.iter().enumerate().filter(|(_, medium)| medium.extent().is_some_and(reaches_far));
    let nodes: BTreeSet<String> = triangles
        .map(|t| &scene.instances[t.instance as usize].node)
        .chain(lights.map(|light| &light.node))
        .map(|node| format!("'{node}'"))
        .chain(media.map(|(i, _)| format!("medium {i}")))
        .collect();
    let others = match nodes.len() {
        0 | 1 => String::new(),
        n => format!(" (and {} more)", n - 1),
    };
    nodes.first().map(|node| {
        format!(
            "{node}{others} is more than {:.0e} times as far away as the nearest surface ({:.2e} m). The image is too bright: remove \
             the object, or move it nearer",
            FARTHEST.powi(2),
            f64::from(near) * space.unit
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::parts::{add, diffuse, material};
    use crate::generate::shapes::quad;
    use crate::generate::{Kind, build};
    use crate::render::albedo::AlbedoTable;
    use crate::scene::Medium;
    use crate::settings::Emitters;

    #[test]
    fn an_object_that_is_too_far_away_is_named() {
        let warning_of = |scene: &Scene| {
            let space = RenderSpace::new(scene, scene.cameras[0].transform.translation, &Emitters::Scene);
            let geometry = Geometry::new(scene, &space, &Emitters::Scene, AlbedoTable::shared());
            warnings(scene, &geometry, &space, &BTreeMap::new())
        };
        let warning = |distance: f64| {
            let mut scene = build(Kind::CornellBox);
            let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
            add(&mut scene, "moon", grey, quad(DVec3::Z * distance, DVec3::X, DVec3::Y, [1.0; 2]));
            warning_of(&scene)
        };
        let warning_of_fog = |size: f64| {
            let bounds = Some([DVec3::NEG_ONE, DVec3::ONE].map(|corner| size * corner));
            let fog = Medium { sigma_s: [0.1; 3], bounds, ..Medium::default() };
            warning_of(&Scene { media: vec![Medium::default(), fog], ..build(Kind::CornellBox) })
        };
        assert_eq!(warning(1e12), None);
        assert_eq!(warning_of_fog(1e12), None);
        let found = warning_of_fog(1e13).unwrap();
        assert!(found.starts_with("medium 1 is more than 1e12 times as far away"), "{found}");
        let found = warning(1e13).unwrap();
        assert!(found.starts_with("'moon' is more than 1e12 times as far away") && found.contains("nearer"), "{found}");
    }
}

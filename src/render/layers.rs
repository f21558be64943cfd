//! The auxiliary layers of an image: distance, normal, albedo and object of the surface at the centre of each pixel, and the
//! first arrival of light.

use std::collections::{BTreeMap, HashMap};

use super::arrival::first_arrivals;
use super::first_surface::first_surfaces;
use super::prepared_scene::PreparedScene;
use crate::error::Result;
use crate::gpu::Device;
use crate::image::layers::{CHANNELS, Layers, Plane};
use crate::scene::Scene;
use crate::settings::Settings;
use crate::settings::aov::Aov;

/// The chosen layers of the pixels of the crop. A pixel whose centre shows no surface is 0 in all layers but `arrival.Z`.
///
/// * `depth.Z`: length of the camera ray, from the pinhole or the sensor plane to the surface, in metres.
/// * `normal.X`, `.Y`, `.Z`: see [`FirstSurface::normal`](super::first_surface::FirstSurface::normal).
/// * `albedo.R`, `.G`, `.B`: see [`FirstSurface::albedo`](super::first_surface::FirstSurface::albedo).
/// * `object.ID`: the number of the node, see [`object_ids`].
/// * `arrival.Z`: see [`first_arrivals`].
pub fn layers(
    device: &Device,
    scene: &Scene,
    settings: &Settings,
    prepared: &PreparedScene,
    wanted: Aov,
) -> Result<Layers> {
    let pixels = settings.crop().width() as usize * settings.crop().height() as usize;
    let plane = |wanted: bool| vec![0.0f32; if wanted { pixels } else { 0 }];
    let mut depth = plane(wanted.depth);
    let mut normal = [0, 1, 2].map(|_| plane(wanted.normal));
    let mut albedo = [0, 1, 2].map(|_| plane(wanted.albedo));
    let mut object = vec![0u32; if wanted.object { pixels } else { 0 }];
    let ids = object_ids(scene);
    let mut objects = BTreeMap::new();
    if wanted.needs_surfaces() {
        // A layer that is not wanted has no pixels.
        first_surfaces(device, scene, settings, prepared, &mut |pixel, surface| {
            depth.get_mut(pixel).into_iter().for_each(|z| *z = surface.distance);
            for k in 0..3 {
                normal[k].get_mut(pixel).into_iter().for_each(|x| *x = surface.normal[k]);
                albedo[k].get_mut(pixel).into_iter().for_each(|c| *c = surface.albedo[k]);
            }
            if let Some(id) = object.get_mut(pixel) {
                *id = ids[surface.instance as usize];
                objects.entry(*id).or_insert_with(|| scene.instances[surface.instance as usize].node.clone());
            }
        })?;
    }
    let arrival = match wanted.arrival {
        true => first_arrivals(device, scene, settings, prepared)?,
        false => vec![],
    };
    let ([x, y, z], [r, g, b]) = (normal, albedo);
    let [depth, x, y, z, r, g, b, arrival] = [depth, x, y, z, r, g, b, arrival].map(Plane::Floats);
    let planes: [Plane; CHANNELS.len()] = [depth, x, y, z, r, g, b, Plane::Ids(object), arrival];
    let channels = CHANNELS.into_iter().zip(planes).filter(|(_, plane)| match plane {
        Plane::Floats(values) => !values.is_empty(),
        Plane::Ids(ids) => !ids.is_empty(),
    });
    let channels = channels.map(|(name, plane)| (name.into(), plane)).collect();
    Ok(Layers { channels, objects })
}

/// The number of the node of each instance: 1 for the first node of the scene, 2 for the next one, and so on. Nodes with the same
/// name share a number. Numbers do not depend on the camera.
pub fn object_ids(scene: &Scene) -> Vec<u32> {
    let mut known = HashMap::new();
    let nodes = scene.instances.iter().map(|instance| instance.node.as_str());
    nodes
        .map(|node| {
            let next = known.len() as u32 + 1;
            *known.entry(node).or_insert(next)
        })
        .collect()
}

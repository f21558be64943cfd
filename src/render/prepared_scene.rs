//! A scene made ready for rendering on the host: flattened, its hierarchy built, its emitters collected.

use std::collections::BTreeMap;

use super::albedo::AlbedoTable;
use super::emitters::EmitterSet;
use super::geometry::Geometry;
use super::space::RenderSpace;
use super::{coplanar, oversized};
use crate::error::{Error, Result};
use crate::scene::{Light, Scene};
use crate::settings::{Emitters, Settings};

/// Everything that is uploaded, around the sensor of one camera and for one choice of emitters.
pub struct PreparedScene {
    pub(super) geometry: Geometry,
    pub(super) emitters: EmitterSet,
    pub(super) albedo: &'static AlbedoTable,
    pub(super) space: RenderSpace,
}

impl PreparedScene {
    /// Fails if the scene breaks a promise of [`Scene::check`], has no such camera, or nothing emits.
    pub fn new(scene: &Scene, settings: &Settings) -> Result<PreparedScene> {
        scene.check()?;
        let Some(camera) = scene.cameras.get(settings.camera()) else {
            let (camera, count) = (settings.camera(), scene.cameras.len());
            return Err(Error::Settings(format!("there is no camera {camera}: the scene has {count}, counted from 0")));
        };
        check_emitters(scene, settings)?;
        let origin = camera.transform.translation;
        let albedo = AlbedoTable::shared();
        let space = RenderSpace::new(scene, origin, settings.emitters());
        let mut geometry = Geometry::new(scene, &space, settings.emitters(), albedo);
        let emitters = EmitterSet::new(scene, settings.emitters(), &space, &mut geometry);
        if emitters.table.is_empty() {
            return Err(Error::Settings(
                "nothing emits light (a light of power 0 or a surface of no area does not): select other nodes with \
                 --emitters, or give the scene a light with power"
                    .into(),
            ));
        }
        Ok(PreparedScene { geometry, emitters, albedo, space })
    }

    /// Node and luminance-weighted power in W of everything that shines.
    pub fn powers(&self) -> &BTreeMap<String, f64> {
        &self.emitters.powers
    }

    /// What will look wrong though the file is right, one sentence each with the remedy: triangles that are listed twice,
    /// surfaces that are far too large, lamps in the plane of another surface.
    pub fn warnings(&self, scene: &Scene) -> Vec<String> {
        let copies = self.geometry.copies.map(|(count, instance)| {
            let node = &scene.instances[instance as usize].node;
            let triangles = if count == 1 { "triangle is a copy of another" } else { "triangles are copies of others" };
            format!(
                "{count} {triangles} in the same place and of the same material, and count once (first: node '{node}')"
            )
        });
        let PreparedScene { geometry, space, .. } = self;
        let oversized = oversized::warnings(scene, geometry, space);
        copies.into_iter().chain(oversized).chain(coplanar::warnings(scene, geometry, space)).collect()
    }

    /// Triangles as they are placed, without copies.
    pub fn triangles(&self) -> usize {
        self.geometry.triangles.len()
    }
}

/// Fails where a node that is to shine does not exist, or where light without travel time is to be gated.
fn check_emitters(scene: &Scene, settings: &Settings) -> Result<()> {
    let exists = |name: &String| {
        scene.lights.iter().any(|light| light.node == *name) || scene.instances.iter().any(|i| i.node == *name)
    };
    if let Emitters::Nodes(names) = settings.emitters()
        && let Some(unknown) = names.iter().find(|name| !exists(name))
    {
        return Err(Error::Settings(format!(
            "no node '{unknown}' is in the scene, so it cannot shine; check its name"
        )));
    }
    let distant = |light: &&Light| light.kind.radius().is_none() && settings.emitters().include(&light.node);
    match scene.lights.iter().find(distant) {
        Some(light) if !settings.responses().are_steady() => Err(Error::Settings(format!(
            "the light '{}' is infinitely far away, so its light has no travel time to gate; render without a gate, or without it",
            light.node
        ))),
        _ => Ok(()),
    }
}

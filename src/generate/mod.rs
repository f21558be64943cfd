//! Scenes the project makes itself, as binary glTF: no download, no licence, the same bytes everywhere.
//!
//! A scene is first built as a plain [`Scene`] ([`build`], which tests use as it is) and then written ([`glb::write`]).
//! Nothing here depends on time, platform or the mathematics library: trigonometry and random numbers are our own.

mod clutter;
mod cornell;
mod door;
mod gated_sphere;
pub mod glb;
pub mod numbers;
pub mod paint;
pub mod shapes;
pub mod stage;

use crate::scene::Scene;

/// Which scene to make, with what may vary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// Box of 2 m with a ceiling light, a diffuse box and a rough metal box.
    CornellBox,
    /// Closed diffuse sphere around a point light and a pinhole: the exact test of [`crate::oracle::sphere`].
    GatedSphere {
        /// Metres, > 0: the mean distance of the facets from the centre.
        radius: f32,
        /// 20 * 4^n facets, at most 8.
        subdivisions: u32,
        /// In [0, 1], the same in all channels.
        albedo: f32,
    },
    /// Two rooms and a door ajar; the only light is a beam in the far room.
    DoorAjar,
    /// Room of 6 x 3 x 5 m full of instanced shapes in every material.
    ClutteredRoom {
        /// Least number of triangles, instances counted.
        triangles: u32,
    },
}

impl Kind {
    /// What [`Kind::parse`] understands.
    pub const NAMES: [&str; 4] = ["cornell-box", "gated-sphere", "door-ajar", "cluttered-room"];

    /// The scene of that name with its usual parameters: sphere of 1 m, albedo 0.5, 81,920 facets; clutter of 200,000
    /// triangles. `None` for any other name.
    pub fn parse(name: &str) -> Option<Kind> {
        Some(match name {
            "cornell-box" => Kind::CornellBox,
            "gated-sphere" => Kind::GatedSphere { radius: 1.0, subdivisions: 6, albedo: 0.5 },
            "door-ajar" => Kind::DoorAjar,
            "cluttered-room" => Kind::ClutteredRoom { triangles: 200_000 },
            _ => return None,
        })
    }

    /// One of [`Kind::NAMES`].
    pub fn name(self) -> &'static str {
        match self {
            Kind::CornellBox => Kind::NAMES[0],
            Kind::GatedSphere { .. } => Kind::NAMES[1],
            Kind::DoorAjar => Kind::NAMES[2],
            Kind::ClutteredRoom { .. } => Kind::NAMES[3],
        }
    }
}

/// The scene as binary glTF; the same bytes on every machine.
pub fn scene(kind: Kind) -> Vec<u8> {
    glb::write(&build(kind))
}

/// The scene as plain data, as a loader would give it.
pub fn build(kind: Kind) -> Scene {
    match kind {
        Kind::CornellBox => cornell::build(),
        Kind::GatedSphere { radius, subdivisions, albedo } => gated_sphere::build(radius, subdivisions, albedo),
        Kind::DoorAjar => door::build(),
        Kind::ClutteredRoom { triangles } => clutter::build(triangles),
    }
}

/// Triangles of all instances together.
pub fn triangle_count(scene: &Scene) -> usize {
    scene.instances.iter().map(|i| scene.meshes[i.mesh as usize].triangles.len()).sum()
}

#[cfg(test)]
mod tests;

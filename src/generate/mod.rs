//! Scenes the project makes itself, as binary glTF: no download, no licence, the same bytes everywhere.
//!
//! A scene is first built as a plain [`Scene`] ([`build`], which tests use as it is) and then written ([`glb::write`]).
//! Nothing here depends on time, platform or the mathematics library: trigonometry and random numbers are our own.

mod clutter;
mod cornell;
mod door;
mod gated_sphere;
pub mod glb;
mod hall;
pub mod numbers;
pub mod paint;
pub mod shapes;
pub mod stage;
pub mod zoo;

use crate::scene::Scene;

/// Triangles that may be asked for.
const MAX_TRIANGLES: u32 = 10_000_000;

/// Which scene to make, with what may vary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// Box of 2 m with a ceiling light, a diffuse box and a rough metal box.
    CornellBox,
    /// The same with another metal, and every face but the light's divided: the light travels the same ways.
    CornellBoxOf {
        /// Of the metal box, 0 to 1; the square root of the width alpha of GGX.
        roughness: f32,
        /// Least number of triangles: 34 times a power of four, and two of the light.
        triangles: u32,
    },
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
    /// Room of 4 x 3 x 4 m with every feature of materials, lit by emitters of one kind: for tests.
    Zoo(zoo::Light),
    /// Hall of 12 x 4 x 12 m under a hundred spot lights of unequal power.
    HundredLamps,
}

impl Kind {
    /// What [`Kind::parse`] understands.
    pub const NAMES: [&str; 8] = [
        "cornell-box",
        "gated-sphere",
        "door-ajar",
        "cluttered-room",
        "zoo-area",
        "zoo-punctual",
        "zoo-beam",
        "hundred-lamps",
    ];

    /// The scene of that name with its usual parameters: sphere of 1 m, albedo 0.5, 81,920 facets; clutter of 200,000
    /// triangles. `None` for any other name.
    pub fn parse(name: &str) -> Option<Kind> {
        Some(match name {
            "cornell-box" => Kind::CornellBox,
            "gated-sphere" => Kind::GatedSphere { radius: 1.0, subdivisions: 6, albedo: 0.5 },
            "door-ajar" => Kind::DoorAjar,
            "cluttered-room" => Kind::ClutteredRoom { triangles: 200_000 },
            "zoo-area" => Kind::Zoo(zoo::Light::Area),
            "zoo-punctual" => Kind::Zoo(zoo::Light::Punctual),
            "zoo-beam" => Kind::Zoo(zoo::Light::Beam),
            "hundred-lamps" => Kind::HundredLamps,
            _ => return None,
        })
    }

    /// With another roughness or number of triangles, where they are given; an error names what the scene does not have or a
    /// number that is out of range.
    pub fn with(self, roughness: Option<f32>, triangles: Option<u32>) -> Result<Kind, String> {
        if let Some(roughness) = roughness.filter(|r| !(0.0..=1.0).contains(r)) {
            return Err(format!("the roughness is {roughness}; it must be from 0 to 1"));
        }
        if let Some(triangles) = triangles.filter(|&n| n > MAX_TRIANGLES) {
            return Err(format!("{triangles} triangles are too many; ask for {MAX_TRIANGLES} at most"));
        }
        Ok(match (self, roughness, triangles) {
            (kind, None, None) => kind,
            (Kind::CornellBox, roughness, triangles) => Kind::CornellBoxOf {
                roughness: roughness.unwrap_or(cornell::ROUGHNESS),
                triangles: triangles.unwrap_or(0),
            },
            (Kind::ClutteredRoom { .. }, None, Some(triangles)) => Kind::ClutteredRoom { triangles },
            (kind, Some(_), _) => return Err(format!("{} has no roughness to choose; cornell-box has", kind.name())),
            (kind, ..) => {
                let name = kind.name();
                return Err(format!(
                    "{name} has no number of triangles to choose; cornell-box and cluttered-room have"
                ));
            }
        })
    }

    /// One of [`Kind::NAMES`].
    pub fn name(self) -> &'static str {
        match self {
            Kind::CornellBox | Kind::CornellBoxOf { .. } => Kind::NAMES[0],
            Kind::GatedSphere { .. } => Kind::NAMES[1],
            Kind::DoorAjar => Kind::NAMES[2],
            Kind::ClutteredRoom { .. } => Kind::NAMES[3],
            Kind::Zoo(zoo::Light::Area) => Kind::NAMES[4],
            Kind::Zoo(zoo::Light::Punctual) => Kind::NAMES[5],
            Kind::Zoo(zoo::Light::Beam) => Kind::NAMES[6],
            Kind::HundredLamps => Kind::NAMES[7],
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
        Kind::CornellBox => cornell::build(cornell::ROUGHNESS, 0),
        Kind::CornellBoxOf { roughness, triangles } => cornell::build(roughness, triangles),
        Kind::GatedSphere { radius, subdivisions, albedo } => gated_sphere::build(radius, subdivisions, albedo),
        Kind::DoorAjar => door::build(),
        Kind::ClutteredRoom { triangles } => clutter::build(triangles),
        Kind::Zoo(light) => zoo::zoo(light),
        Kind::HundredLamps => hall::build(),
    }
}

/// Triangles of all instances together.
pub fn triangle_count(scene: &Scene) -> usize {
    scene.instances.iter().map(|i| scene.meshes[i.mesh as usize].triangles.len()).sum()
}

#[cfg(test)]
mod tests;

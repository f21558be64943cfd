//! Scenes that the project generates itself, as binary glTF: no download, no licence, the same bytes everywhere.
//!
//! [`build`] makes a plain [`Scene`], which tests use directly. [`glb_bytes`] builds a scene and writes it as a file. Nothing here
//! depends on the time, the platform or the mathematics library: this module has its own trigonometry and random numbers.

mod clutter;
mod cornell;
mod door;
mod gated_sphere;
pub mod glb;
mod hall;
mod hidden_letter;
pub mod numbers;
pub mod paint;
pub mod parts;
mod pool;
pub mod shapes;
mod street;
mod windscreen;
pub mod zoo;

use crate::scene::Scene;

/// Maximum number of triangles that a user may request.
const MAX_TRIANGLES: u32 = 10_000_000;

/// The scene to generate, with its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// Box of 2 m with a ceiling light, a diffuse box and a rough metal box.
    CornellBox,
    /// The Cornell box with another roughness or finer triangles. All faces except the light's are divided, which does not change
    /// the light transport.
    CornellBoxOf {
        /// Roughness of the metal box, 0 to 1: the square root of the GGX alpha.
        roughness: f32,
        /// Lower bound on the number of triangles. The scene has 34 * 4^n + 2 of them, with the smallest n that suffices.
        triangles: u32,
    },
    /// Closed diffuse sphere around a point light and a pinhole, whose gated radiance [`crate::self_check::sphere`] gives exactly.
    GatedSphere {
        /// Mean distance of the facets from the centre in metres, > 0.
        radius: f32,
        /// Number n of subdivisions, at most 8; the sphere has 20 * 4^n facets.
        subdivisions: u32,
        /// Albedo in [0, 1], the same in all channels.
        albedo: f32,
    },
    /// Two rooms and a door ajar; the only light is a beam in the far room.
    DoorAjar,
    /// Room of 6 x 3 x 5 m full of instanced shapes in many materials.
    ClutteredRoom {
        /// Lower bound on the number of triangles, counted per instance.
        triangles: u32,
    },
    /// Room of 4 x 3 x 4 m with every feature of materials, lit by emitters of one kind. Tests use it.
    Zoo(zoo::Light),
    /// Hall of 12 x 4 x 12 m under a hundred spot lights of unequal power.
    HundredLamps,
    /// Street of 72 m at night, lit by a lamp beside the camera. A car drives towards the camera for two seconds.
    Street,
    /// A letter that a laser and a sensor see only by way of a wall.
    HiddenLetter,
    /// The street, seen by a camera with a lamp, both behind the windscreen of a car: two curved faces, 3,192 triangles.
    Windscreen,
    /// A pool with 5 m of water, seen and lit from 2 m above it.
    Pool,
}

impl Kind {
    /// The names that [`Kind::parse`] accepts.
    pub const NAMES: [&str; 12] = [
        "cornell-box",
        "gated-sphere",
        "door-ajar",
        "cluttered-room",
        "zoo-area",
        "zoo-punctual",
        "zoo-beam",
        "hundred-lamps",
        "street",
        "hidden-letter",
        "windscreen",
        "pool",
    ];

    /// The scene of this name with its default parameters: a sphere of 1 m with albedo 0.5 and 81,920 facets; clutter of at least
    /// 200,000 triangles. `None` for any other name.
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
            "street" => Kind::Street,
            "hidden-letter" => Kind::HiddenLetter,
            "windscreen" => Kind::Windscreen,
            "pool" => Kind::Pool,
            _ => return None,
        })
    }

    /// The scene with another roughness or another number of triangles, if they are given. The error names the parameter that is
    /// out of range or that the scene does not have.
    pub fn with(self, roughness: Option<f32>, triangles: Option<u32>) -> Result<Kind, String> {
        if let Some(roughness) = roughness.filter(|r| !(0.0..=1.0).contains(r)) {
            return Err(format!("the roughness is {roughness}; it must be from 0 to 1"));
        }
        if let Some(triangles) = triangles.filter(|&n| n > MAX_TRIANGLES) {
            return Err(format!("{triangles} triangles are too many; use at most {MAX_TRIANGLES}"));
        }
        Ok(match (self, roughness, triangles) {
            (kind, None, None) => kind,
            (Kind::CornellBox, roughness, triangles) => Kind::CornellBoxOf {
                roughness: roughness.unwrap_or(cornell::ROUGHNESS),
                triangles: triangles.unwrap_or(0),
            },
            (Kind::ClutteredRoom { .. }, None, Some(triangles)) => Kind::ClutteredRoom { triangles },
            (kind, Some(_), _) => return Err(format!("{} has no roughness to set; use cornell-box", kind.name())),
            (kind, ..) => {
                let name = kind.name();
                return Err(format!("{name} has no number of triangles to set; use cornell-box or cluttered-room"));
            }
        })
    }

    /// Its name, one of [`Kind::NAMES`].
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
            Kind::Street => Kind::NAMES[8],
            Kind::HiddenLetter => Kind::NAMES[9],
            Kind::Windscreen => Kind::NAMES[10],
            Kind::Pool => Kind::NAMES[11],
        }
    }
}

/// The scene as a binary glTF file, with the same bytes on every machine.
pub fn glb_bytes(kind: Kind) -> Vec<u8> {
    let motion = matches!(kind, Kind::Street | Kind::Windscreen).then(street::motion);
    glb::write_moving(&build(kind), motion.as_ref())
}

/// The scene as plain data, as the loader would return it. A scene that moves is at its first moment.
pub fn build(kind: Kind) -> Scene {
    match kind {
        Kind::CornellBox => cornell::build(cornell::ROUGHNESS, 0),
        Kind::CornellBoxOf { roughness, triangles } => cornell::build(roughness, triangles),
        Kind::GatedSphere { radius, subdivisions, albedo } => gated_sphere::build(radius, subdivisions, albedo),
        Kind::DoorAjar => door::build(),
        Kind::ClutteredRoom { triangles } => clutter::build(triangles),
        Kind::Zoo(light) => zoo::zoo(light),
        Kind::HundredLamps => hall::build(),
        Kind::Street => street::build(),
        Kind::HiddenLetter => hidden_letter::build(),
        Kind::Windscreen => windscreen::build(),
        Kind::Pool => pool::build(),
    }
}

/// Number of triangles of all instances together.
pub fn triangle_count(scene: &Scene) -> usize {
    scene.instances.iter().map(|i| scene.meshes[i.mesh as usize].triangles.len()).sum()
}

#[cfg(test)]
mod tests;

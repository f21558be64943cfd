//! Attributes of morph targets that are not read: colours and texture coordinates. The parser of the `gltf` crate drops them, so
//! this module looks for them in the JSON.

use std::fmt;

use serde::Deserialize;
use serde::de::{Deserializer, IgnoredAny, MapAccess, Visitor};

#[derive(Deserialize)]
struct Root {
    #[serde(default)]
    meshes: Vec<Mesh>,
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    #[serde(default)]
    targets: Option<Vec<Target>>,
}

/// A morph target.
struct Target {
    moves_colors: bool,
}

/// Index of the first mesh with a morph target that moves colours or texture coordinates.
pub fn first_with_colors(json: &[u8]) -> Option<usize> {
    let moves = |primitive: &Primitive| primitive.targets.iter().flatten().any(|target| target.moves_colors);
    serde_json::from_slice::<Root>(json).ok()?.meshes.iter().position(|mesh| mesh.primitives.iter().any(moves))
}

impl<'de> Deserialize<'de> for Target {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Target, D::Error> {
        deserializer.deserialize_map(Attributes)
    }
}

struct Attributes;

impl<'de> Visitor<'de> for Attributes {
    type Value = Target;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Target, A::Error> {
        let mut moves_colors = false;
        while let Some((key, IgnoredAny)) = map.next_entry::<String, IgnoredAny>()? {
            moves_colors |= key.starts_with("COLOR_") || key.starts_with("TEXCOORD_");
        }
        Ok(Target { moves_colors })
    }
}

//! Auxiliary layers of an image file: channels beside the image.

use std::collections::BTreeMap;

use crate::settings::aov::Aov;

/// The values of a channel, one per pixel, row by row.
#[derive(Debug, Clone, PartialEq)]
pub enum Plane {
    Floats(Vec<f32>),
    /// Numbers that identify something; means of them have no meaning.
    Ids(Vec<u32>),
}

/// Names of all channels of auxiliary layers. Each begins with the name of its layer.
pub const CHANNELS: [&str; 9] =
    ["depth.Z", "normal.X", "normal.Y", "normal.Z", "albedo.R", "albedo.G", "albedo.B", "object.ID", "arrival.Z"];

/// Auxiliary layers of an image file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Layers {
    /// Names of channels, such as `depth.Z`, and their values. See [`CHANNELS`].
    pub channels: Vec<(String, Plane)>,
    /// Names of the objects whose ids are in `object.ID`.
    pub objects: BTreeMap<u32, String>,
}

impl Layers {
    /// Adds the channels of `other` that are not here yet. Both belong to the same image.
    pub fn add_missing(&mut self, other: Layers) {
        for (name, plane) in other.channels {
            if self.channels.iter().all(|(known, _)| *known != name) {
                self.channels.push((name, plane));
            }
        }
        self.objects.extend(other.objects);
    }

    /// Keeps only the layers `wanted`. Fails with the name of the first one that is not here.
    pub fn keep(&mut self, wanted: Aov) -> Result<(), &'static str> {
        let layer_of = |channel: &str| channel.split('.').next().unwrap_or_default().to_owned();
        if let Some(missing) = wanted.names().find(|name| self.channels.iter().all(|(own, _)| layer_of(own) != *name)) {
            return Err(missing);
        }
        self.channels.retain(|(channel, _)| wanted.names().any(|name| layer_of(channel) == name));
        if !wanted.object {
            self.objects.clear();
        }
        Ok(())
    }
}

//! Auxiliary layers of an image file: channels beside the image.

use std::collections::BTreeMap;

/// The values of a channel, one per pixel, row by row.
#[derive(Debug, Clone, PartialEq)]
pub enum Plane {
    Floats(Vec<f32>),
    /// Numbers that identify something; means of them have no meaning.
    Ids(Vec<u32>),
}

/// Auxiliary layers of an image file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Layers {
    /// Names of channels, such as `depth.Z`, and their values.
    pub channels: Vec<(String, Plane)>,
    /// Names of the objects whose ids are in `object.ID`.
    pub objects: BTreeMap<u32, String>,
}

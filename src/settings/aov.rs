//! The choice of auxiliary layers of an image file.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};

/// Auxiliary layers (arbitrary output variables) beside the image; see `render/layers.rs` for their contents.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Aov {
    pub depth: bool,
    pub normal: bool,
    pub albedo: bool,
    pub object: bool,
    pub arrival: bool,
    /// For scans of a LiDAR alone.
    pub velocity: bool,
}

impl Aov {
    /// All layers of an image.
    pub const ALL: Aov = Aov { depth: true, normal: true, albedo: true, object: true, arrival: true, velocity: false };

    fn parts(&mut self) -> [(&'static str, &mut bool); 6] {
        [
            ("depth", &mut self.depth),
            ("normal", &mut self.normal),
            ("albedo", &mut self.albedo),
            ("object", &mut self.object),
            ("arrival", &mut self.arrival),
            ("velocity", &mut self.velocity),
        ]
    }

    /// The names of the chosen layers.
    pub fn names(mut self) -> impl Iterator<Item = &'static str> {
        self.parts().map(|(name, is_on)| is_on.then_some(name)).into_iter().flatten()
    }

    /// Whether any layer shows the first surface along a ray.
    pub fn needs_surfaces(&self) -> bool {
        self.depth || self.normal || self.albedo || self.object
    }
}

impl FromStr for Aov {
    type Err = Error;

    /// Parses `all`, or names of layers with commas between them.
    fn from_str(text: &str) -> Result<Aov> {
        if text.trim() == "all" {
            return Ok(Aov::ALL);
        }
        let mut aov = Aov::default();
        for name in text.split(',').map(str::trim) {
            let known = aov.parts().into_iter().find(|(known, _)| *known == name);
            *known.ok_or_else(|| not_a_layer(name))?.1 = true;
        }
        Ok(aov)
    }
}

fn not_a_layer(name: &str) -> Error {
    Error::advice(
        format!("'{name}' is not an auxiliary layer: "),
        "give all, or some of depth,normal,albedo,object,arrival; velocity is for scans",
    )
}

impl fmt::Display for Aov {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.names().collect::<Vec<_>>().join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_are_named_once_each_in_any_order() {
        let some: Aov = "object, depth".parse().unwrap();
        assert_eq!((some.to_string().as_str(), some.needs_surfaces()), ("depth,object", true));
        assert_eq!("all".parse::<Aov>().unwrap().to_string().parse::<Aov>().unwrap(), Aov::ALL);
        assert!(!"arrival".parse::<Aov>().unwrap().needs_surfaces());
        for bad in ["", "depth,", "Depth", "all,depth", "none"] {
            assert!(bad.parse::<Aov>().unwrap_err().to_string().contains("depth,normal"), "{bad}");
        }
    }
}

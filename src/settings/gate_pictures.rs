//! What the picture of a render with several gates shows.

use std::str::FromStr;

use serde::de::{Deserialize, Deserializer, Error as _};
use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::settings::setting::value_from_text;

/// What the picture of a render with several gates shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GatePictures {
    /// The sum of all gates.
    #[default]
    Sum,
    /// Each gate in a picture of its own.
    Each,
    /// All gates side by side in one picture.
    Strip,
}

const NAMES: [(&str, GatePictures); 3] =
    [("sum", GatePictures::Sum), ("each", GatePictures::Each), ("strip", GatePictures::Strip)];

impl FromStr for GatePictures {
    type Err = Error;

    fn from_str(text: &str) -> Result<GatePictures> {
        let named = NAMES.into_iter().find(|(name, _)| *name == text).map(|(_, pictures)| pictures);
        named.ok_or_else(|| Error::Settings(format!("'{text}' is not a kind of picture: choose sum, each or strip")))
    }
}

impl Serialize for GatePictures {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(NAMES.iter().find(|(_, pictures)| pictures == self).map_or("", |(name, _)| name))
    }
}

impl<'de> Deserialize<'de> for GatePictures {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}

value_from_text!(GatePictures);

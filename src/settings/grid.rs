//! Values of the settings of a density grid.

use std::str::FromStr;

use serde::de::{Deserialize, Deserializer, Error as _};
use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::settings::setting::value_from_text;

/// How a grid continues between the centres of its voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    Linear,
    Nearest,
}

const FILTERS: [(&str, Filter); 2] = [("linear", Filter::Linear), ("nearest", Filter::Nearest)];

impl FromStr for Filter {
    type Err = Error;

    fn from_str(text: &str) -> Result<Filter> {
        let named = FILTERS.into_iter().find(|(name, _)| *name == text);
        named
            .map(|(_, filter)| filter)
            .ok_or_else(|| Error::Settings(format!("'{text}' is not a filter of a grid: choose linear or nearest")))
    }
}

impl Serialize for Filter {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(FILTERS.iter().find(|(_, filter)| filter == self).map_or("", |(name, _)| name))
    }
}

impl<'de> Deserialize<'de> for Filter {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}

value_from_text!(Filter);

//! A span of travel time that the user gives as a length or as a time.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::settings::setting::value_from_text;
use crate::settings::units::{number, path_length};

/// A span of travel time in metres of optical path, finite and > 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpticalPath(pub f64);

impl FromStr for OpticalPath {
    type Err = Error;

    fn from_str(text: &str) -> Result<OpticalPath> {
        let path = path_length(text).filter(|x| *x > 0.0 && x.is_finite());
        path.map(OpticalPath).ok_or_else(|| {
            Error::advice(
                format!("'{text}' is not a length of optical path or a time greater than 0; "),
                "write it like 100m or 400ns",
            )
        })
    }
}

/// Prints text that parses to the same span.
impl fmt::Display for OpticalPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}m", number(self.0))
    }
}

value_from_text!(OpticalPath);

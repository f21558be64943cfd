//! The period of a pulsed laser.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::settings::setting::value_from_text;
use crate::settings::units::{number, path_length};

/// Optical path in metres between two pulses of a laser, finite and > 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Period(pub f64);

impl FromStr for Period {
    type Err = Error;

    fn from_str(text: &str) -> Result<Period> {
        let period = path_length(text).filter(|x| *x > 0.0 && x.is_finite());
        period.map(Period).ok_or_else(|| {
            Error::Settings(format!(
                "'{text}' is not the period of a laser; write a length of optical path or a time, like 100m or 400ns"
            ))
        })
    }
}

/// Prints text that parses to the same period.
impl fmt::Display for Period {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}m", number(self.0))
    }
}

value_from_text!(Period);

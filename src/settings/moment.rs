//! A time in an animation.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::settings::setting::value_from_text;
use crate::settings::typed::{Typed, typed};
use crate::settings::units::number;

/// A time in seconds, finite and at least 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment(pub f64);

impl Moment {
    fn new(seconds: f64) -> Option<Moment> {
        (seconds.is_finite() && seconds >= 0.0).then_some(Moment(seconds))
    }
}

impl FromStr for Moment {
    type Err = Error;

    /// Parses seconds, `1.5s` or `1.5`, or milliseconds, `1500ms`.
    fn from_str(text: &str) -> Result<Moment> {
        seconds(text).and_then(Moment::new).ok_or_else(|| {
            Error::advice(format!("'{text}' is not a time in an animation; "), "write seconds from 0 on, like 1.5s")
        })
    }
}

/// The seconds that `text` says, as a number with or without a unit: s, ms or us. `None` if it says none, or if they are not finite.
pub(super) fn seconds(text: &str) -> Option<f64> {
    let text = text.trim();
    let units = [("us", 1e6), ("ms", 1e3), ("s", 1.0)];
    let with_unit = units.into_iter().find_map(|(unit, per_second)| Some((text.strip_suffix(unit)?, per_second)));
    let (digits, per_second) = with_unit.unwrap_or((text, 1.0));
    digits.trim().parse().ok().map(|x: f64| x / per_second).filter(|seconds| seconds.is_finite())
}

/// Prints text that parses to the same time.
impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}s", number(self.0))
    }
}

impl Serialize for Moment {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_f64(self.0)
    }
}

typed! { Moment, "expected a time in seconds, like 1.5 or \"1.5s\"":
    Typed::Number(seconds) => number(seconds).parse(),
    Typed::Text(text) => text.parse(),
}

value_from_text!(Moment);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_in_seconds() {
        for (text, seconds) in [("1.5s", 1.5), ("1.5", 1.5), ("0", 0.0), ("250ms", 0.25), (" 1e-3 s", 1e-3)] {
            let moment: Moment = text.parse().unwrap();
            assert_eq!((moment, moment.to_string().parse::<Moment>().unwrap()), (Moment(seconds), moment), "{text}");
        }
        for text in ["", "-1s", "inf", "NaN", "1min", "s"] {
            assert!(text.parse::<Moment>().unwrap_err().to_string().contains("like 1.5s"), "{text}");
        }
    }
}

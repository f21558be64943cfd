//! The exposure of a picture.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::settings::typed::{Typed, typed};

/// Maximum absolute value of an exposure in stops. Its factor, 2^126 or 2^-126, is a normal f32.
const MAX_STOPS: f64 = 126.0;

/// The exposure of a picture: `auto`, or a number of stops.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Exposure {
    /// Each picture, or each sequence of pictures, gets its own exposure; see [`crate::image::png_file::exposure`].
    #[default]
    Auto,
    /// Linear values are multiplied by 2 to the power of this number.
    Stops(f64),
}

impl Exposure {
    fn of_stops(stops: f64) -> Result<Exposure> {
        if stops.is_finite() && stops.abs() <= MAX_STOPS {
            return Ok(Exposure::Stops(stops));
        }
        Err(Error::advice(
            format!("an exposure of {stops} stops is out of range: "),
            format!("it is -{MAX_STOPS} to {MAX_STOPS}"),
        ))
    }
}

impl FromStr for Exposure {
    type Err = Error;

    fn from_str(text: &str) -> Result<Exposure> {
        match text.trim() {
            "auto" => Ok(Exposure::Auto),
            number => Exposure::of_stops(number.parse().map_err(|_| {
                Error::advice(
                    format!("'{text}' is not an exposure: "),
                    "give auto, or a number of stops like 3.2 or -1",
                )
            })?),
        }
    }
}

impl fmt::Display for Exposure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Exposure::Auto => f.write_str("auto"),
            Exposure::Stops(stops) => stops.fmt(f),
        }
    }
}

impl Serialize for Exposure {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Exposure::Auto => serializer.serialize_str("auto"),
            Exposure::Stops(stops) => serializer.serialize_f64(*stops),
        }
    }
}

typed! { Exposure, "expected \"auto\" or a number of stops":
    Typed::Number(stops) => Exposure::of_stops(stops),
    Typed::Text(text) => text.parse(),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exposure_is_auto_or_a_number_of_stops() {
        for (text, exposure) in
            [("auto", Exposure::Auto), ("-1.5", Exposure::Stops(-1.5)), ("+3", Exposure::Stops(3.0))]
        {
            assert_eq!(text.parse::<Exposure>().unwrap(), exposure);
            assert_eq!(exposure.to_string().parse::<Exposure>().unwrap(), exposure);
        }
        for bad in ["", "bright", "nan", "inf", "127", "-1e9", "3 EV"] {
            assert!(bad.parse::<Exposure>().unwrap_err().to_string().contains("exposure"), "{bad}");
        }
    }
}

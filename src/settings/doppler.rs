//! Whether an image records how fast its light's paths get longer.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::settings::setting::value_from_text;
use crate::settings::typed::{Typed, typed};
use crate::settings::units::number;

/// The radial velocity in m/s that saturates the colours of a Doppler image; `None` if the image has the colours of the light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Doppler(Option<f64>);

impl Doppler {
    /// The image has the colours of the light.
    pub const OFF: Doppler = Doppler(None);

    /// The radial velocity in m/s that saturates the colours, 1e-6 to 3e8; `None` if the image records no velocities.
    pub fn speed(self) -> Option<f64> {
        self.0
    }

    /// Decodes a pixel of a Doppler image with the saturating `speed`, or a sum over pixels. Returns the mean radial velocity and its standard
    /// deviation in m/s, weighted by light. Not a number if there is no light.
    ///
    /// A path with the radial velocity u, in units of `speed`, has the colour (1 + u)^2, 1 - u^2, (1 - u)^2 times its light.
    pub fn decode(speed: f64, [r, g, b]: [f64; 3]) -> [f64; 2] {
        let light = (r + 2.0 * g + b) / 4.0;
        let mean = (r - b) / 4.0 / light;
        let square = (r - 2.0 * g + b) / 4.0 / light;
        if light > 0.0 { [speed * mean, speed * (square - mean * mean).max(0.0).sqrt()] } else { [f64::NAN; 2] }
    }
}

/// Parses `off`, or a speed; `m/s` or `km/h` may follow.
impl FromStr for Doppler {
    type Err = Error;

    fn from_str(text: &str) -> Result<Doppler> {
        let text = text.trim();
        if text == "off" {
            return Ok(Doppler::OFF);
        }
        let (digits, divisor) = match text.strip_suffix("km/h") {
            Some(digits) => (digits, 3.6),
            None => (text.strip_suffix("m/s").unwrap_or(text), 1.0),
        };
        let speed = digits.trim().parse().ok().map(|x: f64| x / divisor).filter(|x| (1e-6..=3e8).contains(x));
        speed.map(|speed| Doppler(Some(speed))).ok_or_else(|| {
            Error::advice(
                format!("'{text}' is no speed that can saturate the colours: "),
                "write a speed like 20m/s or 90km/h, or off",
            )
        })
    }
}

/// Prints text that parses to the same speed.
impl fmt::Display for Doppler {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(speed) => write!(f, "{}m/s", number(speed)),
            None => f.write_str("off"),
        }
    }
}

impl Serialize for Doppler {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

typed! { Doppler, "expected a speed, like \"20m/s\", or \"off\"":
    Typed::Number(speed) => number(speed).parse(),
    Typed::Text(text) => text.parse(),
}

value_from_text!(Doppler);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_have_units() {
        for (text, speed, printed) in [("20", 20.0, "20m/s"), ("90 km/h", 25.0, "25m/s"), ("0.5m/s", 0.5, "0.5m/s")] {
            let doppler: Doppler = text.parse().unwrap();
            assert_eq!((doppler.speed(), doppler.to_string()), (Some(speed), printed.to_string()));
        }
        assert_eq!("off".parse::<Doppler>().unwrap().to_string(), "off");
        for bad in ["", "0", "-3m/s", "inf", "NaN", "1e9", "fast", "3kn"] {
            assert!(bad.parse::<Doppler>().unwrap_err().to_string().contains("like 20m/s"), "{bad}");
        }
    }

    #[test]
    fn a_mixture_of_speeds_is_decoded() {
        let colour = |u: f64| [(1.0 + u) * (1.0 + u), 1.0 - u * u, (1.0 - u) * (1.0 - u)];
        // Light 3 at 0.4 and light 1 at -1.2: mean 0, variance (3 x 0.16 + 1.44) / 4 = 0.48.
        let sum = [0, 1, 2].map(|k| 3.0 * colour(0.4)[k] + colour(-1.2)[k]);
        let [mean, deviation] = Doppler::decode(10.0, sum);
        assert!(mean.abs() < 1e-12 && (deviation - 10.0 * 0.48f64.sqrt()).abs() < 1e-12, "{mean} {deviation}");
        assert!(Doppler::decode(10.0, [0.0; 3])[0].is_nan());
    }
}

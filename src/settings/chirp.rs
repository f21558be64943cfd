//! The chirp of a frequency-modulated continuous-wave (FMCW) sensor.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use super::moment::seconds;
use crate::error::{Error, Result};
use crate::settings::setting::value_from_text;
use crate::settings::typed::{Typed, typed};
use crate::settings::units::{METRES_PER_NS, number};

/// Light whose frequency rises or falls linearly. The sensor mixes what returns with what it sends, and measures the frequency of the beat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chirp {
    /// Wavelength of the light in metres.
    wavelength: f64,
    /// By how much the frequency changes during a sweep, in Hz; more than 0.
    bandwidth: f64,
    /// Duration of a sweep in seconds; less than 0 if the frequency falls.
    sweep: f64,
}

/// Speed of light in m/s.
const SPEED_OF_LIGHT: f64 = METRES_PER_NS * 1e9;

impl Chirp {
    /// The time in seconds in which a growing path seems to grow further: light whose path has the optical length L, which grows at the rate
    /// v, has the beat frequency of a path at rest of the length |L + v [`Chirp::coupling`]|.
    ///
    /// The beat of a path L = c tau has the frequency B tau / T + nu d(tau)/dt for a sweep of B in T around the frequency nu.
    pub fn coupling(&self) -> f64 {
        SPEED_OF_LIGHT / self.wavelength * self.sweep / self.bandwidth
    }

    /// The beat frequency in Hz per metre of optical path at rest.
    pub fn hertz_per_metre(&self) -> f64 {
        self.bandwidth / self.sweep.abs() / SPEED_OF_LIGHT
    }

    fn new(wavelength: f64, bandwidth: f64, sweep: f64) -> Option<Chirp> {
        let is_possible = (1e-9..1.0).contains(&wavelength)
            && (1.0..1e16).contains(&bandwidth)
            && (1e-12..1e3).contains(&sweep.abs());
        is_possible.then_some(Chirp { wavelength, bandwidth, sweep })
    }
}

/// `text` without one of these units, times its power of ten.
fn with_unit(text: &str, units: &[(&str, i32)]) -> Option<f64> {
    let (digits, &power) = units.iter().find_map(|(unit, power)| Some((text.trim().strip_suffix(unit)?, power)))?;
    // Negative powers of ten have no exact value.
    let scaled = |x: f64| if power < 0 { x / 10f64.powi(-power) } else { x * 10f64.powi(power) };
    digits.trim().parse().ok().map(scaled)
}

/// Parses wavelength, bandwidth and duration with units, such as `1550nm,1GHz,10us`. A duration below 0 is a sweep that falls.
impl FromStr for Chirp {
    type Err = Error;

    fn from_str(text: &str) -> Result<Chirp> {
        let parts: Vec<&str> = text.split(',').collect();
        let chirp = match parts[..] {
            [wavelength, bandwidth, sweep] => {
                let wavelength = with_unit(wavelength, &[("nm", -9), ("um", -6), ("mm", -3)]);
                let bandwidth = with_unit(bandwidth, &[("THz", 12), ("GHz", 9), ("MHz", 6)]);
                wavelength.zip(bandwidth).zip(seconds(sweep)).and_then(|((a, b), c)| Chirp::new(a, b, c))
            }
            _ => None,
        };
        chirp.ok_or_else(|| {
            Error::advice(
                format!("'{text}' is no chirp: "),
                "write wavelength, bandwidth and duration of a sweep, like 1550nm,1GHz,10us (-10us for a frequency that falls)",
            )
        })
    }
}

/// Prints text that parses to the same chirp.
impl fmt::Display for Chirp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [wavelength, bandwidth] = [self.wavelength * 1e9, self.bandwidth / 1e6].map(number);
        write!(f, "{wavelength}nm,{bandwidth}MHz,{}us", number(self.sweep * 1e6))
    }
}

impl Serialize for Chirp {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

typed! { Chirp, "expected a chirp, like \"1550nm,1GHz,10us\"":
    Typed::Text(text) => text.parse(),
}

value_from_text!(Chirp);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chirp_has_three_parts() {
        let chirp: Chirp = "1550nm,1GHz,10us".parse().unwrap();
        assert_eq!(chirp.to_string().parse::<Chirp>().unwrap(), chirp);
        assert_eq!(chirp.to_string(), "1550nm,1000MHz,10us");
        // nu T / B = 193.4 THz x 10 us / 1 GHz. One bin of 1 / T is c / B = 0.3 m.
        assert!((chirp.coupling() - 1.934_145).abs() < 1e-5, "{}", chirp.coupling());
        assert!((chirp.hertz_per_metre() * 0.299_792_458 - 1e5).abs() < 1e-6);
        let falling: Chirp = " 1.55um, 1000 MHz, -0.01ms".parse().unwrap();
        assert!((falling.coupling() + chirp.coupling()).abs() < 1e-9);
        for bad in [
            "",
            "1550nm",
            "1550nm,1GHz",
            "1550,1GHz,10us",
            "1550nm,1GHz,0",
            "1550nm,-1GHz,10us",
            "1550nm,1GHz,10us,1",
            "NaNnm,1GHz,1us",
        ] {
            assert!(bad.parse::<Chirp>().unwrap_err().to_string().contains("like 1550nm,1GHz,10us"), "{bad}");
        }
    }
}

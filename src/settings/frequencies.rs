//! Modulation frequencies of a continuous-wave sensor.

#![warn(missing_docs)]

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::settings::setting::value_from_text;
use crate::settings::typed::{Typed, typed};
use crate::settings::units::{METRES_PER_NS, number};

/// One frequency or two different ones, in MHz.
#[derive(Debug, Clone, PartialEq)]
pub struct Frequencies(Vec<f64>);

impl Frequencies {
    /// Frequencies in MHz. Fails with [`Error::Settings`] unless there are one or two different ones, each from 0.001 to 1,000,000
    /// MHz.
    pub fn new(megahertz: Vec<f64>) -> Result<Frequencies> {
        let are_possible = megahertz.iter().all(|f| (1e-3..=1e6).contains(f));
        match megahertz[..] {
            [_] if are_possible => Ok(Frequencies(megahertz)),
            [a, b] if are_possible && a != b => Ok(Frequencies(megahertz)),
            _ => Err(Error::advice(
                "these are not modulation frequencies: ",
                "write one or two different numbers from 0.001 to 1,000,000 MHz, like 20 or 80,60",
            )),
        }
    }

    /// The frequencies in MHz, one or two.
    pub fn megahertz(&self) -> &[f64] {
        &self.0
    }

    /// Optical path in metres in which the phase of a wave of this frequency, in MHz, makes a full turn: about 15 m for 20 MHz.
    pub fn period(megahertz: f64) -> f64 {
        METRES_PER_NS * 1e3 / megahertz
    }

    /// The frequency in MHz as part of the name of a layer, without a dot: `cw12_5MHz` for 12.5.
    pub fn name(megahertz: f64) -> String {
        format!("cw{}MHz", number(megahertz).replace('.', "_"))
    }
}

/// Parses numbers of MHz with a comma between them; `MHz` may follow.
impl FromStr for Frequencies {
    type Err = Error;

    fn from_str(text: &str) -> Result<Frequencies> {
        let text = text.trim();
        let numbers = text.strip_suffix("MHz").unwrap_or(text).split(',').map(|f| f.trim().parse());
        Frequencies::new(numbers.collect::<std::result::Result<_, _>>().unwrap_or_default())
    }
}

/// Prints text that parses to the same frequencies.
impl fmt::Display for Frequencies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.iter().map(|&f| number(f)).collect::<Vec<_>>().join(","))
    }
}

impl Serialize for Frequencies {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(&self.0)
    }
}

typed! { Frequencies, "expected one or two numbers of MHz, like 20 or [80, 60]":
    Typed::Number(one) => Frequencies::new(vec![one]),
    Typed::List(list) => Frequencies::new(list),
    Typed::Text(text) => text.parse(),
}

value_from_text!(Frequencies);

/// The frequency in Hz by which the sensor's modulation is faster than that of the light. Finite and not 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heterodyne(pub f64);

/// Parses a number of Hz; `Hz` or `kHz` may follow.
impl FromStr for Heterodyne {
    type Err = Error;

    fn from_str(text: &str) -> Result<Heterodyne> {
        let text = text.trim();
        let (digits, hertz) = match text.strip_suffix("kHz") {
            Some(digits) => (digits, 1e3),
            None => (text.strip_suffix("Hz").unwrap_or(text), 1.0),
        };
        let parsed = digits.trim().parse().ok().map(|x: f64| Heterodyne(x * hertz));
        parsed.filter(|Heterodyne(hertz)| hertz.is_finite() && *hertz != 0.0).ok_or_else(|| {
            Error::advice(
                format!("'{text}' is no difference of frequencies: "),
                "write a number of Hz that is not 0, like 30Hz",
            )
        })
    }
}

/// Prints text that parses to the same frequency.
impl fmt::Display for Heterodyne {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}Hz", number(self.0))
    }
}

impl Serialize for Heterodyne {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

typed! { Heterodyne, "expected a number of Hz, like \"30Hz\"":
    Typed::Number(hertz) => number(hertz).parse(),
    Typed::Text(text) => text.parse(),
}

value_from_text!(Heterodyne);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heterodyne_sensor_has_another_frequency() {
        for (text, hertz) in [("30", 30.0), ("-2.5 Hz", -2.5), ("1kHz", 1000.0)] {
            let heterodyne: Heterodyne = text.parse().unwrap();
            assert_eq!((heterodyne, heterodyne.to_string().parse().unwrap()), (Heterodyne(hertz), heterodyne));
        }
        for bad in ["", "0", "inf", "1MHz", "NaN"] {
            assert!(bad.parse::<Heterodyne>().unwrap_err().to_string().contains("like 30Hz"), "{bad}");
        }
    }

    #[test]
    fn one_or_two_frequencies() {
        for (text, printed) in [("20", "20"), (" 80, 60 ", "80,60"), ("12.5MHz", "12.5")] {
            assert_eq!(text.parse::<Frequencies>().unwrap().to_string(), printed);
        }
        for bad in ["", "0", "-20", "20,20", "1,2,3", "inf", "NaN", "20GHz", "1e7"] {
            assert!(bad.parse::<Frequencies>().unwrap_err().to_string().contains("like 20 or 80,60"), "{bad}");
        }
        assert_eq!(Frequencies::name(12.5), "cw12_5MHz");
        assert!((Frequencies::period(20.0) - 14.989_622_9).abs() < 1e-7);
    }
}

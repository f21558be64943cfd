//! The shutter of the camera: for how long it is open, and how a rolling shutter moves down the image.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::settings::moment::seconds;
use crate::settings::setting::value_from_text;
use crate::settings::typed::{Typed, typed};
use crate::settings::units::number;

/// When the shutter is open: from `open` up to `close`, in seconds after the time of `--at` or of the frame. Finite, and `open < close`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shutter {
    /// When it opens.
    pub open: f64,
    /// When it closes.
    pub close: f64,
}

impl Shutter {
    /// How long each row is exposed, in seconds.
    pub fn duration(&self) -> f64 {
        self.close - self.open
    }

    /// The middle of the exposure, in seconds after the time of the frame.
    pub fn middle(&self) -> f64 {
        0.5 * (self.open + self.close)
    }
}

impl FromStr for Shutter {
    type Err = Error;

    /// Parses `A..B`. Each end is in seconds, or has a unit: s, ms or us.
    fn from_str(text: &str) -> Result<Shutter> {
        let ends = text.split_once("..").and_then(|(a, b)| Some((seconds(a)?, seconds(b)?)));
        let shutter = ends.map(|(open, close)| Shutter { open, close }).filter(|shutter| shutter.open < shutter.close);
        shutter.ok_or_else(|| {
            Error::advice(
                format!("'{text}' is no exposure; "),
                "write from when to when the shutter is open, like 0..20ms or -10ms..10ms",
            )
        })
    }
}

/// Prints text that parses to the same shutter.
impl fmt::Display for Shutter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}s..{}s", number(self.open), number(self.close))
    }
}

impl serde::Serialize for Shutter {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

typed! { Shutter, "expected when the shutter is open, like \"0..20ms\"":
    Typed::Text(text) => text.parse(),
}

/// How much later the exposure of each row of the image begins than that of the row above, in seconds. Finite and above 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineTime(pub f64);

impl FromStr for LineTime {
    type Err = Error;

    fn from_str(text: &str) -> Result<LineTime> {
        let time = seconds(text).filter(|&time| time > 0.0).map(LineTime);
        time.ok_or_else(|| {
            Error::advice(
                format!("'{text}' is no time from row to row; "),
                "write a time above 0, like 20us, or leave it out for a shutter that exposes all rows at once",
            )
        })
    }
}

/// Prints text that parses to the same time.
impl fmt::Display for LineTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}s", number(self.0))
    }
}

impl serde::Serialize for LineTime {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

typed! { LineTime, "expected a time from row to row, like \"20us\"":
    Typed::Number(seconds) => number(seconds).parse(),
    Typed::Text(text) => text.parse(),
}

value_from_text!(Shutter, LineTime);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shutter_opens_before_it_closes() {
        for (text, open, close) in [("0..20ms", 0.0, 0.02), ("-10ms..10ms", -0.01, 0.01), ("0.5 .. 1s", 0.5, 1.0)] {
            let shutter: Shutter = text.parse().unwrap();
            assert_eq!(shutter, Shutter { open, close }, "{text}");
            assert_eq!(shutter.to_string().parse::<Shutter>().unwrap(), shutter);
        }
        for text in ["", "20ms", "20ms..0", "0..0", "0..inf", "NaN..1", "a..b", "0..1min"] {
            assert!(text.parse::<Shutter>().unwrap_err().to_string().contains("like 0..20ms"), "{text}");
        }
    }

    #[test]
    fn rows_follow_each_other() {
        let line: LineTime = "20us".parse().unwrap();
        assert_eq!((line, line.to_string().parse::<LineTime>().unwrap()), (LineTime(2e-5), line));
        for text in ["0", "-1us", "inf", "x"] {
            assert!(text.parse::<LineTime>().unwrap_err().to_string().contains("like 20us"), "{text}");
        }
    }
}

//! The frames of a sequence, and gates that move from frame to frame.

use std::ffi::OsStr;
use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use serde::de::{Deserialize, Deserializer, Error as _};
use serde::{Serialize, Serializer};

use crate::error::{Error, Result, SettingsError};
use crate::settings::setting::{Value, value_from_text};
use crate::settings::units::Gate;

/// Maximum number of a frame.
const MAX_FRAME: u32 = 1_000_000;

/// Frames A..B: A, A + 1, ... up to but not including B, at least one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frames(pub Range<u32>);

impl FromStr for Frames {
    type Err = Error;

    fn from_str(text: &str) -> Result<Frames> {
        let numbers = text.split_once("..").and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
        numbers.filter(|(a, b)| a < b && *b <= MAX_FRAME).map(|(a, b)| Frames(a..b)).ok_or_else(|| {
            Error::advice(
                format!("'{text}' are not frames; "),
                format!("write them like 0..24, which are the 24 frames from 0 to 23, up to {MAX_FRAME}"),
            )
        })
    }
}

impl fmt::Display for Frames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}..{}", self.0.start, self.0.end)
    }
}

value_from_text!(Frames);

/// Gates at certain frames, in ascending order of the frames, at least one. Between two of them the ends of the gate move
/// linearly; before the first and after the last the gate stays.
#[derive(Debug, Clone, PartialEq)]
pub struct GateKeys(Vec<(u32, Gate)>);

impl GateKeys {
    /// Fails if there is no key, if the frames do not ascend, or if a gate has no end.
    pub fn new(keys: Vec<(u32, Gate)>) -> Result<GateKeys> {
        let fail = |message: &str| Err(Error::advice(format!("{message}; "), format!("write them like {EXAMPLE}")));
        if keys.is_empty() {
            return fail("the gate has no keys");
        }
        if !keys.is_sorted_by(|a, b| a.0 < b.0) {
            return fail("the keys of the gate are not in ascending order of their frames");
        }
        if keys.iter().any(|(_, gate)| gate.hi.is_infinite()) {
            return fail("a key of the gate has no end");
        }
        Ok(GateKeys(keys))
    }

    /// The gate of a frame, or of a time between two frames, counted in frames.
    pub fn gate(&self, frame: f64) -> Gate {
        let after = self.0.partition_point(|(key, _)| f64::from(*key) <= frame);
        let (first, last) = (self.0[0], self.0[self.0.len() - 1]);
        if after == 0 || after == self.0.len() {
            return if after == 0 { first.1 } else { last.1 };
        }
        let [(from, a), (to, b)] = [self.0[after - 1], self.0[after]];
        let s = (frame - f64::from(from)) / f64::from(to - from);
        Gate { lo: a.lo + s * (b.lo - a.lo), hi: a.hi + s * (b.hi - a.hi) }
    }
}

const EXAMPLE: &str = "0=5m..6m, then 24=8m..9m";

impl Value for GateKeys {
    fn parse(word: &OsStr) -> Result<GateKeys, SettingsError> {
        let text = word.to_str().ok_or("this is not UTF-8")?;
        let key = text.split_once('=').and_then(|(frame, gate)| Some((frame.trim().parse().ok()?, gate)));
        let wrong =
            || SettingsError::advice(format!("'{text}' is not a frame and its gate; "), "write it like 24=8m..9m");
        let (frame, gate) = key.ok_or_else(wrong)?;
        Ok(GateKeys::new(vec![(frame, gate.parse()?)])?)
    }

    /// The keys of several flags may come in any order.
    fn and(self, later: GateKeys) -> GateKeys {
        let mut keys = [self.0, later.0].concat();
        keys.sort_by_key(|(frame, _)| *frame);
        // If a frame has two gates, the later one counts.
        keys.reverse();
        keys.dedup_by_key(|(frame, _)| *frame);
        keys.reverse();
        GateKeys(keys)
    }
}

impl Serialize for GateKeys {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(|(frame, gate)| (frame, gate.to_string())))
    }
}

impl<'de> Deserialize<'de> for GateKeys {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let keys = Vec::<(u32, Gate)>::deserialize(deserializer)?;
        GateKeys::new(keys).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_half_open() {
        assert_eq!("3..5".parse::<Frames>().unwrap().0.collect::<Vec<_>>(), [3, 4]);
        for text in ["5..3", "3..3", "3", "a..b", "-1..3", "0..2000000"] {
            assert!(text.parse::<Frames>().unwrap_err().to_string().contains("like 0..24"), "{text}");
        }
    }

    #[test]
    fn a_gate_moves_linearly_between_its_keys() {
        let key = |text: &str| GateKeys::parse(OsStr::new(text)).unwrap();
        let keys = key("20=8m..9m").and(key("10=5m..7m"));
        assert_eq!(keys.gate(3.0), Gate { lo: 5.0, hi: 7.0 });
        assert_eq!(keys.gate(15.0), Gate { lo: 6.5, hi: 8.0 });
        assert_eq!(keys.gate(12.5), Gate { lo: 5.75, hi: 7.5 });
        assert_eq!(keys.gate(99.0), Gate { lo: 8.0, hi: 9.0 });
        assert_eq!(key("5=1m..2m").and(key("5=3m..4m")).gate(5.0), Gate { lo: 3.0, hi: 4.0 });
        for text in ["5m..6m", "x=5m..6m", "3=6m..5m", "3=5m..inf"] {
            assert!(GateKeys::parse(OsStr::new(text)).is_err(), "{text}");
        }
    }
}

//! Many gates of one width, each of which begins where the one before it ends: the bins of a histogram of travel times.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::settings::units::Gate;

/// Maximum number of gates.
pub const MAX_GATES: u32 = 4096;

/// `count` gates that divide the gate `whole` into equal parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gates {
    whole: Gate,
    count: u32,
}

impl Gates {
    /// Divides `whole` into `count` gates of equal width. Fails if `whole` has no end, or if `count` is 0 or more than
    /// [`MAX_GATES`].
    pub fn new(whole: Gate, count: u32) -> Result<Gates> {
        if !whole.hi.is_finite() {
            return Err(Error::advice(format!("the gates {whole} have no end; "), HOW_TO_WRITE));
        }
        if !(1..=MAX_GATES).contains(&count) {
            return Err(Error::advice(
                format!("{count} gates are not possible: "),
                format!("give 1 to {MAX_GATES}; {HOW_TO_WRITE}"),
            ));
        }
        Ok(Gates { whole, count })
    }

    /// The gate that contains all gates.
    pub fn whole(&self) -> Gate {
        self.whole
    }

    /// Number of gates, 1 to [`MAX_GATES`].
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Width of each gate in metres of optical path.
    pub fn width(&self) -> f64 {
        (self.whole.hi - self.whole.lo) / f64::from(self.count)
    }

    /// Gate `k`, from 0. Gate k + 1 begins at the number at which gate k ends, so no light is lost or counted twice.
    pub fn gate(&self, k: u32) -> Gate {
        let edge = |k: u32| match k == self.count {
            true => self.whole.hi,
            false => self.whole.lo + (self.whole.hi - self.whole.lo) * (f64::from(k) / f64::from(self.count)),
        };
        Gate { lo: edge(k), hi: edge(k + 1) }
    }

    /// The gates as text: `8 gates in 12.5-12.9 m = ...`.
    pub fn describe(&self) -> String {
        let whole = self.whole.describe();
        format!("{} gates in {}", self.count, whole.strip_prefix("gate ").unwrap_or(&whole))
    }
}

const HOW_TO_WRITE: &str = "write them like 10m..20m/100, which is 100 gates of 0.1 m";

/// Prints text that parses to the same gates.
impl fmt::Display for Gates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.whole, self.count)
    }
}

impl FromStr for Gates {
    type Err = Error;

    fn from_str(text: &str) -> Result<Gates> {
        let parsed = text.rsplit_once('/').and_then(|(gate, count)| Some((gate, count.trim().parse::<u32>().ok()?)));
        let (gate, count) =
            parsed.ok_or_else(|| Error::advice(format!("'{text}' does not say how many gates; "), HOW_TO_WRITE))?;
        Gates::new(gate.parse()?, count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gates_abut_and_fill_the_whole() {
        for text in ["10m..20m/100", "0.1m..0.7m/7", "3ns..4ns/4096", "1m..2m/1"] {
            let gates: Gates = text.parse().unwrap();
            let all: Vec<Gate> = (0..gates.count()).map(|k| gates.gate(k)).collect();
            assert_eq!((all[0].lo, all[all.len() - 1].hi), (gates.whole().lo, gates.whole().hi), "{text}");
            assert!(all.windows(2).all(|pair| pair[0].hi == pair[1].lo), "{text}");
            assert!(all.iter().all(|gate| ((gate.hi - gate.lo) / gates.width() - 1.0).abs() < 1e-9), "{text}");
            assert_eq!(gates.to_string().parse::<Gates>().unwrap(), gates, "{text}");
        }
    }

    #[test]
    fn mistakes_come_with_an_example() {
        for (text, part) in [
            ("10m..20m", "how many gates"),
            ("10m..20m/", "how many gates"),
            ("10m..20m/-3", "how many gates"),
            ("10m..20m/2.5", "how many gates"),
            ("10m..20m/0", "give 1 to 4096"),
            ("10m..20m/4097", "give 1 to 4096"),
            ("10m..inf/4", "have no end"),
            ("20m..10m/4", "reversed"),
            ("10..20/4", "no unit"),
        ] {
            let error = text.parse::<Gates>().expect_err(text).to_string();
            assert!(error.contains(part) && error.contains("10m") | error.contains("12.5m"), "{text}: {error}");
        }
    }
}

//! Gates: travel times and depths with their units, parsed and printed.

#![warn(missing_docs)]

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};

/// A half-open interval of travel time [lo, hi), in metres of optical path (c = 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    /// Begin of the gate: the first travel time that counts, >= 0.
    pub lo: f64,
    /// End of the gate, which does not count itself. Infinite for a gate without an end.
    pub hi: f64,
}

/// Speed of light in vacuum, metres per nanosecond (exact).
pub const METRES_PER_NS: f64 = 0.299_792_458;

/// Maximum travel time in metres at which a gate may begin or end (except infinity). f32 represents somewhat larger numbers.
pub(super) const MAX_TRAVEL_TIME: f64 = 1e30;

/// The program refuses a gate that is narrower than this number of f32 steps, unless the user gives `--force`. Rounding may change
/// the brightness of its image by more than 6 %.
pub const REFUSED_ULPS: f64 = 16.0;
/// A gate that is narrower than this number of f32 steps is rendered with a warning.
pub const COARSE_ULPS: f64 = 256.0;

const HOW_TO_WRITE: &str = "write it like 12.5m..12.8m, 41.7ns..42.7ns, 12.65m+-0.15m or 12.5m+0.3m";

/// Width of a gate, in steps between neighbouring f32 travel times at the end of the gate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GatePrecision {
    /// At least [`COARSE_ULPS`] steps, or infinite: rounding is not visible.
    Fine,
    /// Fewer than [`COARSE_ULPS`] steps: rounding is visible in the brightness.
    Coarse {
        /// Width in f32 steps.
        ulps: f64,
    },
    /// Fewer than [`REFUSED_ULPS`] steps: rounding may change the brightness by more than 6 %.
    TooThin {
        /// Width in f32 steps.
        ulps: f64,
    },
}

impl Gate {
    /// Every travel time: the steady state.
    pub const OPEN: Gate = Gate { lo: 0.0, hi: f64::INFINITY };

    /// Whether every travel time counts.
    pub fn is_open(&self) -> bool {
        self.hi == f64::INFINITY && self.lo <= 0.0
    }

    /// Whether light of travel time `tau` (metres) counts. The function on the device is `gate_weight`.
    pub fn contains(&self, tau: f64) -> bool {
        self.lo <= tau && tau < self.hi
    }

    /// The gate [lo, hi), in metres. A negative `lo` is set to 0, because no travel time is negative; `hi` may be infinite. Fails
    /// if no travel time can be inside the gate, or if an end is NaN or beyond 1e30 m.
    pub fn new(lo: f64, hi: f64) -> Result<Gate> {
        if lo.is_nan() || hi.is_nan() {
            return Err(refuse("a gate cannot contain NaN", HOW_TO_WRITE));
        }
        if lo.is_infinite() {
            return Err(refuse(
                "a gate must begin at a finite travel time",
                "only its end may be inf, like 12.5m..inf",
            ));
        }
        if lo == hi {
            return Err(refuse("the gate is empty: it ends where it begins", "give it a width, like 12.5m..12.8m"));
        }
        if hi < lo {
            return Err(refuse("the gate is reversed: it ends before it begins", "swap the two, like 12.5m..12.8m"));
        }
        if lo > MAX_TRAVEL_TIME || (hi > MAX_TRAVEL_TIME && hi.is_finite()) {
            return Err(refuse(
                "the gate begins or ends beyond the maximum travel time of 1e30 m",
                "for a gate without an end write inf, like 12.5m..inf",
            ));
        }
        if hi <= 0.0 {
            return Err(refuse("the gate ends at or before 0, where no light arrives", "end it later, like 0m..0.3m"));
        }
        Ok(Gate { lo: lo.max(0.0), hi })
    }

    /// Parses a gate in optical path length or time: `A..B`, `CENTER+-HALF` or `A+WIDTH`, with units. If only one of the two
    /// numbers has a unit, the unit counts for both. In `A..B`, `B` may be `inf`.
    pub fn parse(text: &str) -> Result<Gate> {
        let (lo, hi) = interval(text, "gate", HOW_TO_WRITE, &PATH_UNITS, PATH_UNIT_NAMES)?;
        Gate::new(lo, hi)
    }

    /// Parses a gate that is given as a range of depths (one way), for a sensor beside the emitter: tau = 2 depth. The units are
    /// lengths.
    pub fn parse_depth(text: &str) -> Result<Gate> {
        let example = "write it like 6.25m..6.4m";
        let (lo, hi) = interval(text, "depth", example, &LENGTH_UNITS, LENGTH_UNIT_NAMES)?;
        Gate::new(2.0 * lo, 2.0 * hi)
    }

    /// Compares the width with the difference between neighbouring f32 numbers at `hi` + `unseen`. `unseen` is a sum of lengths in
    /// metres that make rounding errors larger. It contains the length that travel times omit, and the distance of the sensor from the
    /// origin of render space. If the gate repeats, it also contains the length from `hi` to the latest light.
    #[doc(hidden)]
    pub fn precision(&self, unseen: f64) -> GatePrecision {
        if self.hi.is_infinite() {
            return GatePrecision::Fine;
        }
        let hi = (self.hi + unseen) as f32;
        let ulps = (self.hi - self.lo) / (f64::from(hi.next_up()) - f64::from(hi));
        if ulps < REFUSED_ULPS || ulps.is_nan() {
            GatePrecision::TooThin { ulps }
        } else if ulps < COARSE_ULPS {
            GatePrecision::Coarse { ulps }
        } else {
            GatePrecision::Fine
        }
    }

    /// The gate as text, in optical path, time and depth: `gate 12.5-12.8 m = 41.696-42.696 ns = 6.25-6.4 m depth`.
    pub fn describe(&self) -> String {
        if self.is_open() {
            return "no gate (steady state)".into();
        }
        let path = span(self.lo, self.hi);
        let time = span(self.lo / METRES_PER_NS, self.hi / METRES_PER_NS);
        let depth = span(self.lo / 2.0, self.hi / 2.0);
        format!("gate {path} m = {time} ns = {depth} m depth")
    }
}

/// Prints text that [`Gate::parse`] parses to the same bits.
impl fmt::Display for Gate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.hi.is_infinite() {
            true => write!(f, "{}m..inf", number(self.lo)),
            false => write!(f, "{}m..{}m", number(self.lo), number(self.hi)),
        }
    }
}

impl FromStr for Gate {
    type Err = Error;

    fn from_str(text: &str) -> Result<Gate> {
        Gate::parse(text)
    }
}

/// A gate that is parsed and printed as a range of depths (one way). The gate itself is in metres of optical path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Depth(pub Gate);

impl FromStr for Depth {
    type Err = Error;

    fn from_str(text: &str) -> Result<Depth> {
        Gate::parse_depth(text).map(Depth)
    }
}

impl fmt::Display for Depth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Gate { lo: self.0.lo / 2.0, hi: self.0.hi / 2.0 }.fmt(f)
    }
}

/// Name of a unit, and its size in metres of optical path.
type Unit = (&'static str, f64);

const LENGTH_UNITS: [Unit; 7] =
    [("um", 1e-6), ("µm", 1e-6), ("μm", 1e-6), ("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("km", 1e3)];
const LENGTH_UNIT_NAMES: &str = "um, mm, cm, m or km";
const PATH_UNITS: [Unit; 12] = [
    ("um", 1e-6),
    ("µm", 1e-6),
    ("μm", 1e-6),
    ("mm", 1e-3),
    ("cm", 1e-2),
    ("m", 1.0),
    ("km", 1e3),
    ("ps", 1e-3 * METRES_PER_NS),
    ("ns", METRES_PER_NS),
    ("us", 1e3 * METRES_PER_NS),
    ("µs", 1e3 * METRES_PER_NS),
    ("μs", 1e3 * METRES_PER_NS),
];
const PATH_UNIT_NAMES: &str = "um, mm, cm, m or km (optical path), ps, ns or us (time)";

/// A number, and the size of its unit in metres if the user wrote a unit.
struct Quantity {
    value: f64,
    unit: Option<f64>,
}

/// Parses both ends of an interval, in metres, without comparing them. `what` and `example` are for messages.
fn interval(text: &str, what: &str, example: &str, units: &[Unit], unit_names: &str) -> Result<(f64, f64)> {
    let text = text.trim();
    let quantity = |side: &str| quantity(side, text, example, units, unit_names);
    let no_unit =
        || Error::advice(format!("the {what} '{text}' has no unit: "), format!("add {unit_names}; {example}"));

    if text.contains("...") {
        let remedy = format!("write two dots between its ends; {example}");
        return Err(Error::advice(format!("the {what} '{text}' has three dots: "), remedy));
    }
    if let Some((a, b)) = text.split_once("..") {
        let (a, b) = (quantity(a)?, quantity(b)?);
        let unit_a = a.unit.or(b.unit).ok_or_else(no_unit)?;
        let unit_b = b.unit.or(a.unit).ok_or_else(no_unit)?;
        return Ok((a.value * unit_a, b.value * unit_b));
    }
    // Test for `+-` before `+`, because `+-` also contains a `+`.
    if let Some((centre, half)) = text.split_once("+-").or_else(|| text.split_once('±')) {
        let (centre, half) = (quantity(centre)?, quantity(half)?);
        let centre_m = centre.value * centre.unit.or(half.unit).ok_or_else(no_unit)?;
        let half_m = half.value * half.unit.or(centre.unit).ok_or_else(no_unit)?;
        return Ok((centre_m - half_m, centre_m + half_m));
    }
    if let Some((a, width)) = split_at_width(text) {
        let (a, width) = (quantity(a)?, quantity(width)?);
        let a_m = a.value * a.unit.or(width.unit).ok_or_else(no_unit)?;
        let width_m = width.value * width.unit.or(a.unit).ok_or_else(no_unit)?;
        return Ok((a_m, a_m + width_m));
    }
    Err(Error::advice(format!("'{text}' is not an interval of travel time; "), example))
}

/// Splits at the first `+` that is neither a leading sign nor part of an exponent such as 1e+3.
fn split_at_width(text: &str) -> Option<(&str, &str)> {
    let at = text.char_indices().find(|&(i, c)| c == '+' && i > 0 && !text[..i].ends_with(['e', 'E']))?.0;
    Some((&text[..at], &text[at + 1..]))
}

fn quantity(side: &str, text: &str, example: &str, units: &[Unit], unit_names: &str) -> Result<Quantity> {
    let side = side.trim();
    if side.is_empty() {
        return Err(Error::advice(
            format!("the interval '{text}' lacks an end; "),
            format!("{example}, or 12.5m..inf"),
        ));
    }
    if side.eq_ignore_ascii_case("inf") {
        // Infinity needs no unit, and gives no unit to the other end.
        return Ok(Quantity { value: f64::INFINITY, unit: None });
    }

    let letters = side.find(|c: char| !matches!(c, '0'..='9' | '.' | '+' | '-' | 'e' | 'E')).unwrap_or(side.len());
    let (number, unit) = (side[..letters].trim(), side[letters..].trim());
    let value: f64 = number
        .parse()
        .ok()
        .filter(|v: &f64| v.is_finite())
        .ok_or_else(|| Error::advice(format!("'{side}' in '{text}' is not a number with a unit; "), example))?;
    if unit.is_empty() {
        return Ok(Quantity { value, unit: None });
    }
    let unit = units.iter().find(|(name, _)| *name == unit).map(|(_, metres)| *metres).ok_or_else(|| {
        Error::advice(
            format!("'{unit}' in '{text}' is not a unit for this setting: "),
            format!("use {unit_names}; {example}"),
        )
    })?;
    Ok(Quantity { value, unit: Some(unit) })
}

/// A length of optical path in metres, from a number with a unit of length or time; `None` if `text` is something else.
pub(crate) fn path_length(text: &str) -> Option<f64> {
    let Quantity { value, unit } = quantity(text, text, "", &PATH_UNITS, PATH_UNIT_NAMES).ok()?;
    Some(value * unit?)
}

/// The size in metres of optical path of a unit of length or time; `None` if there is no such unit.
pub(crate) fn path_unit(name: &str) -> Option<f64> {
    PATH_UNITS.iter().find(|(unit, _)| *unit == name).map(|(_, metres)| *metres)
}

/// The size in metres of a unit of length; `None` if there is no such unit.
pub(crate) fn length_unit(name: &str) -> Option<f64> {
    LENGTH_UNITS.iter().find(|(unit, _)| *unit == name).map(|(_, metres)| *metres)
}

/// A length in metres, from a number with a unit of length; `None` if `text` is something else.
pub(crate) fn length(text: &str) -> Option<f64> {
    let Quantity { value, unit } = quantity(text, text, "", &LENGTH_UNITS, LENGTH_UNIT_NAMES).ok()?;
    Some(value * unit?)
}

fn refuse(what: &str, remedy: &str) -> Error {
    Error::advice(format!("{what}; "), remedy)
}

/// The shortest decimal number that parses to the same bits, with an exponent if the number would be long.
pub(crate) fn number(x: f64) -> String {
    if is_long(x) { format!("{x:e}") } else { format!("{x}") }
}

/// Whether a number has so many digits before or after the decimal point that a reader would have to count them.
fn is_long(x: f64) -> bool {
    x != 0.0 && x.is_finite() && !(1e-6..1e9).contains(&x.abs())
}

/// `lo-hi` as text. The number of decimals shows the width to three digits, and is at least three.
fn span(lo: f64, hi: f64) -> String {
    let width = if hi.is_finite() { hi - lo } else { lo };
    let decimals = (2.0 - width.log10().floor()).clamp(3.0, 12.0) as usize;
    let show = |v: f64| {
        if is_long(v) {
            let text = format!("{v:.6e}");
            let (digits, exponent) = text.split_once('e').expect("this format has an exponent");
            return format!("{}e{exponent}", digits.trim_end_matches('0').trim_end_matches('.'));
        }
        let text = format!("{v:.decimals$}");
        match text.contains('.') {
            true => text.trim_end_matches('0').trim_end_matches('.').to_string(),
            false => text,
        }
    };
    format!("{}-{}", show(lo), show(hi))
}

#[cfg(test)]
mod tests;

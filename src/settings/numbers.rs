//! Values of settings that consist of numbers. On the command line they are text, `1,2.5,-3`. Experiment files may contain them
//! as text, numbers or lists. Printed experiments contain numbers and lists.

use std::str::FromStr;

use serde::de::{Deserialize, Deserializer, Error as _};
use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::settings::setting::value_from_text;
use crate::settings::typed::{Typed, typed};

/// `N` finite numbers, such as a point `1,2.5,-3`. Units and space depend on the setting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Numbers<const N: usize>(pub [f64; N]);

impl<const N: usize> Numbers<N> {
    /// Fails if there are not `N` numbers, or if one of them is not finite. `text` is what the user wrote.
    fn new(numbers: &[f64], text: &str) -> Result<Numbers<N>> {
        match <[f64; N]>::try_from(numbers) {
            Ok(numbers) if numbers.iter().all(|x| x.is_finite()) => Ok(Numbers(numbers)),
            _ => {
                let example = ["1", "2.5", "-3", "50"][..N.min(4)].join(",");
                Err(Error::advice(
                    format!("'{text}' is not a list of {N} numbers: "),
                    format!("write them with commas between them, like {example}"),
                ))
            }
        }
    }
}

impl<const N: usize> FromStr for Numbers<N> {
    type Err = Error;

    fn from_str(text: &str) -> Result<Numbers<N>> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
        Numbers::new(&numbers.unwrap_or_default(), text)
    }
}

impl<const N: usize> Serialize for Numbers<N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0)
    }
}

impl<'de, const N: usize> Deserialize<'de> for Numbers<N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(serde::Deserialize)]
        #[serde(untagged, expecting = "expected numbers, like [1, 2.5, -3] or \"1,2.5,-3\"")]
        enum Typed {
            Text(String),
            List(Vec<f64>),
        }
        match Typed::deserialize(deserializer)? {
            Typed::Text(text) => text.parse(),
            Typed::List(list) => Numbers::new(&list, &format!("{list:?}")),
        }
        .map_err(D::Error::custom)
    }
}

/// Declares settings that are a number in a range: a name, the test of the range, what the number is, and the remedy. `$expected`: the
/// message for a value of another type.
macro_rules! number {
    ($expected:literal: $($(#[$doc:meta])* $name:ident, $range:expr, $what:literal, $remedy:literal;)+) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
        pub struct $name(pub f64);

        impl std::str::FromStr for $name {
            type Err = $crate::error::Error;

            fn from_str(text: &str) -> Result<$name, Self::Err> {
                let is_in_range: fn(f64) -> bool = $range;
                match text.trim().parse() {
                    Ok(number) if is_in_range(number) => Ok($name(number)),
                    _ => Err(Self::Err::advice(format!(concat!("'{}' is not ", $what, ": "), text), $remedy)),
                }
            }
        }

        $crate::settings::typed::typed! { $name, $expected:
            $crate::settings::typed::Typed::Text(text) => text.parse(),
            $crate::settings::typed::Typed::Number(number) => number.to_string().parse(),
            $crate::settings::typed::Typed::List(list) => format!("{list:?}").parse(),
        }

        $crate::settings::setting::value_from_text!($name);
    )+};
}
pub(super) use number;

number! { "expected a number of degrees, like 40":
    /// A vertical field of view in degrees, more than 0 and less than 180.
    Fov, |degrees| degrees > 0.0 && degrees < 180.0, "a field of view", "write degrees between 0 and 180, like 40";
}

number! { "expected a number of metres, like 2.5":
    /// The height of an orthographic view in metres, finite and more than 0.
    Height, |metres| metres > 0.0 && metres.is_finite(), "the height of a view", "write metres above 0, like 2.5";
}

/// The radiant intensity of the headlamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Headlamp {
    /// An intensity that suits the size of the scene.
    Auto,
    /// In W / sr, more than 0.
    Intensity(f64),
}

impl Headlamp {
    fn new(intensity: Option<f64>, text: &str) -> Result<Headlamp> {
        intensity.filter(|&watts| watts > 0.0 && watts <= f64::from(f32::MAX)).map(Headlamp::Intensity).ok_or_else(
            || {
                Error::advice(
                    format!("'{text}' is not an intensity in W/sr: "),
                    "write a number above 0, or, if it is the scene, write it before --headlamp",
                )
            },
        )
    }
}

impl FromStr for Headlamp {
    type Err = Error;

    fn from_str(text: &str) -> Result<Headlamp> {
        match text.trim() {
            "auto" => Ok(Headlamp::Auto),
            number => Headlamp::new(number.parse().ok(), text),
        }
    }
}

impl Serialize for Headlamp {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match *self {
            Headlamp::Auto => serializer.serialize_bool(true),
            Headlamp::Intensity(watts) => serializer.serialize_f64(watts),
        }
    }
}

typed! { Headlamp, "expected true or an intensity in W/sr":
    Typed::Wanted(true) => Ok(Headlamp::Auto),
    Typed::Wanted(false) => Err(Error::advice("headlamp cannot be false: ", "remove the key")),
    Typed::Number(watts) => Headlamp::new(Some(watts), &watts.to_string()),
    Typed::Text(text) => text.parse(),
}

/// Point lights: position in world space in metres, and radiant intensity in W / sr.
#[derive(Debug, Clone, PartialEq)]
pub struct Lamps(pub Vec<Numbers<4>>);

impl Lamps {
    fn new(lamps: Vec<Numbers<4>>) -> Result<Lamps> {
        match lamps.iter().find(|Numbers([.., intensity])| *intensity <= 0.0) {
            Some(Numbers([.., intensity])) => Err(Error::advice(
                format!("a lamp has an intensity of {intensity} W/sr: "),
                "write X,Y,Z,INTENSITY with an intensity above 0",
            )),
            None => Ok(Lamps(lamps)),
        }
    }
}

impl FromStr for Lamps {
    type Err = Error;

    fn from_str(text: &str) -> Result<Lamps> {
        Lamps::new(vec![text.parse()?])
    }
}

impl Serialize for Lamps {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(&self.0)
    }
}

impl<'de> Deserialize<'de> for Lamps {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(serde::Deserialize)]
        #[serde(untagged, expecting = "expected a lamp like \"0,2,1,50\" (X,Y,Z,INTENSITY), or a list of lamps")]
        enum Typed {
            One(Numbers<4>),
            List(Vec<Numbers<4>>),
        }
        let lamps = match Typed::deserialize(deserializer)? {
            Typed::One(lamp) => vec![lamp],
            Typed::List(lamps) => lamps,
        };
        Lamps::new(lamps).map_err(D::Error::custom)
    }
}

value_from_text!(Numbers<2>, Numbers<3>, Numbers<4>, Numbers<12>, Headlamp, Lamps {
    fn and(self, later: Lamps) -> Lamps {
        Lamps([self.0, later.0].concat())
    }
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_three_finite_numbers() {
        assert_eq!("1,-2.5, 3e2".parse::<Numbers<3>>().unwrap(), Numbers([1.0, -2.5, 300.0]));
        for bad in ["", "1", "1,2", "1,2,3,4", "1,2,x", "1,2,inf", "1,NaN,2", "1 2 3"] {
            let message = bad.parse::<Numbers<3>>().unwrap_err().to_string();
            assert!(message.contains("like 1,2.5,-3"), "{bad}: {message}");
        }
        assert!("1".parse::<Numbers<2>>().unwrap_err().to_string().ends_with("like 1,2.5"));
    }

    #[test]
    fn degrees_heights_and_intensities_have_limits() {
        assert_eq!("40".parse::<Fov>().unwrap(), Fov(40.0));
        for bad in ["", "0", "-3", "180", "wide", "NaN"] {
            assert!(bad.parse::<Fov>().unwrap_err().to_string().contains("between 0 and 180"), "{bad}");
        }
        assert_eq!("2.5".parse::<Height>().unwrap(), Height(2.5));
        for bad in ["", "0", "-3", "inf", "NaN", "2m"] {
            assert!(bad.parse::<Height>().unwrap_err().to_string().contains("metres above 0"), "{bad}");
        }
        assert_eq!("auto".parse::<Headlamp>().unwrap(), Headlamp::Auto);
        assert_eq!("2.5".parse::<Headlamp>().unwrap(), Headlamp::Intensity(2.5));
        for bad in ["0", "-1", "inf", "1e39", "room.glb"] {
            assert!(bad.parse::<Headlamp>().unwrap_err().to_string().contains("a number above 0"), "{bad}");
        }
        assert!("0,1,2,5".parse::<Lamps>().is_ok());
        assert!("0,1,2".parse::<Lamps>().unwrap_err().to_string().contains("4 numbers"));
        assert!("0,1,2,0".parse::<Lamps>().unwrap_err().to_string().contains("intensity above 0"));
    }
}

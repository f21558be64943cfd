//! Values of settings, parsed from text. The command line and experiment files share one grammar, through `FromStr`.

use std::ffi::OsStr;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::de::{Deserialize, Deserializer, Error as _};
use serde::{Serialize, Serializer};

use crate::error::{Error, Result, SettingsError};
use crate::settings::aov::Aov;
use crate::settings::exposure::Exposure;
use crate::settings::frames::Frames;
use crate::settings::gates::Gates;
use crate::settings::optical_path::OpticalPath;
use crate::settings::pixels::Pixels;
use crate::settings::setting::{Value, value_from_text};
use crate::settings::units::{Depth, Gate, number};
use crate::settings::{
    Crop, Emitters, Estimator, Filter, Fireflies, GatePictures, Importance, Merge, Rays, Sampling, Strategies,
    ThinGlass, UseEllipsoids,
};

/// Width and height in pixels, such as `640x480`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resolution(pub [u32; 2]);

impl FromStr for Resolution {
    type Err = Error;

    fn from_str(text: &str) -> Result<Resolution> {
        let sides = text.trim().split_once(['x', 'X', '×']);
        let parsed = sides.and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
        parsed.map(Resolution).ok_or_else(|| {
            Error::advice(format!("'{text}' is not a resolution: "), "write width x height in pixels, like 640x480")
        })
    }
}

impl fmt::Display for Resolution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.0[0], self.0[1])
    }
}

impl FromStr for Crop {
    type Err = Error;

    fn from_str(text: &str) -> Result<Crop> {
        let wrong = |why: &str| {
            Error::advice(format!("'{text}' is not a crop{why}: "), "write x0,x1,y0,y1 in pixels, like 100,200,50,150")
        };
        let numbers: Vec<u32> =
            text.split(',').map(|n| n.trim().parse()).collect::<Result<_, _>>().map_err(|_| wrong(""))?;
        match numbers[..] {
            [x0, x1, y0, y1] if x0 < x1 && y0 < y1 => Ok(Crop { x0, y0, x1, y1 }),
            [_, _, _, _] => Err(wrong(" because it contains no pixel")),
            _ => Err(wrong(" because it does not have four numbers")),
        }
    }
}

impl fmt::Display for Crop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{},{},{},{}", self.x0, self.x1, self.y0, self.y1)
    }
}

/// Column and row of a pixel in the whole image, such as `120,80`. Row 0 is at the top.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pixel(pub [u32; 2]);

impl FromStr for Pixel {
    type Err = Error;

    fn from_str(text: &str) -> Result<Pixel> {
        let parsed = text.split_once(',').and_then(|(x, y)| Some([x.trim().parse().ok()?, y.trim().parse().ok()?]));
        parsed.map(Pixel).ok_or_else(|| {
            Error::advice(format!("'{text}' is not a pixel: "), "write its column and row, both from 0, like 120,80")
        })
    }
}

/// A duration in seconds, such as `30s`, `500ms`, `5min` or `1.5h`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seconds(pub f64);

impl FromStr for Seconds {
    type Err = Error;

    fn from_str(text: &str) -> Result<Seconds> {
        let trimmed = text.trim();
        let wrong =
            || Error::advice(format!("'{text}' is not a duration with a unit: "), "write it like 30s, 5min or 2h");
        let units = [("ms", 1e-3), ("min", 60.0), ("s", 1.0), ("h", 3600.0)];
        let (number, unit) =
            units.iter().find_map(|(name, size)| Some((trimmed.strip_suffix(name)?, size))).ok_or_else(wrong)?;
        let value: f64 = number.trim().parse().map_err(|_| wrong())?;
        Some(value * unit).filter(|s| s.is_finite() && *s > 0.0).map(Seconds).ok_or_else(wrong)
    }
}

impl fmt::Display for Seconds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}s", number(self.0))
    }
}

impl FromStr for Emitters {
    type Err = Error;

    /// Parses `scene`, or node names with commas between them. A name that contains commas is split here;
    /// [`crate::input::resolve::resolve`], which knows the names in the scene, joins its parts again.
    fn from_str(text: &str) -> Result<Emitters> {
        if text.trim() == "scene" {
            return Ok(Emitters::Scene);
        }
        emitter_names(text.split(',').map(|name| name.trim().to_string()).collect())
    }
}

fn emitter_names(names: Vec<String>) -> Result<Emitters> {
    if names.is_empty() || names.iter().any(String::is_empty) {
        return Err(Error::advice(
            "the list of emitters has an empty name: ",
            "write scene, or node names like beam,lamp",
        ));
    }
    Ok(Emitters::Nodes(names))
}

/// Serialises with `Display` and deserialises with `FromStr`, so that flag and key have the same grammar and the same messages.
macro_rules! serde_as_text {
    ($($type:ty),+) => {$(
        impl Serialize for $type {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(self)
            }
        }

        impl<'de> Deserialize<'de> for $type {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
            }
        }
    )+};
}

/// Like [`serde_as_text`], for types whose text is a list with `$separator` between its parts: an experiment file may also contain
/// a list of words or numbers.
macro_rules! serde_as_list {
    ($($type:ty, $separator:literal, $expecting:literal;)+) => {$(
        impl Serialize for $type {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(self)
            }
        }

        impl<'de> Deserialize<'de> for $type {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                #[derive(serde::Deserialize)]
                #[serde(untagged, expecting = $expecting)]
                enum Typed {
                    Text(String),
                    Words(Vec<String>),
                    Numbers(Vec<i64>),
                }
                let text = match Typed::deserialize(deserializer)? {
                    Typed::Text(text) => text,
                    Typed::Words(words) => words.join($separator),
                    Typed::Numbers(numbers) => {
                        numbers.iter().map(i64::to_string).collect::<Vec<_>>().join($separator)
                    }
                };
                text.parse().map_err(D::Error::custom)
            }
        }
    )+};
}

serde_as_text!(
    Frames,
    Gate,
    Gates,
    Depth,
    OpticalPath,
    Seconds,
    Estimator,
    Fireflies,
    Merge,
    Rays,
    Sampling,
    Strategies,
    ThinGlass,
    UseEllipsoids,
    Filter,
    GatePictures
);
serde_as_list! {
    Resolution, "x", "expected width and height, like \"640x480\" or [640, 480]";
    Crop, ",", "expected four numbers, like \"0,100,0,50\" or [0, 100, 0, 50]";
    Importance, ",", "expected \"all\", \"none\" or a list of factors";
    Aov, ",", "expected \"all\" or a list of layers";
}

value_from_text!(Gate, Gates, Depth, Resolution, Crop, Seconds, Estimator, Fireflies, Importance, Merge, Pixels, Rays, Sampling, Strategies, ThinGlass, UseEllipsoids, Filter, GatePictures, Aov, Exposure, Emitters {
    fn and(self, later: Emitters) -> Emitters {
        match (self, later) {
            (Emitters::Nodes(names), Emitters::Nodes(more)) => Emitters::Nodes([names, more].concat()),
            _ => Emitters::Scene,
        }
    }
});

/// Whether to write a tone-mapped picture, and its file name: `png = true` or `png = "picture.png"`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, serde::Deserialize)]
#[serde(untagged, expecting = "expected true, false or a file name")]
pub enum Png {
    /// Whether to write the picture under the default name: the output file with the extension .png.
    Wanted(bool),
    File(PathBuf),
}

impl Value for Png {
    fn parse(word: &OsStr) -> Result<Png, SettingsError> {
        Ok(if word.is_empty() { Png::Wanted(true) } else { Png::File(word.into()) })
    }

    fn paths(&mut self) -> Vec<&mut PathBuf> {
        match self {
            Png::File(path) => vec![path],
            Png::Wanted(_) => vec![],
        }
    }
}

/// Names of files or folders, for a setting that may be repeated. `$check` says why a name is not possible.
macro_rules! names {
    ($(#[doc = $about:literal] $type:ident, $check:expr, $expecting:literal;)+) => {$(
        #[doc = $about]
        #[derive(Debug, Clone, PartialEq, Eq, Serialize)]
        #[serde(transparent)]
        pub struct $type(pub Vec<PathBuf>);

        impl $type {
            fn new(names: Vec<PathBuf>) -> Result<$type, String> {
                let check: fn(&PathBuf) -> Option<&'static str> = $check;
                match names.iter().find_map(check) {
                    Some(message) => Err(message.into()),
                    None => Ok($type(names)),
                }
            }
        }

        impl Value for $type {
            fn parse(word: &OsStr) -> Result<$type, SettingsError> {
                Ok($type::new(vec![word.into()])?)
            }

            fn paths(&mut self) -> Vec<&mut PathBuf> {
                self.0.iter_mut().collect()
            }

            fn without_empty_names(mut self) -> Option<$type> {
                self.0.retain(|path| !path.as_os_str().is_empty());
                (!self.0.is_empty()).then_some(self)
            }

            fn and(self, later: $type) -> $type {
                $type([self.0, later.0].concat())
            }
        }

        impl<'de> Deserialize<'de> for $type {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                #[derive(serde::Deserialize)]
                #[serde(untagged, expecting = $expecting)]
                enum Typed {
                    One(PathBuf),
                    List(Vec<PathBuf>),
                }
                let names = match Typed::deserialize(deserializer)? {
                    Typed::One(name) => vec![name],
                    Typed::List(names) => names,
                };
                $type::new(names).map_err(D::Error::custom)
            }
        }
    )+};
}

names! {
    /// Names of folders.
    Folders,
    |name| name.as_os_str().is_empty().then_some("a folder has an empty name; write . for the current folder"),
    "expected the name of a folder or a list of such names";
    /// Names of files. In an experiment, an empty name counts as not given.
    Files, |_| None, "expected the name of a file or a list of such names";
}

impl Serialize for Emitters {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Emitters::Scene => serializer.serialize_str("scene"),
            Emitters::Nodes(names) => serializer.collect_seq(names),
        }
    }
}

impl<'de> Deserialize<'de> for Emitters {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(serde::Deserialize)]
        #[serde(untagged, expecting = "expected \"scene\", \"name,name\" or a list of node names")]
        enum Typed {
            Text(String),
            List(Vec<String>),
        }
        match Typed::deserialize(deserializer)? {
            Typed::Text(text) => text.parse(),
            Typed::List(names) => emitter_names(names),
        }
        .map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resolutions() {
        assert_eq!("640x480".parse::<Resolution>().unwrap(), Resolution([640, 480]));
        assert_eq!("640 x 480".parse::<Resolution>().unwrap().to_string(), "640x480");
        for bad in ["640", "640x", "x480", "-1x5", "640x480x3", "1e3x5", "99999999999x1"] {
            assert!(bad.parse::<Resolution>().unwrap_err().to_string().contains("640x480"), "{bad}");
        }
    }

    #[test]
    fn crops() {
        assert_eq!("1,5,2,4".parse::<Crop>().unwrap(), Crop { x0: 1, x1: 5, y0: 2, y1: 4 });
        for bad in ["1,5,2", "1,1,2,4", "5,1,2,4", "1,5,4,4", "a,b,c,d", "", "-1,5,2,4", "1,2,3,4,5"] {
            assert!(bad.parse::<Crop>().unwrap_err().to_string().contains("x0,x1,y0,y1"), "{bad}");
        }
    }

    #[test]
    fn pixels() {
        assert_eq!("120, 80".parse::<Pixel>().unwrap(), Pixel([120, 80]));
        for bad in ["120", "120x80", "-1,2", "1,2,3", "a,b", "", "99999999999,1"] {
            assert!(bad.parse::<Pixel>().unwrap_err().to_string().contains("120,80"), "{bad}");
        }
    }

    #[test]
    fn durations() {
        for (text, seconds) in [("30s", 30.0), ("1.5h", 5400.0), ("5min", 300.0), ("500 ms", 0.5)] {
            assert_eq!(text.parse::<Seconds>().unwrap(), Seconds(seconds), "{text}");
        }
        for bad in ["30", "s", "-3s", "0s", "NaNs", "infs", "30m", "1d"] {
            assert!(bad.parse::<Seconds>().unwrap_err().to_string().contains("30s"), "{bad}");
        }
    }

    #[test]
    fn emitters() {
        assert_eq!("scene".parse::<Emitters>().unwrap(), Emitters::Scene);
        assert_eq!("beam, lamp".parse::<Emitters>().unwrap(), Emitters::Nodes(vec!["beam".into(), "lamp".into()]));
        assert!("beam,,lamp".parse::<Emitters>().is_err());
        assert!("".parse::<Emitters>().is_err());
    }
}

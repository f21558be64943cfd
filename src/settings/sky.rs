//! The sky as the user gives it: a radiance, or the image of a sky; and a factor on it.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};

use crate::error::SettingsError;
use crate::files::has_extension;
use crate::settings::numbers::number;
use crate::settings::setting::Value;
use crate::settings::typed::{Typed, typed};

/// Where the light of the sky comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Sky {
    /// Radiance in W / (m^2 sr), the same in all directions, for red, green and blue. No channel is negative, and at least one is
    /// more than 0.
    Radiance([f64; 3]),
    /// An equirectangular image (EXR or Radiance HDR) of the radiance in W / (m^2 sr).
    Image(PathBuf),
}

impl Sky {
    /// One number for all channels, or three. `text` is what the user wrote.
    fn radiance(numbers: &[f64], text: &str) -> Result<Sky, String> {
        let rgb = match *numbers {
            [grey] => [grey; 3],
            [r, g, b] => [r, g, b],
            _ => return Err(Sky::unknown(text)),
        };
        match rgb.iter().all(|x| x.is_finite() && *x >= 0.0) && rgb.iter().any(|x| *x > 0.0) {
            true => Ok(Sky::Radiance(rgb)),
            false => Err(format!(
                "the sky has a radiance of {text}: write one number above 0, or R,G,B without negative numbers"
            )),
        }
    }

    fn unknown(text: &str) -> String {
        format!(
            "'{text}' is no sky: write a radiance in W/(m^2 sr), such as 1 or 0.4,0.6,1, or the name of an equirectangular image \
             that ends in .exr or .hdr"
        )
    }
}

/// Whether the name says that this is a Radiance HDR file.
pub(crate) fn is_radiance_hdr(path: &Path) -> bool {
    has_extension(path, "hdr")
}

impl Value for Sky {
    fn parse(word: &OsStr) -> Result<Sky, SettingsError> {
        let path = PathBuf::from(word);
        if has_extension(&path, "exr") || is_radiance_hdr(&path) {
            return Ok(Sky::Image(path));
        }
        let text = word.to_str().ok_or("this is not UTF-8")?;
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
        Ok(Sky::radiance(&numbers.map_err(|_| Sky::unknown(text))?, text)?)
    }

    fn paths(&mut self) -> Vec<&mut PathBuf> {
        match self {
            Sky::Image(path) => vec![path],
            Sky::Radiance(_) => vec![],
        }
    }
}

impl Serialize for Sky {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Sky::Radiance([r, g, b]) if r == g && g == b => serializer.serialize_f64(*r),
            Sky::Radiance(rgb) => serializer.collect_seq(rgb),
            Sky::Image(path) => path.serialize(serializer),
        }
    }
}

typed! { Sky, "expected a radiance like 1 or [0.4, 0.6, 1], or the name of an image":
    Typed::Number(grey) => Sky::radiance(&[grey], &grey.to_string()),
    Typed::List(list) => Sky::radiance(&list, &format!("{list:?}")),
    Typed::Text(text) => Sky::parse(text.as_ref()).map_err(|e| e.to_string()),
}

number! { "expected a number, like 2.5":
    /// A factor on the radiance of the sky, finite and more than 0.
    SkyScale, |factor| factor > 0.0 && factor.is_finite(), "a factor of the sky", "write a number above 0, like 2.5";
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::experiment::Experiment;

    #[test]
    fn a_sky_is_a_radiance_or_an_image() {
        let parse = |text: &str| Sky::parse(text.as_ref());
        assert_eq!(parse("2"), Ok(Sky::Radiance([2.0; 3])));
        assert_eq!(parse("0.5, 0,1e3"), Ok(Sky::Radiance([0.5, 0.0, 1000.0])));
        assert_eq!(parse("a,b.EXR"), Ok(Sky::Image("a,b.EXR".into())));
        for bad in ["", "blue", "1,2", "1,2,3,4", "sky.png", "1;2;3"] {
            assert!(parse(bad).unwrap_err().to_string().contains("is no sky: write"), "{bad}");
        }
        for bad in ["0", "0,0,0", "-1", "1,-1,1", "inf", "NaN"] {
            assert!(parse(bad).unwrap_err().to_string().contains("above 0"), "{bad}");
        }
        for bad in ["0", "-1", "inf", "NaN", "x"] {
            assert!(bad.parse::<SkyScale>().unwrap_err().to_string().contains("above 0"), "{bad}");
        }
    }

    #[test]
    fn skies_survive_printing() {
        for keys in ["sky = 2", "sky = [1, 0.5, 0]", "sky = 'a.exr'\nsky-scale = 3", "sky = '1,2,3'\nsky_scale = 0.5"] {
            let read = Experiment::parse(&format!("[emitter]\n{keys}\n")).unwrap_or_else(|e| panic!("{keys}: {e}"));
            assert_eq!(Experiment::parse(&read.to_toml()).unwrap(), read, "{keys}");
        }
    }
}

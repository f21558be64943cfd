//! The lens of a camera as the user gives it: distortion in OpenCV's order of coefficients, aperture and vignetting.

use std::ffi::OsStr;
use std::path::PathBuf;
use std::str::FromStr;

use serde::de::{Deserialize, Deserializer, Error as _};
use serde::{Serialize, Serializer};

use crate::error::{Error, Result, SettingsError};
use crate::files::has_extension;
use crate::scene::Distortion;
use crate::settings::numbers::number;
use crate::settings::setting::{Value, value_from_text};
use crate::settings::typed::{Typed, typed};
use crate::settings::units::length;

/// The distortion of a lens. Text: `k1,k2,p1,p2`, then optionally k3, and k4,k5,k6; or `fisheye:k1,k2,k3,k4`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LensDistortion(pub Distortion);

/// Marks the coefficients of a fisheye.
const FISHEYE: &str = "fisheye:";

impl LensDistortion {
    /// From the coefficients of OpenCV's `calibrateCamera`: k1, k2, p1, p2, then k3, then k4 to k6, then others that must be 0. `text` is
    /// what the user wrote.
    pub fn rational(k: &[f64], text: &str) -> Result<LensDistortion> {
        let is_known = matches!(k.len(), 4 | 5 | 8 | 12 | 14) && k.iter().all(|k| k.is_finite());
        if !is_known {
            return Err(Error::advice(
                format!("'{text}' is no lens distortion: "),
                "write k1,k2,p1,p2, then k3 and then k4,k5,k6 if there are any, like -0.28,0.09,0.001,0; or fisheye:k1,k2,k3,k4",
            ));
        }
        if k.iter().skip(8).any(|&k| k != 0.0) {
            return Err(Error::advice(
                format!("'{text}' has coefficients of thin prisms or a tilted sensor, which taugate does not know: "),
                "calibrate without CALIB_THIN_PRISM_MODEL and CALIB_TILTED_MODEL",
            ));
        }
        let at = |index: usize| k.get(index).copied().unwrap_or(0.0);
        let radial = [at(0), at(1), at(4), at(5), at(6), at(7)];
        Ok(LensDistortion(Distortion::Rational { radial, tangential: [at(2), at(3)] }))
    }

    /// From the four coefficients of OpenCV's `fisheye::calibrate`.
    pub fn fisheye(k: &[f64], text: &str) -> Result<LensDistortion> {
        match <[f64; 4]>::try_from(k) {
            Ok(k) if k.iter().all(|k| k.is_finite()) => Ok(LensDistortion(Distortion::Fisheye(k))),
            _ => Err(Error::advice(
                format!("'{text}' is no fisheye lens: "),
                "write its four coefficients, like fisheye:0.03,-0.01,0.004,-0.0007",
            )),
        }
    }

    /// The coefficients in OpenCV's order: eight, or four of a fisheye. Empty without a distortion.
    pub fn coefficients(&self) -> Vec<f64> {
        match self.0 {
            Distortion::None => vec![],
            Distortion::Rational { radial: [k1, k2, k3, k4, k5, k6], tangential: [p1, p2] } => {
                vec![k1, k2, p1, p2, k3, k4, k5, k6]
            }
            Distortion::Fisheye(k) => k.to_vec(),
        }
    }
}

impl FromStr for LensDistortion {
    type Err = Error;

    fn from_str(text: &str) -> Result<LensDistortion> {
        let numbers = |list: &str| -> Vec<f64> {
            let all: Result<Vec<f64>, _> = list.split(',').map(|k| k.trim().parse()).collect();
            all.unwrap_or_default()
        };
        match text.trim().strip_prefix(FISHEYE) {
            Some(k) => LensDistortion::fisheye(&numbers(k), text),
            None => LensDistortion::rational(&numbers(text), text),
        }
    }
}

impl Serialize for LensDistortion {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let k = self.coefficients();
        match self.0 {
            Distortion::Fisheye(_) => {
                let words: Vec<String> = k.iter().map(f64::to_string).collect();
                serializer.serialize_str(&format!("{FISHEYE}{}", words.join(",")))
            }
            _ => serializer.collect_seq(k),
        }
    }
}

typed! { LensDistortion, "expected coefficients like [-0.28, 0.09, 0.001, 0], or text like \"fisheye:0.03,-0.01,0.004,0\"":
    Typed::Text(text) => text.parse(),
    Typed::List(list) => LensDistortion::rational(&list, &format!("{list:?}")),
}

value_from_text!(LensDistortion);

/// The diameter of an aperture in metres: a length such as `8mm`, or an f-number and a focal length, `f/2.8@35mm`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ApertureDiameter(pub f64);

impl Serialize for ApertureDiameter {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&format_args!("{}m", self.0))
    }
}

impl FromStr for ApertureDiameter {
    type Err = Error;

    fn from_str(text: &str) -> Result<ApertureDiameter> {
        let wrong = |remedy: &str| Error::advice(format!("'{text}' is no aperture: "), remedy);
        let metres = |text: &str| length(text).filter(|metres| *metres > 0.0 && metres.is_finite());
        let diameter = match text.trim().strip_prefix("f/") {
            None => metres(text),
            Some(ratio) => {
                let (number, focal) = ratio.split_once('@').ok_or_else(|| {
                    wrong("an f-number alone has no diameter; add the focal length, like f/2.8@35mm, or write the diameter, like 12mm")
                })?;
                let number = number.trim().parse().ok().filter(|number| *number > 0.0);
                metres(focal).zip(number).map(|(focal, number): (f64, f64)| focal / number)
            }
        };
        diameter.map(ApertureDiameter).ok_or_else(|| {
            wrong("write its diameter with a unit, like 8mm, or an f-number and the focal length, like f/2.8@35mm")
        })
    }
}

typed! { ApertureDiameter, "expected a diameter like \"8mm\", or \"f/2.8@35mm\"":
    Typed::Text(text) => text.parse(),
    Typed::Number(metres) => format!("{metres}m").parse(),
}

number! { "expected a number of metres, like 2.5":
    /// The distance of the plane in focus from the camera in metres, more than 0; it may be infinite.
    Focus, |metres| metres > 0.0, "a distance in focus", "write metres above 0, like 2.5, or inf";
}

value_from_text!(ApertureDiameter);

/// How much light reaches the border of the image: `cos4`, or the file of a table that ends in .csv.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum VignettingChoice {
    Cos4,
    /// A CSV file of angles in degrees and shares.
    Table(PathBuf),
}

const COS4: &str = "cos4";

impl Value for VignettingChoice {
    fn parse(word: &OsStr) -> Result<VignettingChoice, SettingsError> {
        let path = PathBuf::from(word);
        if has_extension(&path, "csv") {
            return Ok(VignettingChoice::Table(path));
        }
        if word == COS4 {
            return Ok(VignettingChoice::Cos4);
        }
        Err(SettingsError::advice(
            format!("'{}' is no vignetting: ", word.display()),
            "write cos4, or the name of a table of angles in degrees and shares of the light that ends in .csv",
        ))
    }

    fn paths(&mut self) -> Vec<&mut PathBuf> {
        match self {
            VignettingChoice::Table(path) => vec![path],
            VignettingChoice::Cos4 => vec![],
        }
    }
}

impl Serialize for VignettingChoice {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            VignettingChoice::Table(path) => path.serialize(serializer),
            VignettingChoice::Cos4 => serializer.serialize_str(COS4),
        }
    }
}

impl<'de> Deserialize<'de> for VignettingChoice {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        VignettingChoice::parse(text.as_ref()).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_have_the_order_of_opencv() {
        let parsed = |text: &str| text.parse::<LensDistortion>().unwrap().0;
        let rational = |radial: [f64; 6], tangential: [f64; 2]| Distortion::Rational { radial, tangential };
        assert_eq!(parsed("1,2,3,4"), rational([1.0, 2.0, 0.0, 0.0, 0.0, 0.0], [3.0, 4.0]));
        assert_eq!(parsed("1,2,3,4,5"), rational([1.0, 2.0, 5.0, 0.0, 0.0, 0.0], [3.0, 4.0]));
        assert_eq!(parsed("1,2,3,4,5,6,7,8"), rational([1.0, 2.0, 5.0, 6.0, 7.0, 8.0], [3.0, 4.0]));
        assert_eq!(parsed("1,2,3,4,5,6,7,8,0,0,0,0"), parsed("1,2,3,4,5,6,7,8"));
        assert_eq!(parsed("fisheye: 1,2,3,4"), Distortion::Fisheye([1.0, 2.0, 3.0, 4.0]));
    }

    #[test]
    fn other_texts_are_refused_with_a_remedy() {
        let message = |text: &str| text.parse::<LensDistortion>().unwrap_err().to_string();
        for text in ["", "1,2,3", "1,2,3,4,5,6", "1,2,3,x", "nan,0,0,0"] {
            assert!(message(text).contains("write k1,k2,p1,p2"), "{text}");
        }
        assert!(message("fisheye:1,2,3").contains("write its four coefficients"));
        assert!(message("1,2,3,4,5,6,7,8,1,0,0,0").contains("thin prisms"));
    }

    #[test]
    fn apertures_are_diameters_or_f_numbers_with_a_focal_length() {
        let metres = |text: &str| text.parse::<ApertureDiameter>().map(|diameter| diameter.0);
        assert_eq!(metres("8mm").unwrap(), 0.008);
        assert!((metres("f/2.8@35mm").unwrap() - 0.0125).abs() < 1e-12);
        assert!(metres("f/2.8").unwrap_err().to_string().contains("add the focal length"));
        for text in ["8", "-1mm", "f/0@35mm", "f/2@", "wide", "infm"] {
            assert!(metres(text).unwrap_err().to_string().contains("like 8mm"), "{text}");
        }
    }

    #[test]
    fn a_vignetting_is_cos4_or_a_table() {
        assert_eq!(VignettingChoice::parse("cos4".as_ref()), Ok(VignettingChoice::Cos4));
        assert_eq!(VignettingChoice::parse("a/b.CSV".as_ref()), Ok(VignettingChoice::Table("a/b.CSV".into())));
        for bad in ["", "cos3", "lens.txt"] {
            assert!(VignettingChoice::parse(bad.as_ref()).unwrap_err().to_string().contains("write cos4"), "{bad}");
        }
    }

    #[test]
    fn what_is_written_is_read_again() {
        for text in ["-0.25,0.1,0.001,0,0.01,0,0,0", "fisheye:0.03,-0.01,0.004,0"] {
            let lens: LensDistortion = text.parse().unwrap();
            let json = serde_json::to_string(&lens).unwrap();
            assert_eq!(serde_json::from_str::<LensDistortion>(&json).unwrap(), lens, "{json}");
        }
        // Also as a flag, which needs the unit.
        let json = serde_json::to_string(&ApertureDiameter(0.008)).unwrap();
        assert_eq!(json, "\"0.008m\"");
        assert_eq!(serde_json::from_str::<ApertureDiameter>(&json).unwrap(), ApertureDiameter(0.008));
    }
}

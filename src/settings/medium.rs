//! Values of the settings of a medium: coefficients, visibilities, parameters of phase functions, and bounds.

use std::str::FromStr;

use serde::de::{Deserialize, Deserializer, Error as _};
use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::settings::numbers::{Numbers, number};
use crate::settings::setting::value_from_text;
use crate::settings::typed::{Typed, typed};
use crate::settings::units::length;

/// A coefficient per metre for red, green and blue, each >= 0. The user writes one number, or three.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coefficient(pub [f64; 3]);

impl Coefficient {
    fn new(numbers: &[f64], text: &str) -> Result<Coefficient> {
        let rgb = match *numbers {
            [grey] => [grey; 3],
            [r, g, b] => [r, g, b],
            _ => [f64::NAN; 3],
        };
        match rgb.iter().all(|x| x.is_finite() && *x >= 0.0) {
            true => Ok(Coefficient(rgb)),
            false => Err(Error::advice(
                format!("'{text}' is not a coefficient per metre: "),
                "write one number from 0, like 0.04, or three for red, green and blue, like 0.04,0.05,0.07",
            )),
        }
    }
}

impl FromStr for Coefficient {
    type Err = Error;

    fn from_str(text: &str) -> Result<Coefficient> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
        Coefficient::new(&numbers.unwrap_or_default(), text)
    }
}

impl Serialize for Coefficient {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            [r, g, b] if r == g && g == b => serializer.serialize_f64(r),
            rgb => serializer.collect_seq(rgb),
        }
    }
}

typed! { Coefficient, "expected a number, a list of numbers, or text":
    Typed::Text(text) => text.parse(),
    Typed::Number(number) => Coefficient::new(&[number], &number.to_string()),
    Typed::List(list) => Coefficient::new(&list, &format!("{list:?}")),
}

number! { "expected a number, a list of numbers, or text":
    /// A share from 0 to 1.
    Share, |share| (0.0..=1.0).contains(&share), "a share", "write a number from 0 to 1, like 0.99";

    /// The mean cosine of a scattering lobe, between -1 and 1.
    MeanCosine, |g| (-0.999..=0.999).contains(&g), "a mean cosine", "write a number from -0.999 to 0.999, like 0.8";

    /// The parameter alpha of a lobe of Draine.
    Alpha, |alpha| (0.0..=1e6).contains(&alpha), "an alpha of Draine", "write a number from 0 to 1000000, like 20";

    /// An index of refraction, or a group index.
    RefractiveIndex, |n| (1.0..=5.0).contains(&n), "an index of refraction", "write a number from 1 to 5, like 1.33";

    /// The diameter of water droplets in micrometres.
    DropletDiameter, |d| (5.0..=50.0).contains(&d), "a droplet diameter", "write a number of micrometres from 5 to 50, like 15";
}

/// A length in metres, more than 0, that the user writes with its unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distance(pub f64);

impl FromStr for Distance {
    type Err = Error;

    fn from_str(text: &str) -> Result<Distance> {
        length(text).filter(|metres| *metres > 0.0).map(Distance).ok_or_else(|| {
            Error::advice(format!("'{text}' is not a distance: "), "write a number above 0 with its unit, like 60m")
        })
    }
}

impl Serialize for Distance {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&format_args!("{}m", self.0))
    }
}

impl<'de> Deserialize<'de> for Distance {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}

/// Two opposite corners of a box, in metres: first the smaller coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds(pub [[f64; 3]; 2]);

impl FromStr for Bounds {
    type Err = Error;

    fn from_str(text: &str) -> Result<Bounds> {
        let Numbers([x0, y0, z0, x1, y1, z1]) = text.parse::<Numbers<6>>().map_err(|_| {
            Error::advice(
                format!("'{text}' is not a box: "),
                "write its two corners as X,Y,Z,X,Y,Z, like -1,0,-1,1,2,1",
            )
        })?;
        Ok(Bounds([[x0, y0, z0], [x1, y1, z1]]))
    }
}

impl Serialize for Bounds {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Bounds {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(serde::Deserialize)]
        #[serde(untagged, expecting = "expected two corners, like [[-1, 0, -1], [1, 2, 1]]")]
        enum Corners {
            Text(String),
            Pair([[f64; 3]; 2]),
        }
        match Corners::deserialize(deserializer)? {
            Corners::Text(text) => text.parse().map_err(D::Error::custom),
            Corners::Pair(pair) => Ok(Bounds(pair)),
        }
    }
}

value_from_text!(Coefficient, Distance, Bounds);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_ranges() {
        assert_eq!("0.04".parse::<Coefficient>().unwrap(), Coefficient([0.04; 3]));
        assert_eq!("1, 2,3".parse::<Coefficient>().unwrap(), Coefficient([1.0, 2.0, 3.0]));
        for bad in ["", "-1", "1,2", "1,2,NaN", "inf", "fog"] {
            assert!(bad.parse::<Coefficient>().unwrap_err().to_string().contains("like 0.04"), "{bad}");
        }
        for bad in ["", "1", "-1", "NaN", "0.9995"] {
            assert!(bad.parse::<MeanCosine>().unwrap_err().to_string().contains("like 0.8"), "{bad}");
        }
        for bad in ["", "4.9", "51", "NaN", "15um"] {
            assert!(bad.parse::<DropletDiameter>().unwrap_err().to_string().contains("from 5 to 50"), "{bad}");
        }
        assert!("-1".parse::<Alpha>().is_err() && "1e7".parse::<Alpha>().is_err());
        assert!("1.01".parse::<Share>().is_err() && "-0.1".parse::<Share>().is_err());
        assert_eq!("0.1km".parse::<Distance>().unwrap(), Distance(100.0));
        for bad in ["", "60", "-3m", "0m", "inf", "60ns", "3m4"] {
            assert!(bad.parse::<Distance>().unwrap_err().to_string().contains("like 60m"), "{bad}");
        }
        assert_eq!("0,1,2,3,4,5".parse::<Bounds>().unwrap(), Bounds([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]));
        assert!("0,1,2".parse::<Bounds>().unwrap_err().to_string().contains("two corners"));
    }
}

//! Name of a phase function, or of the file with its table.

use std::ffi::OsStr;
use std::path::PathBuf;

use serde::de::{Deserialize, Deserializer, Error as _};
use serde::{Serialize, Serializer};

use crate::error::SettingsError;
use crate::files::has_extension;
use crate::settings::setting::Value;

/// A phase function as the user names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Phase {
    Isotropic,
    /// One Henyey-Greenstein lobe.
    Hg,
    /// Two Henyey-Greenstein lobes.
    DoubleHg,
    /// A Henyey-Greenstein lobe and a lobe of Draine.
    Draine,
    Rayleigh,
    /// A CSV file of cosines and values.
    Table(PathBuf),
}

/// The settings that are parameters of phase functions.
pub const PARAMETERS: [&str; 5] = ["phase-g", "phase-g2", "phase-weight", "phase-alpha", "droplet-diameter"];

impl Phase {
    /// The settings that are parameters of this one. `has_droplets`: whether the user gave a droplet diameter, which sets all parameters of `Draine`.
    pub fn parameters(&self, has_droplets: bool) -> &'static [&'static str] {
        match self {
            Phase::Isotropic | Phase::Rayleigh | Phase::Table(_) => &[],
            Phase::Hg => &PARAMETERS[..1],
            Phase::DoubleHg => &PARAMETERS[..3],
            Phase::Draine if has_droplets => &PARAMETERS[4..],
            Phase::Draine => &PARAMETERS[..4],
        }
    }
}

const NAMES: [(&str, Phase); 5] = [
    ("isotropic", Phase::Isotropic),
    ("hg", Phase::Hg),
    ("double-hg", Phase::DoubleHg),
    ("draine", Phase::Draine),
    ("rayleigh", Phase::Rayleigh),
];

impl Value for Phase {
    fn parse(word: &OsStr) -> Result<Phase, SettingsError> {
        let path = PathBuf::from(word);
        if has_extension(&path, "csv") {
            return Ok(Phase::Table(path));
        }
        let named = NAMES.into_iter().find(|(name, _)| word == *name);
        named.map(|(_, phase)| phase).ok_or_else(|| {
            SettingsError::advice(
                format!("'{}' is not a phase function: ", word.display()),
                "write isotropic, hg, double-hg, draine, rayleigh, or the name of a table that ends in .csv",
            )
        })
    }

    fn paths(&mut self) -> Vec<&mut PathBuf> {
        match self {
            Phase::Table(path) => vec![path],
            _ => vec![],
        }
    }
}

impl Serialize for Phase {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Phase::Table(path) => path.serialize(serializer),
            named => {
                let name = NAMES.iter().find(|(_, phase)| phase == named).map_or("", |(name, _)| name);
                serializer.serialize_str(name)
            }
        }
    }
}

impl<'de> Deserialize<'de> for Phase {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        Phase::parse(text.as_ref()).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::experiment::Experiment;

    #[test]
    fn a_phase_function_is_a_name_or_a_table() {
        for (name, phase) in NAMES {
            assert_eq!(Phase::parse(name.as_ref()), Ok(phase));
        }
        assert_eq!(Phase::parse("a/fog.CSV".as_ref()), Ok(Phase::Table("a/fog.CSV".into())));
        for bad in ["", "HG", "mie", "fog.txt"] {
            assert!(
                Phase::parse(bad.as_ref()).unwrap_err().to_string().contains("is not a phase function: write"),
                "{bad}"
            );
        }
        for name in ["double-hg", "draine", "fog.csv"] {
            let read = Experiment::parse(&format!("[medium]\nphase = '{name}'\n")).unwrap();
            assert_eq!(Experiment::parse(&read.to_toml()).unwrap(), read, "{name}");
        }
    }
}

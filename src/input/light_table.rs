//! `[[light]]` of an experiment file: a light that the user adds to the scene.

use glam::DVec3;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::scene::{Light, LightKind};
use crate::settings::keys::Dashed;
use crate::settings::numbers::Numbers;

/// Half angle of a spot's cone in degrees, if the user gives none: as in glTF.
const DEFAULT_OUTER_ANGLE: f64 = 45.0;

/// A light as the user wrote it. Reading a file checks it, so [`LightTable::light`] cannot fail afterwards.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self", deny_unknown_fields, rename_all = "kebab-case")]
pub struct LightTable {
    /// Name for `emitters`; by default `light-1` for the first table, `light-2` for the second, and so on.
    pub name: Option<String>,
    #[serde(rename = "type")]
    pub kind: Kind,
    /// World space, in metres.
    pub position: Numbers<3>,
    /// Spots and beams need either a direction (any length above 0) or a target (a point, in metres).
    pub direction: Option<Numbers<3>>,
    pub target: Option<Numbers<3>>,
    /// W / sr, for points and spots.
    pub intensity: Option<Strength>,
    /// W, for beams.
    pub power: Option<Strength>,
    /// Half angles of a spot's cone in degrees, see [`LightKind::Spot`].
    pub inner_angle: Option<f64>,
    pub outer_angle: Option<f64>,
    /// Radius of a beam in metres, >= 0.
    pub radius: Option<f64>,
}

/// Type of a light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    Point,
    Spot,
    Beam,
}

/// One number for all channels, or one for each of red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected one number, or three numbers for red, green and blue")]
pub enum Strength {
    Grey(f64),
    Rgb([f64; 3]),
}

impl Strength {
    fn rgb(self) -> [f32; 3] {
        match self {
            Strength::Grey(value) => [value as f32; 3],
            Strength::Rgb(rgb) => rgb.map(|value| value as f32),
        }
    }
}

impl LightTable {
    /// The light of table `number`, counted from 1. Fails with one sentence if a key is missing, does not belong to the type of
    /// light, or is out of range.
    pub fn light(&self, number: usize) -> Result<Light, String> {
        let node = self.name.clone().unwrap_or_else(|| format!("light-{number}"));
        let (kind, direction) = match self.kind {
            Kind::Point => {
                self.refuse(&["direction", "target", "power", "inner-angle", "outer-angle", "radius"])?;
                (LightKind::Point { intensity: self.intensity()? }, DVec3::NEG_Z)
            }
            Kind::Spot => {
                self.refuse(&["power", "radius"])?;
                (self.spot()?, self.axis()?)
            }
            Kind::Beam => {
                self.refuse(&["intensity", "inner-angle", "outer-angle"])?;
                let power =
                    self.power.ok_or("a beam needs a power in W: one number, or three for red, green and blue")?;
                let radius = self.radius.ok_or("a beam needs a radius in metres; 0 is a thin ray")?;
                (LightKind::Beam { power: power.rgb(), radius: radius as f32 }, self.axis()?)
            }
        };
        let light = Light { node, position: self.position.0.into(), direction, kind };
        light.check()?;
        Ok(light)
    }

    /// Fails if the user gave one of these keys.
    fn refuse(&self, keys: &[&str]) -> Result<(), String> {
        let given = [
            ("direction", self.direction.is_some()),
            ("target", self.target.is_some()),
            ("intensity", self.intensity.is_some()),
            ("power", self.power.is_some()),
            ("inner-angle", self.inner_angle.is_some()),
            ("outer-angle", self.outer_angle.is_some()),
            ("radius", self.radius.is_some()),
        ];
        let kind = format!("{:?}", self.kind).to_lowercase();
        match given.iter().find(|(key, given)| *given && keys.contains(key)) {
            Some((key, _)) => Err(format!("a {kind} light has no {key}: remove this key, or choose another type")),
            None => Ok(()),
        }
    }

    fn intensity(&self) -> Result<[f32; 3], String> {
        let intensity = self
            .intensity
            .ok_or("this light needs an intensity in W/sr: one number, or three for red, green and blue")?;
        Ok(intensity.rgb())
    }

    fn spot(&self) -> Result<LightKind, String> {
        let outer = self.outer_angle.unwrap_or(DEFAULT_OUTER_ANGLE);
        let inner = self.inner_angle.unwrap_or(0.0);
        if !(inner >= 0.0 && inner <= outer && outer > 0.0 && outer <= 90.0) {
            return Err(format!(
                "a spot needs 0 <= inner-angle <= outer-angle <= 90 (half angles in degrees), not {inner} and {outer}"
            ));
        }
        let [inner, outer] = [inner, outer].map(|degrees| degrees.to_radians() as f32);
        Ok(LightKind::spot(self.intensity()?, inner, outer))
    }

    /// Unit vector along which the light shines.
    fn axis(&self) -> Result<DVec3, String> {
        let axis = match (self.direction, self.target) {
            (Some(direction), None) => DVec3::from(direction.0),
            (None, Some(target)) => DVec3::from(target.0) - DVec3::from(self.position.0),
            _ => return Err("this light needs either a direction or a target".into()),
        };
        axis.try_normalize().ok_or_else(|| "the direction of this light has no length".into())
    }
}

// `remote = "Self"` derives inherent functions of these names; the traits add checks and dashes.
impl Serialize for LightTable {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        LightTable::serialize(self, serializer)
    }
}

impl<'de> Deserialize<'de> for LightTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<LightTable, D::Error> {
        let table = LightTable::deserialize(Dashed(deserializer, |key| key))?;
        table.light(1).map_err(D::Error::custom)?;
        Ok(table)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::experiment::Experiment;

    fn parse(keys: &str) -> Result<Light, String> {
        let experiment = Experiment::parse(&format!("[[light]]\n{keys}")).map_err(|e| e.to_string())?;
        assert_eq!(Experiment::parse(&experiment.to_toml()).unwrap(), experiment, "{}", experiment.to_toml());
        experiment.light[0].light(1)
    }

    #[test]
    fn lights_of_each_type_are_read_and_survive_printing() {
        let point = parse("type = 'point'\nposition = [1, 2, 3.5]\nintensity = 5").unwrap();
        assert_eq!((point.node.as_str(), point.position), ("light-1", DVec3::new(1.0, 2.0, 3.5)));
        assert_eq!(point.kind, LightKind::Point { intensity: [5.0; 3] });
        let spot =
            "name = 's'\ntype = 'spot'\nposition = '0,2,0'\ntarget = '0,1,0'\nintensity = [1, 2, 3]\ninner_angle = 9\n";
        let spot = parse(&format!("{spot}outer-angle = 18")).unwrap();
        assert_eq!((spot.node.as_str(), spot.direction), ("s", DVec3::NEG_Y));
        assert_eq!(spot.kind, LightKind::spot([1.0, 2.0, 3.0], 9f32.to_radians(), 18f32.to_radians()));
        let beam =
            parse("type = 'beam'\nposition = [0, 0, 0]\ndirection = [0, 0, -2]\npower = 4\nradius = 0.5").unwrap();
        assert_eq!((beam.direction, beam.kind), (DVec3::NEG_Z, LightKind::Beam { power: [4.0; 3], radius: 0.5 }));
    }

    #[test]
    fn mistakes_name_the_key() {
        let spot = "type = 'spot'\nposition = [0, 0, 0]\nintensity = 1\n";
        let table = [
            ("type = 'point'\nposition = [0, 0, 0]".to_string(), "needs an intensity"),
            ("type = 'sun'\nposition = [0, 0, 0]".into(), "cannot be \"sun\""),
            ("type = 'point'\nintensity = 3".into(), "needs the key position"),
            ("type = 'point'\nposition = [0, 0]\nintensity = 3".into(), "3 numbers"),
            ("type = 'point'\nposition = [0, 0, 0]\nintensity = -3".into(), "negative"),
            ("type = 'point'\nposition = [0, 0, 0]\nintensity = 1e40".into(), "not finite"),
            ("type = 'point'\nposition = [0, 0, 1e99]\nintensity = 1".into(), "from the origin"),
            ("type = 'point'\nposition = [0, 0, 0]\nintensity = [1, 2]".into(), "three numbers"),
            ("type = 'point'\nposition = [0, 0, 0]\nintensity = 1\nradius = 2".into(), "a point light has no radius"),
            (spot.into(), "either a direction or a target"),
            (format!("{spot}target = [0, 0, 0]"), "has no length"),
            (format!("{spot}target = [0, 0, 1]\nouter-angle = 91"), "outer-angle <= 90"),
            (format!("{spot}target = [0, 0, 1]\ninner-angle = 60"), "not 60 and 45"),
            ("type = 'beam'\nposition = [0, 0, 0]\ntarget = [1, 0, 0]\npower = 1".into(), "needs a radius"),
            ("type = 'beam'\nposition = [0, 0, 0]\ntarget = [1, 0, 0]\nradius = 1".into(), "needs a power"),
        ];
        for (keys, part) in table {
            let message = parse(&keys).expect_err(&keys);
            assert!(message.contains(part), "{keys}: {message}");
        }
    }
}

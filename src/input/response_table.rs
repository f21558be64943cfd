//! `[[response]]` of an experiment file: a response in a table of its own.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use crate::settings::Edge;
use crate::settings::keys::Dashed;
use crate::settings::response_specs::{ResponseSpec, Shape, check_name};
use crate::settings::units::{Depth, Gate};

/// A response as `[[response]]` gives it: the same as one `--response`, with a key for each part.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseTable(pub ResponseSpec);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    /// Name of the response; by default the shape.
    name: Option<String>,
    /// The gate, or the same as a range of depths; by default that of `[gate]`.
    gate: Option<Gate>,
    depth: Option<Depth>,
    /// `box`, `trapezoid:RISE`, `gauss:SIGMA` or `FILE.csv`; by default `box`.
    shape: Option<String>,
}

impl Keys {
    /// Fails with one sentence if keys exclude each other, or if the name or the shape is not valid.
    fn spec(self) -> Result<ResponseSpec, String> {
        let Keys { name, gate, depth, shape } = self;
        if gate.is_some() && depth.is_some() {
            return Err("[[response]] has gate and depth, which both set its gate: keep one".into());
        }
        name.as_deref().map_or(Ok(()), check_name).map_err(|e| e.to_string())?;
        let gate = gate.or(depth.map(|depth| depth.0));
        let Some(shape) = shape else {
            return Ok(ResponseSpec { name, shape: Shape::Gate { edge: Edge::Sharp, gate } });
        };
        let shape: ResponseSpec = shape.parse().map_err(|e: crate::Error| e.to_string())?;
        match shape {
            ResponseSpec { name: Some(_), .. } | ResponseSpec { shape: Shape::Gate { gate: Some(_), .. }, .. } => {
                Err("the shape of a [[response]] must not contain a name or a gate: use the keys name and gate".into())
            }
            ResponseSpec { shape: Shape::Table(_), .. } if gate.is_some() => {
                Err("a [[response]] from a table has the travel times of the table: remove its gate".into())
            }
            ResponseSpec { shape: Shape::Table(path), .. } => Ok(ResponseSpec { name, shape: Shape::Table(path) }),
            ResponseSpec { shape: Shape::Gate { edge, .. }, .. } => {
                Ok(ResponseSpec { name, shape: Shape::Gate { edge, gate } })
            }
        }
    }
}

impl<'de> Deserialize<'de> for ResponseTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let keys = Keys::deserialize(Dashed(deserializer, |key| key))?;
        keys.spec().map(ResponseTable).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use crate::input::experiment::Experiment;

    #[test]
    fn tables_are_the_same_as_flags() {
        let tables = "[[response]]\nname = 'near'\ngate = '10m..11m'\nshape = 'gauss:0.1m'\n[[response]]\nname = 'far'\ndepth = '6m..7m'\n\
                      [[response]]\nshape = 'laser.csv'\n";
        let flags = "[gate]\nresponse = ['near=gauss:10m..11m,0.1m', 'far=box:12m..14m', 'laser.csv']\n";
        assert_eq!(Experiment::parse(tables), Experiment::parse(flags));
        // One file may have the key and the tables. The tables come last.
        let both = Experiment::parse(&format!("{flags}[[response]]\nname = 'more'\n")).unwrap();
        let specs = both.gate.response.clone().unwrap().0;
        assert_eq!((specs.len(), specs[3].name.as_deref()), (4, Some("more")));
        assert_eq!(Experiment::parse(&both.to_toml()), Ok(both));
    }

    #[test]
    fn mistakes_get_one_sentence() {
        for (keys, part) in [
            ("gate = '1m..2m'\ndepth = '1m..2m'", "keep one"),
            ("shape = 'triangle'", "is not a response"),
            ("shape = 'gauss:1m..2m,0.1m'", "use the keys name and gate"),
            ("shape = 'a=gauss:0.1m'", "use the keys name and gate"),
            ("shape = 'a.csv'\ngate = '1m..2m'", "remove its gate"),
            ("name = 'a.b'", "must not be empty or contain a dot"),
            ("name = ' '", "spaces at its ends"),
            ("name = 'a=b'", "an equals sign"),
            ("name = 'a/b'", "a slash"),
            ("gte = '1m..2m'", "has no key gte: choose one of name, gate, depth, shape"),
        ] {
            let error = Experiment::parse(&format!("[[response]]\n{keys}\n")).unwrap_err();
            assert!(error.mistake.to_string().contains(part), "{keys}: {error}");
        }
    }
}

//! Responses as the user writes them: a name, a shape, and a gate or the file of a table.

use std::ffi::OsStr;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::de::{Deserialize, Deserializer, Error as _};
use serde::{Serialize, Serializer};

use crate::error::{Error, Result, SettingsError};
use crate::settings::response::{Edge, Response};
use crate::settings::setting::Value;
use crate::settings::table::GateTable;
use crate::settings::units::{Gate, number, path_length};

const HOW_TO_WRITE: &str = "write box, trapezoid:RISE, gauss:SIGMA or the name of a table FILE.csv; with a name and a gate of its own it is like \
     near=gauss:10m..11m,0.1m";

/// The shape of a response, and its gate if it has one of its own.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A gate with edges.
    Gate { edge: Edge, gate: Option<Gate> },
    /// The file of a table.
    Table(PathBuf),
}

/// One response as the user writes it.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseSpec {
    pub name: Option<String>,
    pub shape: Shape,
}

impl ResponseSpec {
    /// A shape around gates that are given elsewhere.
    pub fn around(edge: Edge) -> ResponseSpec {
        ResponseSpec { name: None, shape: Shape::Gate { edge, gate: None } }
    }

    /// Whether the response needs no other gate.
    pub fn has_own_gate(&self) -> bool {
        !matches!(self.shape, Shape::Gate { gate: None, .. })
    }

    /// Whether the response only gives the edges of gates, so that it fits any number of gates.
    pub fn is_only_edges(&self) -> bool {
        self.name.is_none() && !self.has_own_gate()
    }

    /// The text of a response; `None` for a table that comes from no file.
    pub fn of(response: &Response) -> Option<ResponseSpec> {
        let shape = match response.edge() {
            Some(edge) => Shape::Gate { edge, gate: Some(response.gate()) },
            None => Shape::Table(response.file()?.into()),
        };
        Some(ResponseSpec { name: Some(response.name().into()), shape })
    }
}

impl GateTable {
    /// Prepares this table for settings of `above` that replace its own: a gate replaces responses that have no use for one, and
    /// responses with gates of their own replace a gate.
    pub fn leave_responses_to(&mut self, above: &GateTable) {
        let GateTable { gate, depth, gates, response, gate_keys, .. } = above;
        match response {
            Some(ResponseSpecs(specs)) if specs.iter().all(ResponseSpec::has_own_gate) => {
                (self.gate, self.depth, self.gates, self.gate_keys) = (None, None, None, None);
            }
            Some(_) => {}
            None if gates.is_some() => {
                self.response.take_if(|ResponseSpecs(specs)| !matches!(&specs[..], [spec] if spec.is_only_edges()));
            }
            None if gate.is_some() || depth.is_some() || gate_keys.is_some() => {
                self.response.take_if(|ResponseSpecs(specs)| specs.iter().all(ResponseSpec::has_own_gate));
            }
            None => {}
        }
    }
}

/// Fails if `name` cannot be part of the names of channels in an image file, or of the text of a response in a flag.
pub fn check_name(name: &str) -> Result<()> {
    match name.is_empty() || name.contains(['.', '=', '/', '\\']) || name.trim() != name {
        false => Ok(()),
        true => Err(Error::settings(format!(
            "'{name}' is not a name for a response: it names the layers of an image, so it must not be empty or contain a dot, an \
             equals sign, a slash, or spaces at its ends"
        ))),
    }
}

impl FromStr for ResponseSpec {
    type Err = Error;

    fn from_str(text: &str) -> Result<ResponseSpec> {
        let wrong = || Error::advice(format!("'{text}' is not a response; "), HOW_TO_WRITE);
        // After a slash, the equals sign is part of the path of a table.
        let (name, rest) = match text.split_once('=').filter(|(name, _)| !name.contains(['/', '\\'])) {
            Some((name, rest)) => (Some(name.trim()), rest.trim()),
            None => (None, text.trim()),
        };
        name.map_or(Ok(()), check_name)?;
        let name = name.map(String::from);
        if rest.to_ascii_lowercase().ends_with(".csv") {
            return Ok(ResponseSpec { name, shape: Shape::Table(rest.into()) });
        }
        let (kind, parameters) = rest.split_once(':').unwrap_or((rest, ""));
        let (gate, length) = match (kind.trim(), parameters.rsplit_once(',')) {
            ("box", _) => (parameters, None),
            (_, Some((gate, length))) => (gate, Some(length)),
            (_, None) => ("", Some(parameters)),
        };
        let length = match length {
            None => 0.0,
            Some(length) => path_length(length).filter(|x| *x > 0.0 && x.is_finite()).ok_or_else(wrong)?,
        };
        let edge = match kind.trim() {
            "box" => Edge::Sharp,
            "trapezoid" => Edge::Ramp(length),
            "gauss" => Edge::Gauss(length),
            _ => return Err(wrong()),
        };
        let gate = if gate.trim().is_empty() { None } else { Some(gate.parse()?) };
        Ok(ResponseSpec { name, shape: Shape::Gate { edge, gate } })
    }
}

/// Prints text that parses to the same response.
impl fmt::Display for ResponseSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(name) = &self.name {
            write!(f, "{name}=")?;
        }
        let (edge, gate) = match &self.shape {
            Shape::Table(path) => return write!(f, "{}", path.display()),
            Shape::Gate { edge, gate } => (*edge, gate.map(|gate| gate.to_string())),
        };
        let (kind, length) = match edge {
            Edge::Sharp => ("box", None),
            Edge::Ramp(length) => ("trapezoid", Some(length)),
            Edge::Gauss(sigma) => ("gauss", Some(sigma)),
        };
        let length = length.map(|length| format!("{}m", number(length)));
        let parameters: Vec<String> = [gate, length].into_iter().flatten().collect();
        match parameters.is_empty() {
            true => write!(f, "{kind}"),
            false => write!(f, "{kind}:{}", parameters.join(",")),
        }
    }
}

/// The responses of a list, in order.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseSpecs(pub Vec<ResponseSpec>);

impl Value for ResponseSpecs {
    fn parse(word: &OsStr) -> Result<ResponseSpecs, SettingsError> {
        let text = word.to_str().ok_or("this is not UTF-8")?;
        Ok(ResponseSpecs(vec![text.parse()?]))
    }

    fn paths(&mut self) -> Vec<&mut PathBuf> {
        let mut paths = vec![];
        for spec in &mut self.0 {
            if let Shape::Table(path) = &mut spec.shape {
                paths.push(path);
            }
        }
        paths
    }

    fn and(self, later: ResponseSpecs) -> ResponseSpecs {
        ResponseSpecs([self.0, later.0].concat())
    }
}

impl Serialize for ResponseSpecs {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(ResponseSpec::to_string))
    }
}

impl<'de> Deserialize<'de> for ResponseSpecs {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(serde::Deserialize)]
        #[serde(untagged, expecting = "expected a response like \"gauss:0.1m\" or a list of responses")]
        enum Typed {
            One(String),
            List(Vec<String>),
        }
        let texts = match Typed::deserialize(deserializer)? {
            Typed::One(text) => vec![text],
            Typed::List(texts) => texts,
        };
        let specs = texts.iter().map(|text| text.parse()).collect::<Result<_>>();
        specs.map(ResponseSpecs).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn responses_are_read_as_they_are_printed() {
        for (text, printed) in [
            ("box", "box"),
            ("near=box:10m..11m", "near=box:10m..11m"),
            ("trapezoid:50cm", "trapezoid:0.5m"),
            ("a b = trapezoid: 10m+-1m, 0.25m", "a b=trapezoid:9m..11m,0.25m"),
            ("gauss:1m..2m,1e-3m", "gauss:1m..2m,0.001m"),
            ("far=dir/laser.csv", "far=dir/laser.csv"),
            ("far=dir/t=5/laser.csv", "far=dir/t=5/laser.csv"),
        ] {
            let spec: ResponseSpec = text.parse().unwrap();
            assert_eq!(spec.to_string(), printed);
            assert_eq!(printed.parse::<ResponseSpec>().unwrap(), spec);
        }
        let ns: ResponseSpec = "gauss:1ns".parse().unwrap();
        let folder: ResponseSpec = "dir/t=5/laser.csv".parse().unwrap();
        assert_eq!(folder, ResponseSpec { name: None, shape: Shape::Table("dir/t=5/laser.csv".into()) });
        assert_eq!(folder.to_string().parse::<ResponseSpec>().unwrap(), folder);
        assert_eq!(ns.shape, Shape::Gate { edge: Edge::Gauss(0.299792458), gate: None });
    }

    #[test]
    fn mistakes_say_how_to_write_it() {
        for bad in
            ["", "gauss", "gauss:", "gauss:-1m", "gauss:1", "trapezoid:1m..2m", "sinc:1m", "laser.txt", "gauss:0m"]
        {
            let error = bad.parse::<ResponseSpec>().expect_err(bad).to_string();
            assert!(error.contains("trapezoid:RISE"), "{bad}: {error}");
        }
        assert!(
            "a.b=box".parse::<ResponseSpec>().unwrap_err().to_string().contains("must not be empty or contain a dot")
        );
        assert!("box:2m..1m".parse::<ResponseSpec>().unwrap_err().to_string().contains("reversed"));
    }
}

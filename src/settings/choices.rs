//! Choices that a render has: their names, and how they are read.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::estimators::Estimator;

/// Which (s, t) strategies take part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Strategies {
    /// s >= 0, t >= 1.
    All,
    /// The paper's s >= 1, t >= 2 (Sec. 6.1).
    Paper,
}

impl Strategies {
    /// Both sets.
    pub const ALL: [Strategies; 2] = [Strategies::All, Strategies::Paper];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Strategies::All => "all",
            Strategies::Paper => "paper",
        }
    }
}

/// How samples are spread over the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Sampling {
    /// As many in every pixel.
    Uniform,
    /// More where earlier iterations found more error, the same on average.
    Adaptive,
}

impl Sampling {
    /// Both ways.
    pub const ALL: [Sampling; 2] = [Sampling::Uniform, Sampling::Adaptive];

    /// How samples are spread when nothing says it.
    pub fn default_of(estimator: Estimator) -> Sampling {
        if estimator.record().adaptive { Sampling::Adaptive } else { Sampling::Uniform }
    }

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Sampling::Uniform => "uniform",
            Sampling::Adaptive => "adaptive",
        }
    }
}

/// What the importance of a tree node goes by beside its power (`lcs` alone). The image is the same on average in every position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Importance {
    /// The distance of the node's centre; else that of its nearest point. Neither below half its diagonal.
    pub centre: bool,
    /// The greatest cosine at the shade point; else none. Nodes behind the shade point are culled in any case.
    pub cosine: bool,
    /// How much of every bucket meets the gate; else buckets count fully that can meet it.
    pub overlap: bool,
    /// The lobe of gloss at the shade point; else it reflects as a diffuse surface.
    pub gloss: bool,
}

impl Importance {
    /// Every part.
    pub const ALL: Importance = Importance { centre: true, cosine: true, overlap: true, gloss: true };
    /// No part: power alone.
    pub const NONE: Importance = Importance { centre: false, cosine: false, overlap: false, gloss: false };

    fn parts(self) -> [(&'static str, bool); 4] {
        [("centre", self.centre), ("cosine", self.cosine), ("overlap", self.overlap), ("gloss", self.gloss)]
    }
}

/// When a render stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Budget {
    /// Samples per pixel, >= 1.
    Spp(u32),
    /// Seconds of rendering after load and kernel compilation, > 0.
    Seconds(f64),
}

/// Which emitters of the file shine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Emitters {
    /// Everything in the scene that emits.
    Scene,
    /// Only what stands on these nodes, by name.
    Nodes(Vec<String>),
}

impl Emitters {
    /// Whether what stands on the node of this name shines.
    pub fn include(&self, node: &str) -> bool {
        match self {
            Emitters::Scene => true,
            Emitters::Nodes(names) => names.iter().any(|name| name == node),
        }
    }
}

/// Pixel window [x0, x1) x [y0, y1), row 0 at the top, inside the resolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crop {
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// Column after the last.
    pub x1: u32,
    /// Row after the last.
    pub y1: u32,
}

impl Crop {
    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.x1 - self.x0
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.y1 - self.y0
    }
}

impl fmt::Display for Importance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Importance::ALL => f.write_str("all"),
            Importance::NONE => f.write_str("none"),
            some => {
                let names: Vec<&str> = some.parts().iter().filter(|(_, on)| *on).map(|(name, _)| *name).collect();
                f.write_str(&names.join(","))
            }
        }
    }
}

impl FromStr for Importance {
    type Err = Error;

    fn from_str(text: &str) -> Result<Importance> {
        match text.trim() {
            "all" => return Ok(Importance::ALL),
            "none" => return Ok(Importance::NONE),
            _ => {}
        }
        let mut importance = Importance::NONE;
        for name in text.split(',').map(str::trim) {
            match name {
                "centre" => importance.centre = true,
                "cosine" => importance.cosine = true,
                "overlap" => importance.overlap = true,
                "gloss" => importance.gloss = true,
                _ => {
                    return Err(Error::Settings(format!(
                        "no part of the importance is called '{name}': give all, none, or some of centre,cosine,overlap,gloss"
                    )));
                }
            }
        }
        Ok(importance)
    }
}

impl fmt::Display for Sampling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Sampling {
    type Err = Error;

    fn from_str(text: &str) -> Result<Sampling> {
        Sampling::ALL.into_iter().find(|s| s.name() == text).ok_or_else(|| {
            Error::Settings(format!("no way to spread samples is called '{text}': choose uniform or adaptive"))
        })
    }
}

impl fmt::Display for Strategies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Strategies {
    type Err = Error;

    fn from_str(text: &str) -> Result<Strategies> {
        Strategies::ALL
            .into_iter()
            .find(|s| s.name() == text)
            .ok_or_else(|| Error::Settings(format!("no set of strategies is called '{text}': choose all or paper")))
    }
}

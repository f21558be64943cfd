//! Settings that are choices between named alternatives, and how they are parsed and printed.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::estimators::Estimator;

/// The set of (s, t) strategies that the estimator uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Strategies {
    /// All strategies: s >= 0, t >= 1.
    All,
    /// The strategies of the paper (Sec. 6.1): s >= 1, t >= 2.
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

/// Distribution of samples over the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Sampling {
    /// Every pixel has the same number of samples.
    Uniform,
    /// Pixels in which earlier iterations found more error have more samples; the average number is the same.
    Adaptive,
}

impl Sampling {
    /// Both modes.
    pub const ALL: [Sampling; 2] = [Sampling::Uniform, Sampling::Adaptive];

    /// The default for an estimator.
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

/// Whether `lcs` also forms ellipsoidal connections. The mean of the image does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum UseEllipsoids {
    /// In gates so thin that they pay off; on the driver SwiftShader never, because it takes minutes to compile the kernel.
    Auto,
    /// In any gate.
    On,
    /// Never.
    Off,
}

impl UseEllipsoids {
    /// All choices.
    pub const ALL: [UseEllipsoids; 3] = [UseEllipsoids::Auto, UseEllipsoids::On, UseEllipsoids::Off];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            UseEllipsoids::Auto => "auto",
            UseEllipsoids::On => "on",
            UseEllipsoids::Off => "off",
        }
    }
}

/// Which surfaces with transmission are thin glass. Light passes straight through thin glass, and refracts at solid glass.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ThinGlass {
    /// Those of open meshes, and those whose material says so.
    Auto,
    /// All of them.
    All,
    /// None.
    None,
}

impl ThinGlass {
    /// All choices.
    pub const ALL: [ThinGlass; 3] = [ThinGlass::Auto, ThinGlass::All, ThinGlass::None];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            ThinGlass::Auto => "auto",
            ThinGlass::All => "all",
            ThinGlass::None => "none",
        }
    }
}

/// The factors of a tree node's importance beside its power, for the estimator `lcs`. The mean of the image does not depend on
/// them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Importance {
    /// True: use the distance to the node's centre. False: use the distance to its nearest point. Both are at least half the
    /// diagonal of the node's box.
    pub centre: bool,
    /// Include the maximum cosine at the shade point. Nodes behind the shade point are always culled.
    pub cosine: bool,
    /// True: weight every power bucket by the fraction of it that meets the gate. False: every bucket that can meet the gate
    /// counts fully.
    pub overlap: bool,
    /// Include the glossy lobe at the shade point. Without it, the shade point counts as a diffuse surface.
    pub gloss: bool,
}

impl Importance {
    /// All factors.
    pub const ALL: Importance = Importance { centre: true, cosine: true, overlap: true, gloss: true };
    /// No factor: the power alone.
    pub const NONE: Importance = Importance { centre: false, cosine: false, overlap: false, gloss: false };

    fn parts(self) -> [(&'static str, bool); 4] {
        [("centre", self.centre), ("cosine", self.cosine), ("overlap", self.overlap), ("gloss", self.gloss)]
    }
}

/// The budget after which a render stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Budget {
    /// Samples per pixel, >= 1.
    Spp(u32),
    /// Seconds of rendering, > 0. The time to load the scene and to compile kernels does not count.
    Seconds(f64),
}

/// The emitters that are switched on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Emitters {
    /// All emitters of the scene.
    Scene,
    /// Only the emitters on the nodes with these names.
    Nodes(Vec<String>),
}

impl Emitters {
    /// Whether the emitters on the node with this name are switched on.
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
    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.x1 - self.x0
    }

    /// Height in pixels.
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
                        "'{name}' is not a factor of the importance: give all, none, or some of centre,cosine,overlap,gloss"
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
        Sampling::ALL
            .into_iter()
            .find(|s| s.name() == text)
            .ok_or_else(|| Error::Settings(format!("'{text}' is not a sampling mode: choose uniform or adaptive")))
    }
}

impl fmt::Display for UseEllipsoids {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for UseEllipsoids {
    type Err = Error;

    fn from_str(text: &str) -> Result<UseEllipsoids> {
        UseEllipsoids::ALL.into_iter().find(|s| s.name() == text).ok_or_else(|| {
            Error::Settings(format!(
                "'{text}' does not say when to form ellipsoidal connections: choose auto, on or off"
            ))
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
            .ok_or_else(|| Error::Settings(format!("'{text}' is not a set of strategies: choose all or paper")))
    }
}

impl fmt::Display for ThinGlass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for ThinGlass {
    type Err = Error;

    fn from_str(text: &str) -> Result<ThinGlass> {
        ThinGlass::ALL.into_iter().find(|choice| choice.name() == text).ok_or_else(|| {
            Error::Settings(format!("'{text}' does not say which glass is thin: choose auto, all or none"))
        })
    }
}

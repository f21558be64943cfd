//! What a render is asked to do, after flags, experiment file and scene have been merged. Nobody validates again after this.

mod keys;
pub mod setting;
pub mod table;
pub mod units;
pub mod values;

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
pub use crate::estimators::Estimator;
use crate::settings::units::Gate;
use crate::wgsl::layout::constants::MOST_SUBTREES;

/// Samples a pixel when neither `spp` nor `time` is given.
pub const DEFAULT_SPP: u32 = 64;
/// Path segments at most. Long enough that a white room loses under 1 % of its light.
pub const DEFAULT_MAX_DEPTH: u32 = 24;
/// Light subpaths per iteration whose vertices are stored, M of the paper, when nothing says how many: one per pixel, at least this and at
/// most as many as the estimator's record says.
pub const LEAST_LIGHT_PATHS_BY_DEFAULT: u32 = 4096;
/// Power buckets a node, B of the paper.
pub const DEFAULT_BUCKETS: u32 = 8;
pub const DEFAULT_SEED: u32 = 0;
pub const DEFAULT_STRATEGIES: Strategies = Strategies::All;
/// Pixels across when neither flags nor the camera say how many.
pub const DEFAULT_WIDTH: u32 = 512;

/// Pixels along one side at most.
pub const MAX_SIDE: u32 = 16_384;
/// Pixels in an image at most: 64 Mi.
pub const MAX_PIXELS: u64 = 1 << 26;
pub const MAX_SPP: u32 = 1 << 24;
/// Vertices count their segments in 8 bits.
pub const MAX_DEPTH: u32 = 254;
pub const MAX_LIGHT_PATHS: u32 = 1 << 24;
pub const MAX_QUERIES: u32 = 64;
/// The node layout has room for eight bucket powers.
pub const MAX_BUCKETS: u32 = 8;
/// A reference to a leaf has four bits for its size.
pub const MAX_LEAF_SIZE: u32 = 16;
/// A frontier has room for so many subtrees.
pub const MAX_FRONTIER: u32 = MOST_SUBTREES;
/// A year, in seconds.
pub const MAX_SECONDS: f64 = 365.0 * 86_400.0;

/// Which (s, t) strategies take part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Strategies {
    /// s >= 0, t >= 1.
    All,
    /// The paper's s >= 1, t >= 2 (Sec. 6.1).
    Paper,
}

impl Strategies {
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
    pub const ALL: Importance = Importance { centre: true, cosine: true, overlap: true, gloss: true };
    pub const NONE: Importance = Importance { centre: false, cosine: false, overlap: false, gloss: false };

    fn parts(self) -> [(&'static str, bool); 4] {
        [("centre", self.centre), ("cosine", self.cosine), ("overlap", self.overlap), ("gloss", self.gloss)]
    }
}

/// When a render stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Budget {
    /// Samples a pixel, >= 1.
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
    pub x0: u32,
    pub y0: u32,
    pub x1: u32,
    pub y1: u32,
}

impl Crop {
    pub fn width(&self) -> u32 {
        self.x1 - self.x0
    }

    pub fn height(&self) -> u32 {
        self.y1 - self.y0
    }
}

/// Resolved settings of a render.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    pub estimator: Estimator,
    pub strategies: Strategies,
    /// Travel times that count; [`Gate::OPEN`] is the steady state.
    pub gate: Gate,
    /// Width and height of the whole image in pixels.
    pub resolution: [u32; 2],
    /// The part that is rendered; pixels keep the values they have in the whole image.
    pub crop: Crop,
    pub budget: Budget,
    pub seed: u32,
    /// Greatest number of path segments, >= 1.
    pub max_depth: u32,
    /// Light subpaths an iteration whose vertices are stored, M of the paper, >= 1.
    pub light_paths: u32,
    /// Further light subpaths an iteration that only the sensor sees (t = 1).
    pub splat_paths: u32,
    /// Tree queries a shade point and tree, K of the paper, >= 1.
    pub queries: u32,
    /// Temporal power buckets a node, B of the paper, 1 to 8.
    pub buckets: u32,
    /// Most light vertices in a leaf, 1 to 16; 0 for estimators without trees.
    pub leaf_size: u32,
    /// Subtrees that the queries of a shade point start among (`lcs`), 1 (the root) to 32.
    pub frontier: u32,
    /// One tree over emitter points and scattered vertices instead of the two of Sec. 5.4; the same image on average.
    pub single_tree: bool,
    /// [`Importance::ALL`] for estimators that do not choose by it.
    pub importance: Importance,
    pub sampling: Sampling,
    /// Stop subpaths that can no longer meet the gate (exact; DESIGN 3.1).
    pub cull: bool,
    /// Index into `Scene::cameras`.
    pub camera: usize,
    pub emitters: Emitters,
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

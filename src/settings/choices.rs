//! Settings that are choices between named alternatives, and how they are parsed and printed.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::estimators::Estimator;

/// Generates enums of named alternatives. Flags and experiment files contain the names. A word that is no name gets a message: the word,
/// the literal after the type, and the names.
macro_rules! choices {
    ($($(#[$about:meta])+ $type:ident, $wrong:literal { $($(#[$doc:meta])+ $variant:ident = $name:literal,)+ })+) => {$(
        $(#[$about])+
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum $type { $($(#[$doc])+ $variant,)+ }

        impl $type {
            /// All choices.
            pub const ALL: [$type; [$($name),+].len()] = [$($type::$variant),+];

            /// The name on the command line.
            pub fn name(self) -> &'static str {
                match self { $($type::$variant => $name,)+ }
            }
        }

        impl fmt::Display for $type {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(self.name())
            }
        }

        impl FromStr for $type {
            type Err = Error;

            fn from_str(text: &str) -> Result<$type> {
                let named = $type::ALL.into_iter().find(|choice| choice.name() == text);
                named.ok_or_else(|| {
                    let (last, others) = ([$($name),+].split_last()).expect("there are choices");
                    Error::advice(format!("'{text}' {}: ", $wrong), format!("choose {} or {last}", others.join(", ")))
                })
            }
        }
    )+};
}

choices! {
    /// The set of (s, t) strategies that the estimator uses.
    Strategies, "is not a set of strategies" {
        /// All strategies: s >= 0, t >= 1.
        All = "all",
        /// The strategies of the paper (Sec. 6.1): s >= 1, t >= 2.
        Paper = "paper",
    }

    /// Distribution of samples over the image.
    Sampling, "is not a sampling mode" {
        /// Every pixel has the same number of samples.
        Uniform = "uniform",
        /// Pixels in which earlier iterations found more error have more samples; the average number is the same.
        Adaptive = "adaptive",
    }

    /// Whether `lcs` also forms ellipsoidal connections. The mean of the image does not depend on it.
    UseEllipsoids, "does not say when to form ellipsoidal connections" {
        /// In gates so thin that they pay off; on the driver SwiftShader never, because it takes minutes to compile the kernel.
        Auto = "auto",
        /// In any gate.
        On = "on",
        /// Never.
        Off = "off",
    }

    /// Whether sensor subpaths gather light over paths that no strategy forms, such as those through solid glass to a wall and back.
    Merge, "does not say when to merge" {
        /// Wherever lamps without a surface and smooth glass or mirrors may need it.
        Auto = "auto",
        /// Never.
        Off = "off",
    }

    /// Whether samples that are much brighter than all others around them count fully.
    Fireflies, "does not say what to do with fireflies" {
        /// They count as they are, so the image is unbiased.
        Keep = "keep",
        /// They count less.
        Damp = "damp",
    }

    /// What traces rays. The mean of the image does not depend on it.
    Rays, "does not say what traces rays" {
        /// The kernels, until ray queries were tried on a card.
        Auto = "auto",
        /// The ray queries of the device, which may be software. A device without them cannot render.
        Hardware = "hardware",
        /// The kernels.
        Software = "software",
    }

    /// Which surfaces with transmission are thin glass. Light passes straight through thin glass, and refracts at solid glass.
    ThinGlass, "does not say which glass is thin" {
        /// Those of open meshes, and those whose material says so.
        Auto = "auto",
        /// All of them.
        All = "all",
        /// None.
        None = "none",
    }

    /// How a density grid continues between the centres of its voxels.
    Filter, "is not a filter of a grid" {
        /// Linear interpolation.
        Linear = "linear",
        /// Each voxel has a constant density.
        Nearest = "nearest",
    }

    /// What the picture of a render with several gates shows.
    #[derive(Default)]
    GatePictures, "is not a kind of picture" {
        /// The sum of all gates.
        #[default]
        Sum = "sum",
        /// Each gate in a picture of its own.
        Each = "each",
        /// All gates side by side in one picture.
        Strip = "strip",
    }
}

impl Sampling {
    /// The default for an estimator.
    pub fn default_of(estimator: Estimator) -> Sampling {
        if estimator.record().adaptive { Sampling::Adaptive } else { Sampling::Uniform }
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

    /// The part with these rows, counted from its first row.
    #[doc(hidden)]
    pub fn rows(&self, rows: std::ops::Range<u32>) -> Crop {
        Crop { y0: self.y0 + rows.start, y1: self.y0 + rows.end, ..*self }
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
                    return Err(Error::advice(
                        format!("'{name}' is not a factor of the importance: "),
                        "give all, none, or some of centre,cosine,overlap,gloss",
                    ));
                }
            }
        }
        Ok(importance)
    }
}

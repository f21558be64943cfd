//! What a render is asked to do, after flags, experiment file and scene have been merged. Nobody validates again after this.

use crate::units::Gate;

/// Which paths are formed and how connections are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Estimator {
    /// Path tracing with next-event estimation: strategies s <= 1.
    Pt,
    /// Full bidirectional path tracing; paths outside the gate are rejected.
    Bdpt,
    /// Light-cone shell queries exactly as the paper has them (Secs. 5 and 6).
    LcsPaper,
}

/// Which (s, t) strategies take part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Strategies {
    /// s >= 0, t >= 1.
    All,
    /// The paper's s >= 1, t >= 2 (Sec. 6.1).
    Paper,
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
    /// Light subpaths an iteration, M of the paper, >= 1.
    pub light_paths: u32,
    /// Tree queries a shade point and tree, K of the paper, >= 1.
    pub queries: u32,
    /// Temporal power buckets a node, B of the paper, 1 to 8.
    pub buckets: u32,
    /// Stop subpaths that can no longer meet the gate (exact; DESIGN 3.1).
    pub cull: bool,
    /// Index into `Scene::cameras`.
    pub camera: usize,
    pub emitters: Emitters,
}

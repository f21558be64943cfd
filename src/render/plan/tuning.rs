//! How the work of a render is divided, and what the device reports about it.

/// Parameters that change the speed but never the image; a test checks this.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tuning {
    /// Threads per workgroup.
    pub workgroup: u32,
    /// Maximum number of sensor paths in a tile. `None` adapts it to the time that submits take. On a graphics card a fixed
    /// tile size also fixes the number of bounces per submit of light paths.
    pub tile: Option<usize>,
    /// Number of contributions of sensor subpaths that the device keeps until the host reads them, or more if one bounce needs more.
    /// `None`: as many as take at most a few hundred megabytes. No effect if the device reports no contributions.
    pub observed: Option<usize>,
    /// Number of iterations in flight, 1 or 2; see [`Drive::in_flight`](crate::gpu::Drive::in_flight). `None`: that of the device.
    pub in_flight: Option<u32>,
    /// Whether the device keeps the images of several responses, if it can (`responses/on_device.rs`). `None`: if it is worth it.
    pub device_film: Option<bool>,
    /// Holds back the last tile of an iteration until the light of the next one is there, and the image of the one before is in the film.
    /// So a test shows that the device need not wait for them.
    pub holds_for_host: bool,
}

impl Default for Tuning {
    fn default() -> Self {
        Tuning { workgroup: 64, tile: None, observed: None, in_flight: None, device_film: None, holds_for_host: false }
    }
}

/// What the device reports to the host about every contribution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observe {
    /// Nothing: the device renders an image.
    Nothing,
    /// The contribution and its travel time.
    Times,
    /// The contribution without its MIS weight, and the MIS weight.
    Strategies,
    /// The image, and for each contribution its pixel and travel time, from which the host computes the images of several
    /// responses.
    Responses,
}

impl Observe {
    /// Whether the host reads which strategy each contribution comes from. The device then renders no image.
    pub fn has_strategies(self) -> bool {
        matches!(self, Observe::Times | Observe::Strategies)
    }

    /// Whether the device reports a number for each splat (t = 1), beside its light and its pixel.
    pub fn has_splat_details(self) -> bool {
        matches!(self, Observe::Strategies | Observe::Responses)
    }
}

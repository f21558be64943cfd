//! What a render is asked to do: a [`Settings`] is checked where it is built, and nobody validates it again.

#![warn(missing_docs)]

mod builder;
mod choices;
mod keys;
mod responses;
#[allow(missing_docs)]
pub mod setting;
#[allow(missing_docs)]
pub mod table;
pub mod units;
#[allow(missing_docs)]
pub mod values;

pub use self::builder::SettingsBuilder;
pub use self::choices::{Budget, Crop, Emitters, Importance, Sampling, Strategies};
pub use self::responses::{Response, Responses};
use crate::error::{Error, Result};
pub use crate::estimators::Estimator;
use crate::settings::table::{CameraTable, EmitterTable, GateTable, RenderTable, Tables};
use crate::wgsl::layout::constants::MAX_SUBTREES;

/// Samples per pixel when neither `spp` nor `time` is given.
pub const DEFAULT_SPP: u32 = 64;
/// Path segments at most. Long enough that a white room loses under 1 % of its light.
pub const DEFAULT_MAX_DEPTH: u32 = 24;
/// Light subpaths per iteration whose vertices are stored, M of the paper, when nothing says how many: one per pixel, at least this and at
/// most as many as the estimator's record says.
pub const MIN_DEFAULT_LIGHT_PATHS: u32 = 4096;
/// Power buckets per node, B of the paper.
pub const DEFAULT_BUCKETS: u32 = 8;
/// Seed when nothing says which.
pub const DEFAULT_SEED: u32 = 0;
/// Strategies when nothing says which.
pub const DEFAULT_STRATEGIES: Strategies = Strategies::All;
/// Pixels across when neither flags nor the camera say how many.
pub const DEFAULT_WIDTH: u32 = 512;

/// Pixels along one side at most.
pub const MAX_SIDE: u32 = 16_384;
/// Pixels in an image at most: 64 Mi.
pub const MAX_PIXELS: u64 = 1 << 26;
/// Samples per pixel at most.
pub const MAX_SPP: u32 = 1 << 24;
/// Vertices count their segments in 8 bits.
pub const MAX_DEPTH: u32 = 254;
/// Light subpaths per iteration at most.
pub const MAX_LIGHT_PATHS: u32 = 1 << 24;
/// Tree queries per shade point at most.
pub const MAX_QUERIES: u32 = 64;
/// The node layout has room for eight bucket powers.
pub const MAX_BUCKETS: u32 = 8;
/// A reference to a leaf has four bits for its size.
pub const MAX_LEAF_SIZE: u32 = 16;
/// A frontier has room for so many subtrees.
pub const MAX_FRONTIER: u32 = MAX_SUBTREES;
/// A year, in seconds.
pub const MAX_SECONDS: f64 = 365.0 * 86_400.0;

/// Settings of a render. What was left open has the default of the estimator.
///
/// The default is a steady render of 512 x 512 pixels with 64 samples each, by the estimator that finds all light of any scene.
///
/// ```
/// use taugate::{Budget, Estimator, Settings};
/// let settings = Settings::builder()
///     .estimator(Estimator::Lcs)
///     .gate("12.5m..12.8m".parse()?)
///     .resolution([320, 240])
///     .budget(Budget::Spp(16))
///     .build()?;
/// assert_eq!((settings.queries(), settings.crop().width()), (16, 320));
/// # Ok::<(), taugate::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Settings {
    chosen: SettingsBuilder,
}

impl Settings {
    /// Nothing chosen yet: what stays open has its default.
    pub fn builder() -> SettingsBuilder {
        SettingsBuilder::default()
    }

    /// A builder of settings that differ from these. What was left open stays open: another estimator brings its defaults.
    pub fn change(&self) -> SettingsBuilder {
        self.chosen.clone()
    }

    /// How paths are found.
    pub fn estimator(&self) -> Estimator {
        self.chosen.render.estimator.unwrap_or(Estimator::UNGATED)
    }

    /// What the sensor measures.
    pub fn responses(&self) -> &Responses {
        &self.chosen.responses
    }

    /// Width and height of the whole image in pixels.
    pub fn resolution(&self) -> [u32; 2] {
        self.chosen.resolution
    }

    /// The part that is rendered; with uniform samples its pixels have the values that they have in the whole image.
    pub fn crop(&self) -> Crop {
        let [x1, y1] = self.chosen.resolution;
        self.chosen.crop.unwrap_or(Crop { x0: 0, y0: 0, x1, y1 })
    }

    /// When the render stops.
    pub fn budget(&self) -> Budget {
        let RenderTable { spp, time, .. } = self.chosen.render;
        time.map_or(Budget::Spp(spp.unwrap_or(DEFAULT_SPP)), |time| Budget::Seconds(time.0))
    }

    /// Index into `Scene::cameras`.
    pub fn camera(&self) -> usize {
        self.chosen.camera
    }

    /// Which emitters of the scene shine.
    pub fn emitters(&self) -> &Emitters {
        &self.chosen.emitters
    }

    /// The settings of `[render]` that the image depends on, all filled in; those that the estimator does not use stay open.
    #[doc(hidden)]
    pub fn to_table(&self) -> RenderTable {
        let mut table = self.values();
        table.estimator = Some(self.estimator());
        (table.spp, table.time) = match self.budget() {
            Budget::Spp(spp) => (Some(spp), None),
            Budget::Seconds(seconds) => (None, Some(values::Seconds(seconds))),
        };
        table
    }

    /// All that the image depends on, as an experiment has it, filled in. The name of the camera stays open: the scene knows it.
    #[doc(hidden)]
    pub fn to_tables(&self) -> Tables {
        let responses = self.responses();
        Tables {
            camera: CameraTable {
                camera: None,
                resolution: Some(values::Resolution(self.resolution())),
                crop: Some(self.crop()),
            },
            emitter: EmitterTable { emitters: Some(self.emitters().clone()) },
            gate: GateTable { gate: (!responses.are_steady()).then(|| responses.support()), ..GateTable::default() },
            render: self.to_table(),
        }
    }
}

/// Settings are equal that render the same, whether a value was chosen or is the default.
impl PartialEq for Settings {
    fn eq(&self, other: &Settings) -> bool {
        let view = |s: &Settings| (s.resolution(), s.crop(), s.camera());
        view(self) == view(other)
            && self.responses() == other.responses()
            && self.emitters() == other.emitters()
            && self.to_table() == other.to_table()
    }
}

/// Fails if an image cannot have this size; `source` says where the size comes from.
pub fn check_resolution(source: &str, [width, height]: [u32; 2]) -> Result<()> {
    let fits = |side: u32| (1..=MAX_SIDE).contains(&side);
    if fits(width) && fits(height) && u64::from(width) * u64::from(height) <= MAX_PIXELS {
        return Ok(());
    }
    Err(Error::Settings(format!(
        "{source} is {width}x{height}; sides must be from 1 to {MAX_SIDE} and the image at most {} megapixels: give \
         --resolution WxH",
        MAX_PIXELS >> 20
    )))
}

#[cfg(test)]
mod tests;

//! The settings of a render. [`SettingsBuilder::build`] checks them once, so other code need not check them again.

#![warn(missing_docs)]

#[allow(missing_docs)]
pub mod aov;
mod builder;
pub mod chirp;
mod choices;
pub mod doppler;
#[allow(missing_docs)]
pub mod exposure;
#[allow(missing_docs)]
pub mod frames;
pub mod frequencies;
pub mod gates;
pub mod keys;
#[allow(missing_docs)]
pub mod lens;
#[allow(missing_docs)]
pub mod medium;
#[allow(missing_docs)]
pub mod missing;
pub mod moment;
pub mod numbers;
pub mod optical_path;
#[allow(missing_docs)]
pub mod phase;
#[allow(missing_docs)]
pub mod pixels;
mod response;
#[allow(missing_docs)]
pub mod response_specs;
mod responses;
#[allow(missing_docs)]
pub mod setting;
#[allow(missing_docs)]
pub mod shard;
pub mod shutter;
#[allow(missing_docs)]
pub mod sky;
pub mod table;
#[allow(missing_docs)]
pub mod tev;
mod typed;
pub mod units;
#[allow(missing_docs)]
pub mod values;

pub use self::builder::SettingsBuilder;
pub use self::choices::{
    Budget, Crop, Emitters, Filter, Fireflies, GatePictures, Importance, Merge, Rays, Sampling, Strategies, ThinGlass,
    UseEllipsoids,
};
pub use self::response::{Edge, Response};
pub use self::responses::Responses;
use crate::error::{Error, Result};
pub use crate::estimators::Estimator;
use crate::scene::{Light, Scene};
use crate::settings::table::{CameraTable, EmitterTable, RenderTable, Tables};
use crate::wgsl::layout::constants::MAX_SUBTREES;

/// Samples per pixel when neither `spp` nor `time` is given.
pub const DEFAULT_SPP: u32 = 64;
/// Default for the maximum number of segments of a path. A white room loses less than 1 % of its light.
pub const DEFAULT_MAX_DEPTH: u32 = 24;
/// Minimum of the default for `light_paths` (M of the paper). The default is one light subpath per pixel, clamped to this minimum and
/// to the maximum in the estimator's record, which may be the lower one.
pub const MIN_DEFAULT_LIGHT_PATHS: u32 = 4096;
/// Default for B of the paper, the number of power buckets per node.
pub const DEFAULT_BUCKETS: u32 = 8;
/// Default seed.
pub const DEFAULT_SEED: u32 = 0;
/// Default set of strategies.
pub const DEFAULT_STRATEGIES: Strategies = Strategies::All;
/// Default width of the image in pixels, if neither flags nor the camera give a resolution.
pub const DEFAULT_WIDTH: u32 = 512;

/// Maximum number of pixels along one side of the image.
pub const MAX_SIDE: u32 = 16_384;
/// Maximum number of pixels in an image of one row, as scans have: the list of samples stores a column in 16 bits.
pub const MAX_ROW: u32 = 65_535;
/// Maximum number of pixels in an image: 64 Mi.
pub const MAX_PIXELS: u64 = 1 << 26;
/// Maximum number of samples per pixel.
pub const MAX_SPP: u32 = 1 << 24;
/// Maximum of the setting `max_depth`: a vertex stores its number of segments in 8 bits.
pub const MAX_DEPTH: u32 = 254;
/// Maximum of each of the settings `light_paths` and `splat_paths`.
pub const MAX_LIGHT_PATHS: u32 = 1 << 24;
/// Maximum number of tree queries per shade point and tree.
pub const MAX_QUERIES: u32 = 64;
/// Maximum number of power buckets per node: the layout of a node has room for eight.
pub const MAX_BUCKETS: u32 = 8;
/// Maximum number of light vertices in a leaf: a reference to a leaf stores the number in four bits.
pub const MAX_LEAF_SIZE: u32 = 16;
/// Maximum number of subtrees in a frontier.
pub const MAX_FRONTIER: u32 = MAX_SUBTREES;
/// Maximum time of a render: a year, in seconds.
pub const MAX_SECONDS: f64 = 365.0 * 86_400.0;

/// Settings of a render. A setting that was not chosen has the default of the estimator.
///
/// [`Settings::default`] is a steady-state render of 512 x 512 pixels with 64 samples per pixel and the estimator `bdpt`, which
/// finds the light of every kind of emitter.
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
    /// A builder in which nothing is chosen yet, so that all settings have their defaults.
    pub fn builder() -> SettingsBuilder {
        SettingsBuilder::default()
    }

    /// A builder that starts from these settings. A setting that was not chosen has the default of the estimator, also if the
    /// estimator changes.
    pub fn change(&self) -> SettingsBuilder {
        self.chosen.clone()
    }

    /// The estimator.
    pub fn estimator(&self) -> Estimator {
        self.chosen.render.estimator.unwrap_or(Estimator::UNGATED)
    }

    /// The responses that the sensor measures.
    pub fn responses(&self) -> &Responses {
        &self.chosen.responses
    }

    /// Width and height of the whole image in pixels.
    pub fn resolution(&self) -> [u32; 2] {
        self.chosen.resolution
    }

    /// The part of the image that is rendered. With uniform sampling its pixels have the same values as in the whole image.
    pub fn crop(&self) -> Crop {
        self.chosen.crop.unwrap_or(self.whole())
    }

    /// The whole image as a crop.
    fn whole(&self) -> Crop {
        let [x1, y1] = self.chosen.resolution;
        Crop { x0: 0, y0: 0, x1, y1 }
    }

    /// The number of samples per pixel, or the time, after which a render stops; see [`crate::Renderer::render`].
    pub fn budget(&self) -> Budget {
        let RenderTable { spp, time, .. } = self.chosen.render;
        time.map_or(Budget::Spp(spp.unwrap_or(DEFAULT_SPP)), |time| Budget::Seconds(time.0))
    }

    /// Index into `Scene::cameras`.
    pub fn camera(&self) -> usize {
        self.chosen.camera
    }

    /// The emitters of the scene that are switched on.
    pub fn emitters(&self) -> &Emitters {
        &self.chosen.emitters
    }

    /// The lights of `scene` that are switched on, but whose light the estimator cannot find: beams, with the estimator `pt`. The
    /// image lacks their light.
    pub fn missed_lights<'a>(&'a self, scene: &'a Scene) -> impl Iterator<Item = &'a Light> {
        let lights = scene.lights.iter().filter(move |light| self.emitters().include(&light.node));
        lights.filter(move |light| self.estimator().misses(&light.kind))
    }

    /// The settings of `[render]` that the image depends on, with defaults filled in. Settings that the estimator does not use
    /// are `None`.
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

    /// All settings that the image depends on, as tables of an experiment, with defaults filled in. The name of the camera is
    /// `None`, because only the scene knows the name. A crop of the whole image is `None` too, so that the user can change the
    /// resolution of a printed experiment and still sees the whole image.
    #[doc(hidden)]
    pub fn to_tables(&self) -> Tables {
        let responses = self.responses();
        Tables {
            camera: CameraTable {
                resolution: Some(values::Resolution(self.resolution())),
                crop: Some(self.crop()).filter(|&crop| crop != self.whole()),
                ..CameraTable::default()
            },
            emitter: EmitterTable { emitters: Some(self.emitters().clone()), ..EmitterTable::default() },
            gate: responses.to_table(),
            render: self.to_table(),
        }
    }
}

/// Settings are equal if they render the same image. A chosen value equals the same default value.
impl PartialEq for Settings {
    fn eq(&self, other: &Settings) -> bool {
        let view = |s: &Settings| (s.resolution(), s.crop(), s.camera());
        view(self) == view(other)
            && self.responses() == other.responses()
            && self.emitters() == other.emitters()
            && self.to_table() == other.to_table()
    }
}

/// Fails if an image cannot have this width and height in pixels. `source` says where the size comes from, for the message.
pub fn check_resolution(source: &str, [width, height]: [u32; 2]) -> Result<()> {
    let longest = if height == 1 { MAX_ROW } else { MAX_SIDE };
    let fits = (1..=longest).contains(&width) && (1..=MAX_SIDE).contains(&height);
    if fits && u64::from(width) * u64::from(height) <= MAX_PIXELS {
        return Ok(());
    }
    Err(Error::advice(
        format!(
            "{source} is {width}x{height}; sides must be from 1 to {MAX_SIDE} and the image at most {} megapixels: ",
            MAX_PIXELS >> 20
        ),
        "give --resolution WxH",
    )
    .about("resolution"))
}

#[cfg(test)]
mod tests;

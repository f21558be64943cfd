//! The settings of the estimator and of its samples, which have defaults.

use crate::settings::doppler::Doppler;
use crate::settings::pixels::Pixels;
use crate::settings::setting::Taker::{Info, Page, View};
use crate::settings::setting::{Form, Setting, table};
use crate::settings::values::Seconds;
use crate::settings::*;

const BARE_TRUE: Form = Form::Optional { bare: "true", equals: true };

/// One light subpath per pixel, within bounds. The lower bound keeps the trees a good representation of the light; more subpaths
/// than the upper bound are not worth their time.
fn default_light_paths(settings: &Settings) -> u32 {
    let [width, height] = settings.resolution();
    let most = (settings.estimator().record().max_default_light_paths)(settings.responses().len() > 1);
    (width * height).clamp(MIN_DEFAULT_LIGHT_PATHS.min(most), most)
}

fn traces_light(estimator: Estimator) -> bool {
    estimator.record().light_subpaths
}

table! {
    /// `[render]`: how the image is computed. At most one of `spp` and `time`.
    impl Settings for RenderTable = "render" {
        /// Estimator: pt (path tracing), bdpt (bidirectional path tracing), epc (ellipsoidal path connections), lcs-paper (light-cone
        /// shell queries of the paper), lcs (light-cone shell queries with importance and resampling) [default: lcs for gates up to 0.4
        /// times the scene's diagonal, in thick fog, and with a beam and at most one gate; otherwise bdpt; without a gate
        /// pt under a sun or a sky, unless there are mirrors, glass, sharp gloss or fog]
        estimator: Estimator, Setting::sampling("estimator", "NAME").also(Page);

        /// Strategies (s, t) that connect subpaths: all, or paper (s >= 1 and t >= 2: no sensor path that hits an emitter, no
        /// light vertex that connects to the camera) [default: all]
        strategies: Strategies = |_| DEFAULT_STRATEGIES, Setting::sampling("strategies", "all|paper");

        /// Samples per pixel [default: 64]
        spp: u32, Setting::sampling("spp", "N").within(1, MAX_SPP);

        /// Render for this time instead of a number of samples, such as 30s, 5min or 2h
        time: Seconds, Setting::sampling("time", "DURATION").excludes(&["spp"], "limit the render");

        /// Seed of the random numbers; the same seed gives the same image, bit by bit [default: 0]
        seed: u32 = |_| DEFAULT_SEED, Setting::sampling("seed", "N").also(Page);

        /// Maximum number of segments of a path [default: 24]
        max_depth: u32 = |_| DEFAULT_MAX_DEPTH, Setting::sampling("max-depth", "N").within(1, MAX_DEPTH).also(Page).also(Info);

        /// Light subpaths per iteration whose vertices are stored [default: one per pixel, at least 4096 and at most 50000; lcs:
        /// at most 8192, with several gates 2048]
        light_paths: u32 = default_light_paths, Setting::sampling("light-paths", "N").within(1, MAX_LIGHT_PATHS).also(Page).also(Info);

        /// Additional light subpaths per iteration, which only connect to the camera (t = 1); for caustics [default: 0]
        splat_paths: u32 = |_| 0, Setting::sampling("splat-paths", "N").within(0, MAX_LIGHT_PATHS).only_for(traces_light);

        /// Queries per shade point and tree, 1 to 64; with several gates that are together wider than a tenth of the scene's
        /// diagonal, lcs draws two light vertices per query by their travel times, without trees [default: 1; lcs: 16]
        queries: u32 = |s| s.estimator().default_queries(), Setting::sampling("queries", "N").within(1, MAX_QUERIES).only_for(Estimator::has_trees).also(Page);

        /// Travel-time buckets of power per tree node, 1 to 8 [default: 8]
        buckets: u32 = |_| DEFAULT_BUCKETS, Setting::sampling("buckets", "N").within(1, MAX_BUCKETS).only_for(Estimator::has_trees);

        /// Maximum number of light vertices in a leaf of a tree, 1 to 16 [default: lcs-paper: 1; lcs: 16]
        leaf_size: u32 = |s| s.estimator().leaf_size(), Setting::sampling("leaf-size", "N").within(1, MAX_LEAF_SIZE).only_for(Estimator::has_trees);

        /// For lcs: maximum number of subtrees from which the queries of a shade point start, 1 (the whole tree) to 32; the mean
        /// image is the same [default: 32]
        frontier: u32 = |_| MAX_FRONTIER, Setting::sampling("frontier", "N").within(1, MAX_FRONTIER).only_for(Estimator::by_importance);

        /// Build one tree over emitter points and scattered light together, instead of a tree for each; the mean image is the
        /// same [default: false; lcs: true]
        single_tree: bool = |s| s.estimator().default_single_tree(), Setting::sampling("single-tree", "true|false").form(BARE_TRUE).only_for(Estimator::has_trees);

        /// For lcs: factors of a tree node's importance beside its power: all, none, or some of centre,cosine,overlap,gloss
        /// (distance to the centre, maximum cosine, part of a bucket inside the gate, glossy lobe); the mean image is the same
        /// [default: all]
        importance: Importance = |_| Importance::ALL, Setting::sampling("importance", "NAME,...").only_for(Estimator::by_importance);

        /// For lcs: ellipsoidal connections, which find light in the thinnest gates: auto, on or off. With auto they are on in gates below
        /// 0.04 % of the scene's diagonal and of their own end, without participating media, but not on the driver SwiftShader. The mean
        /// image is the same [default: auto]
        ellipsoids: UseEllipsoids = |_| UseEllipsoids::Auto, Setting::sampling("ellipsoids", "auto|on|off").only_for(Estimator::by_importance);

        /// Gather light that no strategy forms: a lamp without a surface sends it over smooth glass or mirrors to a surface, which the
        /// camera sees over glass or mirrors too. Merging takes photons of its own. auto or off [default: auto]
        merge: Merge = |_| Merge::Auto, Setting::sampling("merge", "auto|off").also(Page);

        /// Radius in pixels within which merging gathers light in the first iteration. It falls with the sixth root of the number of
        /// iterations, and its bias with the cube root [default: 1.5]
        merge_radius: Pixels = |_| Pixels::DEFAULT_MERGE_RADIUS, Setting::sampling("merge-radius", "PIXELS");

        /// Samples that are much brighter than all others in and around their pixel: keep or damp. Damping makes single bright dots disappear.
        /// The image is then too dark where light is rare, less so with more samples; image files keep the other image as undamped.R,
        /// .G and .B. Only for a single gate [default: keep]
        fireflies: Fireflies = |_| Fireflies::Keep, Setting::sampling("fireflies", "keep|damp");

        /// Record how fast objects recede instead of the colours of their light: white light comes from objects at rest, red light from
        /// objects that recede, blue light from objects that approach, each at this radial velocity, such as 20m/s. EXR files have the mean
        /// velocity and its deviation, weighted by light; off records colours [default: off]
        doppler: Doppler = |_| Doppler::OFF, Setting::sampling("doppler", "SPEED|off").except(View);

        /// Distribution of samples over the image: uniform, or adaptive (more samples for pixels with more error so far)
        /// [default: adaptive; lcs-paper: uniform]
        sampling: Sampling = |s| Sampling::default_of(s.estimator()), Setting::sampling("sampling", "NAME").also(Page);

        /// Also trace subpaths that can no longer meet the gate; slower, and the mean image is the same
        no_cull: bool = |_| false, Setting::sampling("no-cull", "").form(Form::Switch);

        /// What traces rays: the device's ray queries (hardware), or kernels (software). auto is software, because no card has run ray queries
        /// yet; taugate devices --check compares both. The mean image is the same [default: auto]
        rays: Rays = |_| Rays::Auto, Setting::sampling("rays", "NAME");

        /// Vulkan device by index or part of its name, see taugate devices [default: the fastest kind of device]
        device: String, Setting::diagnostics("device", "INDEX|NAME").also(Info);

        /// Fail at the first sample that is not finite; else such samples are dropped and counted
        strict: bool, Setting::diagnostics("strict", "").form(Form::Switch).except(View);
    }
}

impl RenderTable {
    /// A note for every setting that the user gave and that `estimator` does not use.
    pub fn without_effect(&self, estimator: Estimator) -> Vec<String> {
        self.given().into_iter().filter_map(|setting| setting.without_effect(estimator)).collect()
    }
}

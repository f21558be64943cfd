//! All settings, one listing each: key and flag, type, help, limits, and the estimators that use it.
//!
//! Experiment files, the command line, merging, limits and notes about settings without effect follow from these tables.

use std::path::PathBuf;

use serde::Serialize;

use crate::error::Result;
use crate::settings::setting::{Form, Setting, Value, Visitor, table};
use crate::settings::units::{Depth, Gate};
use crate::settings::values::{Png, Resolution, Seconds};
use crate::settings::*;

const BARE_TRUE: Form = Form::Optional { bare: "true", equals: true };

/// Enough that the trees know the light, and no more than sensor paths can pay for.
fn default_light_paths(settings: &Settings) -> u32 {
    let [width, height] = settings.resolution();
    (width * height).clamp(MIN_DEFAULT_LIGHT_PATHS, settings.estimator().record().max_default_light_paths)
}

fn traces_light(estimator: Estimator) -> bool {
    estimator.record().light_subpaths
}

table! {
    /// `[camera]`: what the sensor sees.
    CameraTable {
        /// Camera of the file to look through; where several have one name, NAME#2 is the second of them [default: the first]
        camera: String, Setting::scene("camera", "NAME");

        /// Image size in pixels [default: what the camera says, else 512 wide]
        resolution: Resolution, Setting::scene("resolution", "WxH");

        /// Render only the pixels x0 <= x < x1, y0 <= y < y1, with the values they have in the whole image (by --sampling
        /// adaptive but for noise)
        crop: Crop, Setting::scene("crop", "x0,x1,y0,y1");
    }
}

table! {
    /// `[emitter]`: what shines.
    EmitterTable {
        /// What shines: scene for everything that emits, or names of nodes; may be repeated
        emitters: Emitters, Setting::scene("emitters", "scene|NODE,...").form(Form::Repeated);
    }
}

table! {
    /// `[gate]`: the travel times that count. At most one of `gate` and `depth`.
    GateTable {
        /// Travel times that count, half-open: A..B, CENTER+-HALF or A+WIDTH with um, mm, cm, m, km (optical path) or
        /// ps, ns, us (time), such as 12.5m..12.8m [default: all, the steady state]
        gate: Gate, Setting::gate("gate", "A..B").form(Form::Signed);

        /// The gate as one-way range: half the optical path, lengths only
        depth: Depth, Setting::gate("depth", "A..B").form(Form::Signed).excludes("gate");

        /// Render a gate that is thinner than 16 steps of 32-bit travel times, or that no light meets
        force: bool, Setting::gate("force", "").form(Form::Switch);
    }
}

table! {
    /// `[render]`: how the image is computed. At most one of `spp` and `time`.
    impl Settings for RenderTable {
        /// How paths are found: pt (path tracing), bdpt (bidirectional), lcs-paper (light-cone shell queries),
        /// lcs (the same by importance, resampled) [default: lcs; bdpt through a gate wider
        /// than 0.4 of the scene's diagonal; without one pt, or bdpt where there are mirrors,
        /// glass, sharp gloss or a beam]
        estimator: Estimator, Setting::sampling("estimator", "NAME");

        /// Ways to join subpaths: all, or those of the paper (no emitter hit by chance, none seen by the sensor directly)
        /// [default: all]
        strategies: Strategies = |_| DEFAULT_STRATEGIES, Setting::sampling("strategies", "all|paper");

        /// Samples per pixel [default: 64]
        spp: u32, Setting::sampling("spp", "N").within(1, MAX_SPP);

        /// Render for this long instead, such as 30s, 5min or 2h
        time: Seconds, Setting::sampling("time", "DURATION").excludes("spp");

        /// Same seed, same image, to the bit [default: 0]
        seed: u32 = |_| DEFAULT_SEED, Setting::sampling("seed", "N");

        /// Most segments of a path [default: 24]
        max_depth: u32 = |_| DEFAULT_MAX_DEPTH, Setting::sampling("max-depth", "N").within(1, MAX_DEPTH);

        /// Light subpaths per iteration whose vertices are kept [default: one per pixel, 4096 to 50000; lcs: to 8192]
        light_paths: u32 = default_light_paths, Setting::sampling("light-paths", "N").within(1, MAX_LIGHT_PATHS);

        /// Further light subpaths per iteration that only the sensor sees; for caustics [default: 0]
        splat_paths: u32 = |_| 0, Setting::sampling("splat-paths", "N").within(0, MAX_LIGHT_PATHS).only_for(traces_light);

        /// Tree queries per shade point, 1 to 64 [default: 1; lcs: 16]
        queries: u32 = |s| s.estimator().default_queries(), Setting::sampling("queries", "N").within(1, MAX_QUERIES).only_for(Estimator::has_trees);

        /// Temporal power buckets per tree node, 1 to 8 [default: 8]
        buckets: u32 = |_| DEFAULT_BUCKETS, Setting::sampling("buckets", "N").within(1, MAX_BUCKETS).only_for(Estimator::has_trees);

        /// Most light vertices in a leaf of a tree, 1 to 16 [default: lcs-paper: 1; lcs: 16]
        leaf_size: u32 = |s| s.estimator().leaf_size(), Setting::sampling("leaf-size", "N").within(1, MAX_LEAF_SIZE).only_for(Estimator::has_trees);

        /// lcs: subtrees that the queries of a shade point start among, 1 (the whole tree) to 32; same image on average [default: 32]
        frontier: u32 = |_| MAX_FRONTIER, Setting::sampling("frontier", "N").within(1, MAX_FRONTIER).only_for(Estimator::by_importance);

        /// One tree over points on emitters and scattered light together, instead of one each; same image on average
        /// [default: false; lcs: true]
        single_tree: bool = |s| s.estimator().default_single_tree(), Setting::sampling("single-tree", "true|false").form(BARE_TRUE).only_for(Estimator::has_trees);

        /// What lcs judges nodes of a tree by beside power: all, none, or some of centre,cosine,overlap,gloss (distance of the
        /// centre, greatest cosine, part of a bucket inside the gate, lobe of gloss); same image on average [default: all]
        importance: Importance = |_| Importance::ALL, Setting::sampling("importance", "NAME,...").only_for(Estimator::by_importance);

        /// How samples are spread over the image: uniform, or adaptive: more where earlier ones found more error
        /// [default: adaptive; lcs-paper: uniform]
        sampling: Sampling = |s| Sampling::default_of(s.estimator()), Setting::sampling("sampling", "NAME");

        /// Also follow subpaths that can no longer meet the gate; same image on average, slower
        no_cull: bool = |_| false, Setting::sampling("no-cull", "").form(Form::Switch);

        /// Vulkan device by index or part of its name, see taugate devices [default: the fastest kind]
        device: String, Setting::diagnostics("device", "INDEX|NAME");

        /// Fail on the first sample that is not finite, instead of dropping and counting it
        strict: bool, Setting::diagnostics("strict", "").form(Form::Switch);
    }
}

table! {
    /// `[output]`: the files that a render writes.
    OutputTable {
        /// Image file (.exr): R, G, B, their variance and the settings
        output: PathBuf, Setting::output("output", "OUT.exr").short('o');

        /// Also write a tone-mapped picture [default name: the output with .png]
        png: Png, Setting::output("png", "FILE.png").form(Form::Optional { bare: "", equals: false });

        /// Also write numbers about the render: rays, times, mean and its error, dropped samples, part inside the gate
        stats: PathBuf, Setting::output("stats", "FILE.json");

        /// Also render the image once more and write what each strategy adds to it into this folder: for s vertices from the
        /// light and t from the sensor s02_t03_weighted.exr (by MIS; these add up to the image) and _unweighted.exr
        strategy_images: PathBuf, Setting::output("strategy-images", "DIR");
    }
}

impl RenderTable {
    /// Fails where a count is outside its limits.
    pub fn check(&self) -> Result<()> {
        struct Check(Result<()>);
        impl Visitor for Check {
            fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
                if let (Ok(()), Some(count)) = (&self.0, slot.as_ref().and_then(T::count)) {
                    self.0 = setting.check(count);
                }
            }
        }
        let mut check = Check(Ok(()));
        self.clone().visit(&mut check);
        check.0
    }

    /// A note for every setting that was typed and that the estimator does not use.
    pub fn without_effect(&self, estimator: Estimator) -> Vec<String> {
        struct Notes(Estimator, Vec<String>);
        impl Visitor for Notes {
            fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
                self.1.extend(slot.as_ref().and_then(|_| setting.without_effect(self.0)));
            }
        }
        let mut notes = Notes(estimator, vec![]);
        self.clone().visit(&mut notes);
        notes.1
    }
}

/// The tables of an experiment that say what an image shows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tables {
    pub camera: CameraTable,
    pub emitter: EmitterTable,
    pub gate: GateTable,
    pub render: RenderTable,
}

impl Tables {
    /// The experiment as TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("tables are plain text and numbers")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::experiment::Experiment;

    /// Key and flag are one name, so it must be the key under which the file has the value; and every flag needs its help.
    #[test]
    fn names_are_the_keys_of_the_file_and_all_have_help() {
        struct Fill(Vec<String>);
        impl Visitor for Fill {
            fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
                assert!(!setting.help.trim().is_empty() && !setting.help.ends_with('.'), "--{}", setting.name);
                assert!(
                    setting.excludes.is_none_or(|other| self.0.iter().any(|name| name == other)),
                    "--{}",
                    setting.name
                );
                let words = ["true", "1", "1m..2m", "4x4", "0,1,0,1", "3s", "pt", "all", "uniform", "word"];
                *slot = words.iter().find_map(|word| T::parse(word.as_ref()).ok());
                assert!(slot.is_some(), "--{} has a value that this test does not know", setting.name);
                self.0.push(setting.name.into());
            }
        }
        let (mut experiment, mut fill) = (Experiment::default(), Fill(vec![]));
        experiment.visit(&mut fill);
        let text = experiment.to_toml();
        let keys: Vec<&str> = text.lines().filter_map(|line| Some(line.split_once(" = ")?.0)).collect();
        assert_eq!(keys, fill.0, "{text}");
    }

    #[test]
    fn notes_name_the_estimators_that_use_a_setting() {
        let setting = Setting::sampling("splat-paths", "N").only_for(traces_light);
        assert_eq!(setting.without_effect(Estimator::Bdpt), None);
        let note = "--splat-paths is for bdpt, lcs-paper and lcs; pt renders as without it";
        assert_eq!(setting.without_effect(Estimator::Pt).as_deref(), Some(note));
        let note = Setting::sampling("frontier", "N")
            .only_for(Estimator::by_importance)
            .without_effect(Estimator::Bdpt)
            .unwrap();
        assert!(note.starts_with("--frontier is for lcs; bdpt"), "{note}");
    }
}

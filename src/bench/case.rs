//! One scene of a suite, loaded, with the settings of every variant resolved.

use std::path::PathBuf;

use super::suite::{Part, SceneEntry, Suite};
use crate::error::{Error, Result};
use crate::generate;
use crate::gpu::Device;
use crate::image::fingerprint::{self, Hash};
use crate::input::experiment::Experiment;
use crate::input::{resolve, scenery};
use crate::render::PreparedScene;
use crate::scene::{Scene, gltf};
use crate::settings::Settings;

use super::timed_renderer::TimedRenderer;

/// A scene with its gate, and the settings that render it.
pub struct Case {
    pub name: String,
    pub scene: Scene,
    /// One entry per variant that finds all light of the scene.
    pub entries: Vec<Entry>,
    /// Notes about the scene and warnings about the settings, one sentence each, without repetitions.
    pub warnings: Vec<String>,
    /// Hash of the scene file, of the files it refers to, and of the grids and tables that the settings name.
    hash: Hash,
}

/// A variant's settings for one scene.
#[derive(Clone)]
pub struct Entry {
    pub variant: String,
    pub settings: Settings,
    /// The experiment with these settings, as TOML without scene, seed, samples and time.
    pub config: String,
    /// Fingerprint of scene, settings and renderer. Rows with the same fingerprint can be compared and kept.
    pub fingerprint: String,
    /// File name of the reference for these settings. Variants with the same strategies and maximum depth share one.
    pub reference: String,
}

impl Case {
    /// Loads a scene. Errors name line and column of the scene in the suite file. Variants that would miss light are left out
    /// with a warning.
    pub fn load(suite: &Suite, entry: &SceneEntry) -> Result<Case> {
        let wrong = |error: Error, part| suite.error_at(entry, part, &error.to_string());
        let files = match entry.generated {
            Some(kind) => vec![generate::glb_bytes(kind)],
            None => gltf::files(entry.path()).map_err(|e| wrong(e, Part::Path))?,
        };
        let mut scene = gltf::load_slice(&files[0], entry.path()).map_err(|e| wrong(e, Part::Path))?;
        let mut own = entry.experiment.clone();
        let warnings = scenery::apply(&mut own, &mut scene).map_err(|e| wrong(e, Part::Name))?;
        let mut hash = files.iter().fold(Hash::new(), |hash, bytes| hash.with(bytes));
        let inputs = own.input_files();
        if !inputs.is_empty() {
            let contents = fingerprint::of_files(&inputs).map_err(|e| wrong(e, Part::Name))?;
            hash = hash.with(contents.as_bytes());
        }
        let mut case = Case { name: entry.name.clone(), scene, entries: vec![], warnings, hash };
        for variant in &suite.variants {
            let (camera, emitter) = (own.camera.clone(), own.emitter.clone());
            let experiment = Experiment { camera, emitter, ..suite.experiment(entry, variant) };
            let resolved = resolve::resolve(&experiment, &case.scene).map_err(|e| wrong(e, Part::Name))?;
            case.warnings
                .extend(resolved.warnings.into_iter().filter(|w| !case.warnings.contains(w)).collect::<Vec<_>>());
            if resolved.settings.missed_lights(&case.scene).next().is_none() {
                case.entries.push(case.entry(&variant.name, &experiment, resolved.settings));
            } else {
                case.warnings.push(format!("{} is left out because it cannot find the light of a beam", variant.name));
            }
        }
        if case.entries.is_empty() {
            return Err(suite.error_at(
                entry,
                Part::Name,
                "no variant finds the light of its beam; add a variant with bdpt or lcs",
            ));
        }
        Ok(case)
    }

    fn entry(&self, variant: &str, experiment: &Experiment, settings: Settings) -> Entry {
        let mut config = resolve::as_experiment(experiment, &settings, &self.scene);
        config.scene = None;
        // The names of references are hashes of this text. Earlier versions printed the crop of a whole image too.
        config.camera.crop = Some(settings.crop());
        (config.render.seed, config.render.spp, config.render.time) = (None, None, None);
        let text = config.to_toml();
        // The hash has the contents of the files, so their folders do not matter.
        let placeless = without_folders(config);

        // The expected image depends on scene, camera, gate and the set of paths, not on the estimator.
        let mut truth = placeless.clone();
        truth.render = crate::settings::table::RenderTable {
            strategies: Some(settings.strategies()),
            max_depth: Some(settings.max_depth()),
            ..Default::default()
        };
        let reference = format!("{}-{}.exr", self.name, self.hash.with(truth.to_toml().as_bytes()).digits());
        Entry {
            variant: variant.into(),
            fingerprint: self.hash.with(placeless.to_toml().as_bytes()).with(fingerprint::RENDERER.as_bytes()).digits(),
            config: text,
            reference,
            settings,
        }
    }

    /// Builds the BVH and the tables of the scene, which all entries share. If no path can meet the gate, the error names line
    /// and column of the gate in the suite file.
    pub fn prepare(&self, suite: &Suite, scene: &SceneEntry) -> Result<PreparedScene> {
        let settings = &self.entries[0].settings;
        let prepared =
            PreparedScene::new(&self.scene, settings).map_err(|e| suite.error_at(scene, Part::Name, &e.to_string()))?;
        let bounds = prepared.travel_time_bounds(settings.max_depth());
        let responses = settings.responses();
        if !responses.are_steady() && !bounds.overlaps(&responses.support()) {
            let message = format!(
                "the {} meets no light: {}; see taugate info {}",
                responses.describe(),
                bounds.explain_miss(&responses.support(), |length| format!("{length:.4} m")),
                scene.path().display()
            );
            return Err(suite.error_at(scene, Part::Gate, &message));
        }
        Ok(prepared)
    }

    pub(super) fn timed(
        &self,
        device: &Device,
        settings: &Settings,
        prepared: &PreparedScene,
    ) -> Result<TimedRenderer> {
        TimedRenderer::new(device, &self.scene, settings, prepared)
    }
}

/// The experiment with the names of its files alone.
fn without_folders(mut experiment: Experiment) -> Experiment {
    let cut = experiment.each_path(|path| {
        *path = path.file_name().map_or(PathBuf::new(), PathBuf::from);
        Ok(())
    });
    cut.expect("cutting does not fail");
    experiment
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// The entry of a scene with these keys, in a suite in this folder.
    fn entry_in(folder: &Path, keys: &str) -> Entry {
        let text = format!(
            "[[scene]]\nname = 'box'\ngenerate = {{ name = 'cornell-box' }}\nresolution = '8x8'\n{keys}\n[[variant]]\nname = 'bdpt'\n"
        );
        let suite = Suite::parse(&folder.join("s.toml"), text).unwrap_or_else(|e| panic!("{keys}: {e}"));
        let mut case = Case::load(&suite, &suite.scenes[0]).unwrap_or_else(|e| panic!("{keys}: {e}"));
        case.entries.remove(0)
    }

    /// The name of the reference of a scene with these keys.
    fn reference(keys: &str) -> String {
        entry_in(Path::new(""), keys).reference
    }

    /// A suite whose keys stay the same keeps its references.
    #[test]
    fn the_text_behind_a_name_has_the_crop_of_the_whole_image() {
        let config = entry_in(Path::new(""), "").config;
        assert!(config.contains("crop = \"0,8,0,8\""), "{config}");
    }

    #[test]
    fn another_camera_or_light_has_another_reference() {
        let light = "[[scene.light]]\ntype = 'point'\nposition = [0, 1, 0]\nintensity = 1";
        let keys = [
            "",
            "camera = 'auto'",
            "look-from = [0, 1, 3]",
            "look_at = [0, 1.5, 0]",
            "up = [1, 0, 0]",
            "fov = 30",
            "ortho = 2.5",
            "principal-point = [0.4, 0.5]",
            "headlamp = true",
            "headlamp = 3.5",
            "headlamp-offset = [0, 0, 1]",
            "lamp = [0, 1, 0, 2]",
            light,
        ];
        let names: std::collections::BTreeSet<String> = keys.iter().map(|keys| reference(keys)).collect();
        assert_eq!(names.len(), keys.len(), "{names:?}");
        assert!(names.contains(&reference("")));
    }

    #[test]
    fn the_contents_of_a_table_decide_and_not_its_place() {
        let keys = "medium = { sigma-s = 0.1, phase = 'tables/fog.csv' }";
        let [here, there] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let reference = |folder: &tempfile::TempDir, table: &str| {
            std::fs::create_dir_all(folder.path().join("tables")).unwrap();
            std::fs::write(folder.path().join("tables/fog.csv"), table).unwrap();
            entry_in(folder.path(), keys).reference
        };
        let first = reference(&here, "-1,1\n1,1\n");
        assert_ne!(reference(&here, "-1,2\n1,1\n"), first);
        assert_eq!(reference(&there, "-1,1\n1,1\n"), first);
    }
}

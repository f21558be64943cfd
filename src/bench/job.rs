//! One scene of a suite made ready: loaded, and its settings resolved for every variant.

use super::suite::{Part, SceneEntry, Suite};
use crate::error::{Error, Result};
use crate::generate;
use crate::gpu::Device;
use crate::image::fingerprint::{self, Hash};
use crate::input::experiment::Experiment;
use crate::input::resolve;
use crate::render::{PreparedScene, TravelTimeBounds};
use crate::scene::{Scene, gltf};
use crate::settings::Settings;

use super::timed_renderer::TimedRenderer;

/// A scene through a gate, and the ways to render it.
pub struct Job {
    pub name: String,
    pub scene: Scene,
    /// Of the variants that find all of the scene's light.
    pub entries: Vec<Entry>,
    /// What the user should know about the settings, one sentence each, without repetitions.
    pub warnings: Vec<String>,
    /// Of the scene's file and of all that it names.
    hash: Hash,
}

/// A variant's settings for one scene.
#[derive(Clone)]
pub struct Entry {
    pub variant: String,
    pub settings: Settings,
    /// The experiment that renders the same, as TOML without scene, seed and budget.
    pub config: String,
    /// Fingerprint of scene, settings and renderer: rows of a table that carry it were measured with them.
    pub fingerprint: String,
    /// Name of the file that holds the truth for these settings. Variants of the same strategies and depth share one.
    pub reference: String,
}

impl Job {
    /// Loads a scene. Errors name the place in the suite where the scene, its camera, emitters or gate are chosen.
    pub fn load(suite: &Suite, entry: &SceneEntry) -> Result<Job> {
        let wrong = |error: Error, part| suite.error_at(entry, part, &error.to_string());
        let files = match entry.generated {
            Some(kind) => vec![generate::scene(kind)],
            None => gltf::files(entry.path()).map_err(|e| wrong(e, Part::Path))?,
        };
        let scene = gltf::load_slice(&files[0], entry.path()).map_err(|e| wrong(e, Part::Path))?;
        let hash = files.iter().fold(Hash::new(), |hash, bytes| hash.with(bytes));
        let mut job = Job { name: entry.name.clone(), scene, entries: vec![], warnings: vec![], hash };
        for variant in &suite.variants {
            let experiment = suite.experiment(entry, variant);
            let resolved = resolve::resolve(&experiment, &job.scene).map_err(|e| wrong(e, Part::Name))?;
            job.warnings
                .extend(resolved.warnings.into_iter().filter(|w| !job.warnings.contains(w)).collect::<Vec<_>>());
            if job.sees_all(&resolved.settings) {
                job.entries.push(job.entry(&variant.name, &experiment, resolved.settings));
            } else {
                job.warnings.push(format!("{} is left out: it would miss the light of a beam", variant.name));
            }
        }
        if job.entries.is_empty() {
            return Err(suite.error_at(
                entry,
                Part::Name,
                "no variant finds the light of its beam; add one of bdpt or lcs",
            ));
        }
        Ok(job)
    }

    /// Whether settings find all the light: not every estimator sees a beam.
    fn sees_all(&self, settings: &Settings) -> bool {
        let selected = self.scene.lights.iter().filter(|light| settings.emitters().include(&light.node));
        let beams = selected.filter(|light| light.kind.needs_light_subpaths()).count();
        beams == 0 || settings.estimator().sees_beams()
    }

    fn entry(&self, variant: &str, experiment: &Experiment, settings: Settings) -> Entry {
        let mut config = resolve::as_experiment(experiment, &settings, &self.scene);
        config.scene = None;
        (config.render.seed, config.render.spp, config.render.time) = (None, None, None);
        let text = config.to_toml();

        // The truth depends on what is looked at and on which paths count, not on how they are found.
        let mut truth = config.clone();
        truth.render = crate::settings::table::RenderTable {
            strategies: Some(settings.strategies()),
            max_depth: Some(settings.max_depth()),
            ..Default::default()
        };
        let reference = format!("{}-{}.exr", self.name, self.hash.with(truth.to_toml().as_bytes()).digits());
        Entry {
            variant: variant.into(),
            fingerprint: self.hash.with(text.as_bytes()).with(fingerprint::RENDERER.as_bytes()).digits(),
            config: text,
            reference,
            settings,
        }
    }

    /// The scene's hierarchy, which all entries share. Fails with the gate's place in the suite if no path can meet it.
    pub fn prepare(&self, suite: &Suite, scene: &SceneEntry) -> Result<PreparedScene> {
        let settings = &self.entries[0].settings;
        let prepared =
            PreparedScene::new(&self.scene, settings).map_err(|e| suite.error_at(scene, Part::Name, &e.to_string()))?;
        let bounds = TravelTimeBounds::new(&prepared, settings);
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

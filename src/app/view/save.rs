//! Saves the image of the viewer, in the same file formats as `taugate render`.

use std::path::{Path, PathBuf};

use anyhow::bail;
use taugate::internals::image::exr_file::Provenance;
use taugate::internals::image::layers::Layers;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::{self, Outputs};
use taugate::internals::job::preparation::Preparation;
use taugate::internals::job::sum_files::Before;
use taugate::internals::render::Renderer;
use taugate::internals::settings::values::Files;
use taugate::internals::settings::{Budget, MAX_SPP};

use super::super::report::Report;
use super::viewed_scene::ViewedScene;

/// Maximum length of a name.
const MAX_NAME: usize = 100;

/// The image so far.
pub struct Finished<'a> {
    pub renderer: &'a Renderer,
    pub viewed: &'a ViewedScene,
    /// Time spent on the iterations.
    pub seconds: f64,
}

impl Finished<'_> {
    /// Writes the files of `name` into `folder` and returns their names. Fails if the name could lead elsewhere, or if a file exists.
    pub fn save(&self, folder: &Path, name: &str) -> anyhow::Result<Vec<PathBuf>> {
        let outputs = self.outputs(folder, name)?;
        let files = outputs.files();
        if let Some(file) = outputs.replaced().iter().find(|file| file.symlink_metadata().is_ok()) {
            bail!("{} exists already; save under another name", file.display());
        }
        let view = self.viewed.view();
        let samples = self.renderer.film().samples().min(MAX_SPP.into()) as u32;
        let settings = view.settings.change().budget(Budget::Spp(samples)).build()?;
        let config = resolve::as_experiment(&view.placed, &settings, self.viewed.scene());
        let printed = Experiment { output: Default::default(), ..config }.to_toml();
        let provenance =
            Provenance { merged: self.renderer.merged(), ..Provenance::new(&settings, self.seconds, printed) };
        let report = Report {
            renderer: self.renderer,
            settings: &settings,
            provenance: &provenance,
            seconds: self.seconds,
            before: Before::default(),
            layers: &Layers::default(),
            preparation: &Preparation::start(),
            warnings: &view.warnings,
            // The page shows all warnings.
            gate_warning: None,
            is_frame: false,
        };
        report.write(&outputs, |_| Ok(()))?;
        Ok(files)
    }

    fn outputs(&self, folder: &Path, name: &str) -> anyhow::Result<Outputs> {
        check_name(name)?;
        let path = folder.join(name);
        let mut wanted = Experiment { gate: self.viewed.view().experiment.gate.clone(), ..Experiment::default() };
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        // `resolve::outputs` needs an image or an array, even if only other files are written.
        let image = if extension == "exr" { path.clone() } else { path.with_extension("npy") };
        wanted.output.output = Some(Files(vec![image]));
        let has_variance = self.renderer.response_count() == 1 || self.renderer.has_response_variance();
        wanted.output.variance = (extension == "npy" && has_variance).then_some(true);
        let outputs = match extension.to_str() {
            Some("exr" | "npy") => resolve::outputs(&wanted)?,
            Some("png") => Outputs { npy: None, png: Some(path), ..resolve::outputs(&wanted)? },
            Some("json") => Outputs { npy: None, stats: Some(path), ..resolve::outputs(&wanted)? },
            _ => {
                bail!("'{name}' ends in none of .exr, .png, .npy and .json; add the ending of the format that you want")
            }
        };
        Ok(outputs)
    }
}

/// Fails if `name` is not the plain name of a visible file.
fn check_name(name: &str) -> anyhow::Result<()> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    let begins_well = name.starts_with(|c: char| c.is_ascii_alphanumeric());
    if begins_well && name.len() <= MAX_NAME && name.chars().all(is_plain) {
        return Ok(());
    }
    bail!(
        "a file name has at most {MAX_NAME} letters, digits, dots, dashes and underscores, and begins with a letter or a digit"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_the_folder() {
        for good in ["a.exr", "Fog_12.5m-13m.png", "7.json"] {
            check_name(good).unwrap();
        }
        let long = "a".repeat(101);
        for bad in [
            "",
            ".",
            "..",
            ".hidden.exr",
            "../a.exr",
            "a/b.exr",
            "a\\b.exr",
            "-rf.exr",
            "a b.exr",
            "ä.exr",
            "a\0.exr",
            &long,
        ] {
            assert!(check_name(bad).is_err(), "{bad:?}");
        }
    }
}

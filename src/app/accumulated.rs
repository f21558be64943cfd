//! The images of sums (`.acc`), for the commands that read images.

use std::path::Path;

use taugate::internals::files::has_extension;
use taugate::internals::image::accumulation::file::{read, read_about};
use taugate::internals::image::accumulation::{About, Accumulation};
use taugate::internals::image::exr_file::Picture;
use taugate::internals::image::npy_read::{DescribedResponse, ImageArray};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::responses::chosen;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Response, Responses};
use taugate::{Error, Result};

/// Whether `path` names sums.
pub fn is_sums(path: &Path) -> bool {
    has_extension(path, "acc")
}

/// Whether `path` names sums of several responses.
pub fn has_many(path: &Path) -> Result<bool> {
    Ok(is_sums(path) && read_about(path)?.responses.len() > 1)
}

/// The experiment of the sums in the file `path`.
pub fn experiment(path: &Path, about: &About) -> Result<Experiment> {
    Experiment::parse(&about.settings)
        .map_err(|e| Error::File { path: path.into(), message: format!("its settings cannot be read: {e}") })
}

/// The responses of the sums in the file `path`, from the settings in it. Fails if a file of `--response` has changed since the render.
/// The second result is a warning if the sums do not record what such a file contained.
pub fn responses(path: &Path, about: &About) -> Result<(Responses, Option<String>)> {
    let fail = |message: String| Error::File { path: path.into(), message };
    let responses = chosen(&experiment(path, about)?.gate)?;
    if responses.len() != about.responses.len() {
        return Err(fail(format!(
            "has sums of {} gates, but its settings name {}; restore the files of --response",
            about.responses.len(),
            responses.len()
        )));
    }
    let warning = about.check_tables(&responses).map_err(|error| fail(error.to_string()))?;
    Ok((responses, warning.map(|warning| format!("warning: {}: {warning}", path.display()))))
}

/// As [`responses`], but prints the warning.
fn responses_for_reading(path: &Path, about: &About) -> Result<Responses> {
    let (responses, warning) = responses(path, about)?;
    warning.iter().for_each(|warning| super::say(warning));
    Ok(responses)
}

/// The image of a single response.
pub fn picture(path: &Path) -> Result<Picture> {
    let sums = read(path)?;
    let merged = sums.merged();
    let Accumulation { about, film, responses: many, .. } = sums;
    if many.is_some() {
        let message =
            "has the sums of several gates, but only an image of a single gate can be compared; give other sums".into();
        return Err(Error::File { path: path.into(), message });
    }
    // The gate without its edges, as EXR files have it.
    let gate = responses_for_reading(path, &about)?.iter().next().map_or(Gate::OPEN, Response::gate);
    Ok(Picture {
        width: film.width(),
        height: film.height(),
        rgb: film.shown(),
        undamped: film.damps_fireflies().then(|| film.mean()),
        variance: Some(film.variance_of_mean()),
        cell_batches: Some(film.cells().to_floats()),
        seed: Some(about.seed.to_string()),
        renderer: Some(about.renderer),
        seconds: Some(about.seconds),
        merged,
        gate: Some([gate.lo, gate.hi]),
        corner: [about.crop[0] as i32, about.crop[2] as i32],
    })
}

/// The images of all responses, and a description of each response.
pub fn array(path: &Path) -> Result<(ImageArray, Vec<DescribedResponse>)> {
    let Accumulation { about, film, responses: many, .. } = read(path)?;
    let (width, height) = (film.width() as usize, film.height() as usize);
    let array = match many {
        None => ImageArray { width, height, responses: None, values: film.shown() },
        Some(all) => {
            let values = (0..all.pixels()).flat_map(|pixel| all.means_of(pixel)).collect();
            ImageArray { width, height, responses: Some(all.responses()), values }
        }
    };
    Ok((array, responses_for_reading(path, &about)?.iter().map(DescribedResponse::of).collect()))
}

//! Checks of the outputs before a render, so that no long render and no input is lost.

use std::path::{Path, PathBuf};

use taugate::internals::files::{check_writable, lies_in};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::{self, Outputs};
use taugate::internals::input::sequence::Sequence;
use taugate::internals::scene::gltf;
use taugate::{Error, Result};

use super::super::strategies;

/// Fails if an output cannot be written, or if two outputs are one file.
pub fn check_outputs(outputs: &Outputs) -> Result<()> {
    let paths = outputs.files();
    paths.iter().try_for_each(|path| check_writable(path))?;
    let mut pairs = paths.iter().enumerate().flat_map(|(i, path)| paths[..i].iter().map(move |other| (path, other)));
    if let Some((path, other)) = pairs.find(|(path, other)| lies_in(path, other)) {
        if path == other {
            return Err(Error::settings(format!(
                "two outputs have the name {} (an array OUT.npy comes with a description OUT.json); choose another name",
                path.display()
            )));
        }
        return Err(Error::settings(format!(
            "{} and {} are links to one file, so one would replace the other; choose another name",
            other.display(),
            path.display()
        )));
    }
    let Some(folder) = &outputs.strategy_images else { return Ok(()) };
    strategies::check_folder(folder)?;
    match paths.iter().find(|file| lies_in(file, folder)) {
        Some(file) => Err(Error::settings(format!(
            "the folder of --strategy-images is replaced as a whole, and {} would lie in this folder; choose another",
            file.display()
        ))),
        None => Ok(()),
    }
}

/// Refuses outputs that would replace an input: a file of the scene, such as a texture, or a file that the settings name.
pub fn check_inputs(outputs: &[PathBuf], scene: &Path, experiment: &Experiment) -> Result<()> {
    let existing: Vec<_> = outputs.iter().filter(|path| path.exists()).collect();
    if existing.is_empty() {
        return Ok(());
    }
    let find = |inputs: &[PathBuf]| {
        existing
            .iter()
            .find(|output| inputs.iter().any(|input| lies_in(output, input)))
            .map(|output| output.to_path_buf())
    };
    if let Some(path) = find(&experiment.input_files()) {
        let message = "is a file that the settings name as an input; choose another name".into();
        return Err(Error::File { path, message });
    }
    if let Some(path) = find(&gltf::paths(scene, &experiment.input.allowed())) {
        let message = format!("is a file that the scene {} reads; choose another name", scene.display());
        return Err(Error::File { path, message });
    }
    Ok(())
}

/// Fails if the contact sheet or the animation cannot be written, or if it would replace an input or a file of a frame.
pub fn check_pictures(sequence: &Sequence, experiment: &Experiment) -> Result<()> {
    let pictures: Vec<PathBuf> = sequence.contact_sheet.iter().chain(&sequence.gif).cloned().collect();
    pictures.iter().try_for_each(|path| check_writable(path))?;
    for frame in sequence.frames().filter(|_| !pictures.is_empty()) {
        // The gate does not name pictures, and its tables need not be read for every frame.
        let without_gate = Experiment { gate: Default::default(), ..sequence.frame(frame) };
        let files = resolve::outputs(&without_gate)?.files();
        if let Some(path) = pictures.iter().find(|picture| files.iter().any(|file| lies_in(picture, file))) {
            let message = format!("is a file of frame {frame}; choose another name");
            return Err(Error::File { path: path.clone(), message });
        }
    }
    let scene = experiment.scene.as_ref().expect("the experiment names a scene");
    check_inputs(&pictures, scene, experiment)
}

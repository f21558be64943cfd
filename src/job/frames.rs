//! The frames of a sequence: rendered one after the other, and found again by a later command.

use std::path::Path;

use super::sums::Identity;
use crate::error::{Error, Result};
use crate::files::{has_extension, has_left_over, remove};
use crate::image::accumulation;
use crate::image::exr_header::{missing_layer, read_settings};
use crate::image::npy_file::description_path;
use crate::input::experiment::Experiment;
use crate::input::resolve::Outputs;
use crate::input::sequence::Sequence;
use crate::settings::aov::Aov;

/// How the first line of a frame's settings begins. The fingerprint of the input files follows. The line is a comment in TOML.
const INPUTS: &str = "# Inputs: ";

/// How a render ended.
pub enum Outcome {
    Done,
    /// The files are there already, with the same settings.
    Kept,
    /// The scene cannot be rendered at the moment of this frame, for example because the camera is scaled to nothing.
    LeftOut(Error),
    /// The user stopped the render.
    Interrupted,
}

/// What became of the frames of a sequence that this machine renders.
#[derive(Default)]
pub struct Frames {
    /// The frames that existed before.
    pub kept: Vec<u32>,
    pub left_out: Vec<(u32, Error)>,
    /// Whether the user stopped the render; there are more frames.
    pub is_interrupted: bool,
}

/// Calls `render` with the number and the experiment of each frame of this shard, up to the first error or interrupt. The first argument
/// counts the frames from 1.
pub fn render_all<E>(
    sequence: &Sequence,
    mut render: impl FnMut(usize, u32, Experiment) -> Result<Outcome, E>,
) -> Result<Frames, E> {
    let mut frames = Frames::default();
    for (place, frame) in sequence.own_frames().enumerate() {
        match render(place + 1, frame, sequence.frame(frame))? {
            Outcome::Done => {}
            Outcome::Kept => frames.kept.push(frame),
            Outcome::LeftOut(error) => frames.left_out.push((frame, error)),
            Outcome::Interrupted => return Ok(Frames { is_interrupted: true, ..frames }),
        }
    }
    Ok(frames)
}

/// The settings of a frame with a first line about its inputs, so that a later command can check both.
pub fn with_inputs(settings: &str, identity: &Identity) -> String {
    format!("{INPUTS}{}\n{settings}", identity.inputs())
}

/// Removes the array of a frame whose process was killed before the JSON file, which comes last, had its name. The file is still there under
/// its temporary name.
pub fn remove_cut_off(outputs: &Outputs) -> Result<()> {
    let is_cut_off = |npy: &Path| !description_path(npy).exists() && has_left_over(&description_path(npy));
    outputs.npy.as_deref().filter(|npy| is_cut_off(npy)).map_or(Ok(()), remove)
}

/// Whether all files of a frame exist. Its picture may be missing, because it is made from them. Fails if an image has other
/// settings or inputs than `identity`, or lacks a layer. Fails if sums belong to another render, or have another `--spp` or `--time`.
/// Settings that do not affect the image may differ.
pub fn is_finished(outputs: &Outputs, identity: &Identity) -> Result<bool> {
    let other = |path: &Path, difference: &str| {
        let message = format!("{} exists, but {difference}; remove it, or choose another name", path.display());
        Err(Error::settings(message))
    };
    for path in [&outputs.exr, &outputs.npy].into_iter().flatten().filter(|path| path.exists()) {
        if Some(path) == outputs.npy.as_ref() && !description_path(path).exists() {
            return other(path, "has no JSON file beside it");
        }
        let found = settings_of(path).unwrap_or_default();
        let (inputs, found) = match found.strip_prefix(INPUTS).and_then(|rest| rest.split_once('\n')) {
            Some((inputs, rest)) => (Some(inputs), rest),
            None => (None, &found[..]),
        };
        match identity.difference_to(found) {
            Some(difference) => return other(path, &format!("has other settings ({difference})")),
            None if inputs.is_none() => {
                return other(path, "was rendered alone, without a fingerprint of its inputs");
            }
            None if inputs != Some(identity.inputs()) => return other(path, "its scene or another input has changed"),
            None => {}
        }
    }
    if let Some(path) = outputs.exr.as_ref().filter(|path| path.exists())
        && let Some(layer) = missing_layer(path, outputs.aov)
    {
        return other(path, &format!("lacks the layer {layer}"));
    }
    if let Some(path) = outputs.acc.as_ref().filter(|path| path.exists()) {
        identity.check_file(path)?;
        if !identity.has_budget_of(path)? {
            return other(path, "was rendered with another --spp or --time");
        }
        if outputs.aov != Aov::default()
            && let Err(layer) = accumulation::file::read(path)?.layers.keep(outputs.aov)
        {
            return other(path, &format!("lacks the layer {layer}"));
        }
    }
    Ok(outputs.files().iter().all(|path| path.exists() || Some(path) == outputs.png.as_ref()))
}

/// The settings that an image or an array was rendered with; `None` if they are not known.
fn settings_of(path: &Path) -> Option<String> {
    if has_extension(path, "exr") {
        return read_settings(path);
    }
    let text = std::fs::read(description_path(path)).ok()?;
    let description: serde_json::Value = serde_json::from_slice(&text).ok()?;
    Some(description["settings"].as_str()?.into())
}

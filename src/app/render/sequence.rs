//! `taugate render --frames`: renders the frames of a sequence one after the other.

mod pictures;

use std::path::Path;
use std::process::ExitCode;

use taugate::Error;
use taugate::internals::error::Result;
use taugate::internals::files::{has_left_over, remove};
use taugate::internals::image::accumulation;
use taugate::internals::image::exr_header::{missing_layer, read_settings};
use taugate::internals::image::npy_file::description_path;
use taugate::internals::input::resolve::{Outputs, outputs};
use taugate::internals::input::sequence::Sequence;
use taugate::internals::job::read;
use taugate::internals::job::sums::Identity;
use taugate::internals::settings::aov::Aov;

use super::outputs::check_pictures;
use super::{Interrupt, Outcome, Session};

/// How the first line of a frame's settings begins. The fingerprint of the input files follows. The line is a comment in TOML.
const INPUTS: &str = "# Inputs: ";

/// Renders the frames of this shard that are not finished. Then writes the contact sheet and the animation, and the pictures that are
/// missing or may have another exposure.
pub fn run(mut sequence: Sequence, session: &mut Session) -> anyhow::Result<ExitCode> {
    if let Some(first) = sequence.frames().next() {
        check_pictures(&sequence, &sequence.frame(first))?;
    }
    // The first frames must not be rendered if the last one is beyond the end of the animation.
    if let Some(last) = sequence.frames().next_back() {
        read::check_pose(&sequence.frame(last))?;
    }
    // There is no result to keep yet.
    session.interrupts.end_the_process_at(Interrupt::First);
    let notes = sequence.choose_for_all(read::scene)?;
    notes.iter().for_each(|note| session.say(format!("note: {note}")));
    let sequence = &sequence;
    session.is_sequence = true;
    let count = sequence.own_frames().count();
    let (mut kept, mut failed) = (vec![], vec![]);
    for (number, frame) in sequence.own_frames().enumerate() {
        let outcome = match session.render(sequence.frame(frame)) {
            // The scene cannot be rendered at this moment, for example because the camera is scaled to nothing.
            Err(error) if matches!(error.downcast_ref(), Some(Error::Scene { .. })) => {
                session.progress.line(&format!("frame {frame} is left out: {error}"));
                failed.push((frame, error));
                continue;
            }
            outcome => outcome?,
        };
        if outcome == Outcome::Kept {
            kept.push(frame);
        }
        if outcome == Outcome::Done {
            session.progress.line(&format!("frame {frame}: {} of {count}", number + 1));
        }
        if outcome == Outcome::Interrupted {
            return Ok(outcome.code());
        }
    }
    if !kept.is_empty() {
        let line = format!("{} of {count} frames exist with the same settings and are kept", kept.len());
        session.progress.line(&line);
    }
    if let Some((frame, error)) = failed.first() {
        let pictures = match sequence.contact_sheet.is_some() || sequence.gif.is_some() {
            true => ", without the contact sheet and the animation",
            false => "",
        };
        let message = format!(
            "{} of {count} frames could not be rendered; the others are finished{pictures}; the first is frame {frame}: {error}",
            failed.len()
        );
        return Err(Error::settings(message).into());
    }
    pictures::write(sequence, &kept, session)?;
    Ok(ExitCode::SUCCESS)
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
    if path.extension()?.eq_ignore_ascii_case("exr") {
        return read_settings(path);
    }
    let text = std::fs::read(description_path(path)).ok()?;
    let description: serde_json::Value = serde_json::from_slice(&text).ok()?;
    Some(description["settings"].as_str()?.into())
}

/// The files of a frame.
fn files(sequence: &Sequence, frame: u32) -> Result<Outputs> {
    outputs(&sequence.frame(frame))
}

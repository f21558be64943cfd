//! `taugate render --frames`: renders the frames of a sequence one after the other.

mod pictures;

use std::process::ExitCode;

use taugate::internals::input::resolve::{Outputs, outputs};
use taugate::internals::input::sequence::Sequence;
use taugate::internals::job::exposure::Exposure;
use taugate::internals::job::frames::{self, Frames, Outcome};
use taugate::internals::job::{Job, read};
use taugate::{Error, Result};

use super::outputs::check_pictures;
use super::{Interrupt, Session, code};

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
    // The shutter must not be open beyond the end, either.
    if let Some(last) = sequence.frames().next_back().map(|last| sequence.frame(last))
        && last.input.shutter.is_some()
    {
        // A scene that cannot be rendered is left out later.
        if let Ok(job) = read::scene(&last).and_then(|scene| Job::new(last, scene)) {
            Exposure::new(&job.config(), job.settings(), job.scene())?;
        }
    }
    let sequence = &sequence;
    session.is_sequence = true;
    let count = sequence.own_frames().count();
    let frames = frames::render_all(sequence, |place, frame, experiment| {
        let outcome = match session.render(experiment).map_err(anyhow::Error::downcast::<Error>) {
            Err(Ok(error @ Error::Scene { .. })) => Outcome::LeftOut(error),
            Err(Ok(error)) => return Err(error.into()),
            Err(Err(error)) => return Err(error),
            Ok(outcome) => outcome,
        };
        match &outcome {
            Outcome::Done => session.progress.line(&format!("frame {frame}: {place} of {count}")),
            Outcome::LeftOut(error) => session.progress.line(&format!("frame {frame} is left out: {error}")),
            Outcome::Kept | Outcome::Interrupted => {}
        }
        anyhow::Ok(outcome)
    })?;
    if frames.is_interrupted {
        return Ok(code(true));
    }
    let Frames { kept, left_out, .. } = frames;
    if !kept.is_empty() {
        let line = format!("{} of {count} frames exist with the same settings and are kept", kept.len());
        session.progress.line(&line);
    }
    if let Some((frame, error)) = left_out.first() {
        let pictures = match sequence.contact_sheet.is_some() || sequence.gif.is_some() {
            true => ", without the contact sheet and the animation",
            false => "",
        };
        let message = format!(
            "{} of {count} frames could not be rendered; the others are finished{pictures}; the first is frame {frame}: {error}",
            left_out.len()
        );
        return Err(Error::settings(message).into());
    }
    pictures::write(sequence, &kept, session)?;
    Ok(ExitCode::SUCCESS)
}

/// The files of a frame.
fn files(sequence: &Sequence, frame: u32) -> Result<Outputs> {
    outputs(&sequence.frame(frame))
}

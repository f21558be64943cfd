//! Pictures of the frames of a sequence: one by one, side by side, and as an animation. All frames have one exposure. Only one frame at
//! a time is in memory, because a sequence may be much larger than the memory.

use std::path::Path;
use std::{io, iter};

use gif::{DisposalMethod, Encoder, EncodingError, Frame, Repeat};
use taugate::internals::files::write_atomically;
use taugate::internals::image::{exr_responses, npy_read, png_file};
use taugate::internals::input::resolve::Outputs;
use taugate::internals::input::sequence::Sequence;
use taugate::internals::settings::exposure::Exposure;
use taugate::{Error, Result};

use super::super::Session;
use super::files;
use crate::app::accumulated;
use crate::app::rescue::Rescue;
use crate::app::sheet::{Linear, sheet};

/// Writes the pictures that the user wants: of the frames, the contact sheet and the animation. `kept`: the frames that existed before.
pub fn write(sequence: &Sequence, kept: &[u32], session: &mut Session) -> anyhow::Result<()> {
    let own: Vec<Outputs> = sequence.own_frames().map(|frame| files(sequence, frame)).collect::<Result<_>>()?;
    let has_pictures = own.iter().any(|frame| frame.png.is_some());
    if !has_pictures && sequence.contact_sheet.is_none() && sequence.gif.is_none() {
        return Ok(());
    }
    let exposure = match sequence.exposure {
        Exposure::Stops(stops) => Some(stops.exp2() as f32),
        // Another machine may still render the other frames.
        Exposure::Auto if !sequence.is_whole() => None,
        Exposure::Auto => Some(png_file::common_exposure(|see| {
            own.iter().try_for_each(|frame| read(frame).map(|frame| see(&frame.rgb)))
        })?),
    };
    // The picture of a kept frame may have any exposure. That of a new frame has the automatic exposure of this frame.
    let is_automatic = exposure.is_some() && sequence.exposure == Exposure::Auto;
    let is_outdated = |frame: u32| is_automatic || kept.contains(&frame);
    let mut rescue = Rescue::default();
    for (_, outputs) in sequence.own_frames().zip(&own).filter(|(frame, _)| is_outdated(*frame)) {
        rescue.check(rewrite(outputs, exposure));
    }
    if has_pictures
        && is_automatic
        && let Some(stops) = exposure.map(f32::log2)
    {
        session.progress.line(&format!(
            "pictures of all frames: exposure {stops:+.2} EV (auto; --exposure {stops:.2} gives other pictures the same)"
        ));
    }
    // Only a whole sequence has a contact sheet or an animation.
    let exposure = exposure.unwrap_or(1.0);
    if let Some(path) = &sequence.contact_sheet {
        let Linear { width, height, rgb } = sheet(own.len(), |frame| read(&own[frame]))?;
        if rescue.write(path, |path| png_file::write(path, width as u32, height as u32, &rgb, exposure)) {
            session.progress.line(&path.display().to_string());
        }
    }
    if let Some(path) = &sequence.gif
        && rescue.write(path, |path| write_gif(path, &own, sequence.fps(), exposure))
    {
        session.progress.line(&path.display().to_string());
    }
    rescue.finish()
}

/// Writes the picture of a frame again. Without an `exposure`, the picture gets its own.
fn rewrite(outputs: &Outputs, exposure: Option<f32>) -> Result<()> {
    let Some(path) = &outputs.png else { return Ok(()) };
    let Linear { width, height, rgb } = read(outputs)?;
    let exposure = exposure.unwrap_or_else(|| png_file::exposure(&rgb));
    png_file::write(path, width as u32, height as u32, &rgb, exposure)
}

/// Writes the animation of all frames.
fn write_gif(path: &Path, frames: &[Outputs], fps: u32, exposure: f32) -> Result<()> {
    write_atomically(path, |writer| {
        let mut pictures = (frames.iter().enumerate()).map(|(number, outputs)| {
            gif_frame(&read(outputs).map_err(io::Error::other)?, hundredths(number, fps), exposure)
        });
        let first = pictures.next().ok_or_else(|| io::Error::other("the sequence has no frames"))??;
        let mut encoder = Encoder::new(writer, first.width, first.height, &[]).map_err(into_io)?;
        encoder.set_repeat(Repeat::Infinite).map_err(into_io)?;
        for picture in iter::once(Ok(first)).chain(pictures) {
            encoder.write_frame(&picture?).map_err(into_io)?;
        }
        encoder.into_inner().map(drop).map_err(into_io)
    })
}

/// Keeps the kind of a disk error, because the message to the user depends on it.
fn into_io(error: EncodingError) -> io::Error {
    match error {
        EncodingError::Io(error) => error,
        other => io::Error::other(other),
    }
}

/// The picture of a frame in an animation that shows it for `delay` hundredths of a second.
fn gif_frame(image: &Linear, delay: u32, exposure: f32) -> io::Result<Frame<'static>> {
    /// Speed of the choice of 256 colours: the compromise that the encoder recommends.
    const SPEED: i32 = 10;
    let (Ok(width), Ok(height)) = (u16::try_from(image.width), u16::try_from(image.height)) else {
        return Err(io::Error::other(format!("a GIF has at most {0} x {0} pixels; render without --gif", u16::MAX)));
    };
    let mut frame = Frame::from_rgb_speed(width, height, &png_file::expose(&image.rgb, exposure), SPEED);
    frame.delay = delay.try_into().unwrap_or(u16::MAX);
    frame.dispose = DisposalMethod::Background;
    Ok(frame)
}

/// How long an animation shows the frame with this number, counted from 0: whole hundredths of a second, as GIF files have them. The
/// rounding errors do not add up, so that the animation has the right length.
fn hundredths(number: usize, fps: u32) -> u32 {
    let end_of = |count: usize| (100.0 * count as f64 / f64::from(fps)).round() as u32;
    (end_of(number + 1) - end_of(number)).max(1)
}

/// The image of a frame. If the frame has several responses, their sum.
fn read(outputs: &Outputs) -> Result<Linear> {
    let array = match (&outputs.npy, &outputs.exr, &outputs.acc) {
        (Some(path), ..) => npy_read::read(path)?,
        (_, Some(path), _) => exr_responses::read(path)?.0,
        (.., Some(path)) => accumulated::array(path)?.0,
        (None, None, None) => return Err(Error::settings("a sequence needs -o OUT.####.exr")),
    };
    let mut rgb = vec![0.0; 3 * array.width * array.height];
    for response in 0..array.images() {
        rgb.iter_mut().zip(array.image(response)).for_each(|(sum, x)| *sum += x);
    }
    Ok(Linear { width: array.width, height: array.height, rgb })
}

#[cfg(test)]
mod tests {
    use super::hundredths;

    #[test]
    fn an_animation_has_the_wanted_speed() {
        let delays = |fps| [0, 1, 2, 3, 4, 5].map(|number| hundredths(number, fps));
        assert_eq!(delays(4), [25; 6]);
        assert_eq!(delays(24), [4, 4, 5, 4, 4, 4]);
        assert_eq!(delays(60), [2, 1, 2, 2, 1, 2]);
        assert_eq!(delays(1000), [1; 6]);
        assert_eq!((0..240).map(|number| hundredths(number, 24)).sum::<u32>(), 1000);
    }
}

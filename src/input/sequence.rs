//! A sequence of frames: the experiment of each frame.

use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::files::has_extension;
use crate::input::experiment::Experiment;
use crate::input::resolve::resolve;
use crate::input::scenery;
use crate::scene::Scene;
use crate::settings::exposure::Exposure;
use crate::settings::frames::{Frames, GateKeys};
use crate::settings::moment::Moment;
use crate::settings::shard::Shard;
use crate::settings::table::OutputTable;
use crate::settings::values::{Files, Png};

/// Frames per second, if the user gives none.
pub(super) const DEFAULT_FPS: u32 = 24;

/// The frames of an experiment with `--frames`.
pub struct Sequence {
    /// The experiment without the settings of sequences; its outputs have patterns as names.
    experiment: Experiment,
    frames: Range<u32>,
    /// The part of the frames that this machine renders.
    shard: Shard,
    fps: u32,
    keys: Option<GateKeys>,
    /// End of the animations in seconds. The scene is posed at the time of each frame; `None` if no animation moves a node.
    end: Option<f64>,
    pub contact_sheet: Option<PathBuf>,
    pub gif: Option<PathBuf>,
    /// Exposure of all pictures; if it is automatic, a shard gives each picture its own.
    pub exposure: Exposure,
}

impl Sequence {
    /// The sequence of an experiment; `None` if it has no frames. `end`: the end of the scene's animations in seconds, `None` if no
    /// node moves. Fails if the settings do not fit a sequence: see the messages.
    pub fn new(experiment: &Experiment, end: impl FnOnce() -> Result<Option<f64>>) -> Result<Option<Sequence>> {
        experiment.output.check()?;
        let mut experiment = experiment.clone();
        if experiment.output.frames.is_some() {
            check_restartable(&experiment.output)?;
        }
        let OutputTable { frames, fps, contact_sheet, gif, shard, .. } = &mut experiment.output;
        let (frames, fps, contact_sheet, gif) = (frames.take(), fps.take(), contact_sheet.take(), gif.take());
        let shard = if frames.is_some() { shard.take().unwrap_or(Shard::ALL) } else { Shard::ALL };
        let keys = experiment.gate.gate_keys.take();
        let Some(frames) = frames else {
            let given = [
                ("fps", fps.is_some()),
                ("contact-sheet", contact_sheet.is_some()),
                ("gif", gif.is_some()),
                ("gate-keys", keys.is_some()),
            ];
            if let Some((name, _)) = given.iter().find(|(_, given)| *given) {
                return Err(Error::advice(format!("--{name} is for a sequence: "), "add --frames A..B"));
            }
            return check_still(&experiment.output).map(|()| None);
        };
        for (path, extension) in [(&contact_sheet, "png"), (&gif, "gif")] {
            if let Some(path) = path.as_ref().filter(|path| !has_extension(path, extension)) {
                return Err(Error::settings(format!("the picture {} must end in .{extension}", path.display())));
            }
        }
        let output = &experiment.output;
        if output.png_gates.is_some() {
            return Err(Error::settings(
                "--png-gates needs a single frame: the pictures of a sequence show the sum of all gates",
            ));
        }
        if output.strategy_images.is_some() {
            return Err(Error::advice("--strategy-images needs a single frame: ", "render it alone, with --at"));
        }
        if let Some((_, path)) = patterns(output).find(|(_, path)| numbered(path, 0).is_none()) {
            return Err(Error::advice(
                format!("{} would be replaced by every frame: ", path.display()),
                "write the number of the frame as #, like out.####.exr",
            ));
        }
        let exposure = output.exposure.unwrap_or_default();
        if (contact_sheet.is_some() || gif.is_some()) && !has_pictures(output) {
            // The frames have no picture that could be exposed.
            experiment.output.exposure = None;
        }
        let (frames, fps) = (frames.0, fps.unwrap_or(DEFAULT_FPS));
        let end = end()?;
        if end.is_none() && keys.is_none() {
            return Err(Error::advice(
                "no node of the scene is animated and the gate does not move, so all frames would be the same: ",
                "add --gate-keys FRAME=A..B",
            ));
        }
        Ok(Some(Sequence { experiment, frames, shard, fps, keys, end, contact_sheet, gif, exposure }))
    }

    /// Numbers of all frames.
    pub fn frames(&self) -> Range<u32> {
        self.frames.clone()
    }

    /// Numbers of the frames that this machine renders: of N shards, every Nth.
    pub fn own_frames(&self) -> impl Iterator<Item = u32> + Clone {
        let (shard, start) = (self.shard, self.frames.start);
        self.frames.clone().filter(move |frame| shard.has(frame - start))
    }

    /// Whether this machine renders all frames.
    pub fn is_whole(&self) -> bool {
        self.shard.is_all()
    }

    /// Frames per second.
    pub fn fps(&self) -> u32 {
        self.fps
    }

    /// Chooses the camera and the default estimator, and makes the choices of [`scenery::apply`], for all frames. They are those for the
    /// scene of the first frame, which `load` loads. If that scene cannot be rendered, they are those of the second frame. Returns
    /// the notes of [`scenery::apply`].
    pub fn choose_for_all(&mut self, load: impl Fn(&Experiment) -> Result<Scene>) -> Result<Vec<String>> {
        let first = self.frames.start;
        self.choose(first, &load).or_else(|error| match self.frames.contains(&(first + 1)) {
            true => self.choose(first + 1, &load).map_err(|_| error),
            false => Err(error),
        })
    }

    fn choose(&mut self, frame: u32, load: &impl Fn(&Experiment) -> Result<Scene>) -> Result<Vec<String>> {
        let mut first = self.frame(frame);
        let mut scene = load(&first)?;
        let notes = scenery::apply(&mut first, &mut scene)?;
        let settings = resolve(&first, &scene)?.settings;
        let estimator = settings.estimator();
        // The first camera of another frame may be another one. The word `auto` would mean the automatic camera.
        let camera = scene.cameras[settings.camera()].name.as_str();
        if camera != scenery::AUTO {
            first.camera.camera.get_or_insert(camera.into());
        }
        (self.experiment.camera, self.experiment.emitter) = (first.camera, first.emitter);
        self.experiment.render.estimator = Some(estimator);
        Ok(notes)
    }

    /// The experiment that renders a frame alone.
    pub fn frame(&self, number: u32) -> Experiment {
        let mut experiment = self.experiment.clone();
        experiment.input.at = self.end.map(|end| moment(number, self.fps, end, self.keys.is_some()));
        if let Some(keys) = &self.keys {
            experiment.gate.gate = Some(keys.gate(number.into()));
        }
        let name = |path: &mut PathBuf| *path = numbered(path, number).expect("the names were checked");
        let OutputTable { output, png, stats, .. } = &mut experiment.output;
        output.iter_mut().flat_map(|Files(files)| files).for_each(name);
        if let Some(Png::File(path)) = png {
            name(path);
        }
        stats.iter_mut().for_each(name);
        experiment
    }
}

/// The files that have the number of the frame in their names, or need it in a sequence, with their flags.
fn patterns(output: &OutputTable) -> impl Iterator<Item = (&'static str, &PathBuf)> {
    let png = match &output.png {
        Some(Png::File(path)) => Some(path),
        _ => None,
    };
    let images = output.output.iter().flat_map(|files| &files.0).map(|path| ("-o", path));
    images.chain(png.map(|path| ("--png", path))).chain(output.stats.iter().map(|path| ("--stats", path)))
}

/// Fails if a file of a render without frames has the name of frames: for example, if `--at` renders one moment of an experiment
/// with frames.
fn check_still(output: &OutputTable) -> Result<()> {
    let Some((flag, path)) = patterns(output).find(|(_, path)| is_for_frames(path)) else { return Ok(()) };
    let extension = path.extension().unwrap_or_default().display();
    Err(Error::advice(
        format!("{} is a name for the frames of a sequence: ", path.display()),
        format!("give {flag} OUT.{extension} instead, a name without #, or add --frames A..B"),
    ))
}

/// Whether the file can only be meant for the frames of a sequence. A # before a digit, as in the camera `eye#2`, belongs to a name.
fn is_for_frames(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.split('#').skip(1).any(|after| !after.starts_with(|c: char| c.is_ascii_digit()))
}

/// Whether a render, or each frame of a sequence, has a picture.
pub(super) fn has_pictures(output: &OutputTable) -> bool {
    let wanted = output.png.as_ref().is_some_and(|png| *png != Png::Wanted(false));
    wanted || output.output.iter().flat_map(|files| &files.0).any(|path| is_picture(path))
}

pub(super) fn is_picture(path: &Path) -> bool {
    has_extension(path, "png")
}

/// The experiment with the time of its first frame, and with the gate of this frame beside its gate keys. Defaults such as the
/// camera and the estimator depend on them. `end`: as in [`Sequence::new`]. Without frames, the experiment stays as it is.
pub fn at_first_frame(experiment: &Experiment, end: Option<f64>) -> Result<Experiment> {
    experiment.output.check()?;
    let mut first = experiment.clone();
    let OutputTable { frames, fps, .. } = &first.output;
    let number = frames.as_ref().map_or(0, |Frames(frames)| frames.start);
    let keys = &first.gate.gate_keys;
    if frames.is_some()
        && let Some(end) = end
    {
        first.input.at = Some(moment(number, fps.unwrap_or(DEFAULT_FPS), end, keys.is_some()));
    }
    if let Some(keys) = keys {
        first.gate.gate = Some(keys.gate(number.into()));
    }
    Ok(first)
}

/// The time of a frame. `end`: the end of the animations in seconds. A gate may sweep longer than the nodes move: then they keep
/// their last pose, as glTF prescribes.
fn moment(number: u32, fps: u32, end: f64, gate_moves: bool) -> Moment {
    let time = f64::from(number) / f64::from(fps);
    Moment(if gate_moves { time.min(end) } else { time })
}

/// Fails with --checkpoint or --resume. Also fails if a restarted sequence could not tell which frames are finished, and for a shard
/// if an output needs the frames of other shards.
fn check_restartable(output: &OutputTable) -> Result<()> {
    if output.checkpoint.is_some() || output.resume.is_some() {
        return Err(Error::advice(
            "finished frames are always kept, and the same command continues after them: ",
            "leave out --checkpoint and --resume",
        ));
    }
    let names = output.output.iter().flat_map(|files| &files.0);
    if names.clone().next().is_some() && names.clone().all(|path| is_picture(path)) {
        return Err(Error::advice(
            "a PNG does not record its settings, so a restarted sequence could not tell which frames are finished: ",
            "add -o OUT.####.exr",
        ));
    }
    let is_part = output.shard.is_some_and(|shard| !shard.is_all());
    if is_part && (output.contact_sheet.is_some() || output.gif.is_some()) {
        return Err(Error::advice(
            "a shard does not have all frames: ",
            "leave out --contact-sheet and --gif, and add them to the same command without --shard after the last shard",
        ));
    }
    Ok(())
}

/// `path` with the number of a frame in place of the last `#`s of its file name; `None` if it has none.
fn numbered(path: &Path, number: u32) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?;
    let end = name.rfind('#')? + 1;
    let begin = name[..end].trim_end_matches('#').len();
    let digits = end - begin;
    Some(path.with_file_name(format!("{}{number:0digits$}{}", &name[..begin], &name[end..])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::units::Gate;

    fn sequence(text: &str, end: Option<f64>) -> Result<Option<Sequence>> {
        Sequence::new(&Experiment::parse(text).unwrap(), || Ok(end))
    }

    #[test]
    fn a_frame_has_its_time_its_gate_and_its_files() {
        let text = "[output]\nframes = '10..20'\nfps = 4\noutput = ['a/b.###.exr', 'c#.npy']\nstats = '#.json'\n\
                    [gate]\ngate-keys = [[10, '5m..6m'], [14, '7m..8m']]\n";
        let sequence = sequence(text, Some(9.0)).unwrap().unwrap();
        assert_eq!((sequence.frames(), sequence.fps()), (10..20, 4));
        let frame = sequence.frame(12);
        assert_eq!((frame.input.at, frame.gate.gate), (Some(Moment(3.0)), Some(Gate { lo: 6.0, hi: 7.0 })));
        assert_eq!(frame.output.output, Some(Files(vec!["a/b.012.exr".into(), "c12.npy".into()])));
        assert_eq!((frame.output.stats, frame.output.frames), (Some("12.json".into()), None));
        let still = super::tests::sequence(text, None).unwrap().unwrap();
        assert_eq!(still.frame(12).input.at, None);
        // With gate keys, the nodes keep their last pose.
        let short = super::tests::sequence(text, Some(2.75)).unwrap().unwrap();
        assert_eq!([11, 12].map(|frame| short.frame(frame).input.at), [Some(Moment(2.75)); 2]);
        let (without_keys, _) = text.split_once("[gate]").unwrap();
        let short = super::tests::sequence(without_keys, Some(2.75)).unwrap().unwrap();
        assert_eq!(short.frame(12).input.at, Some(Moment(3.0)));
        assert!(super::tests::sequence("scene = 'a.glb'", Some(1.0)).unwrap().is_none());
    }

    #[test]
    fn an_exposure_is_for_the_pictures_that_exist() {
        let exposures = |text: &str| {
            let text = format!("[output]\nframes = '0..2'\nexposure = 2\n{text}");
            let sequence = sequence(&text, Some(1.0)).unwrap().unwrap();
            (sequence.exposure, sequence.frame(0).output.exposure)
        };
        let two = Exposure::Stops(2.0);
        assert_eq!(exposures("output = 'a#.exr'\ngif = 'a.gif'"), (two, None));
        assert_eq!(exposures("output = 'a#.exr'\ncontact-sheet = 'a.png'\npng = false"), (two, None));
        assert_eq!(exposures("output = 'a#.exr'\ngif = 'a.gif'\npng = true"), (two, Some(two)));
        assert_eq!(exposures("output = ['a#.exr', 'a#.png']\ngif = 'a.gif'"), (two, Some(two)));
        // Without any picture, the exposure is a mistake, which each frame refuses.
        assert_eq!(exposures("output = 'a#.exr'"), (two, Some(two)));
    }

    #[test]
    fn mistakes_name_the_remedy() {
        for (text, part) in [
            ("frames = '0..2'\noutput = 'a.exr'", "like out.####.exr"),
            ("frames = '0..2'\noutput = 'a#.exr'\npng = 'b.png'", "b.png would be replaced"),
            ("frames = '0..2'\noutput = 'a#.exr'\ngif = 'b.png'", "must end in .gif"),
            ("frames = '0..2'\noutput = 'a#.exr'\nstrategy-images = 'b'", "with --at"),
            ("frames = '0..2'\noutput = 'a#.exr'", "--gate-keys"),
            ("frames = '0..2'\noutput = 'a#.exr'\nfps = 0", "--fps is 0; it must be"),
            ("frames = '0..2'\noutput = 'a#.png'", "a PNG does not record its settings"),
            ("frames = '0..2'\noutput = 'a#.exr'\ncheckpoint = 'a.acc'", "finished frames are always kept"),
            ("frames = '0..2'\noutput = 'a#.exr'\nshard = '0/2'\ngif = 'a.gif'", "does not have all frames"),
            ("fps = 3\noutput = 'a#.exr'", "--fps is for a sequence"),
            ("gif = 'a.gif'", "--gif is for a sequence"),
            (
                "output = ['a.exr', 'a.####.npy']",
                "a.####.npy is a name for the frames of a sequence: give -o OUT.npy instead,",
            ),
            ("output = 'a.exr'\npng = 'a#.png'", "give --png OUT.png instead, a name without #, or add --frames A..B"),
            ("output = 'a.exr'\nstats = 'a#.json'", "give --stats OUT.json instead,"),
        ] {
            let error = sequence(&format!("[output]\n{text}\n"), None).map(drop).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        // The second camera of a name.
        assert!(sequence("[output]\noutput = 'eye#2.exr'\n", None).unwrap().is_none());
    }
}

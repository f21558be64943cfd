//! The experiment file: the scene and the settings of a render, as TOML. Every key has the name of its flag.
//!
//! The same structure also holds the flags of the command line. [`Experiment::over`] merges flags and file. The resolved settings
//! of a render can be printed as an experiment file, which renders the same image again.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::files::{check_readable, read_error};
use crate::input::light_table::LightTable;
use crate::input::medium_tables::MediumTables;
use crate::input::plain::{plain, table_of};
use crate::input::response_table::ResponseTable;
use crate::input::scan_table::ScanTable;
use crate::input::sequence::DEFAULT_FPS;
use crate::settings::moment::Moment;
use crate::settings::response_specs::{ResponseSpec, ResponseSpecs};
use crate::settings::setting::{Setting, Value, Visitor};
use crate::settings::table::{CameraTable, EmitterTable, GateTable, InputTable, OutputTable, RenderTable};

/// Maximum size of an experiment file in bytes. A real experiment is a page of text, so a larger file is something else.
const MAX_BYTES: u64 = 1 << 20;

/// The settings that the user gave. `None`: the user did not give this setting.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Experiment {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<PathBuf>,
    pub camera: CameraTable,
    pub emitter: EmitterTable,
    pub input: InputTable,
    pub medium: MediumTables,
    pub gate: GateTable,
    pub render: RenderTable,
    pub output: OutputTable,
    /// Lights to add to those of the scene.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub light: Vec<LightTable>,
    /// A laser and a sensor that look at points of a wall, instead of a camera and lights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scan: Option<ScanTable>,
    /// `[[response]]` while a file is read; [`Experiment::parse`] moves it to the end of `gate.response`.
    #[serde(skip_serializing)]
    pub response: Vec<ResponseTable>,
}

impl Experiment {
    /// Reads an experiment file. Relative paths in the file are relative to its folder. An empty file name counts as not given.
    /// Fails if the file cannot be read, is not text, or is not a valid experiment; the message gives line and column.
    pub fn read(path: &Path) -> Result<Experiment> {
        let fail = |message: String| Error::File { path: path.into(), message };
        let length = check_readable(path)?;
        if length > MAX_BYTES {
            return Err(fail(format!(
                "{length} bytes are too many for an experiment; give an experiment (.toml) or a scene (.glb, .gltf)"
            )));
        }
        let bytes = std::fs::read(path).map_err(|e| read_error(path, e))?;
        let text = String::from_utf8(bytes).map_err(|_| {
            fail("this is not text in UTF-8; give an experiment (.toml) or a scene (.glb, .gltf)".into())
        })?;
        let mut experiment = Experiment::parse(&text)
            .map_err(|e| Error::Settings(format!("{}:{}:{}: {}", path.display(), e.line, e.column, e.message)))?;

        experiment.scene.take_if(|name| name.as_os_str().is_empty());
        experiment.visit(&mut WithoutEmptyNames);
        let folder = path.parent().unwrap_or(Path::new(""));
        experiment.each_path(|file| {
            *file = folder.join(&*file);
            Ok(())
        })?;
        Ok(experiment)
    }

    /// Parses the text of an experiment. Paths stay as written.
    pub fn parse(text: &str) -> Result<Experiment, ParseError> {
        let mut experiment: Experiment = toml::from_str(text).map_err(|e| {
            let at = e.span().map_or(0, |span| span.start);
            let (line, column) = position(text, at);
            ParseError { line, column, message: plain(e.message(), text, at, table_of) }
        })?;
        let tables = std::mem::take(&mut experiment.response).into_iter().map(|table| table.0);
        let specs: Vec<ResponseSpec> =
            experiment.gate.response.take().map_or(vec![], |specs| specs.0).into_iter().chain(tables).collect();
        experiment.gate.response = (!specs.is_empty()).then_some(ResponseSpecs(specs));
        // If two keys exclude each other, the error points to the later one.
        let exclusive = |first: &str, second: &str, message: &str| {
            let at = [first, second].iter().filter_map(|key| key_offset(text, key)).max();
            let (line, column) = position(text, at.unwrap_or(0));
            ParseError { line, column, message: message.into() }
        };
        let GateTable { gate, depth, gates, response, repeat, cw, gate_keys, .. } = &experiment.gate;
        if gate.is_some() && depth.is_some() {
            return Err(exclusive("gate", "depth", "gate and depth both set the gate: keep one"));
        }
        if gates.is_some() && (gate.is_some() || depth.is_some()) {
            let other = if gate.is_some() { "gate" } else { "depth" };
            return Err(exclusive(other, "gates", &format!("{other} and gates both set the gates: keep one")));
        }
        let fixed = [("gate", gate.is_some()), ("depth", depth.is_some()), ("gates", gates.is_some())];
        if let Some((other, _)) = fixed.iter().find(|(_, given)| *given && gate_keys.is_some()) {
            return Err(exclusive(other, "gate-keys", &format!("{other} and gate-keys both set the gate: keep one")));
        }
        let others = [
            ("gate", gate.is_some()),
            ("depth", depth.is_some()),
            ("gates", gates.is_some()),
            ("gate-keys", gate_keys.is_some()),
            ("response", response.is_some()),
            ("repeat", repeat.is_some()),
        ];
        if let Some((other, _)) = others.iter().find(|(_, given)| *given && cw.is_some()) {
            return Err(exclusive(other, "cw", &format!("{other} and cw both say which light counts: keep one")));
        }
        if experiment.camera.fov.is_some() && experiment.camera.ortho.is_some() {
            return Err(exclusive("fov", "ortho", "fov and ortho both set the view of the camera: keep one"));
        }
        if experiment.input.at.is_some() && experiment.output.frames.is_some() {
            return Err(exclusive("at", "frames", "at and frames both set the time of the scene: keep one"));
        }
        if experiment.render.spp.is_some() && experiment.render.time.is_some() {
            return Err(exclusive("spp", "time", "spp and time both limit the render: keep one"));
        }
        Ok(experiment)
    }

    /// Merges two experiments: the settings of `self`, and those of `below` that `self` does not give. The list of lights counts
    /// as one setting.
    pub fn over(self, mut below: Experiment) -> Experiment {
        // Keys that exclude each other count as one setting: a depth given as a flag also replaces the gate of the file.
        if let Some(Moment(seconds)) = self.input.at {
            below.render_only(seconds);
        }
        if self.output.frames.is_some() {
            below.input.at = None;
        }
        below.gate.leave_responses_to(&self.gate);
        if self.gate.gate.is_some() || self.gate.depth.is_some() || self.gate.gates.is_some() {
            (below.gate.gate, below.gate.depth, below.gate.gates, below.gate.cw) = (None, None, None, None);
            below.gate.gate_keys = None;
        }
        if self.gate.gate_keys.is_some() {
            (below.gate.gate, below.gate.depth, below.gate.gates, below.gate.cw) = (None, None, None, None);
        }
        if self.gate.response.is_some() || self.gate.repeat.is_some() {
            below.gate.cw = None;
        }
        if self.gate.cw.is_some() {
            below.gate = GateTable { force: below.gate.force, ..GateTable::default() };
        }
        if self.camera.fov.is_some() || self.camera.ortho.is_some() {
            (below.camera.fov, below.camera.ortho) = (None, None);
        }
        if self.render.spp.is_some() || self.render.time.is_some() {
            (below.render.spp, below.render.time) = (None, None);
        }
        // If `self` names a camera, the place and the view in `below` may belong to another camera.
        if self.camera.camera.is_some() {
            let CameraTable { camera, resolution, crop, .. } = below.camera;
            below.camera = CameraTable { camera, resolution, crop, ..CameraTable::default() };
        }
        Experiment {
            scene: self.scene.or(below.scene),
            camera: self.camera.over(below.camera),
            emitter: self.emitter.over(below.emitter),
            input: self.input.over(below.input),
            gate: self.gate.over(below.gate),
            render: self.render.over(below.render),
            output: self.output.over(below.output),
            medium: self.medium.over(below.medium),
            light: if self.light.is_empty() { below.light } else { self.light },
            scan: self.scan.or(below.scan),
            response: vec![],
        }
    }

    /// Turns a sequence of frames into the single moment at `seconds`, with the gate that the keys of the sequence give then.
    fn render_only(&mut self, seconds: f64) {
        let OutputTable { frames, fps, shard, contact_sheet, gif, .. } = &mut self.output;
        let fps = fps.take().unwrap_or(DEFAULT_FPS);
        if let Some(keys) = self.gate.gate_keys.take() {
            self.gate.gate = Some(keys.gate(seconds * f64::from(fps)));
        }
        if frames.take().is_some() {
            // The shard of a sequence is a part of its frames.
            *shard = None;
        }
        (*contact_sheet, *gif) = (None, None);
    }

    /// Calls `visitor` with every setting of every table.
    pub fn visit(&mut self, visitor: &mut impl Visitor) {
        let Experiment {
            scene: _,
            camera,
            emitter,
            input,
            gate,
            render,
            output,
            medium,
            light: _,
            scan: _,
            response: _,
        } = self;
        camera.visit(visitor);
        emitter.visit(visitor);
        input.visit(visitor);
        medium.visit(visitor);
        gate.visit(visitor);
        render.visit(visitor);
        output.visit(visitor);
    }

    /// Calls `look` with every path, up to the first error.
    pub(crate) fn each_path(&mut self, mut look: impl FnMut(&mut PathBuf) -> Result<()>) -> Result<()> {
        struct Paths<F>(F, Result<()>);
        impl<F: FnMut(&mut PathBuf) -> Result<()>> Visitor for Paths<F> {
            fn visit<T: Value>(&mut self, _: &'static Setting, slot: &mut Option<T>) {
                for path in slot.iter_mut().flat_map(T::paths) {
                    if self.1.is_ok() {
                        self.1 = (self.0)(path);
                    }
                }
            }
        }
        self.scene.as_mut().map_or(Ok(()), &mut look)?;
        let mut paths = Paths(look, Ok(()));
        self.visit(&mut paths);
        paths.1
    }

    /// Fails if a path is not UTF-8, because images and printed experiments store paths as text.
    pub fn check_paths(&self) -> Result<()> {
        self.clone().each_path(|path| match path.to_str() {
            Some(_) => Ok(()),
            None => Err(Error::File { path: path.clone(), message: "this name is not UTF-8; rename it".into() }),
        })
    }

    /// The files that the settings name, beside the scene and the outputs: grids, tables, the image of the sky.
    pub fn input_files(&self) -> Vec<PathBuf> {
        let mut inputs = Experiment { scene: None, output: OutputTable::default(), ..self.clone() };
        let mut files = vec![];
        let collected = inputs.each_path(|path| {
            files.extend(path.is_file().then(|| path.clone()));
            Ok(())
        });
        collected.expect("collecting does not fail");
        files
    }

    /// Makes all paths absolute. Fails if there is no current folder, or if a path is not UTF-8.
    pub fn with_absolute_paths(mut self) -> Result<Experiment> {
        self.each_path(|path| {
            *path = std::path::absolute(&*path).map_err(|e| read_error(path, e))?;
            Ok(())
        })?;
        self.check_paths()?;
        Ok(self)
    }

    /// The experiment as TOML.
    ///
    /// # Panics
    /// If a path is not UTF-8, see [`Experiment::check_paths`].
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("an experiment is plain text, numbers and tables")
    }
}

/// Replaces empty file names by `None`.
struct WithoutEmptyNames;

impl Visitor for WithoutEmptyNames {
    fn visit<T: Value>(&mut self, _: &'static Setting, slot: &mut Option<T>) {
        slot.take_if(|value| value.paths().iter().any(|path| path.as_os_str().is_empty()));
    }
}

/// An error in the text of an experiment, with its position: line and column count from 1, columns in characters.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: {message}")]
pub struct ParseError {
    pub line: usize,
    pub column: usize,
    pub message: String,
}

/// Line and column of byte `offset` in `text`. Both count from 1; columns are in characters.
pub(crate) fn position(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |at| at + 1);
    (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
}

/// Offset in bytes of the first line that sets `key` (`key =`), without its indentation; `None` if no line does.
fn key_offset(text: &str, key: &str) -> Option<usize> {
    text.split_inclusive('\n')
        .scan(0, |at, line| {
            let start = *at;
            *at += line.len();
            Some((start, line))
        })
        .find_map(|(start, line)| {
            let indent = line.len() - line.trim_start().len();
            let (name, _) = line.split_once('=')?;
            (name.trim().replace('_', "-") == key).then_some(start + indent)
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Emitters;
    use crate::settings::numbers::{Fov, Height, Numbers};
    use crate::settings::units::{Depth, Gate};
    use crate::settings::values::{Files, Folders, Png};

    const FULL: &str = r#"
scene = "room.glb"
[camera]
camera = "front"
resolution = "640x480"
crop = "0,10,0,20"
[emitter]
emitters = ["beam", "lamp, left"]
[input]
double-sided = true
allow-path = "../textures"
[gate]
depth = "6.25m..6.4m"
[render]
estimator = "bdpt"
strategies = "paper"
time = "30s"
max-depth = 7
no-cull = true
[output]
output = "out.exr"
png = true
"#;

    #[test]
    fn a_full_file_is_read_and_survives_printing() {
        let read = Experiment::parse(FULL).unwrap();
        assert_eq!(read.gate.depth, Some(Depth(Gate { lo: 12.5, hi: 12.8 })));
        assert_eq!(read.emitter.emitters, Some(Emitters::Nodes(vec!["beam".into(), "lamp, left".into()])));
        assert_eq!(read.output.png, Some(Png::Wanted(true)));
        assert_eq!(read.input.allow_path, Some(Folders(vec!["../textures".into()])));
        assert_eq!(Experiment::parse(&read.to_toml()).unwrap(), read);
    }

    #[test]
    fn mistakes_are_reported_where_they_stand() {
        let table = [
            ("scene = \"a.glb\"\nscne = 1\n", 2, 1, "no key scne"),
            ("[render]\nspp = 4\n  sppp = 5\n", 3, 3, "no key sppp"),
            ("[render]\nmax_dept = 5\n", 2, 1, "no key max-dept"),
            ("\n[render]\nmax-depth = 5\nmax_depth = 6\n", 2, 1, "max-depth twice"),
            ("[render]\nmax_depth = -1\n", 2, 13, "a whole number"),
            ("render = 3\n", 1, 10, "write [render]"),
            ("[render]\nspp = -4\n", 2, 7, "the number -4"),
            ("[render]\nspp = \"four\"\n", 2, 7, "the text"),
            ("[render]\nestimator = \"magic\"\n", 2, 13, "choose pt, bdpt, epc, lcs-paper or lcs"),
            ("[gate]\ngate = \"1..2\"\n", 2, 8, "no unit"),
            ("[gate]\ngate = \"1m..2m\"\ndepth = \"1m..2m\"\n", 3, 1, "keep one"),
            (
                "[gate]\ngates = \"1m..2m/4\"\ndepth = \"1m..2m\"\n",
                3,
                1,
                "depth and gates both set the gates: keep one",
            ),
            (
                "[gate]\ngate-keys = [[0, \"1m..2m\"]]\ngate = \"1m..2m\"\n",
                3,
                1,
                "gate and gate-keys both set the gate: keep one",
            ),
            ("[gate]\ndepth = \"1m..2m\"\ngate_keys = [[0, \"1m..2m\"]]\n", 3, 1, "depth and gate-keys both"),
            ("[gate]\ngates = \"1m..2m/4\"\ngate-keys = [[0, \"1m..2m\"]]\n", 3, 1, "gates and gate-keys both"),
            (
                "[gate]\ncw = 20\ngate-keys = [[0, \"1m..2m\"]]\n",
                3,
                1,
                "gate-keys and cw both say which light counts: keep one",
            ),
            (
                "[input]\nat = 1\n[output]\nframes = \"0..2\"\n",
                4,
                1,
                "at and frames both set the time of the scene: keep one",
            ),
            ("[gate]\ngates = \"1m..2m\"\n", 2, 9, "how many gates"),
            ("[render]\ntime = \"3s\"\nspp = 4\n", 3, 1, "keep one"),
            ("[camera]\nresolution = \"big\"\n", 2, 14, "640x480"),
            ("[medium]\nsigma = 1.0\n", 2, 1, "no key sigma"),
            ("scene = \"a.glb\n", 1, 15, "invalid basic string"),
            ("[emitter]\nemitters = 3\n", 2, 12, "list of node names"),
            ("[output]\npng = 3\n", 2, 7, "true, false or a file name"),
            ("[camera]\nlook-from = [1, 2]\n", 2, 13, "not a list of 3 numbers"),
            ("[camera]\nup = true\n", 2, 6, "must be numbers"),
            ("[camera]\nfov = 200\n", 2, 7, "between 0 and 180"),
            ("[camera]\northo = -2\n", 2, 9, "metres above 0"),
            ("[camera]\northo = true\n", 2, 9, "a number of metres"),
            ("[camera]\northo = 2\nfov = 30\n", 3, 1, "fov and ortho both set the view of the camera: keep one"),
            ("[emitter]\nheadlamp = false\n", 2, 12, "remove the key"),
            ("[emitter]\nlamp = [[1, 2, 3]]\n", 2, 8, "X,Y,Z,INTENSITY"),
            ("\n[[light]]\ntype = \"point\"\nposition = [1, 2, 3]\n", 2, 1, "needs an intensity"),
        ];
        for (text, line, column, part) in table {
            let error = Experiment::parse(text).expect_err(text);
            assert!(error.message.contains(part), "{text}: {error}");
            assert_eq!((error.line, error.column), (line, column), "{text}: {error}");
        }
    }

    #[test]
    fn lists_and_text_are_alike() {
        let of = |text: &str| Experiment::parse(text).unwrap_or_else(|e| panic!("{text}: {e}"));
        for (text, list) in [
            ("camera.resolution = '640x480'", "camera.resolution = [640, 480]"),
            ("camera.crop = '0,10,0,20'", "camera.crop = [0, 10, 0, 20]"),
            ("camera.up = '0,0,1'", "camera.up = [0, 0, 1]"),
            ("emitter.emitters = 'a,b'", "emitter.emitters = ['a', 'b']"),
            ("emitter.lamp = '0,1,2,3'", "emitter.lamp = [[0, 1, 2, 3]]"),
            ("input.allow-path = 'a'", "input.allow-path = ['a']"),
            ("render.importance = 'centre,gloss'", "render.importance = ['centre', 'gloss']"),
            ("render.importance = 'all'", "render.importance = ['all']"),
            ("output.aov = 'depth,normal'", "output.aov = ['depth', 'normal']"),
        ] {
            assert_eq!(of(text), of(list), "{text}");
        }
    }

    #[test]
    fn underscores_count_as_dashes_in_keys() {
        let of = |text: &str| Experiment::parse(text).unwrap();
        let dashes = of("render = { max-depth = 5, no-cull = true }\n[output]\nstrategy-images = 'a_b'\n");
        assert_eq!(of("render = { max_depth = 5, no_cull = true }\n[output]\nstrategy_images = 'a_b'\n"), dashes);
        assert_eq!((dashes.render.max_depth, dashes.output.strategy_images), (Some(5), Some("a_b".into())));
    }

    #[test]
    fn flags_win_and_alternatives_replace_each_other() {
        let file = Experiment::parse(FULL).unwrap();
        let mut flags = Experiment::default();
        flags.gate.gate = Some(Gate { lo: 1.0, hi: 2.0 });
        flags.render.spp = Some(3);
        flags.render.seed = Some(9);
        let merged = flags.over(file);
        assert_eq!((merged.gate.gate, merged.gate.depth), (Some(Gate { lo: 1.0, hi: 2.0 }), None));
        assert_eq!((merged.render.spp, merged.render.time), (Some(3), None));
        assert_eq!((merged.render.seed, merged.render.max_depth), (Some(9), Some(7)));
        assert_eq!(merged.camera.camera.as_deref(), Some("front"));

        let file = Experiment::parse("camera = { camera = 'auto', look-from = '1,2,3', crop = '0,1,0,1' }").unwrap();
        let mut flags = Experiment::default();
        flags.camera.fov = Some(Fov(30.0));
        assert_eq!(flags.clone().over(file.clone()).camera.look_from, Some(Numbers([1.0, 2.0, 3.0])));
        flags.camera.camera = Some("front".into());
        let merged = flags.over(file).camera;
        assert_eq!((merged.look_from, merged.fov, merged.crop.is_some()), (None, Some(Fov(30.0)), true));

        let file = Experiment::parse("camera.fov = 30").unwrap();
        let mut flags = Experiment::default();
        flags.camera.ortho = Some(Height(2.0));
        let merged = flags.over(file).camera;
        assert_eq!((merged.fov, merged.ortho), (None, Some(Height(2.0))));
    }

    #[test]
    fn a_moment_replaces_the_frames_of_the_file() {
        let file = "[output]\nframes = '0..16'\nfps = 8\nshard = '0/2'\noutput = 'a.##.exr'\ngif = 'a.gif'\ncontact-sheet = 'a.png'\n\
                    [gate]\ngate-keys = [[0, '1m..2m'], [16, '3m..4m']]\n";
        let merged = |flags: &str, file: &str| Experiment::parse(flags).unwrap().over(Experiment::parse(file).unwrap());
        let moment = merged("input.at = 1", file);
        assert_eq!(
            moment,
            Experiment::parse("input.at = 1\ngate.gate = '2m..3m'\noutput.output = 'a.##.exr'").unwrap(),
            "the gate is that of frame 8"
        );
        assert_eq!(
            merged("input.at = 1\ngate.depth = '4m..5m'", file).gate,
            Experiment::parse("gate.depth = '4m..5m'").unwrap().gate
        );
        let frames = merged("output.frames = '2..3'", "input.at = 1\n");
        assert_eq!((frames.input.at, frames.output.frames.is_some()), (None, true));
    }

    #[test]
    fn a_gate_replaces_the_responses_of_the_file_that_have_gates() {
        let merged = |flags: &str, file: &str| {
            let parse = |keys: &str| Experiment::parse(&format!("[gate]\n{keys}\n")).unwrap();
            parse(flags).over(parse(file)).gate
        };
        let of = |keys: &str| Experiment::parse(&format!("[gate]\n{keys}\n")).unwrap().gate;
        let slices = "response = ['near=box:1m..2m', 'slice.csv']";
        for gate in ["gate = '5m..6m'", "depth = '5m..6m'", "gates = '5m..6m/4'", "gate-keys = [[0, '5m..6m']]"] {
            assert_eq!(merged(gate, slices), of(gate));
            // The edges of the file belong to any gate.
            assert_eq!(merged(gate, "response = 'gauss:0.1m'"), of(&format!("{gate}\nresponse = 'gauss:0.1m'")));
            assert_eq!(merged(slices, gate), of(slices));
        }
        let mixed = "response = ['near=box:1m..2m', 'gauss:0.1m']";
        assert_eq!(merged("gate = '5m..6m'", mixed), of(&format!("gate = '5m..6m'\n{mixed}")));
        assert_eq!(merged("gates = '5m..6m/4'", mixed), of("gates = '5m..6m/4'"), "--gates takes one response");
        assert_eq!(
            merged("response = 'gauss:0.1m'", "gate = '5m..6m'"),
            of("gate = '5m..6m'\nresponse = 'gauss:0.1m'")
        );
    }

    #[test]
    fn paths_are_taken_from_the_folder_of_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("e.toml");
        std::fs::write(
            &path,
            "scene = \"s/a.glb\"\ninput.allow-path = ['t', '/u']\n[output]\noutput = \"/abs.exr\"\npng = \"p.png\"\n",
        )
        .unwrap();
        let read = Experiment::read(&path).unwrap();
        assert_eq!(read.scene, Some(folder.path().join("s/a.glb")));
        assert_eq!(read.input.allow_path, Some(Folders(vec![folder.path().join("t"), "/u".into()])));
        assert_eq!(read.output.output, Some(Files(vec!["/abs.exr".into()])));
        assert_eq!(read.output.png, Some(Png::File(folder.path().join("p.png"))));
    }
}

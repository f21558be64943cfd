//! A suite: a TOML file with the scenes, gates and variants to compare.
//!
//! Every `[[scene]]` is rendered with every `[[variant]]`. The `render` table of a variant has the same keys as that of an
//! experiment. A value of the variant takes precedence over that of the scene, and that of the scene over that of the suite. A scene
//! is a file, or is generated (`generate`). The scenes of one `sweep` differ in one quantity; [`super::growth`] fits how the
//! cost of a sample depends on this quantity. With `errors = false` only costs are measured, and no references are needed. The
//! report shows the text under `paper` beside the results of the scene.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer};
use toml::Spanned;

use super::sweep::Sweep;
use crate::error::{Error, Result};
use crate::generate::Kind;
use crate::input::experiment::{Experiment, position};
use crate::input::light_table::LightTable;
use crate::input::medium_tables::MediumTables;
use crate::input::plain::from_toml;
use crate::settings::Emitters;
use crate::settings::keys::Dashed;
use crate::settings::numbers::{Fov, Headlamp, Height, Lamps, Numbers};
use crate::settings::setting::Setting;
use crate::settings::table::{CameraTable, EmitterTable, GateTable, RenderTable, find};
use crate::settings::units::{Depth, Gate, GatePrecision};
use crate::settings::values::{Resolution, Seconds};

/// Larger files are refused: a suite is a few pages of text.
const MAX_BYTES: u64 = 1 << 20;
/// Default of [`Suite::seconds`].
pub const DEFAULT_SECONDS: f64 = 30.0;
pub const DEFAULT_REPETITIONS: u32 = 3;
const MAX_REPETITIONS: u32 = 1000;

/// A suite that was read and checked.
#[derive(Debug, Clone)]
pub struct Suite {
    pub path: PathBuf,
    /// The file's name without its extension.
    pub name: String,
    /// Purpose of the suite, for the report; may be empty.
    pub about: String,
    /// Rendering time per variant, scene and repetition.
    pub seconds: f64,
    pub repetitions: u32,
    /// Whether images are compared with references. If not, only costs are measured.
    pub errors: bool,
    pub scenes: Vec<SceneEntry>,
    pub variants: Vec<Variant>,
    text: String,
}

/// One scene through one gate.
#[derive(Debug, Clone)]
pub struct SceneEntry {
    pub name: String,
    /// The quantity in which the scenes of its sweep differ; `None` if it belongs to no sweep.
    pub sweep: Option<Sweep>,
    /// The results that the paper reports for this scene; may be empty.
    pub paper: String,
    /// The generated scene; `None` for scene files.
    pub generated: Option<Kind>,
    /// Scene, camera, emitters, gate and the settings that all variants share.
    pub experiment: Experiment,
    /// Byte ranges of the scene's path, gate and name in the suite; see [`Part`]. Without a gate, the second range is that of the
    /// name.
    at: [Range<usize>; 3],
}

/// Settings to compare with others.
#[derive(Debug, Clone)]
pub struct Variant {
    pub name: String,
    render: RenderTable,
}

/// The part of a scene that a message is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    Path,
    Gate,
    Name,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct File {
    #[serde(default)]
    about: String,
    time: Option<Seconds>,
    repetitions: Option<Spanned<u32>>,
    errors: Option<bool>,
    render: Option<Spanned<RenderTable>>,
    #[serde(default)]
    scene: Vec<SceneTable>,
    #[serde(default)]
    variant: Vec<VariantTable>,
}

#[derive(Deserialize)]
#[serde(remote = "Self", deny_unknown_fields, rename_all = "kebab-case")]
struct SceneTable {
    name: Spanned<String>,
    scene: Option<Spanned<PathBuf>>,
    generate: Option<Spanned<GenerateTable>>,
    sweep: Option<Sweep>,
    #[serde(default)]
    paper: String,
    camera: Option<String>,
    look_from: Option<Numbers<3>>,
    look_at: Option<Numbers<3>>,
    up: Option<Numbers<3>>,
    fov: Option<Fov>,
    ortho: Option<Spanned<Height>>,
    principal_point: Option<Numbers<2>>,
    resolution: Option<Resolution>,
    emitters: Option<Emitters>,
    headlamp: Option<Headlamp>,
    headlamp_offset: Option<Numbers<3>>,
    lamp: Option<Lamps>,
    #[serde(default)]
    light: Vec<LightTable>,
    #[serde(default)]
    medium: MediumTables,
    gate: Option<Spanned<Gate>>,
    depth: Option<Spanned<Depth>>,
    render: Option<Spanned<RenderTable>>,
}

impl<'de> Deserialize<'de> for SceneTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<SceneTable, D::Error> {
        SceneTable::deserialize(Dashed(deserializer, |key| key))
    }
}

/// The arguments of `taugate generate`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct GenerateTable {
    name: String,
    roughness: Option<f32>,
    triangles: Option<u32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct VariantTable {
    name: Spanned<String>,
    render: Option<Spanned<RenderTable>>,
}

/// Byte range of a mistake in the suite, and the message.
type Mistake = (Range<usize>, String);

impl Suite {
    /// Reads a suite. Paths of scenes, grids and tables are relative to the folder of the suite. Errors name line and column.
    pub fn read(path: &Path) -> Result<Suite> {
        let fail = |message: String| Error::File { path: path.into(), message };
        let length = std::fs::metadata(path).map_err(|e| fail(format!("cannot read the suite: {e}")))?.len();
        if length > MAX_BYTES {
            return Err(fail(format!("{length} bytes are too many for a suite; check the name")));
        }
        let bytes = std::fs::read(path).map_err(|e| fail(format!("cannot read the suite: {e}")))?;
        let text = String::from_utf8(bytes).map_err(|_| fail("this is not text in UTF-8; a suite is TOML".into()))?;
        Suite::parse(path, text)
    }

    /// Like [`Suite::read`], for a file at `path` with this text.
    pub fn parse(path: &Path, text: String) -> Result<Suite> {
        let file: File =
            from_toml(&text, |_| None).map_err(|(span, mistake)| located(path, &text, &span, &mistake.to_string()))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let parts = parts(file, folder).map_err(|(span, mistake)| located(path, &text, &span, &mistake.to_string()))?;
        let (about, seconds, repetitions, errors, scenes, variants) = parts;
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Suite { path: path.into(), name, about, seconds, repetitions, errors, scenes, variants, text })
    }

    /// The experiment for a scene and a variant, without samples and time.
    pub fn experiment(&self, scene: &SceneEntry, variant: &Variant) -> Experiment {
        let top = Experiment { render: variant.render.clone(), ..Experiment::default() };
        top.over(scene.experiment.clone())
    }

    /// An error with the position of a part of a scene, as in `suite.toml:3:9: message`.
    pub fn error_at(&self, scene: &SceneEntry, part: Part, message: &str) -> Error {
        located(&self.path, &self.text, &scene.at[part as usize], message)
    }
}

impl SceneEntry {
    /// Path of the scene file. For a generated scene, its name with `.glb`.
    pub fn path(&self) -> &Path {
        self.experiment.scene.as_deref().expect("every entry has a path")
    }

    /// Whether the scene is available: it is generated, or its file exists.
    pub fn exists(&self) -> bool {
        self.generated.is_some() || self.path().is_file()
    }

    /// Whether the folder of the scene exists. If the folder is missing, the user has not downloaded that set of scenes; if only the
    /// file is missing, its name is wrong.
    pub fn folder_exists(&self) -> bool {
        self.path().parent().is_none_or(|folder| folder == Path::new("") || folder.is_dir())
    }
}

fn located(path: &Path, text: &str, span: &Range<usize>, message: &str) -> Error {
    let (line, column) = position(text, span.start);
    Error::settings(format!("{}:{line}:{column}: {}", path.display(), message.replace('\n', ", ")))
}

type Parts = (String, f64, u32, bool, Vec<SceneEntry>, Vec<Variant>);

fn parts(file: File, folder: &Path) -> Result<Parts, Mistake> {
    let repetitions = match &file.repetitions {
        Some(typed) if !(1..=MAX_REPETITIONS).contains(typed.get_ref()) => {
            return Err((typed.span(), format!("repetitions must be from 1 to {MAX_REPETITIONS}")));
        }
        Some(typed) => *typed.get_ref(),
        None => DEFAULT_REPETITIONS,
    };
    if file.scene.is_empty() {
        return Err((
            0..0,
            "the suite has no scene: add [[scene]] with name = \"...\" and scene = \"room.glb\"".into(),
        ));
    }
    if file.variant.is_empty() {
        let example =
            "the suite has no variant: add [[variant]] with name = \"bdpt\" and render = { estimator = \"bdpt\" }";
        return Err((0..0, example.into()));
    }

    let shared = render(file.render)?;
    let mut names = BTreeSet::new();
    let mut scenes = vec![];
    for table in file.scene {
        unique(&mut names, &table.name)?;
        scenes.push(scene(table, folder, &shared)?);
    }
    names.clear();
    let mut variants = vec![];
    for table in file.variant {
        unique(&mut names, &table.name)?;
        variants.push(Variant { name: table.name.into_inner(), render: render(table.render)? });
    }
    let seconds = file.time.map_or(DEFAULT_SECONDS, |time| time.0);
    Ok((file.about, seconds, repetitions, file.errors.unwrap_or(true), scenes, variants))
}

fn scene(table: SceneTable, folder: &Path, shared: &RenderTable) -> Result<SceneEntry, Mistake> {
    let clash = |first: &str, second: &str| find(second).expect("it is a setting").clash(first).to_string();
    if let (Some(_), Some(depth)) = (&table.gate, &table.depth) {
        return Err((depth.span(), clash("gate", "depth")));
    }
    if let (Some(_), Some(ortho)) = (&table.fov, &table.ortho) {
        return Err((ortho.span(), clash("fov", "ortho")));
    }
    let gate_at = table.gate.as_ref().map(Spanned::span).or(table.depth.as_ref().map(Spanned::span));
    let gate = table.gate.map(Spanned::into_inner).or(table.depth.map(|depth| depth.into_inner().0));
    if let (Some(gate), Some(at)) = (gate, &gate_at)
        && let GatePrecision::TooThin { ulps } = gate.precision(0.0)
    {
        let gate = gate.describe();
        let message = format!("the {gate} is only {ulps:.1} steps of 32-bit travel times wide; make it wider");
        return Err((at.clone(), message));
    }
    let (path, path_at, generated) = match (table.scene, table.generate) {
        (Some(file), None) => (folder.join(file.get_ref()), file.span(), None),
        (None, Some(wanted)) => {
            let at = wanted.span();
            let (path, kind) = make(wanted.into_inner()).map_err(|message| (at.clone(), message))?;
            (path, at, Some(kind))
        }
        _ => {
            let message = "a scene needs either scene = \"room.glb\" or generate = { name = \"cornell-box\" }";
            return Err((table.name.span(), message.into()));
        }
    };
    let at = [path_at, gate_at.unwrap_or(table.name.span()), table.name.span()];
    let mut own = Experiment {
        camera: CameraTable {
            camera: table.camera,
            look_from: table.look_from,
            look_at: table.look_at,
            up: table.up,
            fov: table.fov,
            ortho: table.ortho.map(Spanned::into_inner),
            principal_point: table.principal_point,
            resolution: table.resolution,
            ..CameraTable::default()
        },
        emitter: EmitterTable {
            emitters: table.emitters,
            headlamp: table.headlamp,
            headlamp_offset: table.headlamp_offset,
            lamp: table.lamp,
            ..EmitterTable::default()
        },
        light: table.light,
        medium: table.medium,
        gate: GateTable { gate, ..GateTable::default() },
        render: render(table.render)?,
        ..Experiment::default()
    };
    own.take_paths_from(folder);
    own.check_paths().map_err(|e| (table.name.span(), e.to_string()))?;
    own.scene = Some(path);
    let below = Experiment { render: shared.clone(), ..Experiment::default() };
    let (name, sweep, paper) = (table.name.into_inner(), table.sweep, table.paper);
    Ok(SceneEntry { name, sweep, paper, generated, experiment: own.over(below), at })
}

/// The scene to generate, and a path that stands for it in messages.
fn make(table: GenerateTable) -> Result<(PathBuf, Kind), String> {
    let GenerateTable { name, roughness, triangles } = table;
    let Some(kind) = Kind::parse(&name) else {
        return Err(format!("no scene is called '{name}'; choose one of {}", Kind::NAMES.join(", ")));
    };
    Ok((format!("{name}.glb").into(), kind.with(roughness, triangles)?))
}

/// Checks a table of settings. It may not contain settings that the bench chooses itself.
fn render(table: Option<Spanned<RenderTable>>) -> Result<RenderTable, Mistake> {
    let Some(table) = table else { return Ok(RenderTable::default()) };
    let taken = ["spp", "time", "seed", "device", "strict"];
    match table.get_ref().given().into_iter().find(|setting| taken.contains(&setting.name)) {
        Some(Setting { name, .. }) => {
            Err((table.span(), format!("the bench chooses '{name}' itself; remove the key from this table")))
        }
        None => Ok(table.into_inner()),
    }
}

/// Checks that a name can be part of file names and of the table, and that it is used only once.
fn unique(seen: &mut BTreeSet<String>, name: &Spanned<String>) -> Result<(), Mistake> {
    let text = name.get_ref();
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.+ ".contains(c);
    if text.is_empty() || text.starts_with('.') || !text.chars().all(plain) {
        let message = format!("'{text}' cannot be a name; use letters, digits, spaces and - _ . +");
        return Err((name.span(), message));
    }
    // File names have a - for each space.
    match seen.insert(text.replace(' ', "-")) {
        true => Ok(()),
        false => Err((
            name.span(),
            format!("the name '{text}' is taken (in file names a space becomes a -); choose another"),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"
about = "a test"
time = "2s"
[render]
max-depth = 9
[[scene]]
name = "box"
scene = "scenes/box.glb"
gate = "8m..8.5m"
resolution = "16x16"
render = { light-paths = 100 }
[[variant]]
name = "bdpt"
render = { estimator = "bdpt" }
[[variant]]
name = "two queries"
render = { queries = 2, light-paths = 200 }
"#;

    #[test]
    fn settings_are_laid_over_each_other() {
        let suite = Suite::parse(Path::new("a/s.toml"), GOOD.into()).unwrap();
        assert_eq!((suite.name.as_str(), suite.seconds, suite.repetitions), ("s", 2.0, DEFAULT_REPETITIONS));
        let of = |v: usize| suite.experiment(&suite.scenes[0], &suite.variants[v]);
        assert_eq!(of(0).scene, Some("a/scenes/box.glb".into()));
        assert_eq!((of(0).render.light_paths, of(0).render.max_depth), (Some(100), Some(9)));
        assert_eq!((of(1).render.light_paths, of(1).render.queries), (Some(200), Some(2)));
        assert_eq!(of(1).gate.gate, Some(Gate { lo: 8.0, hi: 8.5 }));
    }

    #[test]
    fn mistakes_are_reported_where_they_stand() {
        let table = [
            ("max-depth = 9", "max-dept = 9", "5:1: [render] has no key max-dept"),
            ("gate = ", "depth = '4m..5m'\ngate = ", "9:9: gate and depth both set the gate: keep one"),
            (
                "gate = ",
                "fov = 40\northo = 2\ngate = ",
                "10:9: fov and ortho both set the view of the camera: keep one",
            ),
            ("gate = ", "gat = ", "9:1: [[scene]] has no key gat"),
            ("8m..8.5m", "8.5m..8m", "9:8: the gate is reversed"),
            ("8m..8.5m", "8m+0.001um", "9:8: the gate"),
            ("estimator = \"bdpt\"", "estimator = \"magic\"", "14:24: no estimator is called 'magic'"),
            ("queries = 2", "spp = 2", "17:10: the bench chooses 'spp' itself"),
            ("two queries", "bdpt", "16:8: the name 'bdpt' is taken"),
            ("two queries", "a/b", "16:8: 'a/b' cannot be a name"),
            ("scene = \"scenes/box.glb\"\n", "", "7:8: a scene needs either scene"),
            ("scene = \"scenes/box.glb\"", "generate = { name = \"palace\" }", "8:12: no scene is called 'palace'"),
            (
                "scene = \"scenes/box.glb\"",
                "generate = { name = \"door-ajar\", triangles = 5 }",
                "8:12: door-ajar has no number of triangles",
            ),
            ("gate = \"8m", "sweep = \"moons\"\ngate = \"8m", "9:9: sweep cannot be \"moons\""),
            ("about = \"a test\"", "repetitions = 0", "2:15: repetitions must be"),
            ("[[variant]]\nname = \"bdpt\"", "[[varian]]\nname = \"bdpt\"", "12:3: the file has no key varian"),
        ];
        for (from, to, part) in table {
            let text = GOOD.replacen(from, to, 1);
            assert_ne!(text, GOOD, "{from}");
            let error = Suite::parse(Path::new("s.toml"), text).unwrap_err().to_string();
            assert!(error.contains(&format!("s.toml:{part}")), "expected {part}: {error}");
        }
        for (text, part) in [("", "no scene"), (GOOD.split("[[variant").next().unwrap(), "no variant")] {
            assert!(Suite::parse(Path::new("s.toml"), text.into()).unwrap_err().to_string().contains(part));
        }
    }
}

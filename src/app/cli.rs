//! What can be typed: subcommands and flags. What they mean is settled in `taugate::input::resolve`.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use taugate::input::experiment::{CameraTable, EmitterTable, Experiment, GateTable, OutputTable, Png, RenderTable};
use taugate::settings::units::{Depth, Gate};
use taugate::settings::values::{Resolution, Seconds};
use taugate::settings::{Crop, Emitters, Estimator, Importance, Sampling, Strategies};

/// Renders what a time-gated sensor sees: only the light whose travel time falls inside a gate.
#[derive(Debug, Parser)]
#[command(name = "taugate", version, term_width = 100, disable_help_subcommand = true)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    Render(Box<RenderArgs>),
    Compare(CompareArgs),
    Bench(BenchArgs),
    Info(InfoArgs),
    Devices(DevicesArgs),
    Generate(GenerateArgs),
}

const RENDER_EXAMPLES: &str = "\
Examples:
  taugate render room.glb -o room.exr --png
  taugate render room.glb -o gated.exr --gate 12.5m..12.8m --spp 256
  taugate render room.glb -o gated.exr --gate 42.2ns+-0.5ns --emitters beam --time 30s
  taugate render experiment.toml --seed 7

Exit codes: 0 done, 2 wrong input or file, 3 non-finite samples with --strict, 4 device,
130 interrupted (the image so far is written)";

/// Render a scene, gated or steady
#[derive(Debug, Args)]
#[command(after_help = RENDER_EXAMPLES)]
pub struct RenderArgs {
    /// A scene (.glb, .gltf), or an experiment (.toml) whose keys are these flags
    #[arg(value_name = "SCENE|EXPERIMENT")]
    pub input: PathBuf,

    /// Camera of the file to look through [default: the first]
    #[arg(long, value_name = "NAME", help_heading = "Scene")]
    camera: Option<String>,

    /// What shines: scene for everything that emits, or names of nodes; may be repeated
    #[arg(long, value_name = "scene|NODE,...", help_heading = "Scene")]
    emitters: Vec<Emitters>,

    /// Image size in pixels [default: what the camera says, else 512 wide]
    #[arg(long, value_name = "WxH", help_heading = "Scene")]
    resolution: Option<Resolution>,

    /// Render only the pixels x0 <= x < x1, y0 <= y < y1, with the values they have in the whole image (by --sampling
    /// adaptive but for noise)
    #[arg(long, value_name = "x0,x1,y0,y1", help_heading = "Scene")]
    crop: Option<Crop>,

    /// Travel times that count, half-open: A..B, CENTER+-HALF or A+WIDTH with um, mm, cm, m, km (optical path) or
    /// ps, ns, us (time), such as 12.5m..12.8m [default: all, the steady state]
    #[arg(long, value_name = "A..B", help_heading = "Gate", allow_hyphen_values = true)]
    gate: Option<Gate>,

    /// The gate as one-way range: half the optical path, lengths only
    #[arg(long, value_name = "A..B", help_heading = "Gate", conflicts_with = "gate", allow_hyphen_values = true)]
    depth: Option<Depth>,

    /// Render a gate that is thinner than 16 steps of 32-bit travel times, or that no light meets
    #[arg(long, help_heading = "Gate")]
    force: bool,

    /// How paths are found: pt (path tracing), bdpt (bidirectional), lcs-paper (light-cone shell queries),
    /// lcs (the same by importance, resampled) [default: lcs; bdpt through a gate wider
    /// than 0.4 of the scene's diagonal; without one pt, or bdpt where there are mirrors,
    /// glass, sharp gloss or a beam]
    #[arg(long, value_name = "NAME", help_heading = "Sampling")]
    estimator: Option<Estimator>,

    /// Samples a pixel [default: 64]
    #[arg(long, value_name = "N", help_heading = "Sampling")]
    spp: Option<u32>,

    /// Render for this long instead, such as 30s, 5min or 2h
    #[arg(long, value_name = "DURATION", help_heading = "Sampling", conflicts_with = "spp")]
    time: Option<Seconds>,

    /// Same seed, same image, to the bit [default: 0]
    #[arg(long, value_name = "N", help_heading = "Sampling")]
    seed: Option<u32>,

    /// Most segments of a path [default: 24]
    #[arg(long, value_name = "N", help_heading = "Sampling")]
    max_depth: Option<u32>,

    /// Light subpaths an iteration whose vertices are kept [default: one a pixel, 4096 to 50000; lcs: to 8192]
    #[arg(long, value_name = "N", help_heading = "Sampling")]
    light_paths: Option<u32>,

    /// Further light subpaths an iteration that only the sensor sees; for caustics [default: 0]
    #[arg(long, value_name = "N", help_heading = "Sampling")]
    splat_paths: Option<u32>,

    /// Tree queries a shade point, 1 to 64 [default: 1; lcs: 16]
    #[arg(long, value_name = "N", help_heading = "Sampling")]
    queries: Option<u32>,

    /// Temporal power buckets a tree node, 1 to 8 [default: 8]
    #[arg(long, value_name = "N", help_heading = "Sampling")]
    buckets: Option<u32>,

    /// Light vertices in a leaf of a tree at most, 1 to 16 [default: lcs-paper: 1; lcs: 16]
    #[arg(long, value_name = "N", help_heading = "Sampling")]
    leaf_size: Option<u32>,

    /// lcs: subtrees that the queries of a shade point start among, 1 (the whole tree) to 32; same image on average [default: 32]
    #[arg(long, value_name = "N", help_heading = "Sampling")]
    frontier: Option<u32>,

    /// One tree over points on emitters and scattered light together, instead of one each; same image on average
    /// [default: false; lcs: true]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    #[arg(help_heading = "Sampling")]
    single_tree: Option<bool>,

    /// What lcs judges nodes of a tree by beside power: all, none, or some of centre,cosine,overlap,gloss (distance of the
    /// centre, greatest cosine, part of a bucket inside the gate, lobe of gloss); same image on average [default: all]
    #[arg(long, value_name = "NAME,...", help_heading = "Sampling")]
    importance: Option<Importance>,

    /// How samples are spread over the image: uniform, or adaptive: more where earlier ones found more error
    /// [default: adaptive; lcs-paper: uniform]
    #[arg(long, value_name = "NAME", help_heading = "Sampling")]
    sampling: Option<Sampling>,

    /// Ways to join subpaths: all, or those of the paper (no emitter hit by chance, none seen by the sensor directly)
    /// [default: all]
    #[arg(long, value_name = "all|paper", help_heading = "Sampling")]
    strategies: Option<Strategies>,

    /// Also follow subpaths that can no longer meet the gate; same image on average, slower
    #[arg(long, help_heading = "Sampling")]
    no_cull: bool,

    /// Image file (.exr): R, G, B, their variance and the settings
    #[arg(short, long, value_name = "OUT.exr", help_heading = "Output")]
    output: Option<PathBuf>,

    /// Also write a tone-mapped picture [default name: the output with .png]
    #[arg(long, value_name = "FILE.png", num_args = 0..=1, help_heading = "Output")]
    png: Option<Option<PathBuf>>,

    /// Also render the image once more and write what each strategy adds to it into this folder: for s vertices from the
    /// light and t from the sensor s02_t03_weighted.exr (by MIS; these add up to the image) and _unweighted.exr
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    strategy_images: Option<PathBuf>,

    /// Also write numbers about the render: rays, times, mean and its error, dropped samples, part inside the gate
    #[arg(long, value_name = "FILE.json", help_heading = "Output")]
    stats: Option<PathBuf>,

    /// Print nothing but errors
    #[arg(short, long, help_heading = "Output")]
    pub quiet: bool,

    /// Vulkan device by index or part of its name, see taugate devices [default: the fastest kind]
    #[arg(long, value_name = "INDEX|NAME", help_heading = "Diagnostics")]
    device: Option<String>,

    /// Fail on the first sample that is not finite, instead of dropping and counting it
    #[arg(long, help_heading = "Diagnostics")]
    strict: bool,

    /// Print all settings as an experiment file and stop
    #[arg(long, help_heading = "Diagnostics")]
    pub print_config: bool,
}

impl RenderArgs {
    /// The flags as an experiment; `scene` is left to the caller, who knows what `input` is.
    pub fn into_experiment(self) -> Experiment {
        let png = self.png.map(|file| file.map_or(Png::Wanted(true), Png::File));
        Experiment {
            camera: CameraTable { camera: self.camera, resolution: self.resolution, crop: self.crop },
            emitter: EmitterTable { emitters: together(self.emitters) },
            gate: GateTable { gate: self.gate, depth: self.depth, force: self.force.then_some(true) },
            render: RenderTable {
                estimator: self.estimator,
                strategies: self.strategies,
                spp: self.spp,
                time: self.time,
                seed: self.seed,
                max_depth: self.max_depth,
                light_paths: self.light_paths,
                splat_paths: self.splat_paths,
                queries: self.queries,
                buckets: self.buckets,
                leaf_size: self.leaf_size,
                frontier: self.frontier,
                single_tree: self.single_tree,
                importance: self.importance,
                sampling: self.sampling,
                no_cull: self.no_cull.then_some(true),
                device: self.device,
                strict: self.strict.then_some(true),
            },
            output: OutputTable { output: self.output, png, stats: self.stats, strategy_images: self.strategy_images },
            ..Experiment::default()
        }
    }
}

/// What a flag that was repeated names in all; none if it was not given.
fn together(emitters: Vec<Emitters>) -> Option<Emitters> {
    emitters.into_iter().reduce(|all, more| match (all, more) {
        (Emitters::Nodes(all), Emitters::Nodes(more)) => Emitters::Nodes([all, more].concat()),
        _ => Emitters::Scene,
    })
}

/// Measure the error of an image against a reference
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 compared (within the threshold, no difference), 1 above the threshold or different, 2 error"
)]
pub struct CompareArgs {
    /// The image to judge
    #[arg(value_name = "A.exr")]
    pub image: PathBuf,

    /// The reference, of the same size
    #[arg(value_name = "REF.exr")]
    pub reference: PathBuf,

    /// Exit with 1 if relMSE is above this
    #[arg(long, value_name = "X", help_heading = "Output")]
    pub max_relmse: Option<f64>,

    /// Test whether the images differ by more than their noise, write the map of z (.exr: signed z; .png: red brighter,
    /// blue darker) and exit with 1 if they do; both rendered by taugate, with different seeds
    #[arg(long, value_name = "OUT.png|OUT.exr", help_heading = "Output")]
    pub z: Option<PathBuf>,

    /// Print JSON
    #[arg(long, help_heading = "Output")]
    pub json: bool,
}

const BENCH_EXAMPLES: &str = "\
Examples:
  taugate bench benches/suites/quick.toml --reference   render what to compare with, once
  taugate bench benches/suites/quick.toml               compare; the page is bench-quick/report.md
  taugate bench benches/suites/fig6.toml --resume       go on after an interrupt

References are kept in the folder references beside the results, under a hash of scene, gate and
settings. Exit codes: 0 done, 1 a race was refused or a reference failed its check, 2 wrong input,
4 device, 130 interrupted (what is finished is kept)";

/// Compare how fast estimators converge on the scenes of a suite
#[derive(Debug, Args)]
#[command(after_help = BENCH_EXAMPLES)]
pub struct BenchArgs {
    /// The suite: scenes, gates and variants of settings
    #[arg(value_name = "SUITE.toml")]
    pub suite: PathBuf,

    /// Only these scenes of the suite
    #[arg(long, value_name = "NAME,...", help_heading = "Scene", value_delimiter = ',')]
    pub scenes: Vec<String>,

    /// Image size in pixels, instead of the suite's
    #[arg(long, value_name = "WxH", help_heading = "Scene")]
    pub resolution: Option<Resolution>,

    /// Rendering time of each variant, scene and repetition, instead of the suite's; references are made for it too
    #[arg(long, value_name = "DURATION", help_heading = "Sampling")]
    pub time: Option<Seconds>,

    /// How often everything is repeated with other seeds, instead of the suite's [default: 3]
    #[arg(long, value_name = "N", help_heading = "Sampling", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub repetitions: Option<u32>,

    /// Render the references that are missing or not good enough, and check them against another estimator
    #[arg(long, help_heading = "Sampling", conflicts_with_all = ["resume", "repetitions"])]
    pub reference: bool,

    /// With --reference, the longest that one may take; those that are there are extended, good or not [default: 40 times
    /// the suite's time, and only those that are not good enough]
    #[arg(long, value_name = "DURATION", help_heading = "Sampling", requires = "reference")]
    pub reference_time: Option<Seconds>,

    /// Folder for results.csv, plots, pictures and report.md [default: bench-SUITE]
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    pub out: Option<PathBuf>,

    /// Keep what results.csv has already, and measure what is missing
    #[arg(long, help_heading = "Output")]
    pub resume: bool,

    /// Print nothing but errors
    #[arg(short, long, help_heading = "Output")]
    pub quiet: bool,

    /// Vulkan device by index or part of its name, see taugate devices [default: the fastest kind]
    #[arg(long, value_name = "INDEX|NAME", help_heading = "Diagnostics")]
    pub device: Option<String>,
}

/// Say what is in a scene, what rendering it takes, and when its light arrives
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// The scene (.glb, .gltf)
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,

    /// Camera of the file to look through [default: the first]
    #[arg(long, value_name = "NAME", help_heading = "Scene")]
    camera: Option<String>,

    /// What shines: scene for everything that emits, or names of nodes; may be repeated
    #[arg(long, value_name = "scene|NODE,...", help_heading = "Scene")]
    emitters: Vec<Emitters>,

    /// Image size in pixels [default: what the camera says, else 512 wide]
    #[arg(long, value_name = "WxH", help_heading = "Scene")]
    resolution: Option<Resolution>,

    /// Most segments of a path [default: 24]
    #[arg(long, value_name = "N", help_heading = "Sampling")]
    max_depth: Option<u32>,

    /// Light subpaths an iteration whose vertices are kept [default: one a pixel, 4096 to 50000]
    #[arg(long, value_name = "N", help_heading = "Sampling")]
    light_paths: Option<u32>,

    /// Print JSON
    #[arg(long, help_heading = "Output")]
    pub json: bool,

    /// Vulkan device by index or part of its name, see taugate devices [default: the fastest kind]
    #[arg(long, value_name = "INDEX|NAME", help_heading = "Diagnostics")]
    pub device: Option<String>,
}

impl InfoArgs {
    /// The flags as an experiment over the scene.
    pub fn experiment(&self) -> Experiment {
        Experiment {
            scene: Some(self.scene.clone()),
            camera: CameraTable { camera: self.camera.clone(), resolution: self.resolution, crop: None },
            emitter: EmitterTable { emitters: together(self.emitters.clone()) },
            render: RenderTable { max_depth: self.max_depth, light_paths: self.light_paths, ..RenderTable::default() },
            ..Experiment::default()
        }
    }
}

/// List Vulkan devices and the limits that matter
#[derive(Debug, Args)]
pub struct DevicesArgs {
    /// Print JSON
    #[arg(long, help_heading = "Output")]
    pub json: bool,
}

/// Write one of the project's own scenes
#[derive(Debug, Args)]
pub struct GenerateArgs {
    /// cornell-box, gated-sphere, door-ajar, cluttered-room, or zoo-area, zoo-punctual, zoo-beam (every material in one
    /// room, lit by a lamp, by a point and a spot, or by a beam)
    #[arg(value_name = "NAME")]
    pub name: String,

    /// Roughness of cornell-box's metal, 0 to 1 [default: 0.45]
    #[arg(long, value_name = "R", help_heading = "Scene")]
    pub roughness: Option<f32>,

    /// At least so many triangles, in cornell-box (by dividing its faces) or cluttered-room
    #[arg(long, value_name = "N", help_heading = "Scene")]
    pub triangles: Option<u32>,

    /// Scene file to write (.glb)
    #[arg(short, long, value_name = "FILE.glb", help_heading = "Output")]
    pub output: PathBuf,
}

//! The subcommands and flags that a user can type. `taugate::internals::input::resolve` turns them into settings.

mod finished;

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use taugate::Estimator;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::settings::values::{Pixel, Resolution, Seconds};

pub use self::finished::{
    CompareArgs, DetectArgs, DetectorArgs, DevelopArgs, DevelopedFiles, HistogramArgs, LidarArgs, MergeArgs,
};
use crate::app::flags::{Flags, Info, Render, View};

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
    View(Box<ViewArgs>),
    Merge(MergeArgs),
    Develop(DevelopArgs),
    Compare(CompareArgs),
    Histogram(HistogramArgs),
    Detect(DetectArgs),
    Lidar(LidarArgs),
    Bench(BenchArgs),
    Info(Box<InfoArgs>),
    Devices(DevicesArgs),
    Generate(GenerateArgs),
}

const RENDER_EXAMPLES: &str = "\
Examples:
  taugate render room.glb -o room.exr --png
  taugate render room.glb -o gated.exr --gate 12.5m..12.8m --spp 256
  taugate render room.glb -o gated.exr --gate 42.2ns+-0.5ns --emitters beam --time 30s
  taugate render experiment.toml --seed 7
  taugate render room.glb -o room.exr --time 8h --checkpoint room.acc

Exit codes: 0 done, 2 wrong input or file, 3 non-finite samples with --strict, 4 device error,
130 interrupted (the image so far is written)";

/// Render a scene, gated or steady
#[derive(Debug, Args)]
#[command(after_help = RENDER_EXAMPLES)]
pub struct RenderArgs {
    /// A scene (.glb, .gltf), or an experiment (.toml) whose keys are these flags
    #[arg(value_name = "SCENE|EXPERIMENT", required_unless_present = "resume")]
    pub input: Option<PathBuf>,

    #[command(flatten)]
    flags: Flags<Render>,

    /// Print nothing but errors
    #[arg(short, long, help_heading = "Output")]
    pub quiet: bool,

    /// Print all settings as an experiment file and stop
    #[arg(long, help_heading = "Diagnostics")]
    pub print_config: bool,
}

impl RenderArgs {
    /// The flags as an experiment. The caller sets `scene`: `input` may be a scene or an experiment file.
    pub fn into_experiment(self) -> Experiment {
        self.flags.0
    }
}

const VIEW_EXAMPLES: &str = "\
Examples:
  taugate view room.glb --gate 12.5m..12.8m --open
  taugate view room.glb --listen 127.0.0.1:9000
  ssh -L 9000:127.0.0.1:9000 HOST                      then open the address here in a browser

Exit codes: 0 ended by Ctrl-C, 2 wrong input or file, 4 device error";

/// Watch a scene converge in a browser, and change gate, camera and settings by hand
#[derive(Debug, Args)]
#[command(after_help = VIEW_EXAMPLES)]
pub struct ViewArgs {
    /// A scene (.glb, .gltf), or an experiment (.toml)
    #[arg(value_name = "SCENE|EXPERIMENT")]
    pub input: PathBuf,

    #[command(flatten)]
    pub flags: Flags<View>,

    /// Address and port of the page. Only this machine can reach a loopback address
    /// [default: 127.0.0.1:8642, or a free port if that one is taken]
    #[arg(long, value_name = "IP:PORT", help_heading = "Page")]
    pub listen: Option<SocketAddr>,

    /// Open the page in the default browser, by way of a private file. So the list of processes does not show the token
    #[arg(long, help_heading = "Page")]
    pub open: bool,

    /// Folder for the images that the page saves
    #[arg(long, value_name = "DIR", help_heading = "Page", default_value = ".")]
    pub save_to: PathBuf,
}

const BENCH_EXAMPLES: &str = "\
Examples:
  taugate bench benches/suites/quick.toml --reference   render the references, once
  taugate bench benches/suites/quick.toml               compare; the page is bench-quick/report.md
  taugate bench benches/suites/fig6.toml --resume       continue after an interrupt

The references are stored in the folder references/ next to the folder of results. Their names
contain a hash of scene, gate and settings. Exit codes: 0 done, 1 results were refused because their
reference is too noisy, or a reference failed its check, 2 wrong input, 4 device error,
130 interrupted (finished results are kept)";

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

    /// Rendering time per variant, scene and repetition, instead of the suite's; it also decides how accurate references
    /// must be
    #[arg(long, value_name = "DURATION", help_heading = "Sampling")]
    pub time: Option<Seconds>,

    /// Number of repetitions, each with another seed, instead of the suite's [default: 3]
    #[arg(long, value_name = "N", help_heading = "Sampling", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub repetitions: Option<u32>,

    /// Render the references that are missing or not accurate enough, and check them against another estimator
    #[arg(long, help_heading = "Sampling", conflicts_with_all = ["resume", "repetitions"])]
    pub reference: bool,

    /// With --reference, the time limit per reference; references that exist are extended even if they are accurate enough
    /// [default: 40 times the suite's time, without extending accurate references]
    #[arg(long, value_name = "DURATION", help_heading = "Sampling", requires = "reference")]
    pub reference_time: Option<Seconds>,

    /// With --reference, the estimator that renders the references; another one checks them [default: the one with the
    /// smallest error per second]
    #[arg(long, value_name = "NAME", help_heading = "Sampling", requires = "reference")]
    pub reference_estimator: Option<Estimator>,

    /// Folder for results.csv, plots, pictures and report.md [default: bench-SUITE]
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    pub out: Option<PathBuf>,

    /// Keep the results in results.csv, and measure the missing ones
    #[arg(long, help_heading = "Output")]
    pub resume: bool,

    /// Print nothing but errors
    #[arg(short, long, help_heading = "Output")]
    pub quiet: bool,

    /// Vulkan device by index or part of its name, see taugate devices
    /// [default: the fastest kind of device]
    #[arg(long, value_name = "INDEX|NAME", help_heading = "Diagnostics")]
    pub device: Option<String>,
}

const INFO_EXAMPLES: &str = "\
Examples:
  taugate info room.glb
  taugate info experiment.toml                         the same with its camera, media and gate
  taugate info room.glb --pixel 120,80                 what is there, and when its light arrives
  taugate info room.glb --resolution 256x256 --map arrival.png
  taugate info room.glb --plot arrivals.svg            when light arrives, to choose gates";

/// Describe a scene: its contents, the memory of a render, and the times at which light arrives
#[derive(Debug, Args)]
#[command(after_help = INFO_EXAMPLES)]
pub struct InfoArgs {
    /// The scene (.glb, .gltf), or an experiment (.toml), whose outputs do not matter here
    #[arg(value_name = "SCENE|EXPERIMENT")]
    pub input: PathBuf,

    #[command(flatten)]
    pub flags: Flags<Info>,

    /// Name the object at the centre of this pixel (column and row of the whole image, from 0), and print when light arrives in
    /// the pixel alone
    #[arg(long, value_name = "X,Y", help_heading = "Scene", conflicts_with = "crop")]
    pub pixel: Option<Pixel>,

    /// Write a map of the first arrival of light in each pixel: a picture in colours, whose scale is printed (.png), or metres of
    /// optical path (.exr); may be repeated
    #[arg(long, value_name = "FILE.png|FILE.exr", help_heading = "Output")]
    pub map: Vec<PathBuf>,

    /// Plot the light that arrives against its travel time, up to the time at which 99 % of it has arrived
    #[arg(long, value_name = "FILE.svg", help_heading = "Output")]
    pub plot: Option<PathBuf>,

    /// Instead of a report, write the poses of an animated node, for the trajectory of a LiDAR ([scan])
    #[arg(long, value_name = "NODE=FILE.csv", help_heading = "Output", conflicts_with_all = ["pixel", "map", "plot", "json"])]
    pub poses: Option<String>,

    /// Print JSON
    #[arg(long, help_heading = "Output")]
    pub json: bool,
}

/// List the Vulkan devices and their limits
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 listed, or all checks are ok, 1 a check found a wrong image, 2 wrong input, 4 device error"
)]
pub struct DevicesArgs {
    /// On one device, render small scenes with every estimator and compare with known images; takes a minute or two
    #[arg(long, conflicts_with = "json", help_heading = "Check")]
    pub check: bool,

    /// Device to check, by index or part of its name [default: the fastest kind of device]
    #[arg(long, value_name = "INDEX|NAME", requires = "check", help_heading = "Check")]
    pub device: Option<String>,

    /// Print JSON
    #[arg(long, help_heading = "Output")]
    pub json: bool,
}

/// Write one of the project's own scenes
#[derive(Debug, Args)]
pub struct GenerateArgs {
    /// cornell-box, gated-sphere, door-ajar, cluttered-room, hundred-lamps, street (with a car that moves), hidden-letter (for
    /// scans), windscreen (the street through glass), pool (a bed under water), or zoo-area, zoo-punctual, zoo-beam (a room with
    /// every material, lit by an area lamp, by a point and a spot light, or by a beam)
    #[arg(value_name = "NAME")]
    pub name: String,

    /// Roughness of cornell-box's metal, 0 to 1 [default: 0.45]
    #[arg(long, value_name = "R", help_heading = "Scene")]
    pub roughness: Option<f32>,

    /// Minimum number of triangles, for cornell-box (its faces are divided) or cluttered-room
    #[arg(long, value_name = "N", help_heading = "Scene")]
    pub triangles: Option<u32>,

    /// Scene file to write (.glb)
    #[arg(short, long, value_name = "FILE.glb", help_heading = "Output")]
    pub output: PathBuf,
}

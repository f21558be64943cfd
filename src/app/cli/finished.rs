//! Flags of the commands that read finished images or sums.

use std::path::PathBuf;

use clap::Args;
use taugate::internals::lidar::echoes::Detection;
use taugate::internals::settings::aov::Aov;
use taugate::internals::settings::exposure::Exposure;
use taugate::internals::settings::optical_path::OpticalPath;
use taugate::internals::settings::values::Pixel;

/// The files that merge and develop write
#[derive(Debug, Args)]
pub struct DevelopedFiles {
    /// Files to write: image (.exr), NumPy array (.npy), picture (.png), or sums (.acc); may be repeated
    #[arg(short, long, value_name = "OUT.exr|npy|png|acc", help_heading = "Output", required = true)]
    pub output: Vec<PathBuf>,

    /// Also write the variances of an array OUT.npy, to OUT.variance.npy
    #[arg(long, help_heading = "Output")]
    pub variance: bool,

    /// Exposure of the picture: auto, or a number of stops [default: auto]
    #[arg(long, value_name = "EV|auto", help_heading = "Output", allow_hyphen_values = true)]
    pub exposure: Option<Exposure>,

    /// Auxiliary layers to keep, of those that the sums have [default: all of them]
    #[arg(long, value_name = "NAME,...", help_heading = "Output")]
    pub aov: Option<Aov>,
}

const MERGE_EXAMPLES: &str = "\
Examples:
  taugate render room.glb --spp 4096 --shard 0/2 -o part0.acc        on one machine
  taugate render room.glb --spp 4096 --shard 1/2 -o part1.acc        on another
  taugate merge part0.acc part1.acc -o room.exr -o room.png

Exit codes: 0 done, 2 wrong input or file";

/// Join the shards of a render
#[derive(Debug, Args)]
#[command(after_help = MERGE_EXAMPLES)]
pub struct MergeArgs {
    /// The sums of the shards, in any order
    #[arg(value_name = "SUMS.acc", required = true)]
    pub parts: Vec<PathBuf>,

    #[command(flatten)]
    pub files: DevelopedFiles,

    /// Print nothing but errors
    #[arg(short, long, help_heading = "Output")]
    pub quiet: bool,
}

const DEVELOP_EXAMPLES: &str = "\
Examples:
  taugate render room.glb --gates 5m..8m/30 --time 8h --checkpoint room.acc -o room.npy
  taugate develop room.acc -o so-far.exr -o so-far.png               while it renders

Exit codes: 0 done, 2 wrong input or file";

/// Make images from the sums of a render, finished or not
#[derive(Debug, Args)]
#[command(after_help = DEVELOP_EXAMPLES)]
pub struct DevelopArgs {
    /// The sums, which render wrote with -o OUT.acc or --checkpoint, or merge
    #[arg(value_name = "SUMS.acc")]
    pub sums: PathBuf,

    #[command(flatten)]
    pub files: DevelopedFiles,

    /// Print nothing but errors
    #[arg(short, long, help_heading = "Output")]
    pub quiet: bool,
}

/// Measure the error of an image against a reference
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 within the threshold and without a significant difference, 1 above the threshold or different, \
                  2 error, or --z has too few samples to judge"
)]
pub struct CompareArgs {
    /// The image to judge (.exr), the array of a render with many gates (.npy), or the sums of either (.acc)
    #[arg(value_name = "A")]
    pub image: PathBuf,

    /// The reference, of the same kind and size
    #[arg(value_name = "REF")]
    pub reference: PathBuf,

    /// Exit with 1 if relMSE is above this, or if there is light in gates that are dark in the reference
    #[arg(long, value_name = "X", help_heading = "Output")]
    pub max_relmse: Option<f64>,

    /// Test whether the images differ by more than their noise, and exit with 1 if they do; OUT is a map of the differences
    /// in standard errors (.exr: signed; .png: red where A is brighter, blue where A is darker); taugate must have rendered
    /// both images, with different seeds
    #[arg(long, value_name = "OUT.png|OUT.exr", help_heading = "Output")]
    pub z: Option<PathBuf>,

    /// Print JSON
    #[arg(long, help_heading = "Output")]
    pub json: bool,
}

const HISTOGRAM_EXAMPLES: &str = "\
Examples:
  taugate render room.glb --gates 5m..8m/30 -o h.npy --variance
  taugate histogram h.npy --pixel 120,80 --plot pixel.svg";

/// Print or plot the light of a pixel in every gate of a render
#[derive(Debug, Args)]
#[command(after_help = HISTOGRAM_EXAMPLES)]
pub struct HistogramArgs {
    /// The array that render wrote with -o; error bars need the array of --variance beside it
    #[arg(value_name = "ARRAY.npy")]
    pub array: PathBuf,

    /// Column and row of the pixel in the array, from 0 [default: the mean over all pixels]
    #[arg(long, value_name = "X,Y", help_heading = "Scene")]
    pub pixel: Option<Pixel>,

    /// Write a plot
    #[arg(long, value_name = "FILE.svg", help_heading = "Output")]
    pub plot: Option<PathBuf>,

    /// Print JSON
    #[arg(long, help_heading = "Output")]
    pub json: bool,
}

const DETECT_EXAMPLES: &str = "\
Examples:
  taugate render room.glb --gates 5m..8m/300 -o light.npy
  taugate detect light.npy -o counts.npy --photons 1e4 --pulses 1000 --first-photon --jitter 50ps
  taugate detect gated.exr -o counts.npy --photons 1e4 --background daylight.exr";

/// Turn radiance into the photon counts of a detector, such as a SPAD array
#[derive(Debug, Args)]
#[command(after_help = DETECT_EXAMPLES)]
pub struct DetectArgs {
    /// The light: an array or a scan (.npy), an image (.exr) or sums (.acc) that taugate rendered with gates; watts of its lamps count as
    /// joules per pulse
    #[arg(value_name = "LIGHT")]
    pub input: PathBuf,

    /// The counts over all pulses, as an array with a JSON file beside it
    #[arg(short, long, value_name = "OUT.npy", help_heading = "Output")]
    pub output: PathBuf,

    /// Also write a picture of the counts, the sum of all gates, next to the output or to FILE.png
    #[arg(long, value_name = "FILE.png", help_heading = "Output", num_args = 0..=1)]
    pub png: Option<Option<PathBuf>>,

    /// Exposure of the picture: auto, or a number of stops [default: auto]
    #[arg(long, value_name = "EV|auto", help_heading = "Output", allow_hyphen_values = true)]
    pub exposure: Option<Exposure>,

    /// Photons that reach a pixel per pulse for each unit of the image, J/(m^2 sr)
    #[arg(long, value_name = "X", help_heading = "Detector", allow_hyphen_values = true)]
    pub photons: f64,

    /// Daylight: radiance in W/(m^2 sr), as a number or as an image rendered without a gate. Each gate collects it for the integral of
    /// its weights, which is the duration of a box
    #[arg(long, value_name = "RADIANCE|FILE.exr", help_heading = "Detector")]
    pub background: Option<String>,

    /// One channel, the mean of red, green and blue, instead of three
    #[arg(long, help_heading = "Detector")]
    pub mono: bool,

    #[command(flatten)]
    pub detector: DetectorArgs,
}

/// A photon-counting detector and the pulses that it sees
#[derive(Debug, Args)]
pub struct DetectorArgs {
    /// Number of pulses
    #[arg(long, value_name = "N", help_heading = "Detector", default_value_t = 1, requires = "photons",
          value_parser = clap::value_parser!(u64).range(1..=1_000_000_000_000))]
    pub pulses: u64,

    /// Quantum efficiency, the probability that a photon is counted
    #[arg(
        long,
        value_name = "0..1",
        help_heading = "Detector",
        allow_hyphen_values = true,
        default_value_t = 1.0,
        requires = "photons"
    )]
    pub efficiency: f64,

    /// Dark counts per second
    #[arg(
        long,
        value_name = "HZ",
        help_heading = "Detector",
        allow_hyphen_values = true,
        default_value_t = 0.0,
        requires = "photons"
    )]
    pub dark_counts: f64,

    /// Standard deviation of the measured time, such as 50ps
    #[arg(long, value_name = "TIME", help_heading = "Detector", allow_hyphen_values = true, requires = "photons")]
    pub jitter: Option<OpticalPath>,

    /// Time for which the detector is blind after each count, such as 20ns
    #[arg(
        long,
        value_name = "TIME",
        help_heading = "Detector",
        allow_hyphen_values = true,
        conflicts_with = "first_photon",
        requires = "photons"
    )]
    pub dead_time: Option<OpticalPath>,

    /// At most one count per pulse: the first photon hides all later ones
    #[arg(long, help_heading = "Detector", requires = "photons")]
    pub first_photon: bool,

    /// Seed of the random counts
    #[arg(long, value_name = "N", help_heading = "Detector", default_value_t = 0, requires = "photons")]
    pub seed: u32,
}

const LIDAR_EXAMPLES: &str = "\
Examples:
  taugate render lidar.toml --aov depth,object -o scan.npy
  taugate lidar scan.npy -o cloud.las
  taugate lidar rising.npy --falling falling.npy -o fmcw.las
  taugate lidar scan.npy -o noisy.ply --photons 1e6 --background 1e4 --min-intensity 1e-3

Exit codes: 0 done, 2 wrong input or file";

/// Turn the waveforms of a LiDAR scan into a point cloud, a point per echo
#[derive(Debug, Args)]
#[command(after_help = LIDAR_EXAMPLES)]
pub struct LidarArgs {
    /// The scan (.npy), or the counts of it that detect wrote; with the layers of --aov depth,object, echoes of the first surface
    /// have its exact range and its object
    #[arg(value_name = "SCAN.npy")]
    pub input: PathBuf,

    /// The point cloud: PLY (binary), LAS 1.4, or a NumPy array with named fields
    #[arg(short, long, value_name = "OUT.ply|las|laz|npy", help_heading = "Output")]
    pub output: PathBuf,

    /// For an FMCW sensor: a scan of the same shots with another sweep, such as one that falls. Both together tell the range and the velocity of
    /// each echo
    #[arg(long, value_name = "SCAN.npy", help_heading = "Echoes", conflicts_with = "photons")]
    pub falling: Option<PathBuf>,

    /// The point of an echo that gives its time: peak, constant-fraction (half of the peak) or threshold
    #[arg(long, value_name = "METHOD", help_heading = "Echoes", default_value = "peak")]
    pub detection: Detection,

    /// Height of the threshold, as a share of the highest bin of the waveform
    #[arg(long, value_name = "0..1", help_heading = "Echoes", allow_hyphen_values = true, default_value_t = 0.1)]
    pub threshold: f64,

    /// Least height of the threshold; 1 is a white diffuse target that faces the sensor at 1 m
    #[arg(long, value_name = "X", help_heading = "Echoes", allow_hyphen_values = true, default_value_t = 0.0)]
    pub min_intensity: f64,

    /// Least distance between two echoes in metres
    #[arg(long, value_name = "METRES", help_heading = "Echoes", allow_hyphen_values = true, default_value_t = 0.5)]
    pub separation: f64,

    /// Maximum number of echoes per shot, up to 8: the first ones
    #[arg(long, value_name = "N", help_heading = "Echoes", default_value_t = 8)]
    pub max_echoes: usize,

    /// Photons that reach the sensor per pulse for each unit of the scan, J/(m^2 sr): the echoes are those of a detector's counts, as
    /// taugate detect draws them
    #[arg(long, value_name = "X", help_heading = "Detector", allow_hyphen_values = true)]
    pub photons: Option<f64>,

    /// Daylight: radiance in W/(m^2 sr)
    #[arg(long, value_name = "RADIANCE", help_heading = "Detector", allow_hyphen_values = true, requires = "photons")]
    pub background: Option<f32>,

    #[command(flatten)]
    pub detector: DetectorArgs,
}

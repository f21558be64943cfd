//! The files that a render writes.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::files::has_extension;
use crate::image::npy_file;
use crate::image::scan_layers::layers_path;
use crate::input::experiment::Experiment;
use crate::input::responses::chosen;
use crate::settings::GatePictures;
use crate::settings::aov::Aov;
use crate::settings::doppler::Doppler;
use crate::settings::exposure::Exposure;
use crate::settings::shard::Shard;
use crate::settings::table::OutputTable;
use crate::settings::values::Png;

/// The files that a render writes. At least one of them keeps the image: `exr`, `npy`, `acc`, `png` or `checkpoint`.
#[derive(Debug, Clone, PartialEq)]
pub struct Outputs {
    pub exr: Option<PathBuf>,
    pub npy: Option<PathBuf>,
    /// File for the sums.
    pub acc: Option<PathBuf>,
    /// Whether the variances of the array are written too.
    pub variance: bool,
    /// Whether the array is of a continuous-wave sensor. Then its depths are written too.
    pub depth: bool,
    /// Auxiliary layers of the image file; of a scan, in a file beside its array.
    pub aov: Aov,
    /// Whether the array is that of a scan.
    pub is_scan: bool,
    /// Whether the velocities of the light of a scan are written too.
    pub velocity: bool,
    pub png: Option<PathBuf>,
    /// What the picture shows if there are several gates.
    pub png_gates: GatePictures,
    /// The names of the gates, for files that contain them.
    pub gate_names: Vec<String>,
    /// Exposure of the picture `png`.
    pub exposure: Exposure,
    pub stats: Option<PathBuf>,
    /// Folder for the images of the strategies.
    pub strategy_images: Option<PathBuf>,
    /// File for the sums so far, and the seconds between two writes.
    pub checkpoint: Option<(PathBuf, f64)>,
    /// Whether the sums need variances.
    pub keeps_variance: bool,
}

impl Outputs {
    /// The name of the image: the path of the first file that holds it.
    pub fn name(&self) -> String {
        let checkpoint = self.checkpoint.as_ref().map(|(path, _)| path);
        let first = self.exr.iter().chain(&self.npy).chain(&self.acc).chain(&self.png).chain(checkpoint).next();
        first.map_or(String::new(), |path| path.display().to_string())
    }

    /// All files, without the folder for the images of the strategies.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = [&self.exr, &self.npy, &self.acc].into_iter().flatten().cloned().collect();
        if let Some(npy) = &self.npy {
            files.push(npy_file::description_path(npy));
            files.extend(self.variance.then(|| npy_file::variance_path(npy)));
            files.extend(self.depth.then(|| npy_file::depth_path(npy)));
            files.extend((self.is_scan && self.aov != Aov::default()).then(|| layers_path(npy)));
            files.extend(self.velocity.then(|| npy_file::velocity_path(npy)));
        }
        files.extend(self.pictures());
        files.extend(self.stats.clone());
        files.extend(self.checkpoint.iter().map(|(path, _)| path.clone()));
        files
    }

    /// The files that are replaced or removed: [`Outputs::files`], and the variances and depths beside an earlier array.
    pub fn replaced(&self) -> Vec<PathBuf> {
        let mut files = self.files();
        files.extend(self.npy.as_deref().map_or(vec![], |npy| npy_file::paths_beside(npy).into()));
        files
    }

    /// The pictures: one, or with [`GatePictures::Each`] one per gate, in the order of the gates.
    pub fn pictures(&self) -> Vec<PathBuf> {
        let Some(png) = &self.png else { return vec![] };
        match self.png_gates {
            GatePictures::Each if self.gate_names.len() > 1 => {
                self.gate_names.iter().map(|name| png.with_extension(format!("{name}.png"))).collect()
            }
            _ => vec![png.clone()],
        }
    }

    /// The files that keep the sums.
    pub fn sums(&self) -> impl Iterator<Item = &Path> {
        let checkpoint = self.checkpoint.as_ref().map(|(path, _)| path);
        self.acc.iter().chain(checkpoint).map(PathBuf::as_path)
    }

    /// Whether a file contains variances.
    pub fn has_variance(&self) -> bool {
        self.exr.is_some() || self.variance || self.keeps_variance
    }
}

/// Extensions of output files.
const EXTENSIONS: [&str; 4] = ["exr", "npy", "png", "acc"];
/// Default of --every in seconds.
const DEFAULT_EVERY: f64 = 60.0;
/// Maximum number of responses in an image file (.exr).
const MAX_EXR_RESPONSES: usize = 64;

/// The files that a render writes. Fails if there is no output file, or if a file has the wrong extension. The function needs no
/// scene, so a mistake is found before the scene is loaded.
pub fn outputs(experiment: &Experiment) -> Result<Outputs> {
    let wanted = &experiment.output;
    let files = wanted.output.clone().map_or(vec![], |files| files.0);
    if files.is_empty() && wanted.checkpoint.is_none() {
        return Err(Error::advice("no output file: ", "add -o OUT.exr or -o OUT.npy"));
    }
    let is_known = |path: &&PathBuf| EXTENSIONS.iter().any(|extension| has_extension(path, extension));
    if let Some(other) = files.iter().find(|path| !is_known(path)) {
        return Err(Error::settings(format!("the output {} must end in .exr, .npy, .png or .acc", other.display())));
    }
    let only = |extension: &str| {
        let mut all = files.iter().filter(|path| has_extension(path, extension));
        match (all.next(), all.next()) {
            (Some(one), Some(two)) => Err(Error::advice(
                format!("{} and {} would hold the same image; ", one.display(), two.display()),
                format!("name one .{extension} file"),
            )),
            (one, _) => Ok(one.cloned()),
        }
    };
    let [exr, npy, acc, picture] = [only("exr")?, only("npy")?, only("acc")?, only("png")?];
    let responses = chosen(&experiment.gate)?;
    let count = responses.len();
    if exr.is_some() && count > MAX_EXR_RESPONSES {
        return Err(Error::advice(
            format!("an .exr file holds at most {MAX_EXR_RESPONSES} gates, and these are {count}; "),
            "write -o OUT.npy",
        ));
    }
    let variance = wanted.variance.unwrap_or(false);
    let checkpoint = checkpoint(wanted)?;
    let keeps_sums = acc.is_some() || checkpoint.is_some();
    if variance && npy.is_none() && !keeps_sums {
        return Err(Error::advice(
            "--variance is for an array: ",
            "add -o OUT.npy (an .exr file always has the variance)",
        ));
    }
    let aov = wanted.aov.unwrap_or_default();
    let is_scan = experiment.scan.is_some();
    if aov != Aov::default() && exr.is_none() && !keeps_sums && !is_scan {
        return Err(Error::advice("--aov adds layers to an image file or to sums: ", "add -o OUT.exr or -o OUT.acc"));
    }
    let png = match &wanted.png {
        None | Some(Png::Wanted(false)) => picture,
        Some(_) if picture.is_some() => {
            return Err(Error::advice("-o OUT.png and --png both name the picture: ", "keep one"));
        }
        Some(Png::Wanted(true)) => match files.first() {
            Some(first) => Some(first.with_extension("png")),
            None => {
                return Err(Error::advice(
                    "--png takes its name from the output: ",
                    "add -o OUT.exr, or write --png FILE.png",
                ));
            }
        },
        Some(Png::File(path)) if has_extension(path, "png") => Some(path.clone()),
        Some(Png::File(path)) => {
            return Err(Error::settings(format!("the picture {} must end in .png", path.display())));
        }
    };
    for (flag, is_given) in [("exposure", wanted.exposure.is_some()), ("png-gates", wanted.png_gates.is_some())] {
        if is_given && png.is_none() {
            return Err(Error::advice(format!("--{flag} is for the picture: "), "add --png"));
        }
    }
    // The extension .json ensures that the file cannot overwrite the scene, the experiment or an image.
    let stats = wanted.stats.clone();
    if let Some(path) = stats.as_ref().filter(|path| !has_extension(path, "json")) {
        return Err(Error::settings(format!("the --stats file {} must end in .json", path.display())));
    }
    if !responses.is_single_box() && wanted.strategy_images.is_some() {
        return Err(Error::advice(
            "--strategy-images needs a single gate with the weight 1: ",
            "render it alone, with --gate and without --response and --repeat",
        ));
    }
    let exposure = wanted.exposure.unwrap_or_default();
    // A scan is no image of depths, and the phases of a heterodyne sensor are none of travel times.
    let depth = responses.have_depths() && !is_scan;
    let keeps_variance = keeps_sums && (variance || count <= MAX_EXR_RESPONSES);
    let outputs = Outputs {
        exr,
        npy,
        acc,
        variance,
        depth,
        aov,
        is_scan,
        velocity: is_scan && experiment.render.doppler.is_some_and(|doppler| doppler != Doppler::OFF),
        png,
        png_gates: wanted.png_gates.unwrap_or_default(),
        gate_names: responses.iter().enumerate().map(|(k, response)| file_name(response.name(), k)).collect(),
        exposure,
        stats,
        strategy_images: wanted.strategy_images.clone(),
        checkpoint,
        keeps_variance,
    };
    check_shard(wanted.shard.unwrap_or(Shard::ALL), &outputs)?;
    Ok(outputs)
}

/// The name of gate `number` in the names of files: its own name, or its number if the name could lead to another folder.
fn file_name(name: &str, number: usize) -> String {
    let is_plain = name.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c));
    if is_plain { name.into() } else { format!("gate{number}") }
}

/// Fails if a part of a render would not be kept as sums. Also sums that a render continues may be of a shard.
pub fn check_shard(shard: Shard, outputs: &Outputs) -> Result<()> {
    match shard.is_all() || outputs.sums().next().is_some() {
        true => Ok(()),
        false => Err(Error::advice(
            "a shard is a part of a render: ",
            "add -o OUT.acc, so that taugate merge can join the parts",
        )),
    }
}

/// The file of --checkpoint and the seconds between two writes. Fails if flags of long renders do not fit together.
pub fn checkpoint(wanted: &OutputTable) -> Result<Option<(PathBuf, f64)>> {
    for (flag, path) in [("checkpoint", &wanted.checkpoint), ("resume", &wanted.resume)] {
        if let Some(path) = path.as_ref().filter(|path| !has_extension(path, "acc")) {
            return Err(Error::settings(format!("the file of --{flag}, {}, must end in .acc", path.display())));
        }
    }
    if wanted.every.is_some() && wanted.checkpoint.is_none() {
        return Err(Error::advice("--every is for the file of --checkpoint: ", "add --checkpoint FILE.acc"));
    }
    let is_long = wanted.checkpoint.is_some() || wanted.resume.is_some() || wanted.shard.is_some();
    if is_long && wanted.strategy_images.is_some() {
        return Err(Error::advice(
            "--strategy-images needs all iterations in one run: ",
            "leave out --checkpoint, --resume and --shard",
        ));
    }
    let seconds = wanted.every.map_or(DEFAULT_EVERY, |every| every.0);
    Ok(wanted.checkpoint.clone().map(|path| (path, seconds)))
}

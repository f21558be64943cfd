//! The state of a render so far: all sums in f64, and the iterations in them. A render can continue from an accumulation, the
//! accumulations of shards can be merged, and all images can be made from one. [`file`] keeps it in a file, `.acc`.
//!
//! Researchers who average the images of several machines must weight them by samples, and cannot average their variances. Sums
//! have neither problem: the sums of disjoint iterations add up.

mod arrays;
pub mod file;
mod iterations;
mod layer_arrays;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::image::exr_file::{Merged, version};
use crate::image::film::Film;
use crate::image::fingerprint;
use crate::image::layers::Layers;
use crate::image::luminance;
use crate::image::response_film::ResponseFilm;
use crate::settings::shard::Shard;
use crate::settings::table::find;
use crate::settings::{Responses, Settings};

pub use iterations::Iterations;

/// The version of the format, which [`file`] describes.
const FORMAT: u32 = 1;

/// The sums of a render or of a part of it.
#[derive(Debug, Clone)]
pub struct Accumulation {
    pub about: About,
    pub film: Film,
    /// The images of several responses; `None` if there is one, whose image is the film.
    pub responses: Option<ResponseFilm>,
    /// `None` if the sampling is uniform.
    pub adaptive: Option<AdaptiveState>,
    /// Auxiliary layers of the image. They do not depend on the number of samples.
    pub layers: Layers,
}

impl Accumulation {
    /// The light that merging found; `None` if the render did not merge, or if an earlier version wrote the sums.
    pub fn merged(&self) -> Option<Merged> {
        self.about.merged.map(|merged| merged.of(&self.film))
    }
}

/// What adaptive sampling has measured so far.
#[derive(Debug, Clone, PartialEq)]
pub struct AdaptiveState {
    /// Per pixel of the crop, row by row: number of samples, sum of their luminances, sum of their squared luminances, and sum
    /// over iterations of the pixel's luminance times the average samples per pixel.
    pub pixels: Vec<[f64; 4]>,
    /// Samples per pixel so far, averaged over the pixels.
    pub samples: f64,
    pub iterations: u32,
    /// The error of each pixel without the last iteration, which the samples of the next iteration follow. `None` in merged sums.
    pub errors: Option<Vec<f64>>,
}

/// The render that the sums belong to, and the part of it that they contain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    pub format: u32,
    /// Name and version of the program.
    pub version: String,
    /// [`crate::image::fingerprint::RENDERER`].
    pub renderer: String,
    /// Fingerprint of the contents of the scene, and of the files that the settings name.
    pub scene: String,
    /// The experiment without outputs, as TOML with absolute paths.
    pub settings: String,
    /// The paths in `settings` of files whose contents are in the fingerprint.
    #[serde(default)]
    pub files: Vec<String>,
    /// Width and height of the whole image.
    pub resolution: [u32; 2],
    /// The part of the image in the arrays: x0, x1, y0, y1.
    pub crop: [u32; 4],
    /// Names of the responses along the axis T of the arrays.
    pub responses: Vec<String>,
    /// Fingerprints of the weights of the responses that are tables, by the name of the response. Files of earlier versions have none.
    #[serde(default)]
    pub tables: BTreeMap<String, String>,
    pub seed: u32,
    pub samples_per_pixel: u64,
    /// Samples that were not finite. They count as 0. Files of earlier versions do not have this number.
    #[serde(default)]
    pub dropped: u64,
    /// Seconds of rendering, summed over the parts.
    pub seconds: f64,
    pub iterations: Iterations,
    /// Index in the random sequences at which the next iteration begins.
    pub next_sample: u32,
    /// The shards that were merged, or the one that was rendered.
    pub shards: Vec<Shard>,
    /// `None` if the render does not merge. Files of earlier versions do not have it.
    #[serde(default)]
    pub merged: Option<MergedLight>,
    /// Order of the axes of `sums` and `squares`, for readers of the file.
    pub axes: String,
}

/// Light that merging found.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MergedLight {
    /// Luminance: the sum over the iterations of the mean over the pixels.
    light: f64,
    iterations: u32,
    /// Radius in pixels of the last iteration.
    radius: f64,
}

impl MergedLight {
    /// Adds an iteration that found `light`, the mean luminance of the pixels, within `radius` pixels.
    pub fn add(&mut self, light: f64, radius: f64) {
        *self = self.plus(MergedLight { light, iterations: 1, radius });
    }

    fn plus(self, other: MergedLight) -> MergedLight {
        let radius = match self.iterations {
            0 => other.radius,
            _ => self.radius.min(other.radius),
        };
        MergedLight {
            light: self.light + other.light,
            iterations: self.iterations.saturating_add(other.iterations),
            radius,
        }
    }

    /// As a share of the luminance of the film.
    pub fn of(&self, film: &Film) -> Merged {
        let pixels = film.mean();
        let all = pixels.chunks_exact(3).map(|rgb| luminance([rgb[0], rgb[1], rgb[2]])).sum::<f64>();
        let share = self.light / f64::from(self.iterations.max(1)) / (3.0 * all / pixels.len() as f64);
        Merged { share: if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 }, radius: self.radius }
    }
}

const AXES: &str = "height, width, response, channel";

impl About {
    /// Describes a render with `settings` before its first iteration. `experiment` is its TOML. `files` are the paths of the files
    /// that `experiment` names beside the scene. `scene` is the fingerprint of the scene and these files.
    pub fn new(settings: &Settings, experiment: String, files: &[PathBuf], scene: String, shard: Shard) -> About {
        let crop = settings.crop();
        About {
            format: FORMAT,
            version: version(),
            renderer: fingerprint::RENDERER.into(),
            scene,
            settings: experiment,
            files: files.iter().map(|path| path.to_string_lossy().into()).collect(),
            resolution: settings.resolution(),
            crop: [crop.x0, crop.x1, crop.y0, crop.y1],
            responses: settings.responses().iter().map(|response| response.name().into()).collect(),
            tables: tables(settings.responses()),
            seed: settings.seed(),
            samples_per_pixel: 0,
            dropped: 0,
            seconds: 0.0,
            iterations: Iterations::default(),
            next_sample: 0,
            shards: vec![shard],
            merged: None,
            axes: AXES.into(),
        }
    }

    /// Number of columns and rows of the arrays.
    pub fn size(&self) -> [u32; 2] {
        let [x0, x1, y0, y1] = self.crop;
        [x1.saturating_sub(x0), y1.saturating_sub(y0)]
    }

    /// The shard in the accumulation, from which a render may continue; `None` if several shards were merged.
    pub fn shard(&self) -> Option<Shard> {
        match self.shards[..] {
            [shard] => Some(shard),
            _ => None,
        }
    }

    /// Compares the tables among `responses`, which were read again, with the tables of the render. Fails if one has changed. Returns a
    /// sentence if an earlier version wrote the sums without this information.
    pub fn check_tables(&self, responses: &Responses) -> Result<Option<String>> {
        let found = tables(responses);
        let known = |name: &String| self.tables.get(name);
        if let Some((name, _)) = found.iter().find(|(name, found)| known(name).is_some_and(|known| known != *found)) {
            return Err(Error::settings(format!(
                "the response {name} has other weights than during the render; restore the file of --response, or render anew"
            )));
        }
        let unknown = responses
            .iter()
            .find(|response| found.contains_key(response.name()) && known(&response.name().into()).is_none());
        Ok(unknown.map(|response| {
            let file = response.file().map_or(response.name().into(), |file| file.display().to_string());
            format!("the sums come from an earlier version, which did not record the weights in {file}; make sure that they are unchanged")
        }))
    }

    /// Fails if the sums of `other` do not belong to the same render; the message says how they differ. The number of samples or
    /// seconds may differ. The message calls the two `name` and `other_name`.
    pub fn check_same_render(&self, name: &str, other: &About, other_name: &str) -> Result<()> {
        let fail = |what: String| Err(Error::settings(what));
        if self.renderer != other.renderer {
            return fail(format!(
                "{name} and {other_name} come from different versions of the renderer ({}, {} and {}, {}), which may differ by \
                 more than noise; render both with one version",
                self.version, self.renderer, other.version, other.renderer
            ));
        }
        let [own, others] = [self, other].map(|about| (&*about.settings, &*about.files));
        let differences = differences((name, own), (other_name, others), &BUDGET);
        if !differences.is_empty() {
            return fail(format!("{name} and {other_name} are not the same render: {}", differences.join("; ")));
        }
        if self.scene != other.scene {
            return fail(format!(
                "{name} and {other_name} are not the same render: the files of the scene, or those that the settings name, have other \
                 contents"
            ));
        }
        match (self.resolution, self.crop, &self.responses, self.seed)
            == (other.resolution, other.crop, &other.responses, other.seed)
        {
            true => Ok(()),
            false => fail(format!("{name} and {other_name} are not the same render: their images differ in size")),
        }
    }
}

impl Accumulation {
    /// Adds the sums of a disjoint part of the same render. The order of the parts changes only the last bits. Messages call the two
    /// `name` and `other_name`. Fails if they are not of the same render, or if they have an iteration in common.
    pub fn merge(&mut self, name: &str, other: &Accumulation, other_name: &str) -> Result<()> {
        self.about.check_same_render(name, &other.about, other_name)?;
        if let Some(common) = self.about.iterations.common(&other.about.iterations) {
            return Err(Error::advice(
                format!("{other_name} has iteration {common}, which is already in {name}; "),
                "merge every part once",
            ));
        }
        if self.film.damps_fireflies() != other.film.damps_fireflies() {
            return Err(Error::advice(
                format!("only one of {name} and {other_name} has what --fireflies damp needs; "),
                "render the other one anew",
            ));
        }
        self.film.merge(&other.film);
        if let (Some(film), Some(other)) = (&mut self.responses, &other.responses) {
            film.merge(other);
        }
        match (&mut self.adaptive, &other.adaptive) {
            (Some(state), Some(other)) => {
                let add = |(pixel, other): (&mut [f64; 4], &[f64; 4])| (0..4).for_each(|k| pixel[k] += other[k]);
                state.pixels.iter_mut().zip(&other.pixels).for_each(add);
                state.samples += other.samples;
                state.iterations += other.iterations;
                state.errors = None;
            }
            (state, _) => *state = None,
        }
        self.layers.add_missing(other.layers.clone());
        let (about, other) = (&mut self.about, &other.about);
        about.samples_per_pixel += other.samples_per_pixel;
        about.dropped = about.dropped.saturating_add(other.dropped);
        about.seconds += other.seconds;
        about.iterations = about.iterations.with(&other.iterations);
        about.next_sample = about.next_sample.max(other.next_sample);
        about.shards.extend(&other.shards);
        about.shards.sort_by_key(|shard| (shard.count(), shard.index()));
        about.shards.dedup();
        if let (Some(merged), Some(other)) = (&mut about.merged, other.merged) {
            *merged = merged.plus(other);
        }
        Ok(())
    }
}

/// Fingerprints of the weights of the responses that are tables, by name.
fn tables(responses: &Responses) -> BTreeMap<String, String> {
    let fingerprint = |rows: &[[f64; 2]]| {
        let numbers = rows.iter().flatten();
        numbers.fold(fingerprint::Hash::new(), |hash, x| hash.with(&x.to_le_bytes())).digits()
    };
    responses.iter().filter_map(|response| Some((response.name().into(), fingerprint(response.rows()?)))).collect()
}

/// Settings that only say when a render ends. The sums may be parts of one render, but the images differ.
const BUDGET: [&str; 2] = ["render.spp", "render.time"];

/// Settings as TOML, and the paths in it of files, which may differ.
type WithPaths<'a> = (&'a str, &'a [String]);

/// The first difference between the settings of two images; `None` if there is none that affects the image. Each image has a name for
/// the message.
pub fn difference_of_images(a: (&str, WithPaths), b: (&str, WithPaths)) -> Option<String> {
    differences(a, b, &[]).into_iter().next()
}

/// The differences between the settings of two renders, one text per setting, without those that are `ignored` or have no effect.
/// Each render has a name for the message.
fn differences((name_a, a): (&str, WithPaths), (name_b, b): (&str, WithPaths), ignored: &[&str]) -> Vec<String> {
    let [a, b] = [a, b].map(|(toml, files)| {
        let mut settings = BTreeMap::new();
        // Longest first, because a path may begin with a shorter one.
        let mut files: Vec<&str> = files.iter().map(String::as_str).collect();
        files.sort_by_key(|path| std::cmp::Reverse(path.len()));
        if let Ok(table) = toml.parse::<toml::Table>() {
            collect("", toml::Value::Table(table), &files, &mut settings);
        }
        settings
    });
    let affects_image = |name: &str| {
        let key = name.rsplit('.').next().unwrap_or(name);
        name != "scene" && find(key).is_none_or(|setting| setting.affects_image)
    };
    let counts = |name: &str| affects_image(name) && !ignored.contains(&name);
    let names: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
    let show = |value: Option<&String>| value.map_or("is not set".into(), |value| format!("is {value}"));
    names
        .into_iter()
        .filter(|name| counts(name) && a.get(*name) != b.get(*name))
        .map(|name| format!("{name} {} in {name_a} and {} in {name_b}", show(a.get(name)), show(b.get(name))))
        .collect()
}

/// Collects the values of all keys below `name`. The word FILE replaces the paths `files`.
fn collect(name: &str, value: toml::Value, files: &[&str], settings: &mut BTreeMap<String, String>) {
    match value {
        toml::Value::Table(table) => {
            for (key, value) in table {
                let key = current_key(key);
                let name = if name.is_empty() { key } else { format!("{name}.{key}") };
                collect(&name, value, files, settings);
            }
        }
        other => {
            settings.insert(name.into(), without_paths(other, files).to_string());
        }
    }
}

/// The present name of a key that may be an old one.
fn current_key(key: String) -> String {
    find(&key).map_or(key, |setting| setting.name.into())
}

fn without_paths(value: toml::Value, files: &[&str]) -> toml::Value {
    match value {
        toml::Value::String(text) => files.iter().fold(text, |text, path| text.replace(path, "FILE")).into(),
        toml::Value::Array(list) => {
            toml::Value::Array(list.into_iter().map(|value| without_paths(value, files)).collect())
        }
        toml::Value::Table(table) => toml::Value::Table(
            table.into_iter().map(|(key, value)| (current_key(key), without_paths(value, files))).collect(),
        ),
        other => other,
    }
}

#[cfg(test)]
mod tests;

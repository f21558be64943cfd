//! `taugate merge` and `taugate develop`: images from the sums of a render or of its shards.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use taugate::internals::files::{check_writable, lies_in};
use taugate::internals::image::accumulation::file::{read, read_about, write};
use taugate::internals::image::accumulation::{About, Accumulation};
use taugate::internals::image::exr_file::Provenance;
use taugate::internals::image::layers::Layers;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::{self, Outputs};
use taugate::internals::settings::aov::Aov;
use taugate::internals::settings::values::Files;
use taugate::internals::settings::{Crop, Responses};
use taugate::internals::threads::spawn_scoped;
use taugate::{Error, Result};

use super::accumulated;
use super::cli::DevelopedFiles;
use super::images::Images;
use super::progress::duration;
use super::render::check_inputs;
use super::report::{BLACK, dropped};
use super::rescue::Rescue;

/// Joins the sums `parts` and writes the files.
pub fn run(parts: &[PathBuf], files: &DevelopedFiles, quiet: bool) -> anyhow::Result<ExitCode> {
    let order = order(parts)?;
    let (path, first) = &order[0];
    let outputs = outputs(files, &accumulated::experiment(path, first)?)?;
    let (responses, doubt) = accumulated::responses(path, first)?;
    check_outputs(&outputs, parts)?;
    // The parts may have been rendered from copies of one scene.
    for (path, about) in &order {
        let experiment = accumulated::experiment(path, about)?;
        if let Some(scene) = &experiment.scene {
            check_inputs(&outputs.replaced(), scene, &experiment)?;
        }
    }

    let mut sums = merged(&order)?;
    if let Some(aov) = files.aov {
        keep_layers(&mut sums.layers, aov)?;
    }
    let provenance = provenance(&sums, responses);
    if (outputs.exr.is_some() || outputs.variance) && sums.responses.as_ref().is_some_and(|film| !film.has_variance()) {
        return Err(Error::settings(format!(
            "{} has no variances of its gates; render with --variance, or write an array without --variance",
            path.display()
        ))
        .into());
    }
    let mut rescue = Rescue::default();
    let images =
        Images { film: &sums.film, responses: sums.responses.as_ref(), provenance: &provenance, layers: &sums.layers };
    images.write(&outputs, &mut rescue);
    if let Some(path) = &outputs.acc {
        rescue.write(path, |path| write(path, sums.parts()));
    }
    rescue.finish()?;
    if !quiet {
        doubt.iter().for_each(|warning| super::say(warning));
        warnings(&sums).iter().for_each(|warning| super::say(&format!("warning: {warning}")));
        super::say(&summary(&sums, &outputs));
        images.describe_exposure(&outputs).iter().for_each(|line| super::say(line));
    }
    Ok(ExitCode::SUCCESS)
}

/// Sorts the parts by their first iteration, so that the result does not depend on the order in which the user names them. Fails if
/// the parts do not belong together. Does not read the arrays yet.
fn order(parts: &[PathBuf]) -> Result<Vec<(PathBuf, About)>> {
    let mut all = vec![];
    for path in parts {
        all.push((path.clone(), read_about(path)?));
    }
    all.sort_by_key(|(path, about)| (about.iterations.first(), path.clone()));
    let (first_path, first) = &all[0];
    let mut seen = first.iterations.clone();
    for (path, about) in &all[1..] {
        first.check_same_render(&name(first_path), about, &name(path))?;
        if let Some(common) = seen.common(&about.iterations) {
            return Err(Error::settings(format!(
                "{} has iteration {common}, which another of the files has too; merge every part once",
                name(path)
            )));
        }
        seen = seen.with(&about.iterations);
    }
    Ok(all)
}

fn name(path: &Path) -> String {
    path.display().to_string()
}

/// Threads that read parts. With two, `merge` is 1.3 times as fast as with one (docs/notebook/merge-speed.md).
const READERS: usize = 2;

/// The sums of all parts, added in the order given. Other threads read the next parts meanwhile. Per thread, at most one part waits, so
/// at most four parts are in memory at a time.
fn merged(order: &[(PathBuf, About)]) -> Result<Accumulation> {
    let (first, others) = order.split_first().expect("the command names a file");
    let mut sums = read(&first.0)?;
    std::thread::scope(|scope| {
        let mut readers = vec![];
        for reader in 0..READERS {
            let (sender, parts) = std::sync::mpsc::sync_channel(0);
            let paths = others.iter().skip(reader).step_by(READERS).map(|(path, _)| path);
            // `send` fails after this function has returned an error. Then no more parts are read.
            let read_all = move || paths.map(|path| read(path)).find_map(|part| sender.send(part).err());
            spawn_scoped(scope, "read", read_all)?;
            readers.push(parts);
        }
        for (k, (path, _)) in others.iter().enumerate() {
            let part = readers[k % READERS].recv().expect("a reader sends every part");
            sums.merge(&name(&first.0), &part?, &name(path))?;
        }
        Ok(sums)
    })
}

/// Keeps the layers `wanted`; `all` keeps every layer of the sums. Fails if the sums lack one of them.
fn keep_layers(layers: &mut Layers, wanted: Aov) -> Result<()> {
    let missing = match wanted == Aov::ALL && !layers.channels.is_empty() {
        true => None,
        false => layers.keep(wanted).err(),
    };
    missing.map_or(Ok(()), |name| {
        Err(Error::advice(
            format!("the sums have no layer {name}: "),
            format!("make it with taugate render --resume SUMS.acc --aov {name} -o OUT.exr"),
        ))
    })
}

/// The files to write. `of_sums` says which gates the images have.
fn outputs(files: &DevelopedFiles, of_sums: &Experiment) -> Result<Outputs> {
    let mut wanted = Experiment { gate: of_sums.gate.clone(), ..Experiment::default() };
    wanted.output.output = Some(Files(files.output.clone()));
    wanted.output.variance = files.variance.then_some(true);
    wanted.output.exposure = files.exposure;
    wanted.output.aov = files.aov;
    resolve::outputs(&wanted)
}

/// Fails if a file cannot be written, or if it is one of the parts.
fn check_outputs(outputs: &Outputs, parts: &[PathBuf]) -> Result<()> {
    for path in outputs.files() {
        check_writable(&path)?;
        if path.exists() && parts.iter().any(|part| lies_in(&path, part)) {
            let message = "is one of the files to read; choose another name".into();
            return Err(Error::File { path, message });
        }
    }
    Ok(())
}

fn provenance(sums: &Accumulation, responses: Responses) -> Provenance {
    let about = &sums.about;
    let [x0, x1, y0, y1] = about.crop;
    Provenance {
        resolution: about.resolution,
        crop: Crop { x0, y0, x1, y1 },
        responses,
        seed: about.seed,
        seconds: about.seconds,
        settings: about.settings.clone(),
        merged: sums.merged(),
    }
}

/// Sentences about parts that are missing, about samples that were not finite, and about an image without light.
fn warnings(sums: &Accumulation) -> Vec<String> {
    let is_black = sums.film.mean().iter().all(|&x| x == 0.0);
    let about = &sums.about;
    missing_parts(about).into_iter().chain(dropped(about.dropped)).chain(is_black.then(|| BLACK.into())).collect()
}

fn missing_parts(about: &About) -> Option<String> {
    let count = about.shards.iter().map(|shard| shard.count()).max().unwrap_or(1);
    let has = |index: u32| about.shards.iter().any(|shard| (shard.index(), shard.count()) == (index, count));
    let missing: Vec<String> =
        (0..count).filter(|&index| !has(index)).map(|index| format!("{index}/{count}")).collect();
    if !missing.is_empty() && about.shards.iter().all(|shard| shard.count() == count) {
        let named = match missing.len() {
            n if n > 8 => format!("{} and {} more", missing[..8].join(", "), n - 8),
            _ => missing.join(", "),
        };
        return Some(format!("shards are missing ({named}), so the image has fewer samples than the whole render"));
    }
    let gap = about.iterations.gap();
    gap.map(|gap| format!("iteration {gap} is missing, because a shard ended early; the image has fewer samples"))
}

fn summary(sums: &Accumulation, outputs: &Outputs) -> String {
    let names: Vec<String> = outputs.files().iter().map(|path| name(path)).collect();
    let (film, about) = (&sums.film, &sums.about);
    let (mean, error) = film.image_mean();
    let error = error.map_or(String::new(), |error| format!(" +- {error:.1e}"));
    format!(
        "{}: {}x{}, {} samples per pixel in {} iterations and {}, mean {mean:.6e}{error}",
        names.join(", "),
        film.width(),
        film.height(),
        film.samples(),
        film.iterations(),
        duration(about.seconds)
    )
}

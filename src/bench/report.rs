//! The report of a suite: one page with a table, a plot and a strip of crops for every scene.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use super::case::Entry;
use super::growth;
use super::plot;
use super::quality::{MARGIN, MARGIN_OF_BOUNDS, Trust};
use super::reference::{self, Reference};
use super::strip::{self, strip};
use super::suite::Suite;
use super::summary::{self, ErrorSummary, Spread, VariantSummary};
use super::table::Row;
use crate::compare::metrics::{Means, RELMSE_FORMULA, TRIMMED};
use crate::error::{Error, Result};
use crate::files::write_atomically;
use crate::image::exr_file::{Picture, read_picture, version};
use crate::settings::Estimator;

/// The contents of a page.
pub struct Page<'a> {
    pub suite: &'a Suite,
    pub rows: &'a [Row],
    /// Name of each scene, with one entry per variant.
    pub scenes: &'a [(String, Vec<Entry>)],
    pub references: &'a Path,
    /// One sentence for each scene that is missing.
    pub missing: &'a [String],
    /// Vulkan device and the number of host threads.
    pub machine: String,
    /// The command that the user typed.
    pub command: String,
    pub seconds: f64,
    pub repetitions: u32,
}

/// File for a variant's image of the first repetition.
pub fn image_path(out: &Path, scene: &str, variant: &str) -> PathBuf {
    // Names cannot contain an @. With a - instead, scene `a-b` with variant `c` and scene `a` with `b-c` would share a file.
    out.join("images").join(format!("{}@{}.exr", plain(scene), plain(variant)))
}

/// The name with spaces replaced, for files and links.
fn plain(name: &str) -> String {
    name.replace(' ', "-")
}

/// Writes `report.md` and its pictures into `out`, and `growth.csv` if the suite has sweeps. Returns the path of the page.
pub fn write(out: &Path, page: &Page) -> Result<PathBuf> {
    let mut text = header(page) + &against_the_paper(page);
    for (scene, entries) in page.scenes {
        let summaries = summary::summarise(page.rows, scene);
        if summaries.is_empty() {
            continue;
        }
        let _ = writeln!(text, "\n## {scene}\n");
        let _ = writeln!(text, "{}\n", image_and_gate(&entries[0]));
        if let Some(paper) = paper_results(page, scene) {
            let _ = writeln!(text, "The paper reports: {paper}.\n");
        }
        text += &convergence(out, page, scene, &summaries)?;
        if !page.suite.errors {
            text += &costs(&summaries);
            continue;
        }
        text += &crops(out, page, scene, entries)?;
        text += &table(&summaries);
        text += &reference_errors(page, entries, &summaries)?;
    }
    let growths = growth::growth(page.suite, page.rows);
    if !growths.is_empty() {
        growth::write(&out.join("growth.csv"), &growths)?;
        text += &growth::section(&growths);
    }
    let path = out.join("report.md");
    write_atomically(&path, |file| std::io::Write::write_all(file, text.as_bytes()))?;
    Ok(path)
}

fn header(page: &Page) -> String {
    let Page { suite, seconds, repetitions, command, machine, .. } = page;
    let mut text = format!("# {}\n\n", suite.name);
    if !suite.about.is_empty() {
        let _ = writeln!(text, "{}\n", suite.about.trim());
    }
    let _ = writeln!(
        text,
        "`{command}`, {}, on {machine}.\n\n\
         In each of {repetitions} repetitions every variant rendered for {seconds} s, in turns with the others. Time is the wall time of \
         iterations: it includes the building of the light trees, but not loading, the BVH and the compilation of kernels. Numbers are \
         medians over the repetitions, with minimum and maximum in brackets.",
        version()
    );
    if suite.errors {
        let _ = writeln!(
            text,
            "relMSE: {RELMSE_FORMULA}. Trimmed relMSE leaves out the worst {:.0} % of the pixels of each image, where a few rare \
             bright samples (in the image or in its reference) dominate. Trimmed relMSE does not show such samples. \
             \"≤\" and \"≥\": the error of the reference is not {MARGIN} times smaller than all errors of the variant, and is part of \
             them. \"Reference too noisy\": it is too large, or not {MARGIN_OF_BOUNDS} times smaller, so the page leaves the number \
             out. FLIP: mean of HDR-FLIP. \"Times lower\": relMSE of the better of bdpt \
             and pt divided by relMSE of the variant, in the same repetition. This ratio is left out if both errors are above 1, \
             which is about the relMSE of a black image. Slope: exponent of relMSE (of trimmed relMSE if \
             relMSE is left out) as a power of time; -1 if errors are independent noise.",
            100.0 * TRIMMED
        );
    }
    let _ = writeln!(
        text,
        "Light vertices: number per iteration. Queries: connections tried at shade points. Dead: share of the queries that find no \
         light vertex which passes the tests of gate, maximum depth and facing. Dropped: number of samples that were not finite, as \
         the sum over the repetitions."
    );
    for sentence in page.missing {
        let _ = writeln!(text, "\n{sentence}.");
    }
    text
}

fn image_and_gate(entry: &Entry) -> String {
    let [width, height] = entry.settings.resolution();
    format!("{width} x {height} pixels, {}.", entry.settings.responses().describe())
}

/// The results that the paper reports for a scene, if the suite names any.
fn paper_results<'a>(page: &Page<'a>, scene: &str) -> Option<&'a str> {
    let entry = page.suite.scenes.iter().find(|entry| entry.name == *scene)?;
    Some(entry.paper.as_str()).filter(|paper| !paper.is_empty())
}

/// A table of ratios beside those that the paper reports, for the variants with light-cone queries. Empty if the paper reports none
/// for the scenes of the suite.
fn against_the_paper(page: &Page) -> String {
    let mut text = String::new();
    for (scene, _) in page.scenes {
        let Some(paper) = paper_results(page, scene) else { continue };
        let has_trees = |summary: &&VariantSummary| {
            let named = |row: &&Row| row.scene == *scene && row.variant == summary.variant;
            let estimator = page.rows.iter().find(named).map(|row| row.estimator.parse::<Estimator>());
            estimator.is_some_and(|estimator| estimator.is_ok_and(Estimator::has_trees))
        };
        for summary in summary::summarise(page.rows, scene).iter().filter(has_trees) {
            let [all, trimmed] = [&summary.all, &summary.trimmed].map(ratio);
            let _ = writeln!(text, "| {scene} | {} | {all} | {trimmed} | {paper} |", summary.variant);
        }
    }
    if text.is_empty() {
        return text;
    }
    String::from(
        "\n## Comparison with the paper\n\nThe paper measured over all pixels, with its own machine, gates and references. \"-\": the \
         reference is too noisy, the suite has no baseline (bdpt or pt), or variant and baseline are both worse than a \
         black image.\n\n\
         | scene | variant | relMSE, times lower | trimmed relMSE, times lower | the paper reports |\n\
         |---|---|---|---|---|\n",
    ) + &text
}

/// Writes the plot of relMSE over all pixels. If one is not fully trusted, the plot shows trimmed relMSE instead, for the variants
/// whose trimmed relMSE is at least a bound. Returns the link to the plot.
fn convergence(out: &Path, page: &Page, scene: &str, summaries: &[VariantSummary]) -> Result<String> {
    let rows: Vec<&Row> = page.rows.iter().filter(|row| row.scene == *scene).collect();
    let over_all = summaries.iter().all(|summary| summary.all.trust == Trust::Full);
    let shown = summaries.iter().filter(|summary| over_all || summary.trimmed.trust > Trust::Nothing);
    let part = if over_all { summary::all } else { summary::trimmed };
    let curves: Vec<_> = shown.map(|s| (s.variant.clone(), summary::curve(&rows, &s.variant, part))).collect();
    let measure = if over_all { "relMSE" } else { "trimmed relMSE" };
    let Some(svg) = plot::convergence(scene, measure, &curves)? else { return Ok(String::new()) };
    let name = format!("{}.svg", plain(scene));
    write_atomically(&out.join(&name), |file| std::io::Write::write_all(file, svg.as_bytes()))?;
    Ok(format!("![{measure} against time]({name})\n\n"))
}

/// Writes the strip of crops, with and without labels. Returns the link to it, or nothing if the reference or all images are missing.
fn crops(out: &Path, page: &Page, scene: &str, entries: &[Entry]) -> Result<String> {
    let Some(Reference { picture, .. }) = reference::read(page.references, &entries[0])? else {
        return Ok(String::new());
    };
    let mut shown: Vec<(&str, Picture)> = vec![];
    for entry in entries {
        let path = image_path(out, scene, &entry.variant);
        if path.exists() {
            let image = read_picture(&path)?;
            if (image.width, image.height) == (picture.width, picture.height) {
                shown.push((&entry.variant, image));
            }
        }
    }
    let (names, images): (Vec<&str>, Vec<Picture>) = shown.into_iter().unzip();
    if images.is_empty() {
        return Ok(String::new());
    }
    let name = plain(scene);
    let picture_path = out.join(format!("{name}.png"));
    let (png, svg) = strip::files(&strip(&picture, &images), &names)
        .map_err(|e| Error::File { path: picture_path.clone(), message: format!("cannot be written: {e}") })?;
    write_atomically(&picture_path, |file| std::io::Write::write_all(file, &png))?;
    let labelled = format!("{name}-crops.svg");
    write_atomically(&out.join(&labelled), |file| std::io::Write::write_all(file, svg.as_bytes()))?;
    Ok(format!("![crops]({labelled})\n\n"))
}

/// The errors of the references themselves, one paragraph per reference.
fn reference_errors(page: &Page, entries: &[Entry], summaries: &[VariantSummary]) -> Result<String> {
    let mut text = String::new();
    for (at, entry) in entries.iter().enumerate() {
        if entries[..at].iter().any(|previous| previous.reference == entry.reference) {
            continue;
        }
        let Some(Reference { own, picture, .. }) = reference::read(page.references, entry)? else { continue };
        let shares = |summary: &&VariantSummary| {
            entries.iter().any(|e| e.variant == summary.variant && e.reference == entry.reference)
        };
        let min = |summary: &VariantSummary| Means { all: summary.all.relmse.min, trimmed: summary.trimmed.relmse.min };
        let (names, errors): (Vec<&str>, Vec<Means>) =
            summaries.iter().filter(shares).map(|summary| (summary.variant.as_str(), min(summary))).unzip();
        let whose = if names.len() == summaries.len() { String::new() } else { format!(" for {}", names.join(", ")) };
        let taken = picture.seconds.map_or(String::new(), |seconds| format!(" after {seconds:.0} s of rendering"));
        let best = errors.into_iter().fold(Means::INFINITE, Means::min);
        let _ = writeln!(
            text,
            "\nThe reference{whose} itself has a relMSE of {:.2e}{taken}, estimated from independent halves: {:.0} times lower than the \
             best result. Its trimmed relMSE is {:.2e}, {:.0} times lower. Every relMSE above includes the error of the reference.",
            own.all,
            best.all / own.all,
            own.trimmed,
            best.trimmed / own.trimmed
        );
    }
    Ok(text)
}

/// The table of a scene as Markdown.
fn table(summaries: &[VariantSummary]) -> String {
    let mut text = String::from(
        "| variant | seconds | samples | relMSE | times lower | trimmed relMSE | times lower | FLIP | slope | light vertices | queries/s | rays/s | dead | dropped |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for summary in summaries {
        let [(error, factor), (trimmed, trimmed_factor)] =
            [&summary.all, &summary.trimmed].map(|error| (relmse(error), ratio(error)));
        let slope = summary.slope.map_or("-".into(), |slope| format!("{slope:.2}"));
        let _ = writeln!(
            text,
            "| {} | {:.1} | {:.0} | {error} | {factor} | {trimmed} | {trimmed_factor} | {} | {slope} | {:.0} | {:.2} M | {:.2} M | {:.1} % | {} |",
            summary.variant,
            summary.seconds,
            summary.samples,
            spread(&summary.flip, &|x| format!("{x:.4}")),
            summary.light_vertices,
            summary.queries_per_s / 1e6,
            summary.rays_per_s / 1e6,
            100.0 * summary.dead_query_share,
            summary.dropped,
        );
    }
    text
}

fn relmse(error: &ErrorSummary) -> String {
    let shown = spread(&error.relmse, &|x| format!("{x:.3e}"));
    match error.trust {
        Trust::Full => shown,
        Trust::Bound => format!("≤ {shown}"),
        Trust::Nothing => "reference too noisy".into(),
    }
}

fn ratio(error: &ErrorSummary) -> String {
    let sign = if error.ratio_is_bound { "≥ " } else { "" };
    error.ratio.map_or("-".into(), |ratio| format!("{sign}{}", spread(&ratio, &|x| format!("{x:.2}"))))
}

/// The table of a scene, as Markdown, if only costs were measured.
fn costs(summaries: &[VariantSummary]) -> String {
    let mut text = String::from(
        "| variant | seconds | samples | us per pixel sample | light vertices | queries/s | rays/s | dead | dropped |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for summary in summaries {
        let _ = writeln!(
            text,
            "| {} | {:.1} | {:.0} | {} | {:.0} | {:.2} M | {:.2} M | {:.1} % | {} |",
            summary.variant,
            summary.seconds,
            summary.samples,
            spread(&summary.us_per_sample, &|x| format!("{x:.3}")),
            summary.light_vertices,
            summary.queries_per_s / 1e6,
            summary.rays_per_s / 1e6,
            100.0 * summary.dead_query_share,
            summary.dropped,
        );
    }
    text
}

/// `median (min to max)`
pub fn spread(spread: &Spread, show: &dyn Fn(f64) -> String) -> String {
    format!("{} ({} to {})", show(spread.median), show(spread.min), show(spread.max))
}

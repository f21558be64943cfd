//! One page that shows a suite's results side by side, with a plot and a strip of crops for every scene.

use std::fmt::Write;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use super::growth;
use super::job::Entry;
use super::plot;
use super::quality::MARGIN;
use super::reference::{self, Reference};
use super::strip::strip;
use super::suite::Suite;
use super::summary::{self, ErrorSummary, Spread, VariantSummary};
use super::table::Row;
use crate::compare::metrics::{Means, RELMSE_FORMULA, TRIMMED};
use crate::error::{Error, Result};
use crate::files::write_atomically;
use crate::image::exr_file::{Picture, read_picture, version};

/// What a page is made of.
pub struct Page<'a> {
    pub suite: &'a Suite,
    pub rows: &'a [Row],
    /// Scenes with what was rendered in them.
    pub scenes: &'a [(String, Vec<Entry>)],
    pub references: &'a Path,
    /// One sentence each about what is missing.
    pub missing: &'a [String],
    /// Vulkan device and the number of host threads.
    pub machine: String,
    /// What was typed.
    pub command: String,
    pub seconds: f64,
    pub repetitions: u32,
}

/// The file that keeps the first repetition's image of a variant.
pub fn image_path(out: &Path, scene: &str, variant: &str) -> PathBuf {
    // No name has an @: without one `a-b` of `c` and `a` of `b-c` would be one file.
    out.join("images").join(format!("{}@{}.exr", plain(scene), plain(variant)))
}

/// Names without spaces, for files and links.
fn plain(name: &str) -> String {
    name.replace(' ', "-")
}

/// Writes `report.md` and its pictures into `out`; returns the page's path.
pub fn write(out: &Path, page: &Page) -> Result<PathBuf> {
    let mut text = header(page) + &against_the_paper(page);
    for (scene, entries) in page.scenes {
        let lines = summary::lines(page.rows, scene);
        if lines.is_empty() {
            continue;
        }
        let _ = writeln!(text, "\n## {scene}\n");
        let _ = writeln!(text, "{}\n", what(&entries[0]));
        if let Some(paper) = reported(page, scene) {
            let _ = writeln!(text, "The paper reports: {paper}.\n");
        }
        text += &convergence(out, page, scene, &lines)?;
        if !page.suite.errors {
            text += &costs(&lines);
            continue;
        }
        text += &crops(out, page, scene, entries)?;
        text += &table(&lines);
        text += &truth(page, entries, &lines)?;
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
         Every variant rendered for {seconds} s in each of {repetitions} repetitions, in turns with the others; time is the wall time of \
         iterations, tree building included, loading, BVH and kernel compilation excluded. Numbers are medians over the \
         repetitions with the least and greatest in brackets.",
        version()
    );
    if suite.errors {
        let _ = writeln!(
            text,
            "relMSE: {RELMSE_FORMULA}. Trimmed: the same without the {:.0} % of the pixels that are worst in each image, which a few rare \
             bright samples (in the image or in its reference) rule; it says nothing of those, and little above 1, which is that of black. Where the error of the reference is not \
             {MARGIN} times below all that was measured of a variant, the figure is left out: \"reference too poor\". FLIP: mean of \
             HDR-FLIP. \"Lower by\": how many times lower relMSE is than that of the better of bdpt and pt in the same repetition. \
             Slope: of relMSE against time (of the trimmed one where that is all there is), in logarithms; -1 where errors are \
             independent noise.",
            100.0 * TRIMMED
        );
    }
    let _ = writeln!(text, "Dead: queries that found nothing inside gate, depth and facing.");
    for sentence in page.missing {
        let _ = writeln!(text, "\n{sentence}.");
    }
    text
}

fn what(entry: &Entry) -> String {
    let [width, height] = entry.settings.resolution();
    format!("{width} x {height} pixels, {}.", entry.settings.responses().describe())
}

/// What the paper says of a scene.
fn reported<'a>(page: &Page<'a>, scene: &str) -> Option<&'a str> {
    let entry = page.suite.scenes.iter().find(|entry| entry.name == *scene)?;
    Some(entry.paper.as_str()).filter(|paper| !paper.is_empty())
}

/// Ratios beside what the paper reports, for the scenes of which it does; nothing without any.
fn against_the_paper(page: &Page) -> String {
    let mut text = String::new();
    for (scene, _) in page.scenes {
        let Some(paper) = reported(page, scene) else { continue };
        let is_baseline = |line: &&VariantSummary| {
            let named = |row: &&Row| row.scene == *scene && row.variant == line.variant;
            page.rows.iter().find(named).is_some_and(|row| summary::is_baseline(&row.estimator))
        };
        for line in summary::lines(page.rows, scene).iter().filter(|line| !is_baseline(line)) {
            let [all, trimmed] = [&line.all, &line.trimmed].map(ratio);
            let _ = writeln!(text, "| {scene} | {} | {all} | {trimmed} | {paper} |", line.variant);
        }
    }
    if text.is_empty() {
        return text;
    }
    String::from(
        "\n## Against the paper\n\nThe paper's figures are for its own machine, gates and references, over all pixels; \"-\" where a \
         reference is too poor.\n\n| scene | variant | relMSE lower by | trimmed lower by | the paper reports |\n|---|---|---|---|---|\n",
    ) + &text
}

/// The plot, of relMSE over all pixels if the reference is good enough for it; else of the trimmed one, where it is for that.
fn convergence(out: &Path, page: &Page, scene: &str, lines: &[VariantSummary]) -> Result<String> {
    let rows: Vec<&Row> = page.rows.iter().filter(|row| row.scene == *scene).collect();
    let over_all = lines.iter().all(|line| line.all.reliable);
    let shown = lines.iter().filter(|line| over_all || line.trimmed.reliable);
    let part = if over_all { summary::all } else { summary::trimmed };
    let curves: Vec<_> = shown.map(|l| (l.variant.clone(), summary::curve(&rows, &l.variant, part))).collect();
    let figure = if over_all { "relMSE" } else { "trimmed relMSE" };
    let Some(svg) = plot::convergence(scene, figure, &curves)? else { return Ok(String::new()) };
    let name = format!("{}.svg", plain(scene));
    write_atomically(&out.join(&name), |file| std::io::Write::write_all(file, svg.as_bytes()))?;
    Ok(format!("![{figure} against time]({name})\n\n"))
}

/// The strip of crops and what is in it; nothing where images are missing.
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
    let name = format!("{}.png", plain(scene));
    let mut bytes = Cursor::new(vec![]);
    strip(&picture, &images)
        .write_to(&mut bytes, image::ImageFormat::Png)
        .map_err(|e| Error::File { path: out.join(&name), message: format!("cannot be written: {e}") })?;
    write_atomically(&out.join(&name), |file| std::io::Write::write_all(file, bytes.get_ref()))?;
    Ok(format!(
        "![crops]({name})\n\nFrom left to right: reference, {}. Below: how FLIP sees the error, black for none.\n\n",
        names.join(", ")
    ))
}

/// How good the references are, one sentence each.
fn truth(page: &Page, entries: &[Entry], lines: &[VariantSummary]) -> Result<String> {
    let mut text = String::new();
    for (at, entry) in entries.iter().enumerate() {
        if entries[..at].iter().any(|previous| previous.reference == entry.reference) {
            continue;
        }
        let Some(Reference { own, picture, .. }) = reference::read(page.references, entry)? else { continue };
        let shares = |line: &&VariantSummary| {
            entries.iter().any(|e| e.variant == line.variant && e.reference == entry.reference)
        };
        let min = |line: &VariantSummary| Means { all: line.all.relmse.min, trimmed: line.trimmed.relmse.min };
        let (names, errors): (Vec<&str>, Vec<Means>) =
            lines.iter().filter(shares).map(|line| (line.variant.as_str(), min(line))).unzip();
        let whose = if names.len() == lines.len() { String::new() } else { format!(" of {}", names.join(", ")) };
        let taken = picture.seconds.map_or(String::new(), |seconds| format!(" after {seconds:.0} s of rendering"));
        let best = errors.into_iter().fold(Means::INFINITE, Means::min);
        let _ = writeln!(
            text,
            "\nThe reference{whose} has a relMSE of its own of {:.2e}{taken}, estimated from independent halves: {:.0} times below the \
             best result; trimmed {:.2e}, {:.0} times. It is part of every relMSE above.",
            own.all,
            best.all / own.all,
            own.trimmed,
            best.trimmed / own.trimmed
        );
    }
    Ok(text)
}

/// The table of a scene as Markdown.
fn table(lines: &[VariantSummary]) -> String {
    let mut text = String::from(
        "| variant | seconds | samples | relMSE | lower by | trimmed relMSE | lower by | FLIP | slope | light vertices | queries/s | rays/s | dead | dropped |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for line in lines {
        let [(error, factor), (trimmed, trimmed_factor)] = [&line.all, &line.trimmed].map(|f| (relmse(f), ratio(f)));
        let slope = line.slope.map_or("-".into(), |slope| format!("{slope:.2}"));
        let _ = writeln!(
            text,
            "| {} | {:.1} | {:.0} | {error} | {factor} | {trimmed} | {trimmed_factor} | {} | {slope} | {:.0} | {:.2} M | {:.2} M | {:.1} % | {} |",
            line.variant,
            line.seconds,
            line.samples,
            spread(&line.flip, &|x| format!("{x:.4}")),
            line.light_vertices,
            line.queries_per_s / 1e6,
            line.rays_per_s / 1e6,
            100.0 * line.dead_query_share,
            line.dropped,
        );
    }
    text
}

fn relmse(figure: &ErrorSummary) -> String {
    match figure.reliable {
        true => spread(&figure.relmse, &|x| format!("{x:.3e}")),
        false => "reference too poor".into(),
    }
}

fn ratio(figure: &ErrorSummary) -> String {
    figure.ratio.map_or("-".into(), |ratio| spread(&ratio, &|x| format!("{x:.2}")))
}

/// The table of a scene where only costs were measured.
fn costs(lines: &[VariantSummary]) -> String {
    let mut text = String::from(
        "| variant | seconds | samples | us a sample of a pixel | light vertices | queries/s | rays/s | dead | dropped |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for line in lines {
        let _ = writeln!(
            text,
            "| {} | {:.1} | {:.0} | {} | {:.0} | {:.2} M | {:.2} M | {:.1} % | {} |",
            line.variant,
            line.seconds,
            line.samples,
            spread(&line.us_per_sample, &|x| format!("{x:.3}")),
            line.light_vertices,
            line.queries_per_s / 1e6,
            line.rays_per_s / 1e6,
            100.0 * line.dead_query_share,
            line.dropped,
        );
    }
    text
}

/// `median (min to max)`
pub fn spread(spread: &Spread, show: &dyn Fn(f64) -> String) -> String {
    format!("{} ({} to {})", show(spread.median), show(spread.min), show(spread.max))
}

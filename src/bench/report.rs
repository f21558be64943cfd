//! One page that shows a suite's results side by side, with a plot and a strip of crops for every scene.

use std::fmt::Write;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use super::growth;
use super::job::Entry;
use super::plot;
use super::reference::{self, Reference};
use super::strip::strip;
use super::suite::Suite;
use super::summary::{self, Line, Spread};
use super::table::Row;
use crate::error::{Error, Result};
use crate::exr_file::{Picture, read_picture, version};
use crate::files::write_atomically;
use crate::metrics::RELMSE_FORMULA;

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
    out.join("images").join(format!("{}-{}.exr", plain(scene), plain(variant)))
}

/// Names without spaces, for files and links.
fn plain(name: &str) -> String {
    name.replace(' ', "-")
}

/// Writes `report.md` and its pictures into `out`; returns the page's path.
pub fn write(out: &Path, page: &Page) -> Result<PathBuf> {
    let mut text = header(page);
    for (scene, entries) in page.scenes {
        let lines = summary::lines(page.rows, scene);
        if lines.is_empty() {
            continue;
        }
        let _ = writeln!(text, "\n## {scene}\n");
        let _ = writeln!(text, "{}\n", what(&entries[0]));
        let rows: Vec<&Row> = page.rows.iter().filter(|row| row.scene == *scene).collect();
        let curves: Vec<_> = lines.iter().map(|l| (l.variant.clone(), summary::curve(&rows, &l.variant))).collect();
        if let Some(svg) = plot::convergence(scene, &curves)? {
            let name = format!("{}.svg", plain(scene));
            write_atomically(&out.join(&name), |file| std::io::Write::write_all(file, svg.as_bytes()))?;
            let _ = writeln!(text, "![relMSE against time]({name})\n");
        }
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
            "relMSE: {RELMSE_FORMULA}. FLIP: mean of HDR-FLIP. \"Lower by\": how many times lower relMSE is than that of the better \
             of bdpt and pt in the same repetition. Slope: of relMSE against time, in logarithms; -1 where errors are \
             independent noise."
        );
    }
    let _ = writeln!(text, "Dead: queries that found nothing inside gate, depth and facing.");
    for sentence in page.missing {
        let _ = writeln!(text, "\n{sentence}.");
    }
    text
}

fn what(entry: &Entry) -> String {
    let [width, height] = entry.settings.resolution;
    format!("{width} x {height} pixels, {}.", entry.settings.gate.describe())
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
fn truth(page: &Page, entries: &[Entry], lines: &[Line]) -> Result<String> {
    let mut text = String::new();
    for (at, entry) in entries.iter().enumerate() {
        if entries[..at].iter().any(|earlier| earlier.reference == entry.reference) {
            continue;
        }
        let Some(Reference { own, picture }) = reference::read(page.references, entry)? else { continue };
        let shares = |line: &&Line| entries.iter().any(|e| e.variant == line.variant && e.reference == entry.reference);
        let (names, errors): (Vec<&str>, Vec<f64>) =
            lines.iter().filter(shares).map(|line| (line.variant.as_str(), line.relmse.least)).unzip();
        let whose = if names.len() == lines.len() { String::new() } else { format!(" of {}", names.join(", ")) };
        let taken = picture.seconds.map_or(String::new(), |seconds| format!(" after {seconds:.0} s of rendering"));
        let best = errors.into_iter().fold(f64::INFINITY, f64::min);
        let _ = writeln!(
            text,
            "\nThe reference{whose} has a relMSE of its own of {own:.2e}{taken}, estimated from independent halves: {:.0} times below the \
             best result. It is part of every relMSE above.",
            best / own
        );
    }
    Ok(text)
}

/// The table of a scene as Markdown.
fn table(lines: &[Line]) -> String {
    let mut text = String::from(
        "| variant | seconds | samples | relMSE | FLIP | lower by | slope | light vertices | queries/s | rays/s | dead | dropped |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for line in lines {
        let ratio = line.ratio.map_or("-".into(), |ratio| spread(&ratio, &|x| format!("{x:.2}")));
        let slope = line.slope.map_or("-".into(), |slope| format!("{slope:.2}"));
        let _ = writeln!(
            text,
            "| {} | {:.1} | {:.0} | {} | {} | {ratio} | {slope} | {:.0} | {:.2} M | {:.2} M | {:.1} % | {} |",
            line.variant,
            line.seconds,
            line.samples,
            spread(&line.relmse, &|x| format!("{x:.3e}")),
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

/// The table of a scene where only costs were measured.
fn costs(lines: &[Line]) -> String {
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

/// `median (least to most)`
pub fn spread(spread: &Spread, show: &dyn Fn(f64) -> String) -> String {
    format!("{} ({} to {})", show(spread.median), show(spread.least), show(spread.most))
}

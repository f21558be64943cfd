//! The measurements as CSV, with one row per scene, variant, repetition and time point.

use std::io::Write;
use std::path::Path;

use crate::compare::metrics::Means;
use crate::error::{Error, Result};
use crate::files::{read_error, write_atomically};

/// The columns in their order.
///
/// * `seconds`: rendering time, with the building of light trees.
/// * `trimmed_relmse`: relMSE without the worst pixels ([`crate::compare::metrics::TRIMMED`]).
/// * `reference_...`: relMSE of the reference itself, estimated from its halves.
/// * `dropped`: non-finite samples.
/// * `light_vertices`: light vertices that are kept per iteration.
/// * `queries_per_s`: queries of the shade points, per second of rendering.
/// * `dead_query_share`: fraction of the queries that find no light vertex which meets the gate, the maximum depth and the facing.
/// * `triangles`: triangles of all instances.
/// * `gate_m`: width of the gate in metres, `inf` without a gate.
/// * `optical_thickness`: along the scene's diagonal, averaged over the channels. Media inside of meshes do not count.
/// * `us_per_sample`: microseconds per pixel sample.
/// * `fingerprint`: hash of scene, settings and renderer, the time, and a hash of the device.
///
/// relMSE and FLIP are NaN if only costs are measured.
pub const COLUMNS: [&str; 23] = [
    "scene",
    "variant",
    "estimator",
    "repetition",
    "point",
    "seconds",
    "samples",
    "relmse",
    "trimmed_relmse",
    "reference_relmse",
    "reference_trimmed_relmse",
    "flip",
    "dropped",
    "light_vertices",
    "queries_per_s",
    "rays_per_s",
    "dead_query_share",
    "triangles",
    "pixels",
    "gate_m",
    "optical_thickness",
    "us_per_sample",
    "fingerprint",
];

/// One measurement; see [`COLUMNS`].
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    pub scene: String,
    pub variant: String,
    pub estimator: String,
    /// From 0.
    pub repetition: u32,
    /// Index of the time in [`super::race::points`] that was reached, from 0.
    pub point: u32,
    pub seconds: f64,
    /// Samples per pixel.
    pub samples: u64,
    pub relmse: Means,
    /// relMSE of the reference itself.
    pub own: Means,
    pub flip: f64,
    pub dropped: u64,
    pub light_vertices: f64,
    pub queries_per_s: f64,
    pub rays_per_s: f64,
    pub dead_query_share: f64,
    /// Triangles of all instances.
    pub triangles: u64,
    pub pixels: u64,
    pub gate_m: f64,
    pub optical_thickness: f64,
    pub us_per_sample: f64,
    /// Hash of scene, settings and renderer, the time, and a hash of the device.
    pub fingerprint: String,
}

impl Row {
    fn to_line(&self) -> String {
        let Row { scene, variant, estimator, repetition, point, seconds, samples, flip, dropped, .. } = self;
        let [Means { all, trimmed }, Means { all: own, trimmed: own_trimmed }] = [self.relmse, self.own];
        let Row { light_vertices, queries_per_s, rays_per_s, dead_query_share, fingerprint, .. } = self;
        let Row { triangles, pixels, gate_m, optical_thickness, us_per_sample, .. } = self;
        format!(
            "{scene},{variant},{estimator},{repetition},{point},{seconds:.4},{samples},{all:e},{trimmed:e},{own:e},{own_trimmed:e},{flip:.6},{dropped},\
             {light_vertices:.1},{queries_per_s:.0},{rays_per_s:.0},{dead_query_share:.4},\
             {triangles},{pixels},{gate_m},{optical_thickness},{us_per_sample:.4},{fingerprint}\n"
        )
    }

    fn from_line(line: &str) -> Option<Row> {
        let fields: Vec<&str> = line.split(',').collect();
        let [scene, variant, estimator, repetition, point, seconds, samples, rest @ ..] = &fields[..] else {
            return None;
        };
        let [all, trimmed, own, own_trimmed, flip, dropped, rest @ ..] = rest else { return None };
        let means = |all: &str, trimmed: &str| Some(Means { all: all.parse().ok()?, trimmed: trimmed.parse().ok()? });
        let [light_vertices, queries_per_s, rays_per_s, dead_query_share, rest @ ..] = rest else { return None };
        let [triangles, pixels, gate_m, optical_thickness, us_per_sample, fingerprint] = rest else { return None };
        Some(Row {
            scene: scene.to_string(),
            variant: variant.to_string(),
            estimator: estimator.to_string(),
            repetition: repetition.parse().ok()?,
            point: point.parse().ok()?,
            seconds: seconds.parse().ok()?,
            samples: samples.parse().ok()?,
            relmse: means(all, trimmed)?,
            own: means(own, own_trimmed)?,
            flip: flip.parse().ok()?,
            dropped: dropped.parse().ok()?,
            light_vertices: light_vertices.parse().ok()?,
            queries_per_s: queries_per_s.parse().ok()?,
            rays_per_s: rays_per_s.parse().ok()?,
            dead_query_share: dead_query_share.parse().ok()?,
            triangles: triangles.parse().ok()?,
            pixels: pixels.parse().ok()?,
            gate_m: gate_m.parse().ok()?,
            optical_thickness: optical_thickness.parse().ok()?,
            us_per_sample: us_per_sample.parse().ok()?,
            fingerprint: fingerprint.to_string(),
        })
    }
}

/// Writes all rows. After an error the old file is unchanged.
pub fn write(path: &Path, rows: &[Row]) -> Result<()> {
    write_atomically(path, |out| {
        writeln!(out, "{}", COLUMNS.join(","))?;
        rows.iter().try_for_each(|row| out.write_all(row.to_line().as_bytes()))
    })
}

/// Reads a file that [`write`] wrote. Errors name the line.
pub fn read(path: &Path) -> Result<Vec<Row>> {
    let text = std::fs::read_to_string(path).map_err(|e| read_error(path, e))?;
    let mut lines = text.lines().enumerate();
    let wrong = |line: usize, what: &str| Error::File {
        path: path.into(),
        message: format!("line {}: {what}; choose another --out, or move the file away", line + 1),
    };
    if lines.next().map(|(_, header)| header) != Some(COLUMNS.join(",").as_str()) {
        return Err(wrong(0, "these are not the columns of a bench"));
    }
    lines.map(|(at, line)| Row::from_line(line).ok_or_else(|| wrong(at, "this is not a row of a bench"))).collect()
}

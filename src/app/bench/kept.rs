//! The rows of an earlier run that `taugate bench --resume` keeps.

use std::path::PathBuf;

#[cfg(doc)]
use taugate::internals::bench::case::Entry;
use taugate::internals::bench::table::{self, Row};
use taugate::internals::gpu::{Device, DeviceInfo};
use taugate::internals::image::fingerprint::Hash;
use taugate::{Error, Result};

use super::Bench;
use crate::app::progress::Progress;

impl Bench {
    /// Rows of an earlier run that are still valid: their settings, time, renderer and device are the same. Keeps all rows of scenes that
    /// this run leaves out.
    pub fn kept(&self, resume: bool, device: &Device, progress: &Progress) -> Result<Vec<Row>> {
        let path = self.results();
        if !path.exists() {
            return Ok(vec![]);
        }
        if !resume {
            let message = "has the results of an earlier run; add --resume to continue, or choose another --out".into();
            return Err(Error::File { path, message });
        }
        let mut rows = table::read(&path)?;
        let known = |row: &Row| {
            let present = self.present.iter().find(|(at, _)| self.scene(*at).name == row.scene);
            present.is_none_or(|(_, entries)| {
                entries
                    .iter()
                    .any(|e| e.variant == row.variant && self.fingerprint(&e.fingerprint, device) == row.fingerprint)
            })
        };
        let all = rows.len();
        rows.retain(known);
        if rows.len() < all {
            let old = unused(|n| path.with_file_name(format!("results.old{n}.csv")));
            std::fs::copy(&path, &old).map_err(|e| Error::File { path: old.clone(), message: e.to_string() })?;
            progress.line(&format!(
                "note: {} of {all} rows of {} are by another version of the renderer, on another device, or for other settings or times, and \
                 are ignored; {} keeps them",
                all - rows.len(),
                path.display(),
                old.display()
            ));
        }
        Ok(rows)
    }

    /// The fingerprint of a row from that of its [`Entry`]. It identifies the scene, the settings, the renderer, the time per render, and
    /// the device with its driver.
    pub fn fingerprint(&self, of_entry: &str, device: &Device) -> String {
        let DeviceInfo { name, driver, .. } = device.info();
        let device = Hash::new().with(name.as_bytes()).with(driver.as_bytes()).digits();
        format!("{of_entry}-{}s-{device}", self.suite.seconds)
    }
}

/// The first path without a file among those with "", "2", "3" and so on in their names.
fn unused(path: impl Fn(&str) -> PathBuf) -> PathBuf {
    let mut paths = std::iter::once(path("")).chain((2..).map(|n: u32| path(&n.to_string())));
    paths.find(|path| !path.exists()).expect("there are many numbers")
}

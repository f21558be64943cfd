//! `--strategy-images`: the folder of images, one a strategy and weighting, written as a whole or not at all.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use taugate::Error;
use taugate::error::Result;
use taugate::exr_file::{self, Provenance};
use taugate::gpu::Device;
use taugate::render::{Prepared, StrategyImages};
use taugate::scene::Scene;
use taugate::settings::Settings;

use super::interrupts::{Interrupt, Interrupts};
use super::progress::Progress;

/// The render whose strategies are shown.
pub struct Job<'a> {
    pub device: &'a Device,
    pub scene: &'a Scene,
    pub settings: &'a Settings,
    /// Samples a pixel of each iteration.
    pub schedule: &'a [u32],
    pub interrupts: &'a Interrupts,
}

/// Fails unless the folder can be made anew: it does not exist and its parent can be written to, or holds strategy images
/// alone.
pub fn check_folder(folder: &Path) -> Result<()> {
    let fail = |message: String| Err(Error::File { path: folder.into(), message });
    match fs::read_dir(folder) {
        Ok(entries) => {
            let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
            if let Some(other) = names.into_iter().find(|name| !is_ours(name)) {
                return fail(format!("holds '{other}', which is no strategy image; choose another folder"));
            }
        }
        Err(e) if e.kind() == io::ErrorKind::NotFound => {}
        Err(_) => return fail("exists and is not a folder that can be read; choose another name".into()),
    }
    temporary_beside(folder).map(drop)
}

/// `s02_t03_weighted.exr`
fn name(s: u32, t: u32, weighting: &str) -> String {
    format!("s{s:02}_t{t:02}_{weighting}.exr")
}

fn is_ours(file: &str) -> bool {
    let parts: Vec<&str> = file.split('_').collect();
    let number = |text: &str, letter| text.strip_prefix(letter).is_some_and(|n| n.parse::<u8>().is_ok());
    matches!(parts[..], [s, t, "weighted.exr" | "unweighted.exr"] if number(s, 's') && number(t, 't'))
}

fn temporary_beside(folder: &Path) -> Result<tempfile::TempDir> {
    let parent = match folder.parent() {
        Some(parent) if parent != Path::new("") => parent.to_path_buf(),
        _ => PathBuf::from("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".taugate-").suffix(".tmp");
    #[cfg(unix)]
    {
        // The mode of any new folder, less the user's umask.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o777));
    }
    builder.tempdir_in(parent).map_err(|e| {
        let message = format!("cannot be written: {e}; choose a place that exists and is yours");
        Error::File { path: folder.into(), message }
    })
}

impl Job<'_> {
    /// Renders all strategies and writes them into `folder`; an interrupt leaves the folder as it was.
    pub fn write(&self, folder: &Path, provenance: &Provenance, progress: &Progress) -> Result<()> {
        let prepared = Prepared::new(self.scene, self.settings)?;
        let mut images = StrategyImages::new(self.device, self.scene, self.settings, &prepared)?;
        self.interrupts.end_the_process_at(Interrupt::Second);
        for &samples in self.schedule {
            if self.interrupts.stop.load(Ordering::Relaxed) {
                progress.line("interrupted: no strategy images were written");
                return Ok(());
            }
            images.iterate(samples)?;
        }

        self.interrupts.end_the_process_at(Interrupt::None);
        let fresh = temporary_beside(folder)?;
        for image in images.images() {
            for (film, weighting) in [(&image.weighted, "weighted"), (&image.unweighted, "unweighted")] {
                exr_file::write(&fresh.path().join(name(image.s, image.t, weighting)), film, provenance)?;
            }
        }
        put_in_place(fresh, folder).map_err(|e| {
            let message = format!("cannot be replaced: {e}; choose another folder");
            Error::File { path: folder.into(), message }
        })?;
        progress.line(&format!("{}: {} strategies, weighted and unweighted", folder.display(), images.images().len()));
        Ok(())
    }
}

/// Renames `fresh` to `folder`; what stood there is removed, or put back if that fails.
fn put_in_place(fresh: tempfile::TempDir, folder: &Path) -> io::Result<()> {
    let fresh = fresh.keep();
    let old = fresh.with_extension("old");
    let had_old = folder.exists();
    let moved = if had_old { fs::rename(folder, &old) } else { Ok(()) };
    let placed = moved.and_then(|()| fs::rename(&fresh, folder));
    match placed {
        Ok(()) if had_old => fs::remove_dir_all(&old),
        Ok(()) => Ok(()),
        Err(e) => {
            if had_old && old.exists() {
                fs::rename(&old, folder)?;
            }
            fs::remove_dir_all(&fresh)?;
            Err(e)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_folders_of_strategy_images_are_replaced() {
        let here = tempfile::tempdir().unwrap();
        let folder = here.path().join("pyramid");
        check_folder(&folder).unwrap();
        fs::create_dir(&folder).unwrap();
        fs::write(folder.join(name(2, 13, "weighted")), "old").unwrap();
        check_folder(&folder).unwrap();

        let fresh = temporary_beside(&folder).unwrap();
        fs::write(fresh.path().join(name(0, 2, "unweighted")), "new").unwrap();
        put_in_place(fresh, &folder).unwrap();
        let names = |path: &Path| -> Vec<_> { fs::read_dir(path).unwrap().map(|e| e.unwrap().file_name()).collect() };
        assert_eq!(names(&folder), ["s00_t02_unweighted.exr"]);
        assert_eq!(names(here.path()), ["pyramid"], "nothing is left behind");

        fs::write(folder.join("thesis.tex"), "years of work").unwrap();
        let message = check_folder(&folder).unwrap_err().to_string();
        assert!(message.contains("thesis.tex"), "{message}");
        assert!(check_folder(&folder.join("thesis.tex")).is_err());
        assert!(check_folder(&here.path().join("no/where")).is_err());
    }
}

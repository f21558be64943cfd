//! `--strategy-images`: a folder with one image per strategy and weighting. The folder is written completely or not at all.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use taugate::internals::files::{remove_left_over, temporary_folder};
use taugate::internals::gpu::Device;
use taugate::internals::image::exr_file::{self, Provenance};
use taugate::internals::render::schedule::lengths;
use taugate::internals::render::{PreparedScene, StrategyImages};
use taugate::internals::scene::Scene;
use taugate::internals::settings::Settings;
use taugate::internals::settings::shard::Shard;
use taugate::{Error, Result};

use super::interrupts::{Interrupt, Interrupts};
use super::progress::Progress;
use super::rescue::Rescue;

/// The render whose strategies are shown.
pub struct StrategyRender<'a> {
    pub device: &'a Device,
    pub scene: &'a Scene,
    pub settings: &'a Settings,
    /// Samples per pixel.
    pub samples: u64,
    pub interrupts: &'a Interrupts,
}

/// Checks that the program may create or replace the folder. The folder must either not exist or hold nothing but strategy
/// images, and its parent must be writable. Also removes temporary folders that killed
/// renders left beside the folder.
pub fn check_folder(folder: &Path) -> Result<()> {
    let fail = |message: String| Err(Error::File { path: folder.into(), message });
    match fs::read_dir(folder) {
        Ok(entries) => {
            for entry in entries {
                let Ok(entry) = entry else { return fail("cannot be read; choose another folder".into()) };
                let name = entry.file_name();
                let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
                if !is_file || !name.to_str().is_some_and(is_ours) {
                    let other = name.to_string_lossy();
                    return fail(format!("holds '{other}', which is not a strategy image; choose another folder"));
                }
            }
        }
        Err(e) if e.kind() == io::ErrorKind::NotFound && !folder.is_symlink() => {}
        Err(_) => return fail("exists and is not a folder that can be read; choose another name".into()),
    }
    let place = real_place(folder)?;
    remove_left_over(&place);
    temporary_beside(&place).map(drop)
}

/// Absolute path of the folder, which need not exist. If the current directory is inside the folder, a relative path would change
/// its meaning when the folder is renamed.
fn real_place(folder: &Path) -> Result<PathBuf> {
    let fail = |e: io::Error| {
        let message = format!("cannot be written: {e}; choose an existing place where you may write");
        Error::File { path: folder.into(), message }
    };
    if folder.exists() {
        return fs::canonicalize(folder).map_err(fail);
    }
    let Some(name) = folder.file_name() else {
        return Err(Error::File { path: folder.into(), message: "is not the name of a folder; choose another".into() });
    };
    let parent = folder.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."));
    Ok(fs::canonicalize(parent).map_err(fail)?.join(name))
}

/// Prints that an interrupt prevented the strategy images.
pub fn report_interrupted(progress: &Progress) {
    progress.line("interrupted: no strategy images were written");
}

/// `s02_t03_weighted.exr`, or `s02_t03_ellipsoidal_weighted.exr`
fn name(s: u32, t: u32, ellipsoidal: bool, weighting: &str) -> String {
    let kind = if ellipsoidal { "ellipsoidal_" } else { "" };
    format!("s{s:02}_t{t:02}_{kind}{weighting}.exr")
}

fn is_ours(file: &str) -> bool {
    let parts: Vec<&str> = file.split('_').collect();
    let number = |text: &str, letter| text.strip_prefix(letter).is_some_and(|n| n.parse::<u8>().is_ok());
    matches!(parts[..], [s, t, "weighted.exr" | "unweighted.exr"] | [s, t, "ellipsoidal", "weighted.exr" | "unweighted.exr"] if number(s, 's') && number(t, 't'))
}

/// Creates a temporary folder and its lock beside `folder`, so that a rename suffices later. `folder` comes from [`real_place`].
fn temporary_beside(folder: &Path) -> Result<(tempfile::TempDir, Option<fs::File>)> {
    temporary_folder(folder).map_err(|e| {
        let message = format!("cannot be written: {e}; choose an existing place where you may write");
        Error::File { path: folder.into(), message }
    })
}

impl StrategyRender<'_> {
    /// Renders all strategies and writes them into `folder`. After an interrupt the folder is unchanged.
    pub fn write(&self, folder: &Path, provenance: &Provenance, progress: &Progress) -> anyhow::Result<()> {
        let prepared = PreparedScene::new(self.scene, self.settings)?;
        let mut images = StrategyImages::new(self.device, self.scene, self.settings, &prepared)?;
        self.interrupts.end_the_process_at(Interrupt::Second);
        for samples in lengths(Shard::ALL, self.samples) {
            if self.interrupts.stop.load(Ordering::Relaxed) {
                report_interrupted(progress);
                return Ok(());
            }
            images.iterate(samples)?;
        }

        self.interrupts.end_the_process_at(Interrupt::None);
        let mut rescue = Rescue::default();
        rescue.write(folder, |folder| write_folder(folder, &images, provenance));
        rescue.finish()?;
        progress.line(&format!("{}: {} strategies, weighted and unweighted", folder.display(), images.images().len()));
        Ok(())
    }
}

/// Writes all images into `folder`, or nothing.
fn write_folder(folder: &Path, images: &StrategyImages, provenance: &Provenance) -> Result<()> {
    let place = real_place(folder)?;
    let (fresh, _lock) = temporary_beside(&place)?;
    for image in images.images() {
        for (film, weighting) in [(&image.weighted, "weighted"), (&image.unweighted, "unweighted")] {
            let name = name(image.s, image.t, image.ellipsoidal, weighting);
            exr_file::write(&fresh.path().join(name), film, provenance)?;
        }
    }
    put_in_place(fresh, &place).map_err(|e| {
        let message = format!("cannot be replaced: {e}; choose another folder");
        Error::File { path: folder.into(), message }
    })
}

/// Renames `fresh` to `folder`. An old folder of that name is removed, or restored if the rename fails.
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
        fs::write(folder.join(name(2, 13, false, "weighted")), "old").unwrap();
        check_folder(&folder).unwrap();

        let (fresh, _lock) = temporary_beside(&folder).unwrap();
        fs::write(fresh.path().join(name(0, 2, false, "unweighted")), "new").unwrap();
        put_in_place(fresh, &folder).unwrap();
        let names = |path: &Path| -> Vec<_> { fs::read_dir(path).unwrap().map(|e| e.unwrap().file_name()).collect() };
        assert_eq!(names(&folder), ["s00_t02_unweighted.exr"]);
        assert_eq!(names(here.path()), ["pyramid"], "nothing is left behind");

        let thesis = folder.join("thesis.tex");
        fs::write(&thesis, "years of work").unwrap();
        let message = check_folder(&folder).unwrap_err().to_string();
        assert!(message.contains("thesis.tex"), "{message}");
        assert!(check_folder(&thesis).is_err());
        fs::remove_file(&thesis).unwrap();
        fs::create_dir(folder.join(name(2, 3, true, "weighted"))).unwrap();
        assert!(check_folder(&folder).is_err(), "a folder with the name of an image");
        fs::remove_dir(folder.join(name(2, 3, true, "weighted"))).unwrap();
        #[cfg(target_os = "linux")]
        {
            use std::os::unix::ffi::OsStrExt;
            let thesis = folder.join(std::ffi::OsStr::from_bytes(b"th\xe9sis.tex"));
            fs::write(&thesis, "years of work").unwrap();
            assert!(check_folder(&folder).is_err(), "a name that is not UTF-8");
            fs::remove_file(&thesis).unwrap();
            std::os::unix::fs::symlink("nowhere", here.path().join("link")).unwrap();
            assert!(check_folder(&here.path().join("link")).is_err());
        }
        check_folder(&folder).unwrap();
        assert!(check_folder(&here.path().join("no/where")).is_err());
    }
}

//! Saves a finished result in another folder if it cannot be written to the user's folder: for example, if the disk is full, or
//! if the folder or the network is gone.

use std::env;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use taugate::{Error, Result};

/// Remembers the files that could not be written where the user wants them.
#[derive(Default)]
pub struct Rescue {
    /// The error of the first of these files.
    first: Option<Error>,
    /// The latest new folder, as soon as a file is saved in it.
    folder: Option<PathBuf>,
    saved: Vec<PathBuf>,
    lost: Vec<PathBuf>,
}

impl Rescue {
    /// Calls `write` with `path`. If that fails, calls it with a file of the same name in a new folder. Returns whether `path` was
    /// written.
    pub fn write(&mut self, path: &Path, write: impl Fn(&Path) -> Result<()>) -> bool {
        let Err(error) = write(path) else { return true };
        self.first.get_or_insert(error);
        match self.save(Path::new(path.file_name().unwrap_or_default()), write) {
            Some(saved) => self.saved.push(saved),
            None => self.lost.push(path.into()),
        }
        false
    }

    /// Remembers the error of a step that saves nothing.
    pub fn check(&mut self, result: Result<()>) {
        if let Err(error) = result {
            self.first.get_or_insert(error);
        }
    }

    /// Writes the file `name` into a new folder inside the system's folder for temporary files, or else inside the current one.
    /// Returns its path, or `None` if both fail. The folder is new, so no file of the user is overwritten. Two files of one name get
    /// two folders.
    fn save(&mut self, name: &Path, write: impl Fn(&Path) -> Result<()>) -> Option<PathBuf> {
        let mut known = self.folder.iter().map(|folder| folder.join(name));
        let known = known.find(|path| !path.exists() && write(path).is_ok());
        known.or_else(|| {
            [Some(env::temp_dir()), env::current_dir().ok()].into_iter().flatten().find_map(|place| {
                let folder = tempfile::Builder::new().prefix("taugate-").tempdir_in(place).ok()?;
                let path = folder.path().join(name);
                write(&path).ok()?;
                self.folder = Some(folder.keep());
                Some(path)
            })
        })
    }

    /// Fails if a file could not be written where the user wants it. The message says why, and where the file is now.
    pub fn finish(self) -> anyhow::Result<()> {
        let Some(first) = self.first else { return Ok(()) };
        let list = |paths: &[PathBuf]| paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ");
        let mut message = first.to_string();
        if !self.saved.is_empty() {
            write!(message, "; the result is saved in {}", list(&self.saved)).expect("a string takes all text");
        }
        if !self.lost.is_empty() {
            let places = "neither the folder for temporary files nor the current folder takes the file";
            write!(message, "; {} is lost, because {places}", list(&self.lost)).expect("a string takes all text");
        }
        Err(anyhow!(message))
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::ErrorKind;

    use taugate::internals::files::write_atomically;

    use super::*;

    #[test]
    fn files_go_to_a_new_folder_and_the_message_names_it() {
        let here = tempfile::tempdir().unwrap();
        let (good, bad) = (here.path().join("out.exr"), here.path().join("gone/out.png"));
        let mut rescue = Rescue::default();
        for path in [&good, &bad] {
            rescue.write(path, |path| write_atomically(path, |file| std::io::Write::write_all(file, b"light")));
        }
        let saved = rescue.saved.clone();
        let message = rescue.finish().unwrap_err().to_string();
        assert_eq!(fs::read(&good).unwrap(), b"light");
        assert_eq!(fs::read(&saved[0]).unwrap(), b"light");
        assert!(message.contains("does not exist") && message.ends_with(&saved[0].display().to_string()), "{message}");
        fs::remove_dir_all(saved[0].parent().unwrap()).unwrap();

        // A second file of the same name does not replace the first one.
        let mut rescue = Rescue::default();
        for (folder, text) in [("gone", "light"), ("away", "depth")] {
            let path = here.path().join(folder).join("out.png");
            rescue.write(&path, |path| write_atomically(path, |file| std::io::Write::write_all(file, text.as_bytes())));
        }
        assert_eq!(rescue.saved.iter().map(|path| fs::read(path).unwrap()).collect::<Vec<_>>(), [b"light", b"depth"]);
        rescue.saved.iter().for_each(|path| fs::remove_dir_all(path.parent().unwrap()).unwrap());

        let mut rescue = Rescue::default();
        rescue.write(&good, |path| write_atomically(path, |_| Err(ErrorKind::FileTooLarge.into())));
        assert!(rescue.folder.is_none());
        let message = rescue.finish().unwrap_err().to_string();
        assert!(message.contains("ulimit -f") && message.contains("out.exr is lost"), "{message}");
        assert!(Rescue::default().finish().is_ok());
    }
}

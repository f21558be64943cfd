//! A lock on the name of an output that a process writes again and again.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};

use super::{target, write_error};
use crate::error::{Error, Result};

/// Maximum number of attempts to lock a file that other processes remove meanwhile.
const ATTEMPTS: u32 = 100;

/// While it lives, no other process can lock the same output. The lock is on a hidden file beside the output. That file is
/// removed when the lock ends. The operating system releases the lock of a process that was killed.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    /// Holds the lock.
    _file: File,
}

impl Lock {
    /// Locks the output `path`. Fails if another process holds its lock. On file systems without locks nothing is locked.
    pub fn new(path: &Path) -> Result<Lock> {
        let output = target(path)?;
        let name = output.file_name().unwrap_or_default().to_string_lossy();
        let lock = output.with_file_name(format!(".taugate-{name}.lock"));
        for _ in 0..ATTEMPTS {
            let file = OpenOptions::new().create(true).append(true).open(&lock);
            let file = file.map_err(|e| write_error(path, &output, e))?;
            if let Err(TryLockError::WouldBlock) = file.try_lock() {
                return Err(Error::File {
                    path: path.into(),
                    message: "another render is writing this file; wait for it, or choose another name".into(),
                });
            }
            // If `lock` now leads to another file, a process removed this one before it was locked: try again.
            if is_at(&file, &lock) {
                return Ok(Lock { path: lock, _file: file });
            }
        }
        Err(Error::File { path: path.into(), message: "other processes lock this file all the time; try again".into() })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // If the file stays, it does no harm: nobody holds its lock.
        let _ = fs::remove_file(&self.path);
    }
}

/// Whether `path` leads to `file`.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let pair = file.metadata().and_then(|file| Ok((file, fs::metadata(path)?)));
    pair.is_ok_and(|(file, other)| (file.dev(), file.ino()) == (other.dev(), other.ino()))
}

/// Whether `path` leads to `file`. Systems other than Unix cannot remove an open file.
#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_output_has_one_writer() {
        let folder = tempfile::tempdir().unwrap();
        let [path, other] = ["a.acc", "b.acc"].map(|name| folder.path().join(name));
        let lock = Lock::new(&path).unwrap();
        let message = Lock::new(&path).unwrap_err().to_string();
        assert!(message.contains("another render is writing this file"), "{message}");
        let _other = Lock::new(&other).unwrap();
        drop(lock);
        drop(Lock::new(&path).unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "only the lock of b.acc is left");
        // The file that a killed process leaves is no obstacle.
        fs::write(folder.path().join(".taugate-a.acc.lock"), "").unwrap();
        assert!(Lock::new(&path).is_ok());
        let missing = Lock::new(&folder.path().join("no/a.acc")).unwrap_err().to_string();
        assert!(missing.contains("does not exist"), "{missing}");
    }
}

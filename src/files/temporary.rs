//! Temporary files and folders beside an output. A name contains the output and the process: `.taugate-out.exr-1234-Xy12Za.tmp`
//! is the temporary of process 1234 for `out.exr`.
//!
//! The process that writes a temporary holds a lock on it. When the process ends, the operating system releases the lock, even if
//! the process was killed. So a temporary without a lock is left over from a killed process.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile, TempDir};

use super::folder_of;

const SUFFIX: &str = ".tmp";
/// Number of characters of the output's name in the name of a temporary. File systems allow at least 255 bytes per name, and a
/// character takes up to 4.
const NAME_CHARACTERS: usize = 50;
/// Number of attempts to create a temporary. Another process may mistake a new temporary for a left-over one and remove it before
/// it is locked.
const ATTEMPTS: usize = 100;

/// The beginning of the names of all temporaries for `output`. Outputs with long names may share it.
fn prefix(output: &Path) -> String {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    format!(".taugate-{}-", name.chars().take(NAME_CHARACTERS).collect::<String>())
}

/// Creates a locked temporary file beside `output`. The file handle holds the lock.
pub fn file(output: &Path) -> io::Result<NamedTempFile> {
    create(output, 0o666, |builder| {
        let file = builder.tempfile_in(folder_of(output))?;
        let held = hold(file.as_file(), file.path());
        Ok(held.then_some(file))
    })
}

/// Creates a temporary folder beside `output`, and its lock. The lock is `None` where folders cannot be locked.
pub fn folder(output: &Path) -> io::Result<(TempDir, Option<File>)> {
    create(output, 0o777, |builder| {
        let folder = builder.tempdir_in(folder_of(output))?;
        let lock = File::open(folder.path()).ok();
        let held = lock.as_ref().is_none_or(|lock| hold(lock, folder.path()));
        Ok(held.then_some((folder, lock)))
    })
}

/// Calls `make` until it returns a temporary or an error. `mode` is the usual mode of a new file or folder, before the user's
/// umask. Without it, the temporary would be readable by its owner only.
#[cfg_attr(not(unix), expect(unused_variables))]
fn create<T>(output: &Path, mode: u32, make: impl Fn(&mut Builder) -> io::Result<Option<T>>) -> io::Result<T> {
    let prefix = format!("{}{}-", prefix(output), std::process::id());
    let mut builder = Builder::new();
    builder.prefix(&prefix).suffix(SUFFIX);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(mode));
    }
    for _ in 0..ATTEMPTS {
        if let Some(made) = make(&mut builder)? {
            return Ok(made);
        }
    }
    Err(io::Error::other("another process removes each temporary file"))
}

/// Locks a new temporary. Returns false if another process is removing it as a left-over one, or has removed it.
fn hold(lock: &File, path: &Path) -> bool {
    match lock.try_lock() {
        Err(TryLockError::WouldBlock) => false,
        // Some file systems have no locks. There, no process removes temporaries.
        Ok(()) | Err(TryLockError::Error(_)) => path.exists(),
    }
}

/// Removes the temporaries for `output` whose processes have ended. Errors are ignored, because left-over files do no harm.
pub fn remove_left_over(output: &Path) {
    for (path, lock) in left_over(output) {
        let _ = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        drop(lock);
    }
}

/// Whether a process ended, for example because it was killed, before it had written `output`.
pub fn has_left_over(output: &Path) -> bool {
    !left_over(output).is_empty()
}

/// The temporaries for `output` whose processes have ended, and their locks.
fn left_over(output: &Path) -> Vec<(PathBuf, File)> {
    let prefix = prefix(output);
    let Ok(entries) = fs::read_dir(folder_of(output)) else { return vec![] };
    let lock_of = |entry: fs::DirEntry| {
        let name = entry.file_name();
        let is_ours = name.to_str().is_some_and(|name| name.starts_with(&prefix) && name.ends_with(SUFFIX));
        let kind = entry.file_type().ok().filter(|kind| is_ours && (kind.is_dir() || kind.is_file()))?;
        let path = entry.path();
        // Some network file systems lock a file only if it is open for writing; folders cannot be opened for writing.
        let lock = if kind.is_dir() { File::open(&path) } else { File::options().write(true).open(&path) }.ok()?;
        lock.try_lock().is_ok().then_some((path, lock))
    };
    entries.flatten().filter_map(lock_of).collect()
}

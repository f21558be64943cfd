//! Reads and writes files with clear errors. A reader never sees a half-written file.

use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Writes a temporary file in the same folder, flushes it to disk and renames it to `path`. After an error the temporary
/// file is removed, and an old file at `path` is unchanged.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<()> {
    let temporary = temporary_beside(path)?;
    let fail = |e: io::Error| write_error(path, e);

    let mut writer = BufWriter::new(temporary.reopen().map_err(fail)?);
    write(&mut writer).map_err(fail)?;
    writer.into_inner().map_err(|e| fail(e.into_error()))?.sync_all().map_err(fail)?;
    temporary.persist(path).map_err(|e| fail(e.error))?;

    // The rename is safe on disk after the folder is flushed. Some file systems cannot flush a folder; the file is complete
    // without it, so errors are ignored.
    let _ = File::open(folder_of(path)).and_then(|folder| folder.sync_all());
    Ok(())
}

/// Fails if [`write_atomically`] would fail: missing folder, no permission, full disk, or no plain file. Call this function
/// before long work.
pub fn check_writable(path: &Path) -> Result<()> {
    let mut temporary = temporary_beside(path)?;
    // Writing one byte fails if the disk is full.
    temporary.write_all(&[0]).map_err(|e| write_error(path, e))
}

fn temporary_beside(path: &Path) -> Result<tempfile::NamedTempFile> {
    if path.file_name().is_none() {
        return Err(Error::File { path: path.into(), message: "this is not the name of a file".into() });
    }
    // `Path` ignores a slash at the end, but the operating system does not.
    if path.as_os_str().to_string_lossy().ends_with(std::path::is_separator) {
        return Err(Error::File { path: path.into(), message: "this is the name of a folder; name a file".into() });
    }
    match std::fs::metadata(path) {
        // The rename would replace a device or a folder instead of writing to it.
        Ok(metadata) if !metadata.is_file() => {
            let message = "exists and is not a plain file; choose another name".into();
            return Err(Error::File { path: path.into(), message });
        }
        Err(e) if e.kind() == ErrorKind::InvalidFilename => return Err(write_error(path, e)),
        _ => {}
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(".taugate-").suffix(".tmp");
    #[cfg(unix)]
    {
        // The usual mode of a new file, less the user's umask. By default a temporary file is private.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder_of(path)).map_err(|e| write_error(path, e))
}

fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder.into(),
        _ => ".".into(),
    }
}

/// Whether `file` is the same file as `other`, or lies in the folder `other`. Both paths are resolved first, so links and
/// relative paths do not matter.
pub fn lies_in(file: &Path, other: &Path) -> bool {
    let real = |path: &Path| {
        let folder = std::fs::canonicalize(folder_of(path)).ok()?;
        Some(std::fs::canonicalize(path).unwrap_or_else(|_| folder.join(path.file_name().unwrap_or_default())))
    };
    real(file).zip(real(other)).is_some_and(|(file, other)| file.starts_with(other))
}

/// The error for a failed write of `path`, with the remedy.
fn write_error(path: &Path, error: io::Error) -> Error {
    let folder = folder_of(path);
    let folder = folder.display();
    let message = match error.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => {
            format!("cannot be written: the folder {folder} does not exist; create it or choose another name")
        }
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
            format!("cannot be written: no permission in the folder {folder}; choose a folder where you may write")
        }
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => {
            format!("cannot be written: {folder} has no space left; free some space or choose another disk")
        }
        ErrorKind::InvalidFilename => "cannot be written: the name is too long or not allowed; choose another".into(),
        _ => format!("cannot be written: {error}"),
    };
    Error::io(path, message, error)
}

/// Returns the size in bytes of a plain file that can be opened. Otherwise returns an error with the remedy.
pub fn check_readable(path: &Path) -> Result<u64> {
    // Opening a pipe would block.
    let metadata = std::fs::metadata(path).map_err(|e| read_error(path, e))?;
    if !metadata.is_file() {
        return Err(Error::File { path: path.into(), message: "is not a plain file; check the name".into() });
    }
    File::open(path).map_err(|e| read_error(path, e))?;
    Ok(metadata.len())
}

/// The error for a failed read of `path`, with the remedy.
pub(crate) fn read_error(path: &Path, error: io::Error) -> Error {
    let message = match error.kind() {
        ErrorKind::NotFound => "no such file; check the name".into(),
        ErrorKind::PermissionDenied => "no permission to read this file; change its permissions".into(),
        _ => format!("cannot be read: {error}; check the name"),
    };
    Error::io(path, message, error)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.exr");
        write_atomically(&path, |w| w.write_all(b"first")).unwrap();
        let error = write_atomically(&path, |w| {
            w.write_all(b"sec")?;
            Err(ErrorKind::StorageFull.into())
        });
        assert!(error.unwrap_err().to_string().contains("no space left"));
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        assert_eq!(names(folder.path()), ["out.exr"]);
        write_atomically(&path, |w| w.write_all(b"third")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"third");
    }

    #[test]
    fn checking_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        check_writable(&folder.path().join("out.exr")).unwrap();
        assert!(names(folder.path()).is_empty());
        let missing = check_writable(&folder.path().join("no/out.exr")).unwrap_err().to_string();
        assert!(missing.contains("does not exist"), "{missing}");
        assert!(check_writable(folder.path()).unwrap_err().to_string().contains("not a plain file"));
        assert!(check_writable(&folder.path().join("out.exr/")).unwrap_err().to_string().contains("name a file"));
        let long = check_writable(&folder.path().join("x".repeat(300))).unwrap_err().to_string();
        assert!(long.contains("choose another"), "{long}");
        #[cfg(target_os = "linux")]
        assert!(check_writable(Path::new("/dev/full")).unwrap_err().to_string().contains("not a plain file"));
    }
}

//! Reads and writes files with clear errors. A reader never sees a half-written file.

mod lock;
mod temporary;

use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::error::{Error, Result};
pub use lock::Lock;
pub use temporary::{folder as temporary_folder, has_left_over, remove_left_over};

/// Maximum number of symbolic links that lead from one to the next, as in Linux.
const MAX_LINKS: usize = 40;

/// Writes a temporary file in the same folder, flushes it to disk and renames it to `path`. A symbolic link stays: the file that
/// it leads to is replaced or created. After an error the temporary file is removed, and an old file at `path` is unchanged.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<()> {
    write_unpublished(path, write)?.publish()
}

/// A whole file that lies on disk under a temporary name. It is removed if it is dropped.
pub struct UnpublishedFile {
    path: PathBuf,
    /// The file that [`UnpublishedFile::publish`] creates or replaces.
    target: PathBuf,
    temporary: NamedTempFile,
}

/// Writes a temporary file in the folder of `path` and flushes it to disk. `path` does not change yet.
pub fn write_unpublished(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<UnpublishedFile> {
    let target = checked_target(path)?;
    let fail = |e: io::Error| write_error(path, &target, e);
    let temporary = temporary::file(&target).map_err(fail)?;

    let mut writer = BufWriter::new(temporary.as_file().try_clone().map_err(fail)?);
    write(&mut writer).map_err(fail)?;
    writer.into_inner().map_err(|e| fail(e.into_error()))?.sync_all().map_err(fail)?;
    Ok(UnpublishedFile { path: path.into(), target, temporary })
}

impl UnpublishedFile {
    /// Renames the file to its path.
    pub fn publish(self) -> Result<()> {
        let UnpublishedFile { path, target, temporary } = self;
        temporary.persist(&target).map_err(|e| write_error(&path, &target, e.error))?;

        // The rename is safe on disk after the folder is flushed. Some file systems cannot flush a folder; the file is complete
        // without it, so errors are ignored.
        let _ = File::open(folder_of(&target)).and_then(|folder| folder.sync_all());
        Ok(())
    }
}

/// Removes the plain file `path`, or the file that its symbolic links lead to; the links stay. A missing file is no error.
pub fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(target(path)?) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            let message = format!("belongs to an earlier array, but cannot be removed: {error}; remove it");
            Err(Error::io(path, message, error))
        }
        _ => Ok(()),
    }
}

/// Fails if [`write_atomically`] would fail: missing folder, no permission, full disk, or no plain file. Also removes the
/// temporary files of earlier writes to `path` that were killed. Call this function before long work.
pub fn check_writable(path: &Path) -> Result<()> {
    let target = checked_target(path)?;
    remove_left_over(&target);
    let fail = |e: io::Error| write_error(path, &target, e);
    let mut temporary = temporary::file(&target).map_err(fail)?;
    // Writing one byte fails if the disk is full.
    temporary.write_all(&[0]).map_err(fail)
}

/// The file that a write to `path` creates or replaces: `path`, or the end of its chain of symbolic links. It need not exist.
/// Fails if the links lead in a circle.
pub fn target(path: &Path) -> Result<PathBuf> {
    let mut target = path.to_path_buf();
    for _ in 0..=MAX_LINKS {
        match fs::read_link(&target) {
            Ok(next) => target = folder_of(&target).join(next),
            Err(_) => return Ok(target),
        }
    }
    Err(Error::File { path: path.into(), message: "is a symbolic link that leads in a circle; remove the link".into() })
}

/// The [`target`] of `path`, if it is the name of a plain file or of nothing.
fn checked_target(path: &Path) -> Result<PathBuf> {
    let fail = |message: &str| Err(Error::File { path: path.into(), message: message.into() });
    let target = target(path)?;
    if target.file_name().is_none() {
        return fail("this is not the name of a file");
    }
    // `Path` ignores a slash at the end, but the operating system does not.
    if target.as_os_str().to_string_lossy().ends_with(std::path::is_separator) {
        return fail("this is the name of a folder; name a file");
    }
    // The metadata of `path`, not of `target`: the operating system may forbid to follow the links of other users.
    match fs::metadata(path) {
        // The rename would replace a device or a folder instead of writing to it.
        Ok(metadata) if !metadata.is_file() => fail("exists and is not a plain file; choose another name"),
        Err(e) if matches!(e.kind(), ErrorKind::InvalidFilename | ErrorKind::PermissionDenied) => {
            Err(write_error(path, &target, e))
        }
        _ => Ok(target),
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."))
}

/// Whether the name of a file ends in a dot and `extension`, in upper or lower case.
pub fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

/// Whether two paths lead to the same file. False if one of the files does not exist.
pub fn is_same(a: &Path, b: &Path) -> bool {
    fs::canonicalize(a).is_ok_and(|a| fs::canonicalize(b).is_ok_and(|b| a == b))
}

/// Whether `file` is the same file as `other`, or lies in the folder `other`. Both paths are resolved first, so links and
/// relative paths do not matter.
pub fn lies_in(file: &Path, other: &Path) -> bool {
    let real = |path: &Path| {
        let path = target(path).ok()?;
        let folder = fs::canonicalize(folder_of(&path)).ok()?;
        Some(fs::canonicalize(&path).unwrap_or_else(|_| folder.join(path.file_name().unwrap_or_default())))
    };
    real(file).zip(real(other)).is_some_and(|(file, other)| file.starts_with(other))
}

/// The error for a failed write of `path`, which leads to `target`, with the remedy.
fn write_error(path: &Path, target: &Path, error: io::Error) -> Error {
    let folder = folder_of(target);
    let folder = folder.display();
    let message = match error.kind() {
        // Folders of the kernel, such as /proc, take no files.
        ErrorKind::NotFound if folder_of(target).is_dir() => {
            format!("cannot be written: the folder {folder} takes no new files; choose another folder")
        }
        ErrorKind::NotFound | ErrorKind::NotADirectory => {
            format!("cannot be written: the folder {folder} does not exist; create it or choose another name")
        }
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
            format!("cannot be written: no permission in the folder {folder}; choose a folder where you may write")
        }
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            format!("cannot be written: {folder} has no space left; free some space or choose another disk")
        }
        ErrorKind::FileTooLarge => {
            "cannot be written: the file is larger than the limit of this shell or this disk; raise the \
                                    limit (ulimit -f) or choose another disk"
                .into()
        }
        ErrorKind::InvalidFilename => "cannot be written: the name is too long or not allowed; choose another".into(),
        _ => format!("cannot be written: {error}"),
    };
    Error::io(path, message, error)
}

/// Returns the size in bytes of a plain file that can be opened. Otherwise returns an error with the remedy.
pub fn check_readable(path: &Path) -> Result<u64> {
    // Opening a pipe would block.
    let metadata = fs::metadata(path).map_err(|e| read_error(path, e))?;
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
        #[cfg(target_os = "linux")]
        {
            let message = check_writable(Path::new("/proc/x.exr")).unwrap_err().to_string();
            assert!(message.contains("the folder /proc takes no new files"), "{message}");
        }
    }

    #[test]
    fn only_left_over_temporaries_of_the_same_output_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let [path, other] = ["out.exr", "other.exr"].map(|name| folder.path().join(name));
        let alive = temporary::file(&path).unwrap();
        let (alive_folder, _lock) = temporary::folder(&path).unwrap();
        // A killed process leaves its temporaries without a lock.
        let left_over = temporary::file(&path).unwrap().keep().unwrap().1;
        let left_over_folder = temporary::folder(&path).unwrap().0.keep();
        std::fs::write(left_over_folder.join("s02_t03_weighted.exr"), "half").unwrap();
        let of_other = temporary::file(&other).unwrap().keep().unwrap().1;
        let by_hand = folder.path().join(".taugate-out.exr-notes.txt");
        std::fs::write(&by_hand, "mine").unwrap();
        check_writable(&path).unwrap();
        assert!(!left_over.exists() && !left_over_folder.exists());
        assert!(alive.path().exists() && alive_folder.path().exists() && of_other.exists() && by_hand.exists());
        let name = alive.path().file_name().unwrap().to_str().unwrap().to_string();
        assert!(name.starts_with(&format!(".taugate-out.exr-{}-", std::process::id())), "{name}");
        // A long name, of characters that take several bytes each, leaves room for the rest.
        check_writable(&folder.path().join("\u{1d11e}".repeat(60))).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_stay() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let here = folder.path();
        std::fs::create_dir(here.join("disk")).unwrap();
        symlink("second.exr", here.join("link.exr")).unwrap();
        symlink("disk/real.exr", here.join("second.exr")).unwrap();
        // At first the link leads to nothing.
        for text in ["first", "second"] {
            check_writable(&here.join("link.exr")).unwrap();
            write_atomically(&here.join("link.exr"), |w| w.write_all(text.as_bytes())).unwrap();
            assert!(here.join("link.exr").is_symlink() && here.join("second.exr").is_symlink());
            assert_eq!(std::fs::read_to_string(here.join("disk/real.exr")).unwrap(), text);
        }
        assert_eq!(names(&here.join("disk")), ["real.exr"]);
        assert!(lies_in(&here.join("link.exr"), &here.join("disk")));

        let message = |to: &str| {
            let _ = std::fs::remove_file(here.join("bad.exr"));
            symlink(to, here.join("bad.exr")).unwrap();
            check_writable(&here.join("bad.exr")).unwrap_err().to_string()
        };
        assert!(message("bad.exr").contains("leads in a circle"));
        assert!(message("no/where.exr").contains("no does not exist"));
        assert!(message("disk").contains("not a plain file"));
        assert!(message("new-folder/").contains("name of a folder"));
        assert!(lies_in(&here.join("link.exr"), &here.join("disk/real.exr")));
        symlink("disk/new.exr", here.join("dangling.exr")).unwrap();
        assert!(lies_in(&here.join("dangling.exr"), &here.join("disk")));
    }
}

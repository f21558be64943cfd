//! The one error type of the library. A variant says who must act; the message names the file or flag and the remedy.

#![warn(missing_docs)]

use std::io;
use std::path::{Path, PathBuf};

/// What went wrong, sorted by who can mend it. `Display` is one sentence without a trailing full stop.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The scene file (or a file it refers to) must be changed.
    #[error("{}: {message}", path.display())]
    Scene {
        /// The scene file; `the scene` for one that was built from arrays.
        path: PathBuf,
        /// What is wrong with it, and the remedy.
        message: String,
    },

    /// A setting must be changed: a flag, a key of the experiment file, an argument.
    #[error("{0}")]
    Settings(String),

    /// A kernel does not compile or its interface does not fit: a defect of taugate itself.
    #[error("shader: {0}")]
    Shader(String),

    /// No usable Vulkan device, too little memory, or the device was lost.
    #[error("device: {0}")]
    Device(String),

    /// A file does not hold what it should.
    #[error("{}: {message}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, and the remedy.
        message: String,
    },

    /// The system does not let a file be read or written.
    #[error("{}: {message}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What could not be done, why, and the remedy.
        message: String,
        /// What the system said.
        source: io::Error,
    },
}

/// Who can mend an [`Error`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// Whoever made the scene.
    Scene,
    /// Whoever chose the settings.
    Settings,
    /// The authors of taugate.
    Shader,
    /// Whoever runs the machine: driver, device, memory.
    Device,
    /// Whoever owns the file or the folder.
    File,
}

impl Error {
    /// Who can mend it.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Error::Scene { .. } => ErrorKind::Scene,
            Error::Settings(_) => ErrorKind::Settings,
            Error::Shader(_) => ErrorKind::Shader,
            Error::Device(_) => ErrorKind::Device,
            Error::File { .. } | Error::Io { .. } => ErrorKind::File,
        }
    }

    pub(crate) fn io(path: &Path, message: impl Into<String>, source: io::Error) -> Error {
        Error::Io { path: path.into(), message: message.into(), source }
    }
}

/// A result with [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

#[cfg(test)]
mod tests {
    use std::error::Error as _;

    use super::*;

    #[test]
    fn an_error_says_who_can_mend_it_and_what_the_system_said() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("missing.glb");
        let error = crate::files::check_readable(&missing).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::File);
        assert!(error.to_string().ends_with("missing.glb: no such file; check the name"), "{error}");
        let source = error.source().and_then(|source| source.downcast_ref::<io::Error>()).expect("the system's error");
        assert_eq!(source.kind(), io::ErrorKind::NotFound);
        assert!(Error::Settings("a mistake".into()).source().is_none());
    }
}

//! The error type of the library. The variant tells who can solve the problem. The message names the file or flag and the
//! remedy.

#![warn(missing_docs)]

mod settings_error;

use std::io;
use std::path::{Path, PathBuf};

pub use settings_error::SettingsError;

/// An error of the library. Each variant stands for the person who can solve the problem. `Display` writes one sentence
/// without a full stop at the end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The scene file, or a file it refers to, must be changed.
    #[error("{}: {message}", path.display())]
    Scene {
        /// The scene file, or `the scene` for a scene that was built from arrays.
        path: PathBuf,
        /// The problem, and the remedy.
        message: String,
    },

    /// A setting must be changed: a flag, a key of the experiment file, or an argument. The error says which one, and what to do, as far
    /// as this is known.
    #[error("{0}")]
    Settings(SettingsError),

    /// A kernel does not compile, or its bindings do not match. This is a defect of taugate.
    #[error("shader: {0}")]
    Shader(String),

    /// There is no usable Vulkan device, its memory is too small, or it was lost.
    #[error("device: {0}")]
    Device(String),

    /// A call of Vulkan failed: the device is out of memory, or it was lost, or the driver has a defect.
    #[error("device: {message}")]
    Vulkan {
        /// The step that failed, and the remedy if there is one.
        message: String,
        /// The error of the driver: a `VkResult`.
        source: Box<dyn std::error::Error + Send + Sync>,
    },

    /// A file has the wrong contents, or its name cannot be used.
    #[error("{}: {message}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The problem, and the remedy.
        message: String,
    },

    /// The operating system cannot read or write a file.
    #[error("{}: {message}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The action that failed, its cause, and the remedy.
        message: String,
        /// The error of the operating system.
        source: io::Error,
    },
}

/// The person who can solve the problem behind an [`Error`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The author of the scene.
    Scene,
    /// The user who chose the settings.
    Settings,
    /// The authors of taugate.
    Shader,
    /// The administrator of the machine: driver, device, memory.
    Device,
    /// The owner of the file or the folder.
    File,
}

impl Error {
    /// Returns who can solve the problem.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Error::Scene { .. } => ErrorKind::Scene,
            Error::Settings(_) => ErrorKind::Settings,
            Error::Shader(_) => ErrorKind::Shader,
            Error::Device(_) | Error::Vulkan { .. } => ErrorKind::Device,
            Error::File { .. } | Error::Io { .. } => ErrorKind::File,
        }
    }

    /// An [`Error::Settings`] with this message, which names the problem and the remedy.
    pub fn settings(message: impl Into<String>) -> Error {
        Error::Settings(SettingsError::new(message))
    }

    /// An [`Error::Settings`] whose message is `problem` and then `remedy`. `problem` ends with its punctuation mark and a space.
    #[doc(hidden)]
    pub fn advice(problem: impl Into<String>, remedy: impl AsRef<str>) -> Error {
        Error::Settings(SettingsError::advice(problem, remedy))
    }

    /// The same error about the setting with this name, without dashes, if it is an error of the settings.
    pub(crate) fn about(self, setting: impl Into<Option<&'static str>>) -> Error {
        match self {
            Error::Settings(error) => Error::Settings(error.about(setting)),
            other => other,
        }
    }

    /// An error of the settings as one of the scene in this file, because the scene may be the cause. Other errors stay as they are.
    #[doc(hidden)]
    #[must_use]
    pub fn in_scene(self, file: Option<&Path>) -> Error {
        match (self, file) {
            (Error::Settings(error), Some(path)) => Error::Scene { path: path.into(), message: error.to_string() },
            (other, _) => other,
        }
    }

    /// The same error with another message, if it is an error of the device. Other errors stay as they are.
    #[doc(hidden)]
    #[must_use]
    pub fn map_device_message(self, change: impl FnOnce(String) -> String) -> Error {
        match self {
            Error::Device(message) => Error::Device(change(message)),
            Error::Vulkan { message, source } => Error::Vulkan { message: change(message), source },
            other => other,
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
        assert!(Error::settings("a mistake").source().is_none());
    }
}

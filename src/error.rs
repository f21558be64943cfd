//! The one error type of the library. A variant says who must act; the message names the file or flag and the remedy.

use std::path::PathBuf;

/// What went wrong, sorted by who can mend it. `Display` is one sentence without a trailing full stop.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene file (or a file it refers to) must be changed.
    #[error("{}: {message}", path.display())]
    Scene { path: PathBuf, message: String },

    /// A flag or a key of the experiment file must be changed.
    #[error("{0}")]
    Settings(String),

    /// A kernel does not compile or its interface does not fit: a defect of taugate itself.
    #[error("shader: {0}")]
    Shader(String),

    /// No usable Vulkan device, too little memory, or the device was lost.
    #[error("device: {0}")]
    Device(String),

    /// A file cannot be read or written.
    #[error("{}: {message}", path.display())]
    File { path: PathBuf, message: String },
}

pub type Result<T, E = Error> = std::result::Result<T, E>;

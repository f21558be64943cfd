//! Errors of renders.

use std::path::Path;

use taugate::Error;

/// The error for non-finite samples with --strict.
#[derive(Debug, thiserror::Error)]
#[error("{dropped} samples were not finite, so --strict wrote no image; without --strict they count as 0")]
pub struct NotFinite {
    pub dropped: u64,
}

/// Appends to the message of a device error that the files hold `what`: the results from before the error. Other errors stay the same.
pub fn after(failure: Error, what: &str) -> Error {
    failure.map_device_message(|message| format!("{message}; the files hold {what}"))
}

/// Names the scene's file in an error of the settings, because the scene may be the cause.
pub fn of_file(error: Error, scene: &Path) -> Error {
    match error {
        Error::Settings(message) => Error::Scene { path: scene.into(), message },
        other => other,
    }
}

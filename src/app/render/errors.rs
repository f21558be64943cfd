//! Errors of renders.

use taugate::Error;
use taugate::internals::job::iterations::End;

/// The error for non-finite samples with --strict.
#[derive(Debug, thiserror::Error)]
#[error("{dropped} samples were not finite, so --strict wrote no image; without --strict they count as 0")]
pub struct NotFinite {
    pub dropped: u64,
}

/// The error of the device that ended a render early. Its results so far are kept. Fails if a strict render ended early.
pub fn failure(end: End) -> Result<Option<Error>, NotFinite> {
    match end {
        End::NotFinite(dropped) => Err(NotFinite { dropped }),
        End::Failed(error) => Ok(Some(error)),
        End::Complete | End::Stopped => Ok(None),
    }
}

/// Appends to the message of a device error that the files hold `results`, from before the error. Other errors stay the same.
pub fn with_saved_results(error: Error, results: &str) -> Error {
    error.map_device_message(|message| format!("{message}; the files hold {results}"))
}

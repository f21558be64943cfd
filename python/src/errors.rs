//! Errors of the library as Python exceptions.

use pyo3::prelude::*;
use taugate::internals::printable::escaped;
use taugate::{Error, ErrorKind, SettingsError};

/// What can go wrong in a render.
pub enum Failure {
    Library(Error),
    /// Non-finite samples in a render with `strict`.
    NotFinite(u64),
    /// An exception of Python, such as the one of a callback.
    Python(PyErr),
}

pub type Result<T> = std::result::Result<T, Failure>;

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        Failure::Library(error)
    }
}

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Failure {
        Failure::Python(error)
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> PyErr {
        match failure {
            Failure::Library(error) => {
                let exception = exception(name(error.kind()), error.to_string());
                if let Error::Settings(error) = &error {
                    add_fields(&exception, error);
                }
                exception
            }
            Failure::NotFinite(dropped) => exception(
                "NotFiniteError",
                format!("{dropped} samples were not finite, so strict=True gives no image; without it they count as 0"),
            ),
            Failure::Python(error) => error,
        }
    }
}

/// Notes and warnings with escaped control characters: programs print these sentences, and they may name files and objects.
pub fn shown(sentences: &[String]) -> Vec<String> {
    sentences.iter().map(|sentence| escaped(sentence).into_owned()).collect()
}

/// A mistake in the arguments.
pub fn settings(message: impl Into<String>) -> Failure {
    Failure::Library(Error::settings(message))
}

fn name(kind: ErrorKind) -> &'static str {
    match kind {
        ErrorKind::Scene => "SceneError",
        ErrorKind::Settings => "SettingsError",
        ErrorKind::Device => "DeviceError",
        ErrorKind::File => "FileError",
        _ => "Error",
    }
}

/// Adds the setting, as a keyword argument, and the remedy to a `SettingsError` of Python, if they are known.
fn add_fields(exception: &PyErr, error: &SettingsError) {
    Python::attach(|py| {
        let setting = error.setting().map(|name| name.replace('-', "_"));
        for (field, value) in [("setting", setting), ("remedy", error.remedy().map(|text| escaped(text).into_owned()))]
        {
            // Without the field, the exception still has its message.
            let _ = exception.value(py).setattr(field, value);
        }
    });
}

/// The exception `name` of `taugate._errors`. The message may name files and keys, so control characters in it are escaped.
fn exception(name: &str, message: String) -> PyErr {
    Python::attach(|py| {
        let class = py.import("taugate._errors").and_then(|module| module.getattr(name));
        match class.and_then(|class| class.call1((escaped(&message),))) {
            Ok(error) => PyErr::from_value(error),
            Err(error) => error,
        }
    })
}

//! What is wrong with a setting, and what to do.

use std::convert::Infallible;
use std::num::ParseIntError;
use std::str::ParseBoolError;

use super::Error;

/// A mistake in the settings: [`Error::Settings`]. `Display` writes one sentence with all that is known, without a full stop.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct SettingsError {
    message: String,
    setting: Option<String>,
    /// Length in bytes of the remedy, with which the message ends; 0 if it is not known.
    remedy: usize,
}

impl SettingsError {
    /// A message that begins with a flag is about the setting of this flag.
    pub(crate) fn new(message: impl Into<String>) -> SettingsError {
        let message = message.into();
        let setting = message.strip_prefix("--").map(|rest| {
            let end = rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '-').unwrap_or(rest.len());
            rest[..end].into()
        });
        SettingsError { message, setting, remedy: 0 }
    }

    /// The message is `problem` and then `remedy`, so `problem` ends with its punctuation mark and a space.
    pub(crate) fn advice(problem: impl Into<String>, remedy: impl AsRef<str>) -> SettingsError {
        let (problem, remedy) = (problem.into(), remedy.as_ref());
        SettingsError { remedy: remedy.len(), ..SettingsError::new(problem + remedy) }
    }

    /// The same error about the setting with this name, without dashes.
    #[doc(hidden)]
    #[must_use]
    pub fn about(self, setting: impl Into<Option<&'static str>>) -> SettingsError {
        SettingsError { setting: setting.into().map(String::from).or(self.setting), ..self }
    }

    /// The same error with more text before it.
    #[doc(hidden)]
    #[must_use]
    pub fn after(self, text: &str) -> SettingsError {
        let new = SettingsError::new(format!("{text}{}", self.message));
        SettingsError { setting: self.setting.or(new.setting), remedy: self.remedy, ..new }
    }

    /// The name of the setting to change: that of its flag without the two dashes, and of its key in an experiment file. `None` if no
    /// single setting is to blame, or if it is not known which one. It is known if the value of a named setting cannot be read, if a
    /// value is outside its range, if settings exclude each other, if a key of a file is in the wrong table, if the gate meets no light,
    /// and if the message begins with a flag. A text that a program parses by itself, such as that of a gate, has no name.
    pub fn setting(&self) -> Option<&str> {
        self.setting.as_deref()
    }

    /// What is wrong: the message without the remedy.
    pub fn problem(&self) -> &str {
        let problem = &self.message[..self.message.len() - self.remedy];
        if self.remedy == 0 { problem } else { problem.trim_end_matches([';', ':', ',', ' ']) }
    }

    /// What to do, such as `write degrees between 0 and 180, like 40`. `None` if the message has no remedy that stands apart at its end.
    /// Errors from experiment files seldom have one.
    pub fn remedy(&self) -> Option<&str> {
        (self.remedy > 0).then(|| &self.message[self.message.len() - self.remedy..])
    }
}

/// A message without a remedy that stands apart.
macro_rules! from_messages {
    ($($type:ty),+) => {$(
        impl From<$type> for SettingsError {
            fn from(message: $type) -> SettingsError {
                SettingsError::new(message.to_string())
            }
        }
    )+};
}
from_messages!(&str, String, Infallible, ParseBoolError, ParseIntError);

impl From<Error> for SettingsError {
    fn from(error: Error) -> SettingsError {
        match error {
            Error::Settings(error) => error,
            other => SettingsError::new(other.to_string()),
        }
    }
}

impl From<SettingsError> for Error {
    fn from(error: SettingsError) -> Error {
        Error::Settings(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_the_problem_and_the_remedy() {
        let error = SettingsError::advice("--fov is 200; ", "it must be below 180");
        assert_eq!(error.to_string(), "--fov is 200; it must be below 180");
        let fields = (error.setting(), error.problem(), error.remedy());
        assert_eq!(fields, (Some("fov"), "--fov is 200", Some("it must be below 180")));

        let inner = SettingsError::advice("'x' is no number: ", "write one");
        assert_eq!((inner.setting(), inner.remedy()), (None, Some("write one")));
        let outer = inner.after("--look-at: ");
        assert_eq!(outer.to_string(), "--look-at: 'x' is no number: write one");
        let fields = (outer.setting(), outer.problem(), outer.remedy());
        assert_eq!(fields, (Some("look-at"), "--look-at: 'x' is no number", Some("write one")));

        let plain = SettingsError::new("the scene is empty: nothing to see");
        assert_eq!(
            (plain.setting(), plain.problem(), plain.remedy()),
            (None, "the scene is empty: nothing to see", None)
        );
        assert_eq!(plain.about("spp").setting(), Some("spp"));
    }
}

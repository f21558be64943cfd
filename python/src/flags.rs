//! Turns keyword arguments into settings. Each argument has the name and the words of a flag of the command line.

use std::ffi::OsStr;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::settings::missing;
use taugate::internals::settings::setting::{Form, Setting, Taker, Value, Visitor};
use taugate::internals::settings::table::{self, excluding};
use taugate::{Error, SettingsError};

use crate::errors::Result;

/// The name of a flag without its dashes, and its words: one for each time that the user would type the flag.
pub type Words = (String, Vec<String>);

/// The experiment of the flags. Fails if there is no such flag, if a word is not a valid value, or if two flags exclude each other.
pub fn experiment(flags: &[Words]) -> Result<Experiment> {
    for (k, (name, _)) in flags.iter().enumerate() {
        let earlier = |name: &str| flags[..k].iter().any(|(other, _)| other == name);
        if let Some(other) = excluding(name).find(|other| earlier(other)) {
            return Err(Error::advice(format!("--{name} cannot be used with --{other}; "), "keep one").into());
        }
    }
    let mut experiment = Experiment::default();
    for (name, words) in flags {
        let mut set = Set { name, words, found: None };
        experiment.visit(&mut set);
        set.found.unwrap_or_else(|| Err(format!("there is no setting --{name}").into())).map_err(Error::from)?;
    }
    Ok(experiment)
}

struct Set<'a> {
    name: &'a str,
    words: &'a [String],
    found: Option<taugate::Result<(), SettingsError>>,
}

impl Visitor for Set<'_> {
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
        if setting.name != self.name {
            return;
        }
        let parse = |word: &String| T::parse(OsStr::new(word)).map_err(|error| wrong(setting, word, error));
        let values: taugate::Result<Vec<T>, SettingsError> = self.words.iter().map(parse).collect();
        self.found = Some(values.map(|values| *slot = values.into_iter().reduce(T::and)));
    }
}

/// The message of the command line about a word that is not a valid value of a flag.
fn wrong(setting: &'static Setting, word: &str, error: SettingsError) -> SettingsError {
    let flag = match (setting.form, setting.value) {
        (Form::Switch, _) | (_, "") => format!("--{}", setting.name),
        (Form::Optional { equals: false, .. }, value) => format!("--{} [<{value}>]", setting.name),
        (Form::Optional { equals: true, .. }, value) => format!("--{}[=<{value}>]", setting.name),
        (_, value) => format!("--{} <{value}>", setting.name),
    };
    error.after(&format!("invalid value '{word}' for '{flag}': ")).about(setting.name)
}

/// The settings of a render by name. Each has four entries. The first says how its flag takes values: `value`, `repeated`, `switch`, or
/// `optional`. Then come the value of the flag without a word, what the help text calls the value, and the help text.
#[pyfunction]
pub fn flags(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    for setting in table::all().filter(|setting| setting.is_for(Taker::Python)) {
        let (form, bare) = match setting.form {
            Form::Value | Form::Signed => ("value", ""),
            Form::Repeated | Form::SignedRepeated => ("repeated", ""),
            Form::Switch => ("switch", "true"),
            Form::Optional { bare, .. } => ("optional", bare),
        };
        dict.set_item(setting.name, (form, bare, setting.value, setting.help.trim()))?;
    }
    Ok(dict)
}

/// Why there is no setting `name` (with dashes), and what to do instead; `None` for names that no other renderer has.
#[pyfunction]
pub fn reason_of_missing(name: &str) -> Option<&'static str> {
    missing::reason(name)
}

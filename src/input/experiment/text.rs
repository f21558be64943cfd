//! Parses the text of an experiment, with errors that say where a mistake stands.

use super::Experiment;
use crate::error::SettingsError;
use crate::input::plain::{from_toml, home_of};
use crate::settings::response_specs::{ResponseSpec, ResponseSpecs};
use crate::settings::setting::Setting;
use crate::settings::table::MediumTable;

impl Experiment {
    /// Parses the text of an experiment. Paths stay as written.
    pub fn parse(text: &str) -> Result<Experiment, ParseError> {
        let mut experiment: Experiment = from_toml(text, home_of).map_err(|(span, mistake)| {
            let (line, column) = position(text, span.start);
            ParseError { line, column, mistake }
        })?;
        let tables = std::mem::take(&mut experiment.response).into_iter().map(|table| table.0);
        let specs: Vec<ResponseSpec> =
            experiment.gate.response.take().map_or(vec![], |specs| specs.0).into_iter().chain(tables).collect();
        experiment.gate.response = (!specs.is_empty()).then_some(ResponseSpecs(specs));
        match experiment.exclusive_keys() {
            None => Ok(experiment),
            Some((first, second)) => {
                // The error points to the later one.
                let at = [first, second].iter().filter_map(|setting| key_offset(text, setting)).max();
                let (line, column) = position(text, at.unwrap_or(0));
                Err(ParseError { line, column, mistake: second.clash(first.name) })
            }
        }
    }

    /// The first two given settings that exclude each other.
    fn exclusive_keys(&self) -> Option<(&'static Setting, &'static Setting)> {
        let clash = |given: Vec<&'static Setting>| {
            let mut pairs = given.iter().flat_map(|second| given.iter().map(move |first| (*first, *second)));
            pairs.find(|(first, second)| second.excludes.contains(&first.name))
        };
        std::iter::once(self.given()).chain(self.medium.list.iter().map(MediumTable::given)).find_map(clash)
    }
}

/// An error in the text of an experiment, with its position: line and column count from 1, columns in characters.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: {mistake}")]
pub struct ParseError {
    pub line: usize,
    pub column: usize,
    pub mistake: SettingsError,
}

/// Line and column of byte `offset` in `text`. Both count from 1; columns are in characters.
pub(crate) fn position(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |at| at + 1);
    (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
}

/// Offset in bytes of the first line that sets the key of `setting` (`key =`), without its indentation; `None` if no line does.
fn key_offset(text: &str, setting: &Setting) -> Option<usize> {
    text.split_inclusive('\n')
        .scan(0, |at, line| {
            let start = *at;
            *at += line.len();
            Some((start, line))
        })
        .find_map(|(start, line)| {
            let indent = line.len() - line.trim_start().len();
            let (name, _) = line.split_once('=')?;
            let key = name.trim().replace('_', "-");
            (key == setting.name || Some(&*key) == setting.old_key).then_some(start + indent)
        })
}

//! Parses the text of an experiment, with errors that say where a mistake stands.

use super::Experiment;
use crate::input::plain::{home_of, plain};
use crate::settings::response_specs::{ResponseSpec, ResponseSpecs};
use crate::settings::table::GateTable;

impl Experiment {
    /// Parses the text of an experiment. Paths stay as written.
    pub fn parse(text: &str) -> Result<Experiment, ParseError> {
        let mut experiment: Experiment = toml::from_str(text).map_err(|e| {
            let at = e.span().map_or(0, |span| span.start);
            let (line, column) = position(text, at);
            ParseError { line, column, message: plain(e.message(), text, at, home_of) }
        })?;
        let tables = std::mem::take(&mut experiment.response).into_iter().map(|table| table.0);
        let specs: Vec<ResponseSpec> =
            experiment.gate.response.take().map_or(vec![], |specs| specs.0).into_iter().chain(tables).collect();
        experiment.gate.response = (!specs.is_empty()).then_some(ResponseSpecs(specs));
        match experiment.exclusive_keys() {
            None => Ok(experiment),
            Some((first, second, purpose)) => {
                // The error points to the later one.
                let at = [first, second].iter().filter_map(|key| key_offset(text, key)).max();
                let (line, column) = position(text, at.unwrap_or(0));
                Err(ParseError { line, column, message: format!("{first} and {second} both {purpose}: keep one") })
            }
        }
    }

    /// The first two given keys that exclude each other, and what both do.
    fn exclusive_keys(&self) -> Option<(&'static str, &'static str, &'static str)> {
        let GateTable { gate, depth, gates, response, repeat, cw, gate_keys, .. } = &self.gate;
        let (gate, depth, gates) = (("gate", gate.is_some()), ("depth", depth.is_some()), ("gates", gates.is_some()));
        let (keys, cw) = (("gate-keys", gate_keys.is_some()), ("cw", cw.is_some()));
        let (response, repeat) = (("response", response.is_some()), ("repeat", repeat.is_some()));
        let (fov, ortho) = (("fov", self.camera.fov.is_some()), ("ortho", self.camera.ortho.is_some()));
        let (at, frames) = (("at", self.input.at.is_some()), ("frames", self.output.frames.is_some()));
        let (spp, time) = (("spp", self.render.spp.is_some()), ("time", self.render.time.is_some()));
        let pairs = [
            (gate, depth, "set the gate"),
            (gate, gates, "set the gates"),
            (depth, gates, "set the gates"),
            (gate, keys, "set the gate"),
            (depth, keys, "set the gate"),
            (gates, keys, "set the gate"),
            (gate, cw, "say which light counts"),
            (depth, cw, "say which light counts"),
            (gates, cw, "say which light counts"),
            (keys, cw, "say which light counts"),
            (response, cw, "say which light counts"),
            (repeat, cw, "say which light counts"),
            (fov, ortho, "set the view of the camera"),
            (at, frames, "set the time of the scene"),
            (spp, time, "limit the render"),
        ];
        let clash = pairs.into_iter().find(|(first, second, _)| first.1 && second.1);
        clash.map(|(first, second, purpose)| (first.0, second.0, purpose))
    }
}

/// An error in the text of an experiment, with its position: line and column count from 1, columns in characters.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: {message}")]
pub struct ParseError {
    pub line: usize,
    pub column: usize,
    pub message: String,
}

/// Line and column of byte `offset` in `text`. Both count from 1; columns are in characters.
pub(crate) fn position(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |at| at + 1);
    (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
}

/// Offset in bytes of the first line that sets `key` (`key =`), without its indentation; `None` if no line does.
fn key_offset(text: &str, key: &str) -> Option<usize> {
    text.split_inclusive('\n')
        .scan(0, |at, line| {
            let start = *at;
            *at += line.len();
            Some((start, line))
        })
        .find_map(|(start, line)| {
            let indent = line.len() - line.trim_start().len();
            let (name, _) = line.split_once('=')?;
            (name.trim().replace('_', "-") == key).then_some(start + indent)
        })
}

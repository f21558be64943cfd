//! All settings. Each entry gives the key and the flag, the type, the help text, limits, the settings that it excludes, the parts of the
//! program that take it, and the estimators that use it.
//!
//! All other code reads these tables: experiment files, the command line, Python, the viewer, merging, checks and notes.

#![warn(missing_docs)]

mod gate;
mod medium;
mod output;
mod render;
mod scene;

use serde::Serialize;

pub use self::gate::GateTable;
pub use self::medium::MediumTable;
pub use self::output::OutputTable;
pub use self::render::RenderTable;
pub use self::scene::{CameraTable, EmitterTable, InputTable};
use crate::settings::setting::Setting;

/// All settings, in the order of the help text.
pub fn all() -> impl Iterator<Item = &'static Setting> {
    let tables = [
        CameraTable::SETTINGS,
        EmitterTable::SETTINGS,
        InputTable::SETTINGS,
        MediumTable::SETTINGS,
        GateTable::SETTINGS,
        RenderTable::SETTINGS,
        OutputTable::SETTINGS,
    ];
    tables.into_iter().flatten()
}

/// The setting with this name or this old key; `None` if there is none.
pub fn find(name: &str) -> Option<&'static Setting> {
    all().find(|setting| setting.name == name || setting.old_key == Some(name))
}

/// Names of the settings that cannot be given together with the setting `name`.
pub fn excluding(name: &str) -> impl Iterator<Item = &'static str> {
    let own = find(name).map_or(&[][..], |setting| setting.excludes);
    let others = all().filter(move |setting| setting.excludes.contains(&name));
    own.iter().copied().chain(others.map(|setting| setting.name))
}

/// The tables of an experiment on which an image depends.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tables {
    /// `[camera]`
    pub camera: CameraTable,
    /// `[emitter]`
    pub emitter: EmitterTable,
    /// `[gate]`
    pub gate: GateTable,
    /// `[render]`
    pub render: RenderTable,
}

impl Tables {
    /// The tables as TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("tables are plain text and numbers")
    }
}

#[cfg(test)]
mod tests;

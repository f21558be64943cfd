//! The experiment file: the scene and the settings of a render, as TOML. Every key has the name of its flag; some have an old name, too.
//!
//! The same structure also holds the flags of the command line. [`Experiment::over`] merges flags and file. The resolved settings
//! of a render can be printed as an experiment file, which renders the same image again.

mod over;
mod text;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::files::{check_readable, read_error};
use crate::input::light_table::LightTable;
use crate::input::medium_tables::MediumTables;
use crate::input::response_table::ResponseTable;
use crate::input::scan_table::ScanTable;
use crate::settings::setting::{Given, Setting, Value, Visitor};
use crate::settings::table::{CameraTable, EmitterTable, GateTable, InputTable, OutputTable, RenderTable};

pub use text::ParseError;
pub(crate) use text::position;

/// Maximum size of an experiment file in bytes. A real experiment is a page of text, so a larger file is something else.
const MAX_BYTES: u64 = 1 << 20;

/// The settings that the user gave. `None`: the user did not give this setting.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Experiment {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<PathBuf>,
    pub camera: CameraTable,
    pub emitter: EmitterTable,
    pub input: InputTable,
    pub medium: MediumTables,
    pub gate: GateTable,
    pub render: RenderTable,
    pub output: OutputTable,
    /// Lights to add to those of the scene.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub light: Vec<LightTable>,
    /// A laser and a sensor that look at points of a wall, instead of a camera and lights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scan: Option<ScanTable>,
    /// `[[response]]` while a file is read; [`Experiment::parse`] moves it to the end of `gate.response`.
    #[serde(skip_serializing)]
    pub response: Vec<ResponseTable>,
}

impl Experiment {
    /// Reads an experiment file. Relative paths in the file are relative to its folder. An empty file name counts as not given.
    /// Fails if the file cannot be read, is not text, or is not a valid experiment; the message gives line and column.
    pub fn read(path: &Path) -> Result<Experiment> {
        let fail = |message: String| Error::File { path: path.into(), message };
        let length = check_readable(path)?;
        if length > MAX_BYTES {
            return Err(fail(format!(
                "{length} bytes are too many for an experiment; give an experiment (.toml) or a scene (.glb, .gltf)"
            )));
        }
        let bytes = std::fs::read(path).map_err(|e| read_error(path, e))?;
        let text = String::from_utf8(bytes).map_err(|_| {
            fail("this is not text in UTF-8; give an experiment (.toml) or a scene (.glb, .gltf)".into())
        })?;
        let mut experiment = Experiment::parse(&text)
            .map_err(|e| e.mistake.after(&format!("{}:{}:{}: ", path.display(), e.line, e.column)))?;

        experiment.scene.take_if(|name| name.as_os_str().is_empty());
        experiment.visit(&mut WithoutEmptyNames);
        experiment.medium.list.iter_mut().for_each(|table| table.visit(&mut WithoutEmptyNames));
        experiment.take_paths_from(path.parent().unwrap_or(Path::new("")));
        Ok(experiment)
    }

    /// Makes all relative paths relative to `folder`.
    pub(crate) fn take_paths_from(&mut self, folder: &Path) {
        let joined = self.each_path(|file| {
            *file = folder.join(&*file);
            Ok(())
        });
        joined.expect("joining does not fail");
    }

    /// Calls `visitor` with every setting that has a flag. Those of the list `[[medium]]` have none.
    pub fn visit(&mut self, visitor: &mut impl Visitor) {
        let Experiment {
            scene: _,
            camera,
            emitter,
            input,
            gate,
            render,
            output,
            medium,
            light: _,
            scan: _,
            response: _,
        } = self;
        camera.visit(visitor);
        emitter.visit(visitor);
        input.visit(visitor);
        medium.one.visit(visitor);
        gate.visit(visitor);
        render.visit(visitor);
        output.visit(visitor);
    }

    /// The settings with a flag that the user gave, in the order of the tables.
    pub(crate) fn given(&self) -> Vec<&'static Setting> {
        let mut given = Given::default();
        self.clone().visit(&mut given);
        given.0
    }

    /// Calls `look` with every path, up to the first error.
    pub(crate) fn each_path(&mut self, mut look: impl FnMut(&mut PathBuf) -> Result<()>) -> Result<()> {
        struct Paths<F>(F, Result<()>);
        impl<F: FnMut(&mut PathBuf) -> Result<()>> Visitor for Paths<F> {
            fn visit<T: Value>(&mut self, _: &'static Setting, slot: &mut Option<T>) {
                for path in slot.iter_mut().flat_map(T::paths) {
                    if self.1.is_ok() {
                        self.1 = (self.0)(path);
                    }
                }
            }
        }
        self.scene.as_mut().map_or(Ok(()), &mut look)?;
        let mut paths = Paths(look, Ok(()));
        self.visit(&mut paths);
        self.medium.list.iter_mut().for_each(|table| table.visit(&mut paths));
        let Paths(mut look, done) = paths;
        done?;
        self.scan.iter_mut().flat_map(ScanTable::paths).try_for_each(&mut look)
    }

    /// Fails if a path is not UTF-8, because images and printed experiments store paths as text.
    pub fn check_paths(&self) -> Result<()> {
        self.clone().each_path(|path| match path.to_str() {
            Some(_) => Ok(()),
            None => Err(Error::File { path: path.clone(), message: "this name is not UTF-8; rename it".into() }),
        })
    }

    /// The files that the settings name, beside the scene and the outputs: grids, tables, the image of the sky.
    pub fn input_files(&self) -> Vec<PathBuf> {
        self.input_paths().into_iter().filter(|path| path.is_file()).collect()
    }

    /// All paths that the settings name, beside the scene and the outputs. They need not exist.
    pub fn input_paths(&self) -> Vec<PathBuf> {
        let mut inputs = Experiment { scene: None, output: OutputTable::default(), ..self.clone() };
        let mut paths = vec![];
        let collected = inputs.each_path(|path| {
            paths.push(path.clone());
            Ok(())
        });
        collected.expect("collecting does not fail");
        paths
    }

    /// Makes all paths absolute. Fails if there is no current folder, or if a path is not UTF-8.
    pub fn with_absolute_paths(mut self) -> Result<Experiment> {
        self.each_path(|path| {
            *path = std::path::absolute(&*path).map_err(|e| read_error(path, e))?;
            Ok(())
        })?;
        self.check_paths()?;
        Ok(self)
    }

    /// The experiment as TOML.
    ///
    /// # Panics
    /// If a path is not UTF-8, see [`Experiment::check_paths`].
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("an experiment is plain text, numbers and tables")
    }
}

/// Removes empty file names. A setting without another name becomes `None`.
struct WithoutEmptyNames;

impl Visitor for WithoutEmptyNames {
    fn visit<T: Value>(&mut self, _: &'static Setting, slot: &mut Option<T>) {
        *slot = slot.take().and_then(T::without_empty_names);
    }
}

#[cfg(test)]
mod tests;

//! Files that belong together: an array (`.npy`), its variances and depths, and the JSON file that describes them. A set appears
//! whole: the new files are written under temporary names; then the old JSON file goes, the arrays take their places, and the new
//! JSON file comes last. So a JSON file never lies beside an array of another render, even if the disk is full or the process is
//! killed.
//!
//! The JSON file records the size and the CRC-32 of each array, which every reader checks. Files of earlier versions lack the record.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crc32fast::Hasher;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{Error, Result};
use crate::files::{UnpublishedFile, check_readable, read_error, remove, write_unpublished};
use crate::image::npy_file::{depth_path, description_path, header, variance_path, velocity_path};
use crate::image::scan_layers::layers_path;

/// The array of a set, and the arrays beside it that not every set has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    Array,
    Variance,
    Depth,
    /// Auxiliary layers of a scan.
    Layers,
    /// Velocities of the light of a scan.
    Velocity,
}

impl Role {
    const ALL: [Role; 5] = [Role::Array, Role::Variance, Role::Depth, Role::Layers, Role::Velocity];

    /// The key of the array in `files` of the JSON file.
    pub fn key(self) -> &'static str {
        match self {
            Role::Array => "array",
            Role::Variance => "variance",
            Role::Depth => "depth",
            Role::Layers => "aov",
            Role::Velocity => "velocity",
        }
    }

    /// The file of this role in the set of the array `path`.
    pub fn path(self, path: &Path) -> PathBuf {
        match self {
            Role::Array => path.into(),
            Role::Variance => variance_path(path),
            Role::Depth => depth_path(path),
            Role::Layers => layers_path(path),
            Role::Velocity => velocity_path(path),
        }
    }
}

/// Size and check sum of a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Check {
    bytes: u64,
    /// CRC-32 of the file as eight hexadecimal digits, as `zlib.crc32` of Python computes it.
    crc32: String,
}

impl Check {
    fn of(bytes: &[u8]) -> Check {
        let mut hasher = Hasher::new();
        hasher.update(bytes);
        Check::new(bytes.len() as u64, hasher)
    }

    fn new(bytes: u64, hasher: Hasher) -> Check {
        Check { bytes, crc32: format!("{:08x}", hasher.finalize()) }
    }
}

/// A set whose arrays lie on disk under temporary names.
pub struct ArraySet {
    path: PathBuf,
    arrays: Vec<(Role, UnpublishedFile, Check)>,
}

impl ArraySet {
    /// An empty set. `path` is the name of its array.
    pub fn new(path: &Path) -> ArraySet {
        ArraySet { path: path.into(), arrays: vec![] }
    }

    /// Writes an array of 32-bit floats in C order under a temporary name. `values` are as many as `shape` says.
    pub fn add(&mut self, role: Role, shape: &[usize], values: impl IntoIterator<Item = f32>) -> Result<()> {
        self.add_with(role, |writer| {
            writer.write_all(&header("<f4", shape))?;
            values.into_iter().try_for_each(|value| writer.write_all(&value.to_le_bytes()))
        })
    }

    /// Writes an array under a temporary name; `write` writes its `.npy` file.
    pub fn add_with(&mut self, role: Role, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
        let mut check = None;
        let unpublished = write_unpublished(&role.path(&self.path), |writer| {
            let mut writer = Checked { writer, hasher: Hasher::new(), bytes: 0 };
            write(&mut writer)?;
            check = Some(Check::new(writer.bytes, writer.hasher));
            Ok(())
        })?;
        self.arrays.push((role, unpublished, check.expect("the array was written")));
        Ok(())
    }

    /// Replaces the files of an earlier set. `description` becomes the JSON file, with the record of the arrays added. After an
    /// error, either all files are as before, or the set has no JSON file.
    pub fn publish(self, description: &impl Serialize) -> Result<()> {
        self.steps(description)?.into_iter().try_for_each(Step::run)
    }

    /// The steps of [`ArraySet::publish`], in order. After each of them, no two files that lie together are of different renders.
    fn steps(self, description: &impl Serialize) -> Result<Vec<Step>> {
        let files: serde_json::Map<String, Value> = (self.arrays.iter())
            .map(|(role, _, check)| (role.key().into(), serde_json::to_value(check).expect("a check has plain fields")))
            .collect();
        let json = description_path(&self.path);
        let text = Recorded { description, files };
        let unpublished = write_unpublished(&json, |writer| Ok(serde_json::to_writer_pretty(writer, &text)?))?;

        let mut stale = stale_arrays(&self.path);
        stale.extend(self.arrays.iter().map(|(role, ..)| role.path(&self.path)).filter(|path| *path != self.path));
        let mut steps = vec![Step::Remove(json)];
        steps.extend(stale.into_iter().map(Step::Remove));
        // The array replaces the earlier one, so it must come before the new arrays beside it.
        let mut arrays = self.arrays;
        arrays.sort_by_key(|(role, ..)| *role != Role::Array);
        steps.extend(arrays.into_iter().map(|(_, unpublished, _)| Step::Publish(unpublished)));
        steps.push(Step::Publish(unpublished));
        Ok(steps)
    }
}

enum Step {
    Remove(PathBuf),
    Publish(UnpublishedFile),
}

impl Step {
    fn run(self) -> Result<()> {
        match self {
            Step::Remove(path) => remove(&path),
            Step::Publish(unpublished) => unpublished.publish(),
        }
    }
}

/// The JSON file of a set.
#[derive(Serialize)]
struct Recorded<'a, T: Serialize> {
    #[serde(flatten)]
    description: &'a T,
    files: serde_json::Map<String, Value>,
}

/// Computes the check of the bytes that it passes on.
struct Checked<'a> {
    writer: &'a mut BufWriter<File>,
    hasher: Hasher,
    bytes: u64,
}

impl Write for Checked<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.writer.write(bytes)?;
        self.hasher.update(&bytes[..written]);
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

/// The variances and depths of an earlier array of this name, which a new array without them must not keep. The JSON file beside the
/// earlier array tells whether it had them. Without that file, arrays with these names belong to somebody else.
fn stale_arrays(path: &Path) -> Vec<PathBuf> {
    let earlier = description(path);
    let is_recorded = |role: Role| earlier["files"].get(role.key()).is_some();
    // Earlier versions recorded no files.
    let is_ours = earlier["unit"].is_string() && earlier["shape"].is_array();
    let settings = earlier["settings"].as_str().and_then(|text| text.parse::<toml::Table>().ok());
    let is_wave = settings.is_some_and(|settings| settings.get("gate").is_some_and(|gate| gate.get("cw").is_some()));
    let stale =
        [(Role::Variance, is_ours), (Role::Depth, is_ours && is_wave), (Role::Layers, false), (Role::Velocity, false)];
    stale.into_iter().filter(|(role, is_old)| *is_old || is_recorded(*role)).map(|(role, _)| role.path(path)).collect()
}

/// The JSON file beside the array `path`; null without one.
pub fn description(path: &Path) -> Value {
    let text = std::fs::read(description_path(path)).unwrap_or_default();
    serde_json::from_slice(&text).unwrap_or_default()
}

/// Removes what the JSON file of a set says about its arrays, and about the layers of a scan.
pub fn forget_arrays(description: &mut serde_json::Map<String, Value>) {
    ["files", "aov", "objects"].into_iter().for_each(|key| drop(description.remove(key)));
}

/// The file `role` of the set of the array `path`, if it exists. Without a JSON file there is no set. If the JSON file has a record of the
/// arrays, the file must be in the record; otherwise it belongs to somebody else.
pub fn beside(path: &Path, role: Role) -> Option<PathBuf> {
    let description = description(path);
    let is_recorded = description["files"].as_object().is_none_or(|files| files.contains_key(role.key()));
    Some(role.path(path)).filter(|path| description.is_object() && is_recorded && path.exists())
}

/// The names of all files that the set of the array `path` may have.
pub fn names(path: &Path) -> Vec<PathBuf> {
    Role::ALL.into_iter().map(|role| role.path(path)).chain([description_path(path)]).collect()
}

/// Fails if the JSON file of a set describes other contents of the array `path` than `bytes`. An array without a JSON file, or
/// without a record in it, passes.
pub fn check(path: &Path, bytes: &[u8]) -> Result<()> {
    let Some((json, role)) = set_of(path) else { return Ok(()) };
    let of_file = |path: PathBuf| std::fs::read(path).ok().and_then(|text| serde_json::from_slice::<Value>(&text).ok());
    let Some(recorded) = of_file(json.clone()).and_then(|all| all.get("files")?.get(role.key()).cloned()) else {
        return Ok(());
    };
    if serde_json::from_value::<Check>(recorded).is_ok_and(|recorded| recorded == Check::of(bytes)) {
        return Ok(());
    }
    let message = format!(
        "does not belong to {}, because one of the two was changed or replaced; write both again, or remove the JSON file to read the array without it",
        json.display()
    );
    Err(Error::File { path: path.into(), message })
}

/// The result of `read`, which reads files of the set of the array `path`. Fails if another process replaces the set meanwhile.
pub fn read_whole<T>(path: &Path, read: impl FnOnce() -> Result<T>) -> Result<T> {
    let before = description(path);
    let result = read()?;
    match description(path) == before {
        true => Ok(result),
        false => Err(Error::File {
            path: path.into(),
            message: "was replaced while it was read; read it again when the process that writes it has ended".into(),
        }),
    }
}

/// Fails as [`check`] does, for each file of the set of the array `path`.
pub fn check_files(path: &Path) -> Result<()> {
    for file in Role::ALL.into_iter().filter_map(|role| beside(path, role)) {
        check_readable(&file)?;
        check(&file, &std::fs::read(&file).map_err(|e| read_error(&file, e))?)?;
    }
    Ok(())
}

/// The JSON file of the set that the array `path` is in, and its role there; `None` without such a file. A file that is recorded beside
/// another array belongs to that array, even if it has a JSON file of its own name.
fn set_of(path: &Path) -> Option<(PathBuf, Role)> {
    let beside_another = || {
        let stem = Path::new(path.file_stem()?);
        let is_of = |role: &Role| stem.extension().is_some_and(|extension| extension == role.key());
        let role = Role::ALL.into_iter().filter(|role| *role != Role::Array).find(is_of)?;
        let array = path.with_file_name(stem).with_extension("npy");
        let is_recorded = description(&array)["files"].get(role.key()).is_some();
        is_recorded.then(|| (description_path(&array), role))
    };
    let own = || Some(description_path(path)).filter(|own| own.exists()).map(|own| (own, Role::Array));
    beside_another().or_else(own)
}

#[cfg(test)]
mod tests;

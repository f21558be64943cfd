//! Reads glTF 2.0 into a [`Scene`](super::Scene). Only this module and its submodules know glTF.
//!
//! The `gltf` crate only parses the JSON: its readers panic or return garbage on hostile files. So this module checks every
//! index, size and number of the JSON structs itself. A file that loads has all the properties that [`crate::scene`] demands. Any
//! other file gives an error that names the offending part and the remedy.

mod accessor;
mod camera;
mod document;
mod image;
mod light;
mod material;
mod mesh;
mod node;
mod resolve;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use super::check::is_singular;
use super::{Instance, Scene};
use crate::error::{Error, Result};
use document::{Document, Warnings};

/// The error is one sentence that says why a file cannot be loaded; [`load`] adds the path.
type Checked<T> = std::result::Result<T, String>;

/// Loads the scene from a `.glb` or `.gltf` file. Files that it refers to must lie in the folder of `path` or below.
pub fn load(path: &Path) -> Result<Scene> {
    let bytes = resolve::read_file(path).map_err(|message| Error::Scene { path: path.into(), message })?;
    load_slice(&bytes, path)
}

/// The bytes of the scene's file, then of the external buffers and images that it names, in its order. A missing external file
/// gives an empty entry: [`load`] reports it. Fails if the scene's file cannot be read.
pub fn files(path: &Path) -> Result<Vec<Vec<u8>>> {
    let wrong = |message: String| Error::Scene { path: path.into(), message };
    let bytes = resolve::read_file(path).map_err(wrong)?;
    let mut all = catch_unwind(AssertUnwindSafe(|| resolve::external(&bytes, folder_of(path)))).unwrap_or_default();
    all.insert(0, bytes);
    Ok(all)
}

/// Paths of the scene's file and of the external buffers and images that it names; only its own path if the file cannot be read.
pub fn paths(path: &Path) -> Vec<PathBuf> {
    let named = || Some(resolve::external_paths(&resolve::read_file(path).ok()?, folder_of(path)));
    let mut all = catch_unwind(AssertUnwindSafe(named)).ok().flatten().unwrap_or_default();
    all.insert(0, path.into());
    all
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Loads the scene from the bytes of a `.glb` or `.gltf` file. `path` serves messages and relative URIs.
pub fn load_slice(bytes: &[u8], path: &Path) -> Result<Scene> {
    let folder = folder_of(path);
    // A panic here is a defect of this reader or of a decoder. Report it as an error: the user can at least change the file.
    catch_unwind(AssertUnwindSafe(|| read(bytes, folder)))
        .unwrap_or_else(|_| Err("the glTF reader failed on this file; re-export it, and report the file".into()))
        .map_err(|message| Error::Scene { path: path.into(), message })
}

/// Turns the bytes into a scene.
fn read(bytes: &[u8], folder: &Path) -> Checked<Scene> {
    let mut warnings = Warnings::default();
    let doc = Document::open(bytes, folder)?;
    doc.check_extensions(&mut warnings)?;
    doc.warn_of_media(&mut warnings);

    let worlds = node::world_transforms(&doc)?;
    let mut materials = material::load(&doc, &mut warnings)?;
    let meshes = mesh::load(&doc, &worlds, &mut materials, &mut warnings)?;
    let instances = place(&doc, &worlds, &meshes, &mut warnings)?;
    if instances.is_empty() {
        return Err(meshes.nothing_to_render());
    }

    let cameras = camera::load(&doc, &worlds, &mut warnings)?;
    let lights = light::load(&doc, &worlds)?;
    let images = image::load(&doc, folder, &materials.images, &mut warnings)?;
    let scene = Scene {
        meshes: meshes.meshes,
        instances,
        materials: materials.materials,
        textures: materials.textures,
        images,
        cameras,
        lights,
        warnings: warnings.list,
    };
    scene.checked()?;
    Ok(scene)
}

/// One instance per primitive of each node's mesh, in the order of the nodes.
fn place(
    doc: &Document,
    worlds: &node::Worlds,
    meshes: &mesh::Meshes,
    warnings: &mut Warnings,
) -> Checked<Vec<Instance>> {
    let mut instances = Vec::new();
    let mut triangles = 0u64;
    for (index, transform) in worlds.iter() {
        let Some(range) = doc.root.nodes.get(index).and_then(|node| meshes.of(node.mesh?.value())) else { continue };
        let name = doc.node_name(index);
        if is_singular(&transform) {
            warnings.once("singular", || format!("node `{name}` is scaled to nothing, so its mesh is left out"));
            continue;
        }
        for mesh in range {
            triangles += meshes.meshes[mesh].triangles.len() as u64;
            if triangles > mesh::MAX_TRIANGLES {
                return Err(format!(
                    "the scene has more than {} million triangles, instances included; simplify it or split it",
                    mesh::MAX_TRIANGLES >> 20
                ));
            }
            instances.push(Instance { mesh: mesh as u32, transform, node: name.clone() });
        }
    }
    Ok(instances)
}

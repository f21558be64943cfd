//! Reads glTF 2.0 into a [`Scene`](super::Scene). Only this module and its submodules know glTF.
//!
//! The `gltf` crate only parses the JSON: its readers panic or return garbage on hostile files. So this module checks every
//! index, size and number of the JSON structs itself. A file that loads has all the properties that [`crate::scene`] demands. Any
//! other file gives an error that names the offending part and the remedy.

mod accessor;
mod animation;
mod camera;
mod clean;
mod compressed;
mod decoder;
mod document;
mod draco;
mod extension;
mod extras;
mod flat;
mod image;
mod instancing;
mod jpeg;
mod light;
mod lists;
mod material;
mod material_extension;
mod medium;
mod mesh;
mod meshopt;
mod morph;
mod node;
mod place;
mod pose;
mod resolve;
mod retroreflector;
mod root;
mod source;
mod text;
mod texture;
mod texture_use;
mod thin_glass;
mod volume;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use super::Scene;
use crate::error::{Error, Result};
pub use animation::{Playback, ROUNDING};
use document::{Document, Warnings, label};
pub use medium::from_json as medium_from_json;
use resolve::Folders;

/// The error is one sentence that says why a file cannot be loaded; [`load`] adds the path.
type Checked<T> = std::result::Result<T, String>;

/// Loads the scene from a `.glb` or `.gltf` file. Files that it refers to must lie in the folder of `path` or below.
pub fn load(path: &Path) -> Result<Scene> {
    load_with(path, &[], Playback::default())
}

/// Loads the scene from a `.glb` or `.gltf` file. Files that it refers to must lie in the folder of `path`, in one of the folders
/// `allowed`, or below one of these. Symbolic links are followed first, so that no link leads elsewhere. The nodes have the pose of
/// `playback`.
pub fn load_with(path: &Path, allowed: &[PathBuf], playback: Playback) -> Result<Scene> {
    if let Some(wrong) = allowed.iter().find(|folder| !folder.is_dir()) {
        let message = "is not a folder; check --allow-path".into();
        return Err(Error::File { path: wrong.clone(), message });
    }
    let bytes = resolve::read_file(path).map_err(|message| Error::Scene { path: path.into(), message })?;
    load_from(&bytes, path, allowed, playback)
}

/// Fails as [`load_with`] does if the nodes of the file have no pose at the time of `playback`. Reads neither meshes nor images.
pub fn check_pose(path: &Path, allowed: &[PathBuf], playback: Playback) -> Result<()> {
    let bytes = resolve::read_file(path).map_err(|message| Error::Scene { path: path.into(), message })?;
    guarded(path, || {
        let mut doc = Document::open(&bytes, Folders::new(path, allowed))?;
        animation::pose(&mut doc, playback, &mut Warnings::default()).map(drop)
    })
}

/// The bytes of the scene's file, then of the external buffers and images that it names, in the order of the file. A missing
/// external file gives an empty entry: [`load`] reports it. Fails if the scene's file cannot be read.
pub fn files(path: &Path) -> Result<Vec<Vec<u8>>> {
    let wrong = |message: String| Error::Scene { path: path.into(), message };
    let bytes = resolve::read_file(path).map_err(wrong)?;
    let mut all =
        catch_unwind(AssertUnwindSafe(|| resolve::external(&bytes, Folders::new(path, &[])))).unwrap_or_default();
    all.insert(0, bytes);
    Ok(all)
}

/// Paths of the scene's file and of the external buffers and images that it names; only its own path if the file cannot be read.
/// `allowed` has the same meaning as in [`load_with`].
pub fn paths(path: &Path, allowed: &[PathBuf]) -> Vec<PathBuf> {
    let named = || Some(resolve::external_paths(&resolve::read_file(path).ok()?, Folders::new(path, allowed)));
    let mut all = catch_unwind(AssertUnwindSafe(named)).ok().flatten().unwrap_or_default();
    all.insert(0, path.into());
    all
}

/// Loads the scene from the bytes of a `.glb` or `.gltf` file. `path` appears in messages, and relative URIs start from its folder.
pub fn load_slice(bytes: &[u8], path: &Path) -> Result<Scene> {
    load_from(bytes, path, &[], Playback::default())
}

/// As [`load_slice`], with the nodes in the pose of `playback`.
pub fn load_slice_at(bytes: &[u8], path: &Path, playback: Playback) -> Result<Scene> {
    load_from(bytes, path, &[], playback)
}

fn load_from(bytes: &[u8], path: &Path, allowed: &[PathBuf], playback: Playback) -> Result<Scene> {
    let folders = Folders::new(path, allowed);
    guarded(path, || read(bytes, folders, playback))
}

/// The result of `read`. An error gets the path of the file.
fn guarded<T>(path: &Path, read: impl FnOnce() -> Checked<T>) -> Result<T> {
    // A panic here is a defect of this reader or of a decoder. Report it as an error: the user can at least change the file.
    catch_unwind(AssertUnwindSafe(read))
        .unwrap_or_else(|_| Err("the glTF reader failed on this file; re-export it, and report the file".into()))
        .map_err(|message| Error::Scene { path: path.into(), message })
}

/// Maximum number of nodes that a message names.
const MAX_SHOWN_NODES: usize = 12;

/// Time in seconds, place in metres and rotation of a node.
pub type Pose = (f64, DVec3, DQuat);

/// Poses of the node `name` in world space, at `steps` + 1 evenly spaced times from 0 to the end of the animations, or of the animation
/// `animation`. Scales are left out. Fails as [`load_with`] does if an animation is not valid, and if there is no such node or no animation.
pub fn poses(
    path: &Path,
    allowed: &[PathBuf],
    animation: Option<&str>,
    name: &str,
    steps: impl Fn(f64) -> u32,
) -> Result<Vec<Pose>> {
    let bytes = resolve::read_file(path).map_err(|message| Error::Scene { path: path.into(), message })?;
    guarded(path, || {
        let mut doc = Document::open(&bytes, Folders::new(path, allowed))?;
        let Some(end) = animation::end(&doc, animation)? else {
            return Err("has no animations, so no node moves".into());
        };
        let nodes = 0..doc.root.nodes.len();
        let index = nodes.clone().find(|&index| doc.node_name(index) == name);
        let index = index.ok_or_else(|| {
            let shown: Vec<String> = nodes.clone().map(|index| doc.node_name(index)).take(MAX_SHOWN_NODES).collect();
            let rest = if nodes.len() > shown.len() { ", ..." } else { "" };
            format!("has no node '{name}'; its nodes are {}{rest}", shown.join(", "))
        })?;
        let steps = steps(end).max(1);
        let pose = |step: u32| {
            let time = end * f64::from(step) / f64::from(steps);
            animation::pose(&mut doc, Playback { at: Some(time), animation }, &mut Warnings::default())?;
            let world = node::world_transforms(&doc)?.get(index);
            let world = world.ok_or_else(|| format!("has the node '{name}', but not in its scene"))?;
            let (_, rotation, place) = world.to_scale_rotation_translation();
            Ok((time, place, rotation))
        };
        (0..=steps).map(pose).collect()
    })
}

/// Time in seconds of the last key of the animations in the file, or of the animation `name`. `None` if no animation moves a node.
/// Fails as [`load_with`] does if an animation is not valid. Reads neither meshes nor images.
pub fn end_of_animations(path: &Path, allowed: &[PathBuf], name: Option<&str>) -> Result<Option<f64>> {
    let bytes = resolve::read_file(path).map_err(|message| Error::Scene { path: path.into(), message })?;
    guarded(path, || animation::end(&Document::open(&bytes, Folders::new(path, allowed))?, name))
}

/// Turns the bytes into a scene.
fn read(bytes: &[u8], folders: Folders, playback: Playback) -> Checked<Scene> {
    let mut warnings = Warnings::default();
    let mut doc = Document::open(bytes, folders)?;
    extension::check(&doc, &mut warnings)?;
    if let Some(mesh) = doc.first_mesh_morphing_colors {
        let name = label(doc.root.meshes.get(mesh).and_then(|mesh| mesh.name.as_deref()), "mesh", mesh);
        warnings.push(format!("morph targets move no colours and no texture coordinates (first: mesh `{name}`)"));
    }
    let moving = animation::pose(&mut doc, playback, &mut warnings)?;
    let media = medium::load(&doc, &mut warnings)?;

    let worlds = node::world_transforms(&doc)?;
    let is_used = material::used(&doc, &worlds);
    let mut materials = material::load(&doc, &is_used, &mut warnings)?;
    medium::add_interiors(&doc, &is_used, &mut materials.materials, &mut warnings)?;
    let mut meshes = mesh::load(&doc, &worlds, &mut materials, &mut warnings)?;
    let instances = place::place(&doc, &worlds, &mut meshes, &mut materials, &mut warnings)?;
    if instances.is_empty() && media.is_empty() {
        warnings.push(meshes.nothing_to_render());
    }

    let (cameras, unusable_cameras) = camera::load(&doc, &worlds, &mut warnings);
    let (lights, lights_off) = light::load(&doc, &worlds, &mut warnings)?;
    let images = image::load(&doc, folders, &materials.textures.images, &mut warnings)?;
    material::darken(&mut materials, &images);
    let scene = Scene {
        meshes: meshes.meshes,
        instances,
        materials: materials.materials,
        textures: materials.textures.list,
        images,
        cameras,
        unusable_cameras,
        lights,
        lights_off,
        media,
        moving,
        warnings: warnings.list,
        ..Scene::default()
    };
    scene.checked()?;
    Ok(scene)
}

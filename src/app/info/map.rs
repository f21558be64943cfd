//! `taugate info --map`: when the first light arrives in each pixel, as a picture or as numbers.

use std::path::PathBuf;

use serde::Serialize;
use taugate::internals::files::check_writable;
use taugate::internals::gpu::Device;
use taugate::internals::image::arrival_map::{ArrivalMap, arrival_map};
use taugate::internals::image::exr_file;
use taugate::internals::image::layers::{Layers, Plane};
use taugate::internals::image::png_file;
use taugate::internals::render::{PreparedScene, first_arrivals};
use taugate::internals::scene::Scene;
use taugate::internals::settings::Settings;
use taugate::{Error, Result};

use super::{Arrival, arrival};

/// The maps that were written, and their scale.
#[derive(Serialize)]
pub struct Map {
    pub files: Vec<PathBuf>,
    pub pixels: usize,
    pub lit_pixels: usize,
    /// None if no pixel has light.
    pub scale: Option<Scale>,
}

/// Travel times of the colour scale. Their `percent` is the percentage of the lit pixels that have light by this time.
#[derive(Serialize)]
pub struct Scale {
    /// First arrival over all pixels: dark blue.
    pub first: Arrival,
    /// Time by which 99 % of the lit pixels have light: yellow, like everything later.
    pub end: Arrival,
    pub last: Arrival,
}

/// Fails if a map has the wrong extension or cannot be written. Call it first, because the measurement may take minutes.
pub fn check(files: &[PathBuf]) -> Result<()> {
    files.iter().try_for_each(|path| match extension(path).as_str() {
        "png" | "exr" => check_writable(path),
        _ => Err(Error::settings(format!("the map {} must end in .png or .exr", path.display()))),
    })
}

fn extension(path: &std::path::Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// Measures the arrivals and writes the maps.
pub fn write(
    files: &[PathBuf],
    device: &Device,
    scene: &Scene,
    settings: &Settings,
    prepared: &PreparedScene,
) -> Result<Map> {
    let arrivals = first_arrivals(device, scene, settings, prepared)?;
    let (pixels, map, crop) = (arrivals.len(), arrival_map(&arrivals), settings.crop());
    let layers = Layers { channels: vec![("arrival.Z".into(), Plane::Floats(arrivals))], ..Layers::default() };
    for path in files {
        if extension(path) == "exr" {
            exr_file::write_layers(path, settings.resolution(), crop, &layers)?;
        } else {
            let black = vec![0; 3 * pixels];
            let bytes = map.as_ref().map_or(&black, |map| &map.bytes);
            png_file::write_bytes(path, crop.width(), crop.height(), bytes)?;
        }
    }
    let lit_pixels = map.as_ref().map_or(0, |map| map.lit);
    Ok(Map { files: files.to_vec(), pixels, lit_pixels, scale: map.map(scale) })
}

fn scale(ArrivalMap { scale: [first, end], last, .. }: ArrivalMap) -> Scale {
    let at = |percent: f64, metres: f32| arrival(percent, metres.into());
    Scale { first: at(0.0, first), end: at(99.0, end), last: at(100.0, last) }
}

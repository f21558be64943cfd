//! Images: accumulation, files, and fingerprints of everything that a result depends on.

pub mod accumulation;
pub mod array_set;
pub mod arrival_map;
pub mod batches;
mod brightness_layers;
pub mod channels;
pub mod depth;
pub mod exr_file;
pub mod exr_header;
pub mod exr_responses;
pub mod film;
pub mod fingerprint;
pub mod layers;
mod moments;
pub mod npy_file;
pub mod npy_read;
pub mod png_file;
pub mod response_film;
pub mod scan_file;
pub mod scan_layers;
pub mod time_plot;

/// Rec. 709 luminance. Emitters are selected in proportion to it; any positive weight keeps the estimate unbiased.
pub fn luminance(c: [f32; 3]) -> f64 {
    0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2])
}

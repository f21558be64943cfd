//! Refuses work whose images or other large arrays do not fit into the free memory of this machine.

use crate::error::{Error, Result};
pub use crate::free_memory::free;
use crate::image::response_film::ResponseFilm;
use crate::settings::Settings;

const GIB: f64 = (1u64 << 30) as f64;

/// The data that a render needs in host memory for the images of several gates, besides their sums.
#[derive(Debug, Clone, Copy)]
pub struct ImageParts {
    /// Sums of squares, for variances.
    pub variance: bool,
    /// The channels of an image file (.exr).
    pub exr: bool,
}

impl ImageParts {
    /// Bytes of host memory for the images of `count` gates.
    fn bytes(self, pixels: u64, count: u64) -> u64 {
        let film = ResponseFilm::bytes(pixels, count, self.variance);
        // Before an image file is written, all its channels are in memory as numbers of half the size.
        film.saturating_add(if self.exr { film / 2 } else { 0 })
    }
}

/// Fails if the images of several gates need more than `free` bytes, the memory that was free before these images existed. Does nothing for
/// a single gate, or if `free` is `None`.
pub fn check(settings: &Settings, parts: ImageParts, free: Option<u64>) -> Result<()> {
    let count = settings.responses().len();
    let Some(free) = free.filter(|_| count > 1) else { return Ok(()) };
    let crop = settings.crop();
    let pixels = u64::from(crop.width()) * u64::from(crop.height());
    let needed = parts.bytes(pixels, count as u64);
    if needed <= free {
        return Ok(());
    }
    Err(Error::advice(
        format!(
            "the images of {count} gates of {}x{} pixels need {:.1} GiB of memory, but only {:.1} GiB are free; ",
            crop.width(),
            crop.height(),
            needed as f64 / GIB,
            free as f64 / GIB
        ),
        "use fewer gates, a smaller --resolution, or --crop",
    ))
}

/// Fails if `bytes` is more than `free`, the bytes of free memory. Does nothing if `free` is `None`. The message says
/// that `what` needs this memory; `remedy` says how to need less.
pub fn check_bytes(bytes: u64, free: Option<u64>, what: &str, remedy: &str) -> Result<()> {
    match free.filter(|free| bytes > *free) {
        Some(free) => Err(Error::settings(format!(
            "{what} needs {:.1} GiB of memory, but only {:.1} GiB are free; {remedy}",
            bytes as f64 / GIB,
            free as f64 / GIB
        ))),
        None => Ok(()),
    }
}

/// As [`free`], plus `bytes` that the caller will drop or use again.
pub fn free_without(bytes: u64) -> Option<u64> {
    Some(free()?.saturating_add(bytes))
}

#[cfg(test)]
mod tests {
    use crate::settings::gates::Gates;

    use super::*;

    #[test]
    fn images_of_many_gates_need_room_for_their_file_too() {
        let gates: Gates = "5m..8m/30".parse().unwrap();
        let settings = Settings::builder().resolution([100, 100]).responses(gates).build().unwrap();
        let check = |parts: ImageParts, free| check(&settings, parts, Some(free)).map_err(|e| e.to_string());
        // 8 bytes for each sum and each square of 3 channels, and 4 bytes for each mean and variance in the file.
        for (parts, bytes) in [
            (ImageParts { variance: false, exr: false }, 7_200_000),
            (ImageParts { variance: true, exr: false }, 14_400_000),
            (ImageParts { variance: true, exr: true }, 21_600_000),
        ] {
            assert_eq!(check(parts, bytes), Ok(()), "{parts:?}");
            assert!(check(parts, bytes - 1).unwrap_err().contains("the images of 30 gates"), "{parts:?}");
        }
    }

    /// The images of the previous frame of a sequence are still in memory when the next frame is checked.
    #[test]
    #[cfg(target_os = "linux")]
    fn images_that_will_be_dropped_count_as_free() {
        let [without, with] = [0, 1 << 40].map(|bytes| free_without(bytes).unwrap());
        assert!(with > without + (1 << 39), "{with} {without}");
    }
}

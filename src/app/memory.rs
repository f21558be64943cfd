//! Refuses renders whose images do not fit into the memory of this machine.

use taugate::Error;
use taugate::internals::error::Result;
use taugate::internals::image::response_film::ResponseFilm;
use taugate::internals::settings::Settings;

const GIB: f64 = (1u64 << 30) as f64;

/// Fails if the images of several gates need more memory than was `free` before any of them was in memory. Does nothing if this is not
/// known.
pub fn check(settings: &Settings, has_variance: bool, free: Option<u64>) -> Result<()> {
    let count = settings.responses().len();
    let Some(free) = free.filter(|_| count > 1) else { return Ok(()) };
    let crop = settings.crop();
    let pixels = u64::from(crop.width()) * u64::from(crop.height());
    let needed = ResponseFilm::bytes(pixels, count as u64, has_variance);
    if needed <= free {
        return Ok(());
    }
    Err(Error::Settings(format!(
        "the images of {count} gates of {}x{} pixels need {:.1} GiB of memory, but only {:.1} GiB are free; use fewer gates, \
         a smaller --resolution, or --crop",
        crop.width(),
        crop.height(),
        needed as f64 / GIB,
        free as f64 / GIB
    )))
}

/// Fails if fewer than `bytes` were `free`. The message says that `what` needs this memory; `remedy` says how to need less.
pub fn check_bytes(bytes: u64, free: Option<u64>, what: &str, remedy: &str) -> Result<()> {
    match free.filter(|free| bytes > *free) {
        Some(free) => Err(Error::Settings(format!(
            "{what} needs {:.1} GiB of memory, but only {:.1} GiB are free; {remedy}",
            bytes as f64 / GIB,
            free as f64 / GIB
        ))),
        None => Ok(()),
    }
}

/// Bytes that programs can still allocate, as Linux estimates them; `None` if the operating system does not report them.
pub fn free() -> Option<u64> {
    free_in(&std::fs::read_to_string("/proc/meminfo").ok()?)
}

fn free_in(table: &str) -> Option<u64> {
    let line = table.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kibibytes.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_memory_is_read_from_the_table_of_linux() {
        assert_eq!(free_in("MemTotal:  100 kB\nMemAvailable:   24000 kB\n"), Some(24_576_000));
        assert_eq!(free_in("MemTotal: 100 kB\n"), None);
        assert_eq!(free_in("MemAvailable: many kB\n"), None);
    }
}

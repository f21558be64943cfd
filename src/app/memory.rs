//! Refuses work whose images or other large arrays do not fit into the free memory of this machine.

use std::path::{Path, PathBuf};

use taugate::Error;
use taugate::internals::error::Result;
use taugate::internals::image::response_film::ResponseFilm;
use taugate::internals::settings::Settings;

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
    Err(Error::Settings(format!(
        "the images of {count} gates of {}x{} pixels need {:.1} GiB of memory, but only {:.1} GiB are free; use fewer gates, \
         a smaller --resolution, or --crop",
        crop.width(),
        crop.height(),
        needed as f64 / GIB,
        free as f64 / GIB
    )))
}

/// Fails if `bytes` is more than `free`, the bytes of free memory. Does nothing if `free` is `None`. The message says
/// that `what` needs this memory; `remedy` says how to need less.
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

/// Bytes that programs can still allocate, as Linux estimates them. Limits from Slurm and Kubernetes are included. `None` if the operating
/// system does not report them.
pub fn free() -> Option<u64> {
    let of_machine = read("/proc/meminfo").and_then(|table| free_in(&table));
    let groups = read("/proc/self/cgroup").map_or_else(Vec::new, |table| groups(&table));
    groups.iter().filter_map(|group| group.free()).chain(of_machine).min()
}

/// As [`free`], plus the memory of `film`, which the caller will drop or use again.
pub fn free_without(film: Option<&ResponseFilm>) -> Option<u64> {
    let bytes =
        |film: &ResponseFilm| ResponseFilm::bytes(film.pixels() as u64, film.responses() as u64, film.has_variance());
    Some(free()?.saturating_add(film.map_or(0, bytes)))
}

fn read(path: impl AsRef<Path>) -> Option<String> {
    std::fs::read_to_string(path).ok()
}

fn free_in(table: &str) -> Option<u64> {
    let line = table.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kibibytes.checked_mul(1024)
}

/// A control group: its folder, its two files with the limit and with the memory in use, and the two rows of memory.stat about cached
/// files.
#[derive(Debug, PartialEq)]
struct Group {
    folder: PathBuf,
    files: [&'static str; 2],
    cached: [&'static str; 2],
}

impl Group {
    fn free(&self) -> Option<u64> {
        let [limit, used] = self.files.map(|name| read(self.folder.join(name)));
        free_of_group(&limit?, &used?, &read(self.folder.join("memory.stat")).unwrap_or_default(), self.cached)
    }
}

/// The control groups that limit the memory of a process whose /proc/self/cgroup is `table`: its own, and those around it.
fn groups(table: &str) -> Vec<Group> {
    let of_line = |line: &str| {
        let mut parts = line.splitn(3, ':').skip(1);
        let (controllers, path) = (parts.next()?, parts.next()?);
        let (root, files, cached) = if controllers.is_empty() {
            ("/sys/fs/cgroup", ["memory.max", "memory.current"], ["inactive_file", "active_file"])
        } else if controllers.split(',').any(|name| name == "memory") {
            let files = ["memory.limit_in_bytes", "memory.usage_in_bytes"];
            ("/sys/fs/cgroup/memory", files, ["total_inactive_file", "total_active_file"])
        } else {
            return None;
        };
        // In a container, the path may be that of the host. The container then has only the root folder, and the other folders cannot
        // be read.
        let around = Path::new(path.trim_start_matches('/')).ancestors().map(|path| Path::new(root).join(path));
        Some(around.map(|folder| Group { folder, files, cached }).collect::<Vec<_>>())
    };
    table.lines().filter_map(of_line).flatten().collect()
}

/// Bytes that the processes of a control group can still allocate; `None` without a limit. Cached files count as free,
/// because Linux can drop them.
fn free_of_group(limit: &str, used: &str, stat: &str, cached: [&str; 2]) -> Option<u64> {
    let (limit, used): (u64, u64) = (limit.trim().parse().ok()?, used.trim().parse().ok()?);
    let row = |line: &str| line.split_once(' ').filter(|(name, _)| cached.contains(name))?.1.trim().parse::<u64>().ok();
    let cached = stat.lines().filter_map(row).fold(0, u64::saturating_add);
    Some(limit.saturating_sub(used.saturating_sub(cached)))
}

#[cfg(test)]
mod tests {
    use taugate::internals::settings::gates::Gates;

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
        // The film has 1.1 GiB of zeros. The system provides this memory only when the film is used.
        let film = ResponseFilm::new(1 << 20, 48, false);
        let [without, with] = [None, Some(&film)].map(|film| free_without(film).unwrap());
        assert!(with > without + (1 << 29), "{with} {without}");
    }

    #[test]
    fn control_groups_limit_the_memory() {
        let folders = |table| groups(table).into_iter().map(|group| group.folder).collect::<Vec<_>>();
        assert_eq!(
            folders("0::/a/b\n"),
            ["/sys/fs/cgroup/a/b", "/sys/fs/cgroup/a", "/sys/fs/cgroup/"].map(PathBuf::from)
        );
        let table = "4:memory:/slurm\n3:cpu,cpuacct:/x\n0::/\n";
        let expected = ["/sys/fs/cgroup/memory/slurm", "/sys/fs/cgroup/memory/", "/sys/fs/cgroup/"].map(PathBuf::from);
        assert_eq!(folders(table), expected);
        assert_eq!(folders("nonsense"), Vec::<PathBuf>::new());
        let stat = "anon 5\nfile 90\ninactive_file 30\nactive_file 20\n";
        let cached = ["inactive_file", "active_file"];
        assert_eq!(free_of_group("1000\n", "900\n", stat, cached), Some(150));
        assert_eq!(free_of_group("1000", "1200", "", cached), Some(0));
        assert_eq!(free_of_group("max\n", "900\n", stat, cached), None);
    }

    #[test]
    fn free_memory_is_read_from_the_table_of_linux() {
        assert_eq!(free_in("MemTotal:  100 kB\nMemAvailable:   24000 kB\n"), Some(24_576_000));
        assert_eq!(free_in("MemTotal: 100 kB\n"), None);
        assert_eq!(free_in("MemAvailable: many kB\n"), None);
    }
}

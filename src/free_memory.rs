//! The memory of this machine that is free.

use std::path::{Path, PathBuf};

/// Bytes that programs can still allocate, as Linux estimates them. Limits from Slurm and Kubernetes are included. `None` if the operating
/// system does not report them.
pub fn free() -> Option<u64> {
    let of_machine = read("/proc/meminfo").and_then(|table| free_in(&table));
    let groups = read("/proc/self/cgroup").map_or_else(Vec::new, |table| groups(&table));
    groups.iter().filter_map(|group| group.free()).chain(of_machine).min()
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
    use super::*;

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

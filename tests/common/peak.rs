//! Measures the memory of a part of a test, in a process of its own. Linux only.

use std::path::Path;
use std::process::Command;

const FILE: &str = "TAUGATE_TEST_FILE";

/// Runs the ignored test `helper` of this program with `file`, on two threads: decoders keep a block per thread. Returns its peak
/// resident memory in MiB, and its report.
pub fn peak(helper: &str, file: &Path) -> (u64, String) {
    let output = Command::new(std::env::current_exe().expect("this program has a path"))
        .args(["--exact", "--ignored", "--nocapture", helper])
        .env(FILE, file)
        .env("RAYON_NUM_THREADS", "2")
        .output()
        .expect("the helper starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let (kib, report) = text
        .lines()
        .find_map(|line| line.strip_prefix("peak ")?.split_once(" kB: "))
        .unwrap_or_else(|| panic!("{helper} prints no peak: {text}"));
    (kib.parse::<u64>().expect("a number") >> 10, report.into())
}

/// The body of a helper: prints the peak memory after `report` has read the file. Does nothing without a file.
pub fn helper(report: impl FnOnce(&Path) -> String) {
    let Some(file) = std::env::var_os(FILE) else { return };
    let report = report(Path::new(&file));
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux has it");
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("Linux has it");
    println!("\npeak {}: {}", peak.trim(), report.replace('\n', " "));
}

//! `taugate devices --check`: compares images that a device renders with known images.

use std::process::ExitCode;
use std::time::Instant;

use taugate::internals::gpu::Device;
use taugate::internals::self_check::{self, Verdict};

/// Exit code if a check ended without an image, the same as for any other error of a device.
const DEVICE_FAILED: u8 = 4;
/// Exit code if an image is wrong, and no check ended without an image.
const WRONG: u8 = 1;

pub fn run(device: Option<&str>) -> anyhow::Result<ExitCode> {
    let device = Device::open(device)?;
    let info = device.info();
    super::print(&format!("{}, driver {}, Vulkan {}\n", info.name, info.driver, info.api_version))?;
    let start = Instant::now();
    let (mut all, mut wrong, mut failed) = (0, 0, 0);
    let mut printed = Ok(());
    self_check::check(&device, &mut |outcome| {
        all += 1;
        let (word, text) = match outcome.verdict {
            Verdict::Right(found) => ("ok    ", found),
            Verdict::Wrong(found) => {
                wrong += 1;
                ("FAILED", found)
            }
            Verdict::Failed(error) => {
                failed += 1;
                ("FAILED", error.to_string())
            }
        };
        if printed.is_ok() {
            printed = super::print(&format!("{word} {}: {text}\n", outcome.name));
        }
    });
    printed?;
    let bad = wrong + failed;
    let seconds = start.elapsed().as_secs_f64();
    super::print(&match bad {
        0 => format!("all {all} checks are ok, after {seconds:.0} s\n"),
        _ => format!(
            "{bad} of {all} checks FAILED, after {seconds:.0} s: do not trust images from this device; update its driver, or choose \
             another --device\n"
        ),
    })?;
    Ok(ExitCode::from(match (failed, wrong) {
        (0, 0) => 0,
        (0, _) => WRONG,
        _ => DEVICE_FAILED,
    }))
}

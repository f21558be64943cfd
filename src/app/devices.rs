//! `taugate devices`: what can render, and its limits.

use std::process::ExitCode;

use taugate::gpu::Device;

use crate::cli::DevicesArgs;

pub fn run(args: &DevicesArgs) -> anyhow::Result<ExitCode> {
    let devices = Device::list()?;
    if args.json {
        super::print(&format!("{}\n", serde_json::to_string_pretty(&devices)?));
        return Ok(ExitCode::SUCCESS);
    }
    for (index, device) in devices.iter().enumerate() {
        let heaps: Vec<String> = device.heap_bytes.iter().map(|&bytes| mebibytes(bytes)).collect();
        super::print(&format!(
            "{index}: {}{}\n   driver {}, Vulkan {}, subgroups of {}\n   memory {}; one allocation {}, one storage buffer \
             {}\n",
            device.name,
            if device.is_cpu { " (software)" } else { "" },
            device.driver,
            device.api_version,
            device.subgroup_size,
            heaps.join(" + "),
            mebibytes(device.max_allocation),
            mebibytes(device.max_storage_buffer_range),
        ));
    }
    Ok(ExitCode::SUCCESS)
}

fn mebibytes(bytes: u64) -> String {
    format!("{} MiB", bytes >> 20)
}

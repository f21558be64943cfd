//! `taugate devices`: the Vulkan devices and their limits.

use std::process::ExitCode;

use taugate::internals::gpu::{Device, DeviceInfo, DeviceKind, Drive, RaySupport};

use crate::app::cli::DevicesArgs;

pub fn run(args: &DevicesArgs) -> anyhow::Result<ExitCode> {
    if args.check {
        return super::check::run(args.device.as_deref());
    }
    let devices = Device::list()?;
    if args.json {
        let json: Vec<_> = devices.iter().enumerate().map(|(index, device)| as_json(index, device)).collect();
        super::print(&format!("{}\n", serde_json::to_string_pretty(&json)?))?;
        return Ok(ExitCode::SUCCESS);
    }
    for (index, device) in devices.iter().enumerate() {
        super::print(&format!(
            "{index}: {}{}{}\n   driver {}, Vulkan {}, subgroups of {}\n   memory {}; one allocation {}, one storage buffer \
             {}, one texel buffer {}\n   host and device: {}\n   ray queries: {}\n   images of many gates: {}\n",
            device.name,
            match device.kind {
                DeviceKind::Discrete => " (discrete card)",
                DeviceKind::Integrated => " (integrated card)",
                DeviceKind::Virtual => " (virtual card)",
                DeviceKind::Other => "",
                DeviceKind::Software => " (software)",
            },
            device.unusable.map(|why| format!(", cannot be used: {why}")).unwrap_or_default(),
            device.driver,
            device.api_version,
            device.subgroup_size,
            mebibytes(device.heap_bytes),
            mebibytes(device.max_allocation),
            mebibytes(device.max_storage_buffer_range),
            mebibytes(device.largest_texel_buffer()),
            describe(device.drive),
            match device.quirks.rays {
                RaySupport::Absent => "none",
                RaySupport::Software => "in software, used only with --rays hardware",
                RaySupport::Hardware => "yes, used only with --rays hardware",
            },
            if device.may_keep_images() { "on the device, if they fit" } else { "on the host" },
        ))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// How host and device work together.
fn describe(drive: Drive) -> String {
    let memory = if drive.maps_memory { "one memory" } else { "copies between their memories" };
    let waits = if drive.waits_per_bounce { "a wait per bounce" } else { "a wait per tile" };
    let in_flight = if drive.in_flight == 1 { "one iteration at a time" } else { "two iterations at a time" };
    format!("{memory}, {waits}, {in_flight}")
}

fn as_json(index: usize, device: &DeviceInfo) -> serde_json::Value {
    serde_json::json!({
        "index": index,
        "name": device.name,
        "driver": device.driver,
        "api_version": device.api_version,
        "kind": device.kind,
        "is_cpu": device.is_cpu(),
        "heap_bytes": device.heap_bytes,
        "max_allocation": device.max_allocation,
        "max_storage_buffer_range": device.max_storage_buffer_range,
        "max_texels": device.max_texels,
        "subgroup_size": device.subgroup_size,
        "drive": device.drive,
        "ray_queries": device.quirks.rays,
        "keeps_images_of_gates": device.may_keep_images(),
        "unusable": device.unusable,
    })
}

fn mebibytes(bytes: u64) -> String {
    format!("{} MiB", bytes >> 20)
}

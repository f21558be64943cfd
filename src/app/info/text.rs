//! Formats the report as lines, each with a name and a value.

use std::fmt::Write;

use taugate::internals::gpu::buffer_desc::mebibytes;
use taugate::internals::settings::units::METRES_PER_NS;

use super::{Arrival, Memory, Render, Report};
use crate::app::feasible::{SUGGESTED_PART, short};

struct Lines(String);

impl Lines {
    fn line(&mut self, name: &str, value: impl AsRef<str>) {
        writeln!(self.0, "{name:<11} {}", value.as_ref()).expect("writing to a string cannot fail");
    }
}

pub fn text(report: &Report) -> String {
    let mut lines = Lines(String::new());
    add_contents(&mut lines, report);
    if let Some(render) = &report.render {
        add_memory(&mut lines, render);
        add_travel_times(&mut lines, render);
    }
    for note in &report.notes {
        lines.line("note", note);
    }
    lines.0
}

fn add_contents(lines: &mut Lines, r: &Report) {
    lines.line(
        "triangles",
        format!("{} in {} instances; {} in {} meshes", r.triangles, r.instances, r.mesh_triangles, r.meshes),
    );
    let point = |p: &[f64; 3]| format!("({:.3}, {:.3}, {:.3})", p[0], p[1], p[2]);
    match &r.bounds {
        Some((low, high, diagonal)) => {
            lines.line("bounds", format!("{} to {} m, diagonal {diagonal:.3} m", point(low), point(high)));
        }
        None => lines.line("bounds", "no triangles"),
    }
    for camera in &r.cameras {
        let size = camera.resolution.map(|[w, h]| format!(", {w}x{h} pixels")).unwrap_or_default();
        let (at, degrees) = (point(&camera.position), camera.degrees_high);
        lines.line("camera", format!("{} at {at}, vertical field of view {degrees:.1} degrees{size}", camera.name));
    }
    for emitter in &r.emitters {
        let watts = emitter.watts.map(|w| format!(", {w:.4} W")).unwrap_or_default();
        lines.line("emitter", format!("{}: {}{watts}", emitter.node, emitter.kind));
    }
    let mut names = r.materials.iter().take(12).cloned().collect::<Vec<_>>().join(", ");
    if r.materials.len() > 12 {
        names += &format!(" and {} more", r.materials.len() - 12);
    }
    lines.line("materials", format!("{} used of {}: {names}", r.materials.len(), r.materials_in_file));
    lines.line("textures", format!("{} with {} texels in {} images", r.textures, r.texels, r.images));
    for warning in &r.warnings {
        lines.line("warning", warning);
    }
}

fn add_memory(lines: &mut Lines, render: &Render) {
    let m: &Memory = &render.memory;
    let [width, height] = render.resolution;
    let device = m.device.as_deref().unwrap_or("no device");
    lines.line("render", format!("{width}x{height} through {}, on {device}", render.camera));
    lines.line(
        "memory",
        format!(
            "{} on the device (scene {}, working buffers {}, light vertices about {}); about {} on the host",
            mebibytes(m.device_bytes),
            mebibytes(m.scene_bytes),
            mebibytes(m.iteration_bytes),
            mebibytes(m.pool_bytes),
            mebibytes(m.host_bytes)
        ),
    );
    for part in &m.largest {
        let allowed = part.allowed.map(|b| format!(" of {} allowed", mebibytes(b))).unwrap_or_default();
        let verdict = if part.fits == Some(false) { ": too large" } else { "" };
        lines.line("  buffer", format!("{}: {}{allowed}{verdict}", part.name, mebibytes(part.bytes)));
    }
    if let Some(problem) = &m.problem {
        lines.line("problem", problem);
    }
}

fn add_travel_times(lines: &mut Lines, render: &Render) {
    let p = &render.possible;
    let ns = |metres: f64| short(metres / METRES_PER_NS);
    lines.line(
        "possible",
        format!(
            "travel times from {} m = {} ns to {} m = {} ns ({} segments of at most {} m)",
            short(p.min),
            ns(p.min),
            short(p.max),
            ns(p.max),
            p.max_depth,
            short(p.max_segment)
        ),
    );
    let Some(light) = &render.light else { return };
    let arrival = |a: &Arrival| {
        format!("{:>10} m  {:>10} ns  {:>10} m depth", short(a.metres), short(a.nanoseconds), short(a.depth_metres))
    };
    lines.line("light", "share that has arrived by a travel time, and its one-way depth (without emitters in view)");
    lines.line("  first", arrival(&light.first));
    for a in &light.percentiles {
        lines.line(&format!("  {:.0} %", a.percent), arrival(a));
    }
    lines.line("  last seen", arrival(&light.last));
    if let Some(gate) = &light.suggested_gate {
        let percent = 100.0 * SUGGESTED_PART;
        lines.line("try", format!("--gate {gate} (at the median; as wide as {percent:.0} % of the scene's diagonal)"));
    }
}

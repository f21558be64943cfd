//! Formats the report as lines, each with a name and a value.

use std::fmt::Write;

use taugate::internals::gpu::buffer_desc::mebibytes;
use taugate::internals::job::feasible::{SUGGESTED_PART, short};
use taugate::internals::settings::units::METRES_PER_NS;

use super::map::{Map, Scale};
use super::media::Medium;
use super::pixel::{Object, Shown};
use super::{Arrival, Memory, Render, Report};

/// Maximum number of lines per list, such as the cameras. The JSON report lists all.
const LISTED: usize = 20;

struct Lines(String);

impl Lines {
    fn line(&mut self, name: &str, value: impl AsRef<str>) {
        writeln!(self.0, "{name:<11} {}", value.as_ref()).expect("writing to a string cannot fail");
    }

    /// Writes one line per item. After [`LISTED`] items, a last line says how many more there are.
    fn list<T>(&mut self, name: &str, items: &[T], describe: impl Fn(&T) -> String) {
        items.iter().take(LISTED).for_each(|item| self.line(name, describe(item)));
        if items.len() > LISTED {
            self.line(name, format!("... and {} more, listed by --json", items.len() - LISTED));
        }
    }
}

pub fn text(report: &Report) -> String {
    let mut lines = Lines(String::new());
    add_contents(&mut lines, report);
    if let Some(render) = &report.render {
        if let Some(thickness) = &render.optical_thickness {
            lines.line("fog", thickness.describe());
        }
        lines.list("formed", &render.formed, String::clone);
        add_memory(&mut lines, render);
        add_travel_times(&mut lines, render, report.bounds.is_some());
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
    lines.list("camera", &r.cameras, |camera| {
        let size = camera.resolution.map(|[w, h]| format!(", {w}x{h} pixels")).unwrap_or_default();
        let view = match (camera.degrees_high, camera.metres_high) {
            (_, Some(metres)) => format!("orthographic, {} m high", short(metres)),
            (Some(degrees), None) => format!("vertical field of view {degrees:.1} degrees"),
            (None, None) => "looks at the points of the scan".into(),
        };
        let lens = camera.lens.as_ref().map(|lens| format!(", {lens}")).unwrap_or_default();
        format!("{} at {}, {view}{lens}{size}", camera.name, point(&camera.position))
    });
    lines.list("emitter", &r.emitters, |emitter| {
        let watts = emitter.watts.map(|w| format!(", {w:.4} W")).unwrap_or_default();
        format!("{}: {}{watts}", emitter.node, emitter.kind)
    });
    let mut names = r.materials.iter().take(12).cloned().collect::<Vec<_>>().join(", ");
    if r.materials.len() > 12 {
        names += &format!(" and {} more", r.materials.len() - 12);
    }
    lines.line("materials", format!("{} used of {}: {names}", r.materials.len(), r.materials_in_file));
    lines.list("inside", &r.interiors, String::clone);
    lines.list("glass", &r.glass, |glass| {
        format!("{}: {}, {}", glass.material, if glass.thin { "thin" } else { "solid" }, glass.why)
    });
    lines.line("textures", format!("{} with {} texels in {} images", r.textures, r.texels, r.images));
    lines.list("medium", &r.media, Medium::describe);
    lines.list("warning", &r.warnings, String::clone);
}

fn add_memory(lines: &mut Lines, render: &Render) {
    let m: &Memory = &render.memory;
    let [width, height] = render.resolution;
    let device = m.device.as_deref().unwrap_or("no device");
    lines.line("render", format!("{width}x{height} through {}, on {device}", render.camera));
    lines.line(
        "memory",
        format!(
            "{} on the device (scene {}, working buffers {}, light vertices about {}); about {} on the host{}",
            mebibytes(m.device_bytes),
            mebibytes(m.scene_bytes),
            mebibytes(m.iteration_bytes),
            mebibytes(m.pool_bytes),
            mebibytes(m.host_bytes),
            if m.in_flight == 2 { ", with two iterations at a time" } else { "" }
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

fn add_travel_times(lines: &mut Lines, render: &Render, has_triangles: bool) {
    if let Some(p) = &render.possible {
        let ns = |metres: f64| short(metres / METRES_PER_NS);
        let least = format!("travel times from {} m = {} ns", short(p.min), ns(p.min));
        let greatest = match p.max.is_finite() {
            true => format!(
                " to {} m = {} ns ({} segments of at most {} m)",
                short(p.max),
                ns(p.max),
                p.max_depth,
                short(p.max_segment)
            ),
            false => ", without an upper limit, because the medium fills all space".into(),
        };
        lines.line("possible", least + &greatest);
    }
    if let Some(Shown { column, row, object }) = &render.pixel {
        let shown = object.as_ref().map_or("no surface".into(), describe);
        lines.line("pixel", format!("{column},{row} shows {shown}"));
    }
    if let Some(map) = &render.map {
        add_map(lines, map);
    }
    if let Some(gate) = &render.gate {
        let share = match gate.share {
            Some(share) if share > 0.0 => format!(": {:.2} % of the light arrives in it", 100.0 * share),
            Some(_) => ": no light that the probe has seen arrives in it".into(),
            None => String::new(),
        };
        lines.line("gate", format!("{}{share}", gate.gates));
    }
    let Some(light) = &render.light else { return };
    let arrival = |a: &Arrival| {
        format!("{:>10} m  {:>10} ns  {:>10} m depth", short(a.metres), short(a.nanoseconds), short(a.depth_metres))
    };
    let place = match (&render.pixel, &render.crop) {
        (Some(_), _) => "; in this pixel",
        (None, Some(_)) => "; in the crop",
        (None, None) => "",
    };
    let share = "share that has arrived by a travel time, and its one-way depth (without emitters in view";
    lines.line("light", format!("{share}{place})"));
    lines.line("  first", arrival(&light.first));
    for a in &light.percentiles {
        lines.line(&format!("  {:.0} %", a.percent), arrival(a));
    }
    lines.line("  last seen", arrival(&light.last));
    if let Some(gate) = &light.suggested_gate {
        let percent = 100.0 * SUGGESTED_PART;
        let whole = if has_triangles { "the scene's diagonal" } else { "the time in which 90 % of the light arrives" };
        lines.line("try", format!("--gate {gate} (at the median; at least {percent:.0} % of {whole} wide)"));
    }
}

fn describe(object: &Object) -> String {
    let [x, y, z] = object.position;
    format!(
        "node '{}' (mesh {}, material {}) at ({x:.3}, {y:.3}, {z:.3}), {} m from the camera, {} m along its axis",
        object.node,
        object.mesh,
        object.material,
        short(object.distance_metres),
        short(object.axial_metres)
    )
}

fn add_map(lines: &mut Lines, map: &Map) {
    let files: Vec<String> = map.files.iter().map(|path| path.display().to_string()).collect();
    let Some(Scale { first, end, last }) = &map.scale else {
        lines.line("map", format!("{}: no pixel has light", files.join(", ")));
        return;
    };
    let time = |a: &Arrival| format!("{} m ({} ns)", short(a.metres), short(a.nanoseconds));
    lines.line(
        "map",
        format!(
            "{}: first light per pixel, from {} in dark blue to {} in yellow; the last at {}; {} of {} pixels have no light \
             and are black",
            files.join(", "),
            time(first),
            time(end),
            time(last),
            map.pixels - map.lit_pixels,
            map.pixels
        ),
    );
}

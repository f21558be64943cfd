//! The responses of the sensor: gates and shapes that the user chose, and tables from files.

use std::path::Path;

use crate::error::{Error, Result};
use crate::files::{check_readable, read_error};
use crate::settings::frequencies::Heterodyne;
use crate::settings::response_specs::{ResponseSpec, Shape};
use crate::settings::table::GateTable;
use crate::settings::units::{Gate, length_unit, path_unit};
use crate::settings::{Edge, Response, Responses};

/// Maximum size of a table in bytes.
const MAX_TABLE_BYTES: u64 = 8 << 20;

/// Whether the user chose no gate at all.
pub(super) fn is_steady(table: &GateTable) -> bool {
    table.gate.is_none_or(|gate| gate.is_open())
        && table.depth.is_none()
        && table.gates.is_none()
        && table.response.is_none()
        && table.cw.is_none()
}

/// The responses that the user chose; without a choice the steady state. Fails if a table cannot be read, if a shape has no gate, if
/// a gate has no effect, if two responses have the same name, or if gates without an end should be repeated.
pub fn chosen(table: &GateTable) -> Result<Responses> {
    let of_one_pulse = of_one_pulse(table)?;
    if let Some(chirp) = table.fmcw {
        if of_one_pulse.support().hi.is_infinite() {
            return Err(Error::advice(
                "--fmcw measures a spectrum of beat frequencies: ",
                "give its bins as lengths of paths at rest, like --gates 0..80m/200",
            ));
        }
        return Ok(of_one_pulse.with_chirp(chirp));
    }
    match table.repeat {
        None => Ok(of_one_pulse),
        Some(_) if of_one_pulse.support().hi.is_infinite() => Err(Error::advice(
            "--repeat needs gates with an end, which it repeats: ",
            "add --gate A..B or --gates A..B/N",
        )),
        Some(period) => Ok(of_one_pulse.repeated(period.0)),
    }
}

/// The responses without the repetition by a pulsed laser.
fn of_one_pulse(table: &GateTable) -> Result<Responses> {
    match (&table.cw, table.heterodyne) {
        (Some(frequencies), None) => return Ok(frequencies.clone().into()),
        (Some(frequencies), Some(Heterodyne(hertz))) => {
            return Ok(Responses::from(frequencies.clone()).with_heterodyne(hertz));
        }
        (None, Some(_)) => return Err(Error::advice("--heterodyne needs a continuous-wave sensor: ", "add --cw MHZ")),
        (None, None) => {}
    }
    let gate = table.gate.or(table.depth.map(|depth| depth.0));
    let specs = table.response.clone().map_or(vec![], |specs| specs.0);
    match &specs[..] {
        [] => return Ok(table.gates.map_or_else(|| gate.unwrap_or(Gate::OPEN).into(), Responses::from)),
        [ResponseSpec { name: None, shape: Shape::Gate { edge, gate: None } }] => {
            if let Some(gates) = table.gates {
                return Ok(Responses::uniform_with(gates, *edge));
            }
        }
        all if all.iter().all(ResponseSpec::has_own_gate) && (gate.is_some() || table.gates.is_some()) => {
            return Err(Error::advice(
                "every --response has a gate of its own, so another gate has no effect: ",
                "remove --gate, --depth or --gates",
            ));
        }
        _ => {}
    }
    if table.gates.is_some() {
        return Err(Error::advice(
            "--gates takes one --response, such as gauss:0.1m, for the edges of all gates; ",
            "give other responses without --gates",
        ));
    }
    let list = specs.iter().map(|spec| response(spec, gate)).collect::<Result<_>>()?;
    Responses::new(list)
}

/// The response of `spec`, around `gate` if it has no gate of its own.
fn response(spec: &ResponseSpec, gate: Option<Gate>) -> Result<Response> {
    match &spec.shape {
        Shape::Gate { edge, gate: own } => {
            let kind = match edge {
                Edge::Sharp => "box",
                Edge::Ramp(_) => "trapezoid",
                Edge::Gauss(_) => "gauss",
            };
            let gate = own.or(gate).ok_or_else(|| {
                Error::advice(
                    format!("the response {spec} has no gate: "),
                    format!("add --gate A..B, or write it like {kind}:10m..11m,0.1m"),
                )
            })?;
            Ok(Response::new(spec.name.as_deref().unwrap_or(kind), gate, *edge))
        }
        Shape::Table(path) => {
            // A name must not contain these characters, nor spaces at its ends.
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().replace(['.', '=', '\\'], "-");
            read_table(spec.name.as_deref().unwrap_or(stem.trim()), path)
        }
    }
}

/// Reads a CSV file of two columns, travel time or distance and weight. The header gives the quantity and its unit.
fn read_table(name: &str, path: &Path) -> Result<Response> {
    let fail = |message: String| Error::File { path: path.into(), message };
    let length = check_readable(path)?;
    if length > MAX_TABLE_BYTES {
        return Err(fail(format!(
            "{length} bytes are too many for a response; use fewer rows, at most {MAX_TABLE_BYTES} bytes"
        )));
    }
    let bytes = std::fs::read(path).map_err(|e| read_error(path, e))?;
    let text = String::from_utf8(bytes).map_err(|_| fail(format!("this is not text; {HOW_TO_WRITE}")))?;
    let rows = parse_table(&text).map_err(fail)?;
    Response::table(name, rows, Some(path)).map_err(|error| fail(error.to_string()))
}

const HOW_TO_WRITE: &str =
    "write a first line like tau_m,weight or time_ns,weight, then a travel time and a weight per line";

/// Names of columns with travel times, in units of length or time.
const TRAVEL_TIMES: [&str; 6] = ["tau", "time", "opl", "t", "delay", "travel_time"];
/// Names of columns with distances from a sensor beside the emitter. The travel time is twice the distance.
const DISTANCES: [&str; 3] = ["depth", "range", "distance"];

/// The factor from the values of a column to travel times in metres. `name` is the column's name in the header, such as `tau_m`,
/// `depth_cm` or `ns`.
fn column_unit(name: &str) -> std::result::Result<f64, String> {
    let (quantity, unit) = name.rsplit_once('_').unwrap_or((TRAVEL_TIMES[0], name));
    let metres = path_unit(unit).ok_or_else(|| format!("its header names no unit; {HOW_TO_WRITE}"))?;
    let is_in = |names: &[&str]| names.iter().any(|known| quantity.eq_ignore_ascii_case(known));
    match (is_in(&TRAVEL_TIMES), is_in(&DISTANCES), length_unit(unit)) {
        (true, ..) => Ok(metres),
        (_, true, Some(metres)) => Ok(2.0 * metres),
        (_, true, None) => Err(format!(
            "its header gives a {quantity} in {unit}, which is a unit of time: write {quantity}_m, or time_{unit} for travel times"
        )),
        _ => Err(format!(
            "its header names the quantity '{quantity}', which is unknown: write {} for travel times, or {} for one-way distances",
            TRAVEL_TIMES.join(", "),
            DISTANCES.join(", ")
        )),
    }
}

/// The rows of a table: travel times in metres, and weights. Lines that are empty or begin with `#` do not count.
fn parse_table(text: &str) -> std::result::Result<Vec<[f64; 2]>, String> {
    // Some spreadsheets begin a file with a byte order mark.
    let lines = text.trim_start_matches('\u{feff}').lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let header = lines.next().and_then(|(_, header)| header.split_once(',')).map(|(time, _)| time.trim());
    let unit = column_unit(header.unwrap_or_default())?;
    lines
        .map(|(number, line)| {
            let cells: Vec<f64> = line
                .split(',')
                .map(|cell| cell.trim().parse())
                .collect::<std::result::Result<_, _>>()
                .unwrap_or_default();
            match cells[..] {
                [time, weight] => Ok([time * unit, weight]),
                _ => Err(format!("line {number}, '{line}', is not a row of two numbers; {HOW_TO_WRITE}")),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::experiment::Experiment;

    fn of(keys: &str) -> Result<Responses> {
        chosen(&Experiment::parse(&format!("[gate]\n{keys}")).unwrap_or_else(|e| panic!("{e}")).gate)
    }

    #[test]
    fn shapes_go_around_the_gates() {
        let one = of("gate = '10m..11m'\nresponse = 'gauss:0.1m'").unwrap();
        assert_eq!((one.len(), one.is_single_box(), one.support()), (1, false, Gate { lo: 9.6, hi: 11.4 }));
        let all = of("gates = '10m..11m/4'\nresponse = 'trapezoid:1m'").unwrap();
        assert_eq!((all.len(), all.support()), (4, Gate { lo: 9.5, hi: 11.5 }));
        let names = |responses: &Responses| responses.iter().map(|r| r.name().to_string()).collect::<Vec<_>>();
        let list = of("gate = '1m..2m'\nresponse = ['box', 'near=gauss:1ns', 'far=box:3m..4m']").unwrap();
        assert_eq!(names(&list), ["box", "near", "far"]);
        assert!(of("gate = '1m..2m'\nresponse = 'box'").unwrap().is_single_box());
    }

    /// The name of a layer must contain neither a dot nor an equals sign.
    #[test]
    fn a_table_is_named_after_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(" t=5.0.csv");
        std::fs::write(&path, "tau_m,weight\n1,1\n2,1\n").unwrap();
        let responses = of(&format!("response = '{}'", path.display())).unwrap();
        assert_eq!(responses.iter().next().unwrap().name(), "t-5-0");
    }

    #[test]
    fn mistakes_name_the_remedy() {
        for (keys, part) in [
            ("response = 'gauss:1m'", "has no gate: add --gate"),
            ("gate = '1m..2m'\nresponse = 'box:3m..4m'", "remove --gate"),
            ("gates = '1m..2m/3'\nresponse = ['box', 'gauss:1m']", "takes one --response"),
            ("gate = '1m..2m'\nresponse = ['box', 'box']", "two responses are called 'box'"),
            ("response = '/nowhere/laser.csv'", "laser.csv"),
        ] {
            let error = of(keys).unwrap_err().to_string();
            assert!(error.contains(part), "{keys}: {error}");
        }
    }

    #[test]
    fn tables_have_a_unit() {
        assert_eq!(
            parse_table("# laser\ntau_m,weight\n1,0\n2, 0.5\n\n3,0\n"),
            Ok(vec![[1.0, 0.0], [2.0, 0.5], [3.0, 0.0]])
        );
        assert_eq!(parse_table("ns,weight\n10,1\n"), Ok(vec![[10.0 * 0.299792458, 1.0]]));
        let [weights, twice] = [[[1.0, 0.0], [2.0, 1.0]], [[2.0, 0.0], [4.0, 1.0]]].map(Vec::from);
        for (header, rows) in [
            ("\u{feff}tau_m", &weights),
            ("opl_m", &weights),
            ("Time_m", &weights),
            ("travel_time_m", &weights),
            ("depth_m", &twice),
            ("range_m", &twice),
            ("distance_m", &twice),
        ] {
            assert_eq!(parse_table(&format!("{header},weight\n1,0\n2,1\n")).as_ref(), Ok(rows), "{header}");
        }
        assert_eq!(parse_table("depth_cm,weight\n100,1\n"), Ok(vec![[2.0, 1.0]]));
        for (text, part) in [
            ("", "no unit"),
            ("depth,weight\n1,2\n", "no unit"),
            ("depth_ns,weight\n1,2\n", "write depth_m, or time_ns"),
            (
                "laser_m,weight\n1,2\n",
                "'laser', which is unknown: write tau, time, opl, t, delay, travel_time for travel times, or depth, range",
            ),
            ("1,2\n3,4\n", "no unit"),
            ("time,weight\n1,2\n", "no unit"),
            ("tau_m,weight\n1;2\n", "line 2"),
            ("tau_m,weight\n1,2,3\n", "two numbers"),
        ] {
            assert!(parse_table(text).unwrap_err().contains(part), "{text}");
        }
    }
}

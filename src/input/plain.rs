//! Says in plain words what is wrong with a TOML file. The messages of serde name types of Rust, and omit the key and the table.

use std::ops::Range;

use serde::de::DeserializeOwned;
use serde_path_to_error::{Path, Segment};

use super::scan_table;
use crate::error::SettingsError;
use crate::settings::missing;
use crate::settings::table::find;

/// Reads TOML. The error has the bytes of `text` where the mistake is, and a message that names the table, the key and the remedy.
/// `home` returns the table to which a key belongs, see [`home_of`].
pub fn from_toml<T: DeserializeOwned>(
    text: &str,
    home: impl Fn(&str) -> Option<Home>,
) -> Result<T, (Range<usize>, SettingsError)> {
    let fail = |error: &toml::de::Error, place: Place| {
        let message = error.message().replace('\n', ", ");
        let mistake =
            place.explain(&message, &home).unwrap_or_else(|| SettingsError::new(message).about(place.setting()));
        (error.span().unwrap_or(0..0), mistake)
    };
    let deserializer = toml::Deserializer::parse(text).map_err(|e| fail(&e, Place::default()))?;
    serde_path_to_error::deserialize(deserializer).map_err(|e| fail(e.inner(), Place::new(e.path())))
}

/// Where a mistake is: the names of the outer tables, of the table and of the key, and which of them are lists. If the mistake is
/// not in a value, the last one may be the table.
#[derive(Default)]
struct Place(Vec<(String, bool)>);

impl Place {
    fn new(path: &Path) -> Place {
        let mut names: Vec<(String, bool)> = vec![];
        for segment in path {
            match (segment, names.last_mut()) {
                // Names with `$` are of serde's own tables, which hold a value and its place.
                (Segment::Map { key }, _) if !key.starts_with('$') => names.push((key.clone(), false)),
                (Segment::Seq { .. }, Some((_, is_list))) => *is_list = true,
                _ => {}
            }
        }
        Place(names)
    }

    /// The setting whose value is wrong.
    fn setting(&self) -> Option<&'static str> {
        self.0.last().and_then(|(key, _)| find(&key.replace('_', "-"))).map(|setting| setting.name)
    }

    fn explain(&self, message: &str, home: impl Fn(&str) -> Option<Home>) -> Option<SettingsError> {
        let table = table(&self.0);
        if let Some((key, names)) = quoted(message, "unknown field ") {
            let table = match self.0.split_last() {
                Some(((last, _), outer)) if last.replace('_', "-") == key => self::table(outer),
                _ => table,
            };
            let home = home(key).filter(|(home, _)| format!("[{home}]") != table);
            let remedy = match (home, missing::reason(key)) {
                (Some(("", _)), _) => "it belongs at the top of the file, before all tables".into(),
                (Some((home, name)), _) if name == key => format!("it belongs to [{home}]"),
                (Some((home, name)), _) => format!("it belongs to [{home}], as {name}"),
                (None, Some(reason)) => reason.into(),
                (None, None) => format!("choose one of {}", list(names)),
            };
            let mistake = SettingsError::advice(format!("{table} has no key {key}: "), remedy);
            return Some(mistake.about(find(key).map(|setting| setting.name)));
        }
        if let Some((key, _)) = quoted(message, "duplicate field ") {
            let old = find(key).and_then(|setting| setting.old_key);
            let names = old.map_or(String::new(), |old| format!(" ({old} is an old name of it)"));
            let mistake = SettingsError::advice(format!("{table} has the key {key} twice{names}: "), "remove one");
            return Some(mistake.about(find(key).map(|setting| setting.name)));
        }
        if let Some((key, _)) = quoted(message, "missing field ") {
            return Some(format!("{table} needs the key {key}").into());
        }
        let ((key, _), outer) = self.0.split_last().filter(|((_, is_list), _)| !is_list)?;
        let setting = self.setting();
        if let Some((word, names)) = quoted(message, "unknown variant ") {
            let problem = format!("{key} cannot be \"{word}\": ");
            return Some(SettingsError::advice(problem, format!("choose one of {}", list(names))).about(setting));
        }
        if let Some(wanted) = message.strip_prefix("expected ") {
            return Some(SettingsError::new(format!("{key} must be {wanted}")).about(setting));
        }
        let wrong = message.strip_prefix("invalid type: ").or(message.strip_prefix("invalid value: "))?;
        let (found, wanted) = wrong.split_once(", expected ")?;
        let wanted = wanted_value(wanted, key, outer.is_empty());
        Some(SettingsError::new(format!("{key} is {}, but must be {wanted}", found_value(found))).about(setting))
    }
}

/// The table as the user writes it, such as `[render]` or `[[light]]`.
fn table(names: &[(String, bool)]) -> String {
    let joined = names.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(".");
    match names.last() {
        None => "the file".into(),
        Some((_, true)) => format!("[[{joined}]]"),
        Some((_, false)) => format!("[{joined}]"),
    }
}

/// What a value must be. `is_outermost`: the key is outside of all tables.
fn wanted_value(wanted: &str, key: &str, is_outermost: bool) -> String {
    match wanted {
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, 0 or more".into(),
        "f32" | "f64" => "a number".into(),
        "a boolean" => "true or false".into(),
        "a string" | "path string" => "text in quotation marks".into(),
        "a sequence" if is_outermost => format!("a list: write [[{key}]] on a line and its keys below"),
        "a sequence" => "a list".into(),
        _ if wanted.starts_with("struct") || wanted == "a map" => {
            format!("a table: write [{key}] on a line and its keys below")
        }
        _ => wanted.into(),
    }
}

/// The name in backquotes after `prefix`, and the rest of the message.
fn quoted<'a>(message: &'a str, prefix: &str) -> Option<(&'a str, &'a str)> {
    message.strip_prefix(prefix)?.strip_prefix('`')?.split_once('`')
}

/// The names in backquotes, with commas between them.
fn list(names: &str) -> String {
    names.split('`').skip(1).step_by(2).collect::<Vec<_>>().join(", ")
}

fn found_value(found: &str) -> String {
    match found.split_once(' ') {
        Some(("integer", number)) => format!("the number {}", number.trim_matches('`')),
        Some(("floating", number)) => format!("the number {}", number.trim_start_matches("point ").trim_matches('`')),
        Some(("boolean", value)) => value.trim_matches('`').into(),
        Some(("string", text)) => format!("the text {text}"),
        _ if found == "sequence" => "a list".into(),
        _ if found == "map" => "a table".into(),
        _ => found.into(),
    }
}

/// The table of an experiment file that has a key, and the present name of the key. The table is empty for the key of the scene.
pub type Home = (&'static str, &'static str);

/// Where the key or the flag `name` belongs in an experiment file, and its present name; `None` if no table has it.
pub fn home_of(name: &str) -> Option<Home> {
    if name == "scene" {
        return Some(("", "scene"));
    }
    let key_of_scan = || scan_table::KEYS.into_iter().find(|key| *key == name).map(|key| ("scan", key));
    find(name).map(|setting| (setting.table, setting.name)).or_else(key_of_scan)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::experiment::Experiment;
    use crate::settings::table;

    /// Files with typical mistakes, and a part of the message about each.
    #[test]
    fn no_message_names_a_type_of_rust() {
        let tables = [
            ("spp = 4", "the file has no key spp: it belongs to [render]"),
            ("[output]\nspp = 4", "[output] has no key spp: it belongs to [render]"),
            ("[render]\nsigma-s = 0.1", "[render] has no key sigma-s: it belongs to [medium]"),
            ("[gate]\nmedium_group_ior = 1.36", "[gate] has no key medium-group-ior: it belongs to [medium]"),
            (
                "[render]\ngroup-ior = 1.36",
                "[render] has no key group-ior: it belongs to [medium], as medium-group-ior",
            ),
            (
                "[medium]\ng = 0.8\nphase-g = 0.8",
                "[medium] has the key phase-g twice (g is an old name of it): remove one",
            ),
            ("[camera]\nf_number = 2.8", "[camera] has no key f-number: give the diameter of the lens with --aperture"),
            ("[camera]\nlaser = [1, 2, 3]", "[camera] has no key laser: it belongs to [scan]"),
            ("pixel-fov = 3", "the file has no key pixel-fov: it belongs to [scan]"),
            ("[camera]\npower = 3", "[camera] has no key power: choose one of camera"),
            (
                "[gate]\ngte = 4",
                "[gate] has no key gte: choose one of gate, depth, gates, response, repeat, gate-keys, cw, heterodyne, fmcw, force",
            ),
            ("scne = 'a.glb'", "the file has no key scne: choose one of scene, camera, emitter"),
            ("output = 'x.exr'", "output is the text \"x.exr\", but must be a table: write [output] on a line"),
            ("[render]\nspp = 'four'", "spp is the text \"four\", but must be a whole number, 0 or more"),
            ("[render]\nspp = -4", "spp is the number -4, but must be a whole number, 0 or more"),
            ("[render]\nspp = 4.5", "spp is the number 4.5, but must be a whole number, 0 or more"),
            ("[render]\nno-cull = 1", "no-cull is the number 1, but must be true or false"),
            ("[render]\ntime = 30", "time is the number 30, but must be text in quotation marks"),
            ("[render]\nestimator = ['pt']", "estimator is a list, but must be text in quotation marks"),
            ("[output]\noutput = 3", "output must be the name of a file or a list of such names"),
            ("[output]\npng = 3", "png must be true, false or a file name"),
            ("[input]\nallow-path = 3", "allow-path must be the name of a folder or a list of such names"),
            ("[camera]\nup = true", "up must be numbers, like [1, 2.5, -3]"),
            ("[[light]]\ntype = 'sun'", "type cannot be \"sun\": choose one of point, spot, beam"),
            ("[[light]]\ntype = 'spot'", "[[light]] needs the key position"),
            ("[render]\nmax-depth = 5\nmax_depth = 6", "[render] has the key max-depth twice: remove one"),
            ("render.spp = 'x'", "spp is the text \"x\", but must be a whole number"),
            ("render.sppp = 3", "[render] has no key sppp: choose one of"),
            ("camera = { fov = 3, up = true }", "up must be numbers"),
            ("camera = { fov = 3, upp = true }", "[camera] has no key upp: choose one of"),
            ("[camera]\nup = [1,\n2, 'x']", "up must be numbers"),
            ("[emitter]\nemitters = [\n'[x]'\n]\nlampp = 3", "[emitter] has no key lampp"),
            ("[render.spp]\nx = 1", "spp is a table, but must be a whole number"),
            ("[[medium]]\nmor = '1m'\n[[medium]]\nsigma = 3", "[[medium]] has no key sigma: choose one of"),
            ("[[medium]]\nsigma-s = 3\nsigma_s = 3", "[[medium]] has the key sigma-s twice: remove one"),
            ("light = 3", "light is the number 3, but must be a list"),
            ("scene = 3", "scene is the number 3, but must be text in quotation marks"),
        ];
        for (text, part) in tables {
            let message = Experiment::parse(text).unwrap_err().mistake.to_string();
            assert!(message.contains(part), "{text}: {message}");
            assert!(
                !["struct ", "u32", "f64", "field", "sequence", "boolean", "invalid type"]
                    .iter()
                    .any(|w| message.contains(w)),
                "{message}"
            );
        }
    }

    /// Every key in every table that does not have it: the message names the right table and a key that this table takes.
    #[test]
    fn a_misplaced_key_is_sent_to_the_table_that_has_it() {
        let headers = [
            "",
            "[camera]",
            "[emitter]",
            "[input]",
            "[medium]",
            "[[medium]]",
            "[gate]",
            "[render]",
            "[output]",
            "[scan]",
            "[[light]]",
            "[[response]]",
        ];
        let settings = table::all().flat_map(|setting| {
            [Some(setting.name), setting.old_key].into_iter().flatten().map(|key| (setting.table, key))
        });
        let all: Vec<_> = settings.chain(scan_table::KEYS.map(|key| ("scan", key))).chain([("", "scene")]).collect();
        let mistake = |header: &str, key: &str| {
            let text = format!("{header}\n{key} = true\n");
            Experiment::parse(&text).err().map(|error| error.mistake)
        };
        let message =
            |header: &str, key: &str| mistake(header, key).map_or(String::new(), |mistake| mistake.to_string());
        let mut count = 0;
        for (table, key) in &all {
            for header in headers.iter().filter(|header| header.trim_matches(['[', ']']) != *table) {
                let found = message(header, key);
                if *header == "[[response]]" && ["gate", "depth"].contains(key) {
                    continue;
                }
                count += 1;
                if header.is_empty() && headers.iter().any(|header| header.trim_matches(['[', ']']) == *key) {
                    assert!(found.contains(": write [") && found.contains(&format!("[{key}]")), "{key}: {found}");
                    continue;
                }
                let place = if header.is_empty() { "the file" } else { header };
                let (head, remedy) =
                    found.split_once(": it belongs ").unwrap_or_else(|| panic!("{header} {key}: {found}"));
                assert_eq!(head, format!("{place} has no key {key}"));
                if table.is_empty() {
                    assert_eq!(remedy, "at the top of the file, before all tables");
                    continue;
                }
                let (home, name) = remedy.split_once(", as ").unwrap_or((remedy, key));
                assert_eq!(home, format!("to [{table}]"));
                let there = message(&format!("[{table}]"), name);
                assert!(!there.contains("has no key"), "{header} {key}: {there}");
                assert!(home_of(name) == Some((table, name)), "{key}: {name} is the present name");
                let mistake = mistake(header, key).unwrap();
                assert_eq!(mistake.remedy(), Some(&*format!("it belongs {remedy}")));
                assert_eq!(mistake.setting(), find(key).map(|setting| setting.name));
            }
        }
        assert!(count > 1000, "{count} places");
    }
}

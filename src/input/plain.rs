//! Says in plain words what is wrong with a TOML file. The messages of serde name types of Rust, and omit the key and the table.

use super::scan_table;
use crate::settings::missing;
use crate::settings::table::find;

/// Rewrites a message of the TOML parser about byte `at` of `text`. The result names the table, the key and the remedy. Messages
/// that are already plain stay as they are. `home` returns the table to which a key belongs, see [`home_of`].
pub fn plain(message: &str, text: &str, at: usize, home: impl Fn(&str) -> Option<Home>) -> String {
    let message = message.replace('\n', ", ");
    Place::new(text, at).explain(&message, home).unwrap_or(message)
}

/// Where a mistake is.
#[derive(Debug, Default, PartialEq, Eq)]
struct Place {
    /// The table as the user writes it, such as `[render]` or `[[light]]`; empty outside tables.
    table: String,
    /// The key whose value is wrong; `None` if the mistake is not a value, or is an element of a list.
    key: Option<String>,
}

impl Place {
    fn new(text: &str, at: usize) -> Place {
        let before = text.get(..at).unwrap_or(text);
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let line_end = text[line_start..].find('\n').map_or(text.len(), |length| line_start + length);
        let line = before[line_start..].trim_end();
        if is_header(line) {
            // The mistake is a name in the header `[outer.inner]`.
            let outer = line.trim_start_matches('[').rsplit_once('.').map(|(outer, _)| format!("[{outer}]"));
            return Place { table: outer.unwrap_or_default(), key: None };
        }
        // The parser reports a mistake in a whole table at the start of its header. So the line at `at` may itself be the header.
        let header = text[..line_end].lines().rev().map(str::trim).find(|line| is_header(line));
        let mut table = header
            .map_or(String::new(), |line| line.split_inclusive(']').take_while(|part| part.ends_with(']')).collect());
        let key = line.strip_suffix('=').map(last_word);
        let dotted = key
            .as_deref()
            .and_then(|key| key.rsplit_once('.'))
            .map(|(table, key)| (table.to_string(), key.to_string()));
        // A table may also be written as part of the key, `render.spp = 4`, or in braces, `render = { spp = 4 }`.
        if let Some((of_key, key)) = dotted {
            return Place { table: format!("[{of_key}]"), key: Some(key) };
        }
        if let Some((outer, _)) = line.rsplit_once('{').filter(|(_, inner)| !inner.contains('}')) {
            table = outer.trim_end().strip_suffix('=').map_or(table, |outer| format!("[{}]", last_word(outer)));
        }
        Place { table, key }
    }

    fn explain(&self, message: &str, home: impl Fn(&str) -> Option<Home>) -> Option<String> {
        let table = if self.table.is_empty() { "the file" } else { &self.table };
        if let Some((key, names)) = quoted(message, "unknown field ") {
            let home = home(key).filter(|(home, _)| format!("[{home}]") != self.table);
            return Some(match (home, missing::reason(key)) {
                (Some(("", _)), _) => {
                    format!("{table} has no key {key}: it belongs at the top of the file, before all tables")
                }
                (Some((home, name)), _) if name == key => format!("{table} has no key {key}: it belongs to [{home}]"),
                (Some((home, name)), _) => format!("{table} has no key {key}: it belongs to [{home}], as {name}"),
                (None, Some(reason)) => format!("{table} has no key {key}: {reason}"),
                (None, None) => format!("{table} has no key {key}: choose one of {}", list(names)),
            });
        }
        if let Some((key, _)) = quoted(message, "duplicate field ") {
            let old = find(key).and_then(|setting| setting.old_key);
            let names = old.map_or(String::new(), |old| format!(" ({old} is an old name of it)"));
            return Some(format!("{table} has the key {key} twice{names}: remove one"));
        }
        if let Some((key, _)) = quoted(message, "missing field ") {
            return Some(format!("{table} needs the key {key}"));
        }
        let key = self.key.as_deref()?;
        if let Some((word, names)) = quoted(message, "unknown variant ") {
            return Some(format!("{key} cannot be \"{word}\": choose one of {}", list(names)));
        }
        if let Some(wanted) = message.strip_prefix("expected ") {
            return Some(format!("{key} must be {wanted}"));
        }
        let wrong = message.strip_prefix("invalid type: ").or(message.strip_prefix("invalid value: "))?;
        let (found, wanted) = wrong.split_once(", expected ")?;
        Some(format!("{key} is {}, but must be {}", found_value(found), self.wanted_value(wanted, key)))
    }

    fn wanted_value(&self, wanted: &str, key: &str) -> String {
        match wanted {
            "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, 0 or more".into(),
            "f32" | "f64" => "a number".into(),
            "a boolean" => "true or false".into(),
            "a string" | "path string" => "text in quotation marks".into(),
            "a sequence" if self.table.is_empty() => format!("a list: write [[{key}]] on a line and its keys below"),
            "a sequence" => "a list".into(),
            _ if wanted.starts_with("struct") || wanted == "a map" => {
                format!("a table: write [{key}] on a line and its keys below")
            }
            _ => wanted.into(),
        }
    }
}

fn is_header(line: &str) -> bool {
    line.starts_with('[') && !line.contains('=')
}

/// The last word of a line, with its dots.
fn last_word(line: &str) -> String {
    let line = line.trim_end();
    let start = line.rfind(|c: char| !(c.is_alphanumeric() || "-_.".contains(c))).map_or(0, |at| at + 1);
    line.get(start..).unwrap_or(line).to_string()
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

    #[test]
    fn a_mistake_has_a_table_and_a_key() {
        let place = |text: &str| {
            let at = text.find('!').unwrap();
            let Place { table, key } = Place::new(&text.replace('!', ""), at);
            (table, key.unwrap_or_default())
        };
        let of = |table: &str, key: &str| (table.to_string(), key.to_string());
        assert_eq!(place("scene = !3"), of("", "scene"));
        assert_eq!(place("![render]\nspp = 3"), of("[render]", ""));
        assert_eq!(place("[gate]\n[[light]] # a lamp\n  inner-angle =!3\n"), of("[[light]]", "inner-angle"));
        assert_eq!(place("[render]\nspp = 3\n!x = 4"), of("[render]", ""));
        assert_eq!(place("[gate]\n[[!lamp]]\n"), of("", ""));
        assert_eq!(place("[variant.!rendr]\n"), of("[variant]", ""));
        assert_eq!(place("render.spp = !'x'"), of("[render]", "spp"));
        assert_eq!(place("camera = { fov = 3, up = !4 }"), of("[camera]", "up"));
        assert_eq!(place("[camera]\nup = [1,\n2, !'x']"), of("[camera]", ""));
        assert_eq!(Place::new("a", 99), Place::default());
    }

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
            ("[camera]\nf_number = 2.8", "[camera] has no key f-number: cameras are pinholes or orthographic"),
            ("[camera]\nlaser = [1, 2, 3]", "[camera] has no key laser: it belongs to [scan]"),
            ("pixel-fov = 3", "the file has no key pixel-fov: it belongs to [scan]"),
            ("[camera]\npower = 3", "[camera] has no key power: choose one of camera"),
            (
                "[gate]\ngte = 4",
                "[gate] has no key gte: choose one of gate, depth, gates, response, repeat, gate-keys, cw, force",
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
            ("light = 3", "light is the number 3, but must be a list"),
            ("scene = 3", "scene is the number 3, but must be text in quotation marks"),
        ];
        for (text, part) in tables {
            let message = Experiment::parse(text).unwrap_err().message;
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
        let message = |header: &str, key: &str| {
            let text = format!("{header}\n{key} = true\n");
            Experiment::parse(&text).map_or_else(|error| error.message, |_| String::new())
        };
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
            }
        }
        assert!(count > 1000, "{count} places");
    }
}

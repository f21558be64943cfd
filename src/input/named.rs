//! Changes a setting by the name of its flag, and writes all settings as the words of a command line.

use std::collections::BTreeMap;
use std::ffi::OsStr;

use serde_json::Value as Json;

use crate::error::{Error, Result, SettingsError};
use crate::input::experiment::Experiment;
use crate::settings::missing;
use crate::settings::setting::{Form, LeaveOut, Setting, Value, Visitor};
use crate::settings::table::excluding;

/// Sets the setting `name` to `text`, read as on the command line, and removes all settings that exclude it. `None` only removes
/// the setting itself. Fails without any change if there is no such setting, or if the text is not a valid value.
pub fn set(experiment: &mut Experiment, name: &str, text: Option<&str>) -> Result<()> {
    let mut changed = experiment.clone();
    let mut set = Set { name, text, found: None };
    changed.visit(&mut set);
    set.found.unwrap_or_else(|| {
        let reason = missing::reason(name).map(|reason| format!(": {reason}")).unwrap_or_default();
        Err(Error::settings(format!("there is no setting --{name}{reason}")))
    })?;
    if text.is_some() {
        changed.visit(&mut LeaveOut(&excluding(name).collect::<Vec<_>>()));
    }
    *experiment = changed;
    Ok(())
}

/// The flags for the settings of `experiment`, as words of a command line. Numbers have all digits that are needed to read the
/// same numbers back. The scene and the tables `[[light]]`, `[[medium]]` and `[scan]` are left out, see [`has_tables`].
pub fn as_words(experiment: &Experiment) -> Vec<String> {
    let mut words = Words(vec![]);
    experiment.clone().visit(&mut words);
    words.0
}

/// The settings of `experiment` by the names of their flags, as text. Parts of a list have commas between them.
pub fn as_texts(experiment: &Experiment) -> BTreeMap<&'static str, String> {
    let mut texts = Texts(BTreeMap::new());
    experiment.clone().visit(&mut texts);
    texts.0
}

/// Whether the experiment has tables that no flag can give.
pub fn has_tables(experiment: &Experiment) -> bool {
    !experiment.light.is_empty() || !experiment.medium.list.is_empty() || experiment.scan.is_some()
}

struct Set<'a> {
    name: &'a str,
    text: Option<&'a str>,
    found: Option<Result<()>>,
}

impl Visitor for Set<'_> {
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
        if setting.name != self.name {
            return;
        }
        let value = match (self.text, setting.form) {
            (None, _) => Ok(None),
            (Some(text), Form::Repeated) => parse_all::<T>(std::iter::once(text)),
            (Some(text), Form::SignedRepeated) => parse_all::<T>(text.split_whitespace()),
            (Some(text), _) => T::parse(OsStr::new(text)).map(Some),
        };
        self.found = Some(match value {
            Ok(value) => {
                *slot = value;
                Ok(())
            }
            Err(error) => Err(error.after(&format!("--{}: ", self.name)).into()),
        });
    }
}

fn parse_all<'a, T: Value>(words: impl Iterator<Item = &'a str>) -> Result<Option<T>, SettingsError> {
    let values: Vec<T> = words.map(|word| T::parse(OsStr::new(word))).collect::<Result<_, _>>()?;
    Ok(values.into_iter().reduce(T::and))
}

struct Texts(BTreeMap<&'static str, String>);

impl Visitor for Texts {
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
        self.0.extend(slot.as_ref().map(|value| (setting.name, text(&json(value)))));
    }
}

struct Words(Vec<String>);

impl Visitor for Words {
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
        let Some(value) = slot else { return };
        let flag = format!("--{}", setting.name);
        match (setting.form, json(value)) {
            (Form::Switch | Form::Optional { equals: false, .. }, Json::Bool(on)) => self.0.extend(on.then_some(flag)),
            (Form::Optional { equals: true, .. }, json) => self.0.push(format!("{flag}={}", text(&json))),
            (Form::Repeated | Form::SignedRepeated, Json::Array(list)) => {
                self.0.extend(list.iter().flat_map(|value| [flag.clone(), text(value)]));
            }
            (_, json) => self.0.extend([flag, text(&json)]),
        }
    }
}

fn json(value: &impl Value) -> Json {
    serde_json::to_value(value).expect("the value of a setting is text, a number or a list")
}

/// The value as a word of the command line.
fn text(json: &Json) -> String {
    match json {
        Json::String(text) => text.clone(),
        Json::Array(list) => list.iter().map(text).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Experiment {
        Experiment::parse(text).unwrap_or_else(|e| panic!("{text}: {e}"))
    }

    /// The experiment that results from the words of [`as_words`].
    fn from_words(words: &[String]) -> Experiment {
        let mut experiment = Experiment::default();
        let mut at = 0;
        while at < words.len() {
            let word = words[at].strip_prefix("--").expect("a flag");
            let next = words.get(at + 1).filter(|next| !next.starts_with("--"));
            let (name, text) = match (word.split_once('='), next) {
                (Some((name, text)), _) => (name, text),
                (None, Some(next)) => (word, next.as_str()),
                (None, None) => (word, "true"),
            };
            at += if next.is_some() && !word.contains('=') { 2 } else { 1 };
            set(&mut experiment, name, Some(text)).unwrap();
        }
        experiment
    }

    #[test]
    fn words_give_the_same_experiment() {
        for text in [
            "gate.gate = '0.1m..0.30000000000000004m'",
            "gate.depth = '3.1m..3.2m'",
            "gate.gates = '4m..10m/30'",
            "gate.cw = '80,60'",
            "camera = { look-from = [-1.5, 2, 1e-30], fov = 39.6, resolution = '640x480', principal-point = [0.25, 0.5] }",
            "camera = { camera = 'the front', crop = [0, 10, 0, 20], ortho = 2.5 }",
            "emitter = { emitters = ['lamp'], headlamp = 12.5, headlamp-offset = [-0.1, 0, 0], sky = [0.1, 0.2, 0.3] }",
            "emitter = { lamp = [[-1, 2, 3, 4]] }",
            "medium = { sigma-s = [0.1, 0.2, 0.3], sigma-a = 0.01, phase-g = -0.5, medium-bounds = [[0, 0, 0], [1, 1, 1]], no-medium = true }",
            "medium = { visibility = '60m', albedo = 0.9 }",
            "render = { estimator = 'lcs', spp = 7, single-tree = false, no-cull = true, importance = 'centre,gloss' }",
            "render = { time = '1.5s', sampling = 'uniform', seed = 4000000000 }",
            "input = { double-sided = true, at = '1.5s' }",
        ] {
            let experiment = parsed(text);
            let words = as_words(&experiment);
            assert_eq!(from_words(&words), experiment, "{text}: {words:?}");
        }
        // The comparison above must notice a wrong digit.
        let close = as_words(&parsed("gate.gate = '0.1m..0.3m'"));
        assert_ne!(from_words(&close), parsed("gate.gate = '0.1m..0.30000000000000004m'"));
    }

    #[test]
    fn repeated_flags_come_once_per_value() {
        let words = as_words(&parsed("emitter = { emitters = ['a', 'b'], lamp = [[1, 2, 3, 4], [5, 6, 7, 8]] }"));
        let expected = ["--emitters", "a", "--emitters", "b", "--lamp", "1.0,2.0,3.0,4.0", "--lamp", "5.0,6.0,7.0,8.0"];
        assert_eq!(words, expected);
    }

    #[test]
    fn settings_that_exclude_each_other_replace_each_other() {
        let mut experiment = parsed("gate.gate = '1m..2m'\nrender.spp = 4");
        set(&mut experiment, "depth", Some("3m..4m")).unwrap();
        assert_eq!(as_words(&experiment), ["--depth", "3m..4m", "--spp", "4"]);
        set(&mut experiment, "gates", Some("1m..2m/4")).unwrap();
        assert!(experiment.gate.depth.is_none() && experiment.gate.gates.is_some());
        set(&mut experiment, "gate", None).unwrap();
        assert!(experiment.gate.gates.is_some(), "only the named setting is left out");
        assert_eq!(experiment.render.spp, Some(4));
    }

    #[test]
    fn mistakes_change_nothing() {
        let mut experiment = parsed("gate.gate = '1m..2m'");
        let before = experiment.clone();
        for (name, text) in [("gate", "1..2"), ("depth", "x"), ("nonsense", "1"), ("resolution", "big"), ("fov", "200")]
        {
            let error = set(&mut experiment, name, Some(text)).unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
            assert_eq!(experiment, before);
        }
    }
}

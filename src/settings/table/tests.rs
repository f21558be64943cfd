mod help;

use super::*;
use crate::error::Error;
use crate::input::experiment::Experiment;
use crate::input::named;
use crate::settings::Estimator;
use crate::settings::setting::{LeaveOut, Taker, Value, Visitor};
use crate::settings::{Budget, Crop, Settings};

/// Gives every setting a value, and notes which values name files.
#[derive(Default)]
struct Fill {
    names_files: Vec<&'static str>,
}

impl Visitor for Fill {
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
        let words = [
            "true",
            "1",
            "0.5",
            "1m..2m",
            "1m..2m/3",
            "4x4",
            "0,1,0,1",
            "0,1,0",
            "0,1",
            "0,0,0,1,1,1",
            "1,0,0,0,0,1,0,0,0,0,1,0",
            "linear",
            "3s",
            "3m",
            "0=1m..2m",
            "0..2",
            "0..2ms",
            "2us",
            "30Hz",
            "pt",
            "hg",
            "box",
            "cos4",
            "15",
            "all",
            "uniform",
            "on",
            "off",
            "localhost:1",
            "1550nm,1GHz,10us",
            "0/2",
            "keep",
            "strip",
            "software",
            "word",
        ];
        *slot = words.iter().find_map(|word| T::parse(word.as_ref()).ok());
        assert!(slot.is_some(), "--{} has a value that this test does not know", setting.name);
        if !slot.clone().unwrap().paths().is_empty() {
            self.names_files.push(setting.name);
        }
    }
}

/// An experiment in which every setting has a value.
fn filled() -> Experiment {
    let mut experiment = Experiment::default();
    experiment.visit(&mut Fill::default());
    experiment
}

#[test]
fn names_are_the_keys_of_the_file_and_all_have_help() {
    let text = filled().to_toml();
    let keys: Vec<&str> = text.lines().filter_map(|line| Some(line.split_once(" = ")?.0)).collect();
    assert_eq!(keys, all().map(|setting| setting.name).collect::<Vec<_>>(), "{text}");
    for setting in all() {
        assert!(!setting.help.trim().is_empty() && !setting.help.ends_with('.'), "--{}", setting.name);
    }
}

#[test]
fn settings_exclude_earlier_ones_and_reset_those_of_their_table() {
    for (k, setting) in all().enumerate() {
        let earlier: Vec<&str> = all().take(k).map(|earlier| earlier.name).collect();
        assert!(setting.excludes.iter().all(|other| earlier.contains(other)), "--{}", setting.name);
        assert_eq!(setting.excludes.is_empty(), setting.both.is_empty(), "--{}", setting.name);
        let is_beside = |other: &str| find(other).is_some_and(|other| other.table == setting.table);
        assert!(setting.resets.iter().all(|other| is_beside(other)), "--{}", setting.name);
    }
}

/// Each pair of settings that exclude each other: a file must not have both, and a flag replaces the other one of the file.
#[test]
fn settings_that_exclude_each_other_are_refused_together_and_replace_each_other() {
    let with = |name: &str| {
        let others: Vec<&str> = all().map(|setting| setting.name).filter(|other| *other != name).collect();
        let mut experiment = filled();
        experiment.visit(&mut LeaveOut(&others));
        experiment
    };
    let pairs = all().flat_map(|setting| setting.excludes.iter().map(move |other| (setting, *other)));
    for (setting, other) in pairs {
        let line = |name: &str| {
            let text = with(name).to_toml();
            let line = text.lines().find(|line| line.starts_with(&format!("{name} = "))).unwrap();
            format!("{}.{line}\n", find(name).unwrap().table)
        };
        let mistake = Experiment::parse(&(line(setting.name) + &line(other))).unwrap_err().mistake;
        assert_eq!(mistake.to_string(), format!("{other} and {} both {}: keep one", setting.name, setting.both));
        assert_eq!((mistake.setting(), mistake.remedy()), (Some(setting.name), Some("keep one")));
        for (flag, file) in [(setting.name, other), (other, setting.name)] {
            assert_eq!(with(flag).over(with(file)), with(flag), "--{flag} over {file}");
        }
    }
}

#[test]
fn old_keys_are_read_and_new_ones_are_written() {
    let old: Vec<&Setting> = all().filter(|setting| setting.old_key.is_some()).collect();
    let keys: Vec<&str> = old.iter().filter_map(|setting| setting.old_key).collect();
    assert_eq!(keys, ["g", "g2", "weight", "alpha", "ior", "group-ior", "grid", "bounds"]);
    assert!(
        keys.iter().all(|key| all().all(|setting| setting.name != *key)),
        "an old key is not the name of another one"
    );
    let text = filled().medium.one;
    let new = toml::to_string(&text).unwrap();
    for (setting, key) in old.iter().zip(keys) {
        let line = new.lines().find(|line| line.starts_with(&format!("{} = ", setting.name))).unwrap();
        let old = line.replacen(setting.name, key, 1);
        let read = |text: &str| Experiment::parse(&format!("[medium]\n{text}\n"));
        assert_eq!(read(&old), read(line), "{old}");
        assert_eq!(read(&old).unwrap().to_toml(), read(line).unwrap().to_toml(), "{old}");
        let list = Experiment::parse(&format!("[[medium]]\n{old}\n")).unwrap();
        assert_eq!(list, Experiment::parse(&format!("[[medium]]\n{line}\n")).unwrap());
        let mistake = read(&format!("{old}\n{line}")).unwrap_err().mistake;
        let expected = format!("[medium] has the key {0} twice ({key} is an old name of it): remove one", setting.name);
        assert_eq!(mistake.to_string(), expected);
        assert_eq!((mistake.setting(), mistake.remedy()), (Some(setting.name), Some("remove one")));
    }
}

#[test]
fn an_error_about_a_value_has_its_setting_and_a_remedy() {
    let fields = |error: Error| match error {
        Error::Settings(error) => (error.setting().map(String::from), error.remedy().map(String::from)),
        other => panic!("{other}"),
    };
    let mut with_limits = 0;
    for (setting, (_, max)) in all().filter_map(|setting| Some((setting, setting.limits?))) {
        let Some(above) = max.checked_add(1) else { continue };
        let (name, remedy) = fields(setting.check(above).unwrap_err());
        assert_eq!(name.as_deref(), Some(setting.name));
        assert!(remedy.is_some_and(|remedy| remedy.starts_with("it must be ")), "{}", setting.name);
        with_limits += 1;
    }
    assert!(with_limits >= 5, "{with_limits}");
    for (name, text, remedy) in [
        ("fov", "200", Some("write degrees between 0 and 180, like 40")),
        ("resolution", "big", Some("write width x height in pixels, like 640x480")),
        ("time", "3", Some("write it like 30s, 5min or 2h")),
        ("gates", "1m..2m", Some("write them like 10m..20m/100, which is 100 gates of 0.1 m")),
        ("spp", "many", None),
    ] {
        let error = named::set(&mut Experiment::default(), name, Some(text)).unwrap_err();
        assert_eq!(fields(error), (Some(name.into()), remedy.map(String::from)));
    }
    let settings = Settings::builder();
    for (built, name) in [
        (settings.clone().resolution([0, 4]).build(), "resolution"),
        (settings.clone().crop(Crop { x0: 0, x1: 4000, y0: 0, y1: 4 }).build(), "crop"),
        (settings.clone().budget(Budget::Seconds(0.0)).build(), "time"),
        (settings.budget(Budget::Spp(0)).build(), "spp"),
    ] {
        assert_eq!(fields(built.unwrap_err()).0.as_deref(), Some(name));
    }
    let wrong_type = Experiment::parse("[render]\nspp = 'four'").unwrap_err().mistake;
    assert_eq!(wrong_type.setting(), Some("spp"));
}

/// A page is another program, so none of its settings may name a file to read or write.
#[test]
fn pages_change_no_names_of_files() {
    let mut fill = Fill::default();
    Experiment::default().visit(&mut fill);
    assert!(fill.names_files.contains(&"density-grid") && fill.names_files.contains(&"output"));
    for setting in all().filter(|setting| setting.is_for(Taker::Page)) {
        assert!(!fill.names_files.contains(&setting.name), "--{}", setting.name);
        assert!(setting.is_for(Taker::View), "--{}", setting.name);
    }
}

#[test]
fn notes_name_the_estimators_that_use_a_setting() {
    let setting = find("splat-paths").unwrap();
    assert_eq!(setting.without_effect(Estimator::Bdpt), None);
    let note = "--splat-paths is only for bdpt, epc, lcs-paper and lcs; pt ignores it";
    assert_eq!(setting.without_effect(Estimator::Pt).as_deref(), Some(note));
    let note = find("frontier").unwrap().without_effect(Estimator::Bdpt).unwrap();
    assert!(note.starts_with("--frontier is only for lcs; bdpt"), "{note}");
}

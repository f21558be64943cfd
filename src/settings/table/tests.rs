use super::*;
use crate::input::experiment::Experiment;

/// The name of every setting must be its key in experiment files; the flags of a medium may have a longer name than the keys of
/// `[medium]`. Every setting must have a help text.
#[test]
fn names_are_the_keys_of_the_file_and_all_have_help() {
    struct Fill(Vec<String>);
    impl Visitor for Fill {
        fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
            assert!(!setting.help.trim().is_empty() && !setting.help.ends_with('.'), "--{}", setting.name);
            assert!(setting.excludes.iter().all(|other| self.0.iter().any(|name| name == other)), "--{}", setting.name);
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
                "pt",
                "hg",
                "box",
                "15",
                "all",
                "uniform",
                "on",
                "localhost:1",
                "0/2",
                "strip",
                "word",
            ];
            *slot = words.iter().find_map(|word| T::parse(word.as_ref()).ok());
            assert!(slot.is_some(), "--{} has a value that this test does not know", setting.name);
            self.0.push(setting.name.into());
        }
    }
    let (mut experiment, mut fill) = (Experiment::default(), Fill(vec![]));
    experiment.visit(&mut fill);
    let text = experiment.to_toml();
    let keys: Vec<&str> = text.lines().filter_map(|line| Some(line.split_once(" = ")?.0)).collect();
    let short = |name: &str| {
        let key = ["phase-", "medium-", "density-"].iter().find_map(|prefix| name.strip_prefix(prefix));
        key.unwrap_or(name).to_string()
    };
    assert_eq!(keys, fill.0.iter().map(|name| short(name)).collect::<Vec<_>>(), "{text}");
}

#[test]
fn notes_name_the_estimators_that_use_a_setting() {
    let setting = Setting::sampling("splat-paths", "N").only_for(traces_light);
    assert_eq!(setting.without_effect(Estimator::Bdpt), None);
    let note = "--splat-paths is only for bdpt, epc, lcs-paper and lcs; pt ignores it";
    assert_eq!(setting.without_effect(Estimator::Pt).as_deref(), Some(note));
    let note =
        Setting::sampling("frontier", "N").only_for(Estimator::by_importance).without_effect(Estimator::Bdpt).unwrap();
    assert!(note.starts_with("--frontier is only for lcs; bdpt"), "{note}");
}

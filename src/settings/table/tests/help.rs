//! Defaults and ranges stand in the help texts as words. Here each of them is compared with what the program does.

use glam::DVec3;

use super::*;
use crate::generate::parts::{add, camera, diffuse, light, material};
use crate::generate::shapes::cuboid;
use crate::input::resolve::{outputs, resolve};
use crate::input::responses::chosen;
use crate::input::scenery;
use crate::input::sequence::Sequence;
use crate::scene::{LightKind, Scene};
use crate::settings::tev::DEFAULT_TEV;
use crate::settings::{DEFAULT_WIDTH, MIN_DEFAULT_LIGHT_PATHS};

/// The text between `[default` and the next `]`.
fn default_in_help(setting: &Setting) -> Option<&'static str> {
    setting.help.split_once("[default")?.1.split_once(']').map(|(default, _)| default)
}

/// An experiment with these settings, each written as name=value.
fn experiment(words: &str) -> Experiment {
    let mut experiment = Experiment::default();
    for word in words.split_whitespace() {
        let (name, value) = word.split_once('=').unwrap();
        named::set(&mut experiment, name, Some(value)).unwrap_or_else(|e| panic!("{words}: {e}"));
    }
    experiment
}

/// Everything that a render of a block with one lamp makes of these settings. `camera=none` leaves out the camera of the scene.
fn outcome(words: &str) -> String {
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [1.0; 3]));
    add(&mut scene, "block", white, cuboid(DVec3::NEG_ONE, DVec3::ONE));
    light(&mut scene, "lamp", DVec3::Y * 9.0, DVec3::NEG_Y, LightKind::Point { intensity: [2.0; 3] });
    let rest = words.replace("camera=none", "");
    if rest == words {
        camera(&mut scene, DVec3::Z * 5.0, DVec3::ZERO, 1.0, [40, 30]);
    }
    let mut experiment = experiment(&rest);
    let files = experiment.output.output.is_some().then(|| outputs(&experiment).unwrap());
    let fps = Sequence::new(&experiment, || Ok(Some(1.0))).unwrap().map(|sequence| sequence.fps());
    scenery::apply(&mut experiment, &mut scene).unwrap_or_else(|e| panic!("{words}: {e}"));
    experiment.output = OutputTable::default();
    experiment.gate.gate_keys = None;
    let settings = resolve(&experiment, &scene).unwrap_or_else(|e| panic!("{words}: {e}")).settings;
    let Scene { cameras, lights, materials, media, .. } = scene;
    format!("{:?}", (cameras, lights, materials, media, settings.to_tables(), settings.camera(), files, fps))
}

/// Other settings that the first one needs, its name, its default as the help writes it, the value for that, and another value.
const DEFAULTS: &[[&str; 5]] = &[
    ["look-from=3,2,9", "up", "0,1,0", "0,1,0", "1,0,0"],
    ["camera=none", "fov", "40", "40", "41"],
    ["camera=none", "principal-point", "0.5,0.5", "0.5,0.5", "0.4,0.5"],
    ["aperture=8mm focus=2", "blades", "0", "0", "5"],
    ["camera=none", "resolution", "512 pixels wide", "512x512", "513x512"],
    ["", "emitters", "scene", "scene", "lamp"],
    ["headlamp=1", "headlamp-offset", "0,0,0", "0,0,0", "1,0,0"],
    ["sky=1", "sky-scale", "1", "1", "2"],
    ["", "thin-glass", "auto", "auto", "all"],
    ["sigma-a=1", "sigma-s", "0", "0", "1"],
    ["sigma-s=1", "sigma-a", "0", "0", "1"],
    ["visibility=60m", "albedo", "0.99", "0.99", "0.98"],
    ["sigma-s=1", "phase", "isotropic", "isotropic", "rayleigh"],
    ["sigma-s=1 phase-g=0.5", "phase", "hg", "hg", "hg"],
    ["sigma-s=1 droplet-diameter=15", "phase", "draine", "draine", "draine"],
    ["sigma-s=1", "medium-ior", "1", "1", "1.33"],
    ["sigma-s=1 medium-ior=1.33", "medium-group-ior", "--medium-ior", "1.33", "1.4"],
    ["output=a.png gates=3m..9m/2", "png-gates", "sum", "sum", "each"],
    ["output=a.png", "exposure", "auto", "auto", "1"],
    ["output=a.exr checkpoint=a.acc", "every", "60s", "60s", "61s"],
    ["output=#.exr frames=0..2", "fps", "24", "24", "25"],
];

/// Settings whose help describes the default, because it is no value of the setting or depends on the scene. The defaults of
/// `light-paths`, `response` and `tev` are compared one by one; that of `grid-filter` needs a file.
const DESCRIBED: &[&str] = &[
    "camera",
    "aperture",
    "vignetting",
    "headlamp",
    "animation",
    "shutter",
    "rolling",
    "grid-filter",
    "grid-transform",
    "medium-bounds",
    "gate",
    "response",
    "estimator",
    "light-paths",
    "device",
    "png",
    "tev",
];

#[test]
fn help_names_the_defaults_that_hold() {
    for &[context, name, words, value, other] in DEFAULTS {
        let default = default_in_help(find(name).unwrap()).unwrap();
        let is_named = default.split([' ', ',']).any(|word| word == words) || default.ends_with(words);
        assert!(is_named, "--{name}: {default}");
        let without = outcome(context);
        assert_eq!(outcome(&format!("{context} {name}={value}")), without, "--{name} {value} with {context}");
        assert!(value == other || outcome(&format!("{context} {name}={other}")) != without, "--{name} {other}");
    }
}

/// A default of `[render]` may differ between estimators: `[default: 1; lcs: 16]`. Without a first part it is for the named ones.
#[test]
fn help_names_the_defaults_of_each_estimator() {
    for setting in RenderTable::SETTINGS.iter().filter(|setting| !DESCRIBED.contains(&setting.name)) {
        let Some(default) = default_in_help(setting) else { continue };
        let parts: Vec<&str> = default.trim_start_matches(':').split(';').map(str::trim).collect();
        for estimator in Estimator::ALL.into_iter().filter(|&estimator| setting.is_used_by(estimator)) {
            let own = parts.iter().find_map(|part| part.strip_prefix(&format!("{estimator}: ")));
            let value = own.or(parts.iter().find(|part| !part.contains(':')).copied());
            let value = value.unwrap_or_else(|| panic!("--{}: no default for {estimator}", setting.name));
            let tables = Settings::builder().estimator(estimator).build().unwrap().to_tables();
            let resolved = named::as_texts(&Experiment { render: tables.render, ..Experiment::default() });
            assert_eq!(
                resolved.get(setting.name).map(String::as_str),
                Some(value),
                "--{} of {estimator}",
                setting.name
            );
        }
    }
}

#[test]
fn every_default_in_help_is_compared() {
    let is_tested = |name: &str| DEFAULTS.iter().any(|row| row[1] == name) || DESCRIBED.contains(&name);
    for setting in all().filter(|setting| default_in_help(setting).is_some()) {
        assert!(setting.table == "render" || is_tested(setting.name), "--{}", setting.name);
    }
    assert!(DESCRIBED.iter().all(|name| default_in_help(find(name).unwrap()).is_some()));
    let most = |estimator: Estimator, has_several| (estimator.record().max_default_light_paths)(has_several);
    let words = format!(
        ": one per pixel, at least {MIN_DEFAULT_LIGHT_PATHS} and at most {}; lcs: at most {}, with several gates {}",
        most(Estimator::Bdpt, false),
        most(Estimator::Lcs, false),
        most(Estimator::Lcs, true)
    );
    assert_eq!(default_in_help(find("light-paths").unwrap()), Some(&*words));
    for estimator in Estimator::ALL.into_iter().filter(|estimator| *estimator != Estimator::Lcs) {
        assert_eq!(
            [false, true].map(|several| most(estimator, several)),
            [most(Estimator::Bdpt, false); 2],
            "{estimator}"
        );
    }
    // A response that is given also names its image.
    let shape = |words: &str| {
        let responses = chosen(&experiment(words).gate).unwrap();
        (responses.support(), responses.iter().next().unwrap().integral())
    };
    assert_eq!(default_in_help(find("response").unwrap()), Some(": box"));
    assert_eq!(shape("gate=3m..9m"), shape("gate=3m..9m response=box"));
    assert_ne!(shape("gate=3m..9m"), shape("gate=3m..9m response=gauss:0.1m"));
    assert_eq!(default_in_help(find("tev").unwrap()), Some(&*format!(" address: {DEFAULT_TEV}")));
    assert!(find("resolution").unwrap().help.contains(&format!("{DEFAULT_WIDTH} pixels wide")));
}

/// The ranges A to B in a text. A remark in brackets may stand after A.
fn ranges(text: &str) -> Vec<[f64; 2]> {
    let number = |word: Option<&str>| word?.trim_matches(|c: char| !c.is_ascii_digit()).parse::<f64>().ok();
    let pairs = text.match_indices(" to ").map(|(at, to)| (&text[..at], &text[at + to.len()..]));
    let range = |(before, after): (&str, &str)| {
        let before =
            before.strip_suffix(')').and_then(|before| before.rsplit_once('(')).map_or(before, |parts| parts.0);
        Some([number(before.split_whitespace().next_back())?, number(after.split_whitespace().next())?])
    };
    pairs.filter_map(range).collect()
}

/// Words that a setting accepts and that it refuses, for ranges in the help of settings that are no counts.
const RANGES: &[(&str, &[&str], &[&str])] = &[
    ("gates", &["1m..2m/1", "1m..2m/4096"], &["1m..2m/0", "1m..2m/4097"]),
    ("droplet-diameter", &["5", "50"], &["4.99", "50.01"]),
];

#[test]
fn help_names_the_ranges_that_hold() {
    let accepts = |name: &str, word: &str| named::set(&mut Experiment::default(), name, Some(word)).is_ok();
    let mut with_ranges = 0;
    // The phase of a continuous-wave sensor is no range of its values.
    for setting in all().filter(|setting| setting.name != "cw") {
        for range in ranges(setting.help) {
            with_ranges += 1;
            match setting.limits {
                Some((min, max)) => assert_eq!(range, [min, max].map(f64::from), "--{}", setting.name),
                None => assert!(RANGES.iter().any(|row| row.0 == setting.name), "--{}: {range:?}", setting.name),
            }
        }
        // The placeholder of a number is its range; a mean cosine may come near the ends only.
        let Some((low, high)) = setting.value.split_once("..") else { continue };
        let (Ok(low), Ok(high)) = (low.parse::<f64>(), high.parse::<f64>()) else { continue };
        with_ranges += 1;
        for (end, inside) in [(low, 0.001), (high, -0.001)] {
            assert!(accepts(setting.name, &(end + inside).to_string()), "--{} {end}", setting.name);
            assert!(!accepts(setting.name, &(end - inside).to_string()), "--{} {end}", setting.name);
        }
    }
    assert!(with_ranges >= 12, "{with_ranges}");
    for (name, inside, outside) in RANGES {
        assert!(!ranges(find(name).unwrap().help).is_empty(), "--{name}");
        assert!(inside.iter().all(|word| accepts(name, word)), "--{name}");
        assert!(!outside.iter().any(|word| accepts(name, word)), "--{name}");
    }
}

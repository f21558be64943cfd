use glam::DVec3;

use super::*;
use crate::scene::LightKind;
use crate::settings::units::Gate;

#[test]
fn what_is_left_open_follows_the_estimator() {
    let default = Settings::default();
    assert_eq!(
        (default.estimator(), default.responses().support(), default.budget()),
        (Estimator::Bdpt, Gate::OPEN, Budget::Spp(64))
    );
    assert_eq!((default.resolution(), default.crop().width(), default.crop().height()), ([512, 512], 512, 512));
    assert_eq!((default.queries(), default.leaf_size(), default.light_paths()), (1, 0, 50_000));
    let lcs = default.change().estimator(Estimator::Lcs).build().unwrap();
    assert_eq!((lcs.queries(), lcs.leaf_size(), lcs.single_tree(), lcs.light_paths()), (16, 16, true, 8192));
    let few = lcs.change().resolution([80, 80]).queries(3).leaf_size(2).build().unwrap();
    assert_eq!((few.queries(), few.leaf_size(), few.light_paths(), few.crop().width()), (3, 2, 6400, 80));
    // A setting that the estimator does not use has its default.
    let pt = few.change().estimator(Estimator::Pt).splat_paths(9).build().unwrap();
    assert_eq!((pt.queries(), pt.leaf_size(), pt.splat_paths()), (1, 0, 0));
    assert_eq!((pt.to_table().queries, pt.to_table().spp), (None, Some(64)));
}

#[test]
fn settings_are_equal_that_render_the_same() {
    let default = Settings::default();
    let spelled_out = default.change().table(&default.to_table()).crop(default.crop()).build().unwrap();
    assert_eq!(spelled_out, default);
    assert_ne!(default.change().seed(1).build().unwrap(), default);
    assert_eq!(default.change().queries(2).build().unwrap(), default);
    assert_ne!(default.change().gate(Gate { lo: 1.0, hi: 2.0 }).build().unwrap(), default);
}

#[test]
fn a_light_is_missed_if_it_is_switched_on_and_the_estimator_cannot_find_it() {
    let mut scene = Scene::default();
    let (point, beam) = (LightKind::Point { intensity: [1.0; 3] }, LightKind::Beam { power: [1.0; 3], radius: 0.0 });
    for (name, kind) in [("lamp", point), ("laser", beam)] {
        scene.add_light(name, DVec3::ZERO, DVec3::X, kind);
    }
    let missed = |estimator, emitters| {
        let settings = Settings::builder().estimator(estimator).emitters(emitters).build().unwrap();
        settings.missed_lights(&scene).map(|light| light.node.clone()).collect::<Vec<_>>()
    };
    assert_eq!(missed(Estimator::Pt, Emitters::Scene), ["laser"]);
    assert_eq!(missed(Estimator::Pt, Emitters::Nodes(vec!["lamp".into()])), Vec::<String>::new());
    assert_eq!(missed(Estimator::Lcs, Emitters::Scene), Vec::<String>::new());
}

#[test]
fn settings_outside_their_limits_are_not_built() {
    let builder = Settings::builder;
    let crop = Crop { x0: 0, y0: 0, x1: 513, y1: 512 };
    for (wrong, part) in [
        (builder().max_depth(0), "--max-depth is 0; it must be from 1 to 254"),
        (builder().splat_paths(MAX_LIGHT_PATHS + 1), "--splat-paths is 16777217; it must be at most 16777216"),
        (builder().budget(Budget::Spp(0)), "--spp is 0"),
        (builder().budget(Budget::Seconds(f64::NAN)), "--time must be more than 0"),
        (builder().resolution([0, 5]), "--resolution"),
        (builder().resolution([16_385, 2]), "sides must be from 1 to 16384"),
        (builder().resolution([65_536, 1]), "sides must be from 1 to 16384"),
        (builder().crop(crop), "does not lie inside the image of 512x512"),
        (builder().gate(Gate { lo: 2.0, hi: 1.0 }), "reversed"),
        (builder().gate(Gate { lo: f64::NAN, hi: 1.0 }), "NaN"),
    ] {
        let message = wrong.build().unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
    let gate = Gate { lo: 1.0, hi: 2.0 };
    let one = |name: &str, edge| Responses::new(vec![Response::new(name, gate, edge)]);
    for (wrong, part) in [
        (one("a", Edge::Ramp(-0.4)), "'a' has edges of -0.4 m"),
        (one("a", Edge::Ramp(0.0)), "above 0"),
        (one("a", Edge::Gauss(f64::INFINITY)), "edges of inf m"),
        (one("a", Edge::Gauss(f64::NAN)), "edges of NaN m"),
        (one("a.b", Edge::Sharp), "'a.b' is not a name for a response"),
        (one("", Edge::Sharp), "must not be empty"),
        (Ok(serde_json::from_str(r#"{"list": []}"#).unwrap()), "0 responses are not possible"),
        (Ok(Responses::uniform_with("1m..2m/2".parse().unwrap(), Edge::Ramp(-1.0))), "'bin0' has edges of -1 m"),
        (Ok(Responses::from(gate).repeated(1e-9)), "too short for the gate"),
        (Ok(Responses::from(gate).repeated(f64::NAN)), "too short for the gate"),
        (Ok(Gate { lo: -5.0, hi: -1.0 }.into()), "where no light arrives"),
    ] {
        let message = wrong.and_then(|responses| builder().responses(responses).build()).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
    // A scan has one row of pixels, which may be longer.
    assert!(builder().resolution([65_535, 1]).build().is_ok());
}

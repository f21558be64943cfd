use std::path::PathBuf;

use glam::{DAffine3, DVec3};

use super::*;
use crate::generate::parts::diffuse;
use crate::input::sequence::at_first_frame;
use crate::scene::{Camera, Image, Instance, Light, LightKind, Material, Medium, Mesh, Projection};

/// A scene with two cameras, a sun, a beam, an emissive lamp, and a wall that does not emit.
fn scene() -> Scene {
    let camera = |name: &str, aspect, resolution| Camera {
        name: name.into(),
        transform: DAffine3::IDENTITY,
        projection: Projection::Perspective { yfov: 1.0 },
        aspect,
        resolution,
        principal_point: Camera::CENTRED,
        lens: crate::scene::Lens::PINHOLE,
    };
    let material = |emission| Material { emission: [emission; 3], ..diffuse("", [1.0; 3]) };
    let light = |node: &str, kind| Light { node: node.into(), position: DVec3::ZERO, direction: DVec3::NEG_Z, kind };
    let instance = |mesh, node: &str| Instance { mesh, transform: DAffine3::IDENTITY, node: node.into() };
    // The diagonal of the scene is 2 sqrt(3) m, and 0.4 times this is 1.386 m.
    let mesh = |material| Mesh { material, positions: vec![[-1.0; 3], [1.0; 3]], ..Mesh::default() };
    Scene {
        meshes: vec![mesh(0), mesh(1)],
        instances: vec![instance(0, "wall"), instance(1, "lamp"), instance(1, "lamp")],
        materials: vec![material(0.0), material(2.0)],
        cameras: vec![camera("front", Some(2.0), None), camera("side", None, Some([640, 480]))],
        lights: vec![
            light("sun", LightKind::Directional { irradiance: [1.0; 3] }),
            light("beam", LightKind::Beam { power: [1.0; 3], radius: 0.0 }),
        ],
        ..Scene::default()
    }
}

fn experiment(toml: &str) -> Experiment {
    Experiment::parse(toml).unwrap()
}

fn settings_of(toml: &str) -> Settings {
    resolve(&experiment(toml), &scene()).unwrap().settings
}

fn message(toml: &str, scene: &Scene) -> String {
    resolve(&experiment(toml), scene).expect_err(toml).to_string()
}

#[test]
fn defaults_fill_what_nobody_said() {
    // Without a gate, light-cone queries have no advantage.
    let s = settings_of("emitter.emitters = 'lamp'");
    assert_eq!(
        (s.estimator(), s.strategies(), s.responses().support()),
        (Estimator::Bdpt, Strategies::All, Gate::OPEN)
    );
    assert_eq!((s.queries(), s.leaf_size()), (1, 0));
    let s = settings_of("gate.gate = '1m..2m'\nemitter.emitters = 'beam'");
    assert_eq!(
        (s.estimator(), s.strategies(), s.responses().support()),
        (Estimator::Lcs, Strategies::All, Gate { lo: 1.0, hi: 2.0 })
    );
    assert_eq!((s.budget(), s.seed(), s.max_depth()), (Budget::Spp(64), 0, 24));
    assert_eq!((s.light_paths(), s.splat_paths(), s.queries(), s.buckets(), s.no_cull()), (8192, 0, 16, 8, false));
    assert_eq!((s.leaf_size(), s.frontier(), s.single_tree()), (16, 32, true));
    let paths = |estimator: &str, resolution: &str| {
        let rest = "gate.gate = '1m..2m'\nemitter.emitters = 'beam'";
        settings_of(&format!("render.estimator = '{estimator}'\ncamera.resolution = '{resolution}'\n{rest}"))
            .light_paths()
    };
    assert_eq!(["lcs", "lcs-paper", "bdpt"].map(|e| paths(e, "512x256")), [8192, 50_000, 50_000]);
    assert_eq!(["lcs", "lcs-paper", "bdpt"].map(|e| paths(e, "96x64")), [6144; 3]);
    assert_eq!(["lcs", "lcs-paper", "bdpt"].map(|e| paths(e, "32x32")), [4096; 3]);
    let of_several = |estimator: &str, resolution: &str| {
        let rest = "gate.gates = '1m..2m/2'\nemitter.emitters = 'beam'";
        settings_of(&format!("render.estimator = '{estimator}'\ncamera.resolution = '{resolution}'\n{rest}"))
            .light_paths()
    };
    assert_eq!(["lcs", "lcs-paper", "bdpt"].map(|e| of_several(e, "512x256")), [2048, 50_000, 50_000]);
    assert_eq!(["lcs", "lcs-paper", "bdpt"].map(|e| of_several(e, "8x8")), [2048, 4096, 4096]);
    assert_eq!(
        (s.camera(), s.resolution(), s.emitters().clone()),
        (0, [512, 256], Emitters::Nodes(vec!["beam".into()]))
    );
    assert_eq!(s.crop(), Crop { x0: 0, x1: 512, y0: 0, y1: 256 });
}

#[test]
fn wide_gates_are_for_bdpt_except_with_beams() {
    let estimator =
        |gate: &str, lamp: &str| settings_of(&format!("gate.gate = '{gate}'\nemitter.emitters = '{lamp}'")).estimator();
    assert_eq!(estimator("1m..2.38m", "lamp"), Estimator::Lcs);
    assert_eq!(estimator("1m..2.39m", "lamp"), Estimator::Bdpt);
    assert_eq!(estimator("1m..2.39m", "beam"), Estimator::Lcs);
    let estimator =
        |gates: &str| settings_of(&format!("gate.gates = '{gates}'\nemitter.emitters = 'beam'")).estimator();
    assert_eq!(estimator("1m..9m/100"), Estimator::Lcs);
    assert_eq!(estimator("1m..9m/2"), Estimator::Bdpt);
    let mut mirror = scene();
    mirror.materials[0] = Material { metallic: 1.0, roughness: 0.0, ..mirror.materials[0].clone() };
    for (gates, expected) in [("1m..9m/100", Estimator::Bdpt), ("1m..2m/100", Estimator::Lcs)] {
        let experiment = experiment(&format!("gate.gates = '{gates}'\nemitter.emitters = 'beam'"));
        assert_eq!(resolve(&experiment, &mirror).unwrap().settings.estimator(), expected, "{gates}");
    }
}

#[test]
fn without_a_gate_pt_is_for_a_sun_over_rough_surfaces() {
    let estimator = |toml: &str, scene: &Scene| resolve(&experiment(toml), scene).unwrap().settings.estimator();
    assert_eq!(estimator("emitter.emitters = 'sun'", &scene()), Estimator::Pt);
    assert_eq!(estimator("emitter.emitters = 'lamp'", &scene()), Estimator::Bdpt);
    assert_eq!(estimator("emitter.emitters = 'lamp'\ngate.gate = '1m..9m'", &scene()), Estimator::Bdpt);
    assert_eq!(estimator("emitter.emitters = 'beam'", &scene()), Estimator::Lcs);
    for (roughness, expected) in [(0.2, Estimator::Bdpt), (0.4, Estimator::Pt)] {
        let mut glossy = scene();
        glossy.materials[0] = Material { metallic: 1.0, roughness, ..glossy.materials[0].clone() };
        assert_eq!(estimator("emitter.emitters = 'sun'", &glossy), expected);
    }
    // The mean of the texture's green channel multiplies the roughness.
    for (green, expected) in [([0, 255], Estimator::Pt), ([0, 102], Estimator::Bdpt)] {
        let rgba = green.iter().map(|&green| [255, green, 255, 255]).collect();
        let mut glossy = scene();
        let texture = Some(glossy.add_texture(Image { width: 2, height: 1, rgba }));
        glossy.materials[0] =
            Material { metallic: 1.0, roughness: 0.9, surface_texture: texture, ..glossy.materials[0].clone() };
        assert_eq!(estimator("emitter.emitters = 'sun'", &glossy), expected);
        let coated = diffuse("", [1.0; 3]);
        glossy.materials[0] =
            Material { clearcoat: 1.0, clearcoat_roughness: 0.9, clearcoat_roughness_texture: texture, ..coated };
        assert_eq!(estimator("emitter.emitters = 'sun'", &glossy), expected);
    }
}

#[test]
fn the_camera_gives_the_resolution_unless_one_is_typed() {
    assert_eq!(settings_of("camera.camera = 'side'").resolution(), [640, 480]);
    assert_eq!(settings_of("camera = { camera = 'side', resolution = '10x20' }").resolution(), [10, 20]);
}

#[test]
fn mistakes_name_the_flag_and_the_remedy() {
    let table = [
        ("camera.camera = 'back'", "choose one of front, side, auto"),
        ("camera.resolution = '0x5'", "--resolution is 0x5"),
        ("camera.resolution = '20000x5'", "--resolution WxH"),
        ("camera.resolution = '16384x16384'", "megapixels"),
        ("camera.crop = '0,513,0,10'", "inside the image of 512x256"),
        ("render.spp = 0", "--spp is 0; it must be from 1"),
        ("render.max-depth = 0", "--max-depth"),
        ("render.light-paths = 0", "--light-paths"),
        ("render.splat-paths = 16777217", "--splat-paths is 16777217; it must be at most 16777216"),
        ("render.queries = 65", "from 1 to 64"),
        ("render.buckets = 9", "from 1 to 8"),
        ("render.leaf-size = 17", "--leaf-size is 17; it must be from 1 to 16"),
        ("render.leaf-size = 0", "from 1 to 16"),
        ("render.frontier = 33", "--frontier is 33; it must be from 1 to 32"),
        ("render.time = '9000h'", "at most a year"),
        ("emitter.emitters = 'wall'", "may name sun, beam, lamp"),
        ("emitter.emitters = 'beam,nothing'", "no node 'nothing'"),
        ("gate.gate = '1m..2m'\nemitter.emitters = 'sun'", "choose other lights with --emitters from beam, lamp"),
        ("gate.gate = '100m+0.0001mm'\nemitter.emitters = 'beam'", "make the gate wider, or add --force"),
        (
            "gate = { gate = '1m..2m', repeat = '1e-15m' }\nemitter.emitters = 'beam'",
            "--repeat 1e-15m is too short for the gate of 1 m: give at least 0.001m",
        ),
        (
            "gate = { gates = '1m..6m/2', response = 'trapezoid:0.5m', repeat = '2.9mm' }\nemitter.emitters = 'beam'",
            "at least 0.003m",
        ),
    ];
    for (toml, part) in table {
        let message = message(toml, &scene());
        assert!(message.contains(part), "{toml}: {message}");
    }
}

#[test]
fn a_gated_render_leaves_out_directional_lights() {
    let others = Emitters::Nodes(vec!["beam".into(), "lamp".into()]);
    for emitters in ["", "emitter.emitters = 'sun,beam,lamp'"] {
        let gated = resolve(&experiment(&format!("gate.gate = '1m..2m'\n{emitters}")), &scene()).unwrap();
        assert_eq!(gated.settings.emitters(), &others);
        assert!(gated.warnings.iter().any(|warning| warning.ends_with("leaves out sun")), "{:?}", gated.warnings);
        let steady = resolve(&experiment(emitters), &scene()).unwrap();
        assert!(steady.settings.emitters().include("sun") && steady.warnings.is_empty(), "{:?}", steady.warnings);
    }
    let mut scene = scene();
    scene.lights.truncate(1);
    scene.instances.truncate(1);
    assert!(message("gate.gate = '1m..2m'", &scene).contains("or add a light that has a position"));
}

#[test]
fn a_scene_without_camera_or_light_is_refused() {
    let blind = Scene { cameras: vec![], ..scene() };
    assert!(message("scene = 'r.glb'", &blind).contains("r.glb: has no camera"));
    let mut dark = Scene { lights: vec![], ..scene() };
    dark.materials.iter_mut().for_each(|material| material.emission = [0.0; 3]);
    assert!(message("scene = 'r.glb'", &dark).contains("r.glb: has nothing that emits"));
    let empty = Scene { instances: vec![], ..scene() };
    assert!(message("scene = 'r.glb'", &empty).contains("r.glb: has no surfaces"));
}

#[test]
fn names_with_commas_may_be_typed_in_parts() {
    let mut scene = scene();
    let node = |name: &str| Instance { mesh: 1, transform: DAffine3::IDENTITY, node: name.into() };
    scene.instances.extend([node("lamp, left"), node("left"), node("a,b,c"), node("b")]);
    let chosen = |toml: &str| match resolve(&experiment(toml), &scene).unwrap().settings.emitters().clone() {
        Emitters::Nodes(names) => names,
        Emitters::Scene => panic!("{toml}"),
    };
    assert_eq!(chosen("emitter.emitters = 'a,b,c'"), ["a,b,c"]);
    assert_eq!(chosen("emitter.emitters = 'a , b,c,beam'"), ["a,b,c", "beam"]);
    assert_eq!(chosen("emitter.emitters = ['lamp, left', 'b']"), ["lamp, left", "b"]);
    // Names without commas have priority.
    assert_eq!(chosen("emitter.emitters = 'lamp, left'"), ["lamp", "left"]);
    scene.instances.retain(|instance| instance.node != "left");
    let message = |toml: &str| message(toml, &scene);
    let chosen = |toml: &str| resolve(&experiment(toml), &scene).unwrap().settings.emitters().clone();
    assert_eq!(chosen("emitter.emitters = 'lamp, left'"), Emitters::Nodes(vec!["lamp, left".into()]));
    assert!(message("emitter.emitters = 'a,b,d'").contains("no node 'd'"));
    assert!(message("emitter.emitters = 'left,lamp'").contains("no node 'left'"));
}

#[test]
fn a_thin_gate_warns_or_needs_force() {
    let warnings = |toml: &str| resolve(&experiment(toml), &scene()).unwrap().warnings.len();
    assert_eq!(warnings("gate.gate = '100m+1m'\nemitter.emitters = 'beam'"), 0);
    assert_eq!(warnings("gate.gate = '100m+1mm'\nemitter.emitters = 'beam'"), 1);
    assert_eq!(warnings("gate = { gate = '100m+0.0001mm', force = true }\nemitter.emitters = 'beam'"), 1);
}

/// A gate that repeats also counts light with later travel times, up to 4 diagonals of the scene (14 m). Their rounding errors are larger.
#[test]
fn a_thin_gate_that_repeats_is_tested_at_late_travel_times() {
    let warnings = |keys: &str| {
        let toml = format!("gate = {{ {keys} }}\nemitter.emitters = 'beam'");
        resolve(&experiment(&toml), &scene()).map(|resolved| resolved.warnings.len()).map_err(|e| e.to_string())
    };
    assert_eq!(warnings("gate = '0.1m+0.1mm'"), Ok(0));
    assert_eq!(warnings("gate = '0.1m+0.1mm', repeat = '1m'"), Ok(1));
    assert_eq!(warnings("gate = '0.1m+1mm', repeat = '1m'"), Ok(0));
    // The earlier of two gates may be the thinner one.
    let two = "response = ['a=box:0.1m+0.01mm', 'b=box:0.9m+0.08mm']";
    assert_eq!(warnings(two), Ok(0));
    assert!(warnings(&format!("{two}, repeat = '1m'")).unwrap_err().contains("only 10.5 steps"));
    assert_eq!(warnings(&format!("{two}, repeat = '1m', force = true")), Ok(1));
}

#[test]
fn resolved_settings_printed_as_an_experiment_resolve_to_themselves() {
    let typed = experiment(
        "emitter.emitters = 'beam'\ngate.depth = '6.25m..6.4m'\nrender = { time = '30s', seed = 7, no-cull = true }",
    );
    let first = resolve(&typed, &scene()).unwrap().settings;
    let printed = as_experiment(&typed, &first, &scene()).to_toml();
    assert_eq!(settings_of(&printed), first, "{printed}");
}

#[test]
fn a_printed_experiment_has_no_crop_of_the_whole_image() {
    let printed = |toml: &str| {
        let typed = experiment(&format!("emitter.emitters = 'beam'\n{toml}"));
        as_experiment(&typed, &resolve(&typed, &scene()).unwrap().settings, &scene())
    };
    let mut whole = printed("camera.resolution = '64x64'");
    assert_eq!(whole.camera.crop, None);
    // A stored crop of 64x64 would cut a later render of 128x128 to its top left quarter.
    whole.camera.resolution = Some(Resolution([128, 128]));
    let settings = resolve(&whole, &scene()).unwrap().settings;
    assert_eq!(settings.crop(), Crop { x0: 0, x1: 128, y0: 0, y1: 128 });
    let part = Crop { x0: 0, x1: 63, y0: 0, y1: 64 };
    assert_eq!(printed("camera = { resolution = '64x64', crop = '0,63,0,64' }").camera.crop, Some(part));
}

#[test]
fn a_printed_experiment_keeps_the_moving_gate() {
    let keys = "gate = { gate-keys = [[2, '1m..2m'], [4, '5m..6m']], response = 'gauss:0.01m', force = true }";
    let typed = experiment(&format!("emitter.emitters = 'beam'\noutput.frames = '2..4'\n{keys}"));
    let first = at_first_frame(&typed, None).unwrap();
    let settings = resolve(&first, &scene()).unwrap().settings;
    assert_eq!(settings.responses().iter().next().unwrap().gate(), Gate { lo: 1.0, hi: 2.0 });
    let printed = as_experiment(&first, &settings, &scene());
    assert_eq!((&printed.gate, printed.render.estimator), (&typed.gate, Some(Estimator::Lcs)));
    assert_eq!(experiment(&printed.to_toml()), printed);
}

#[test]
fn a_single_response_keeps_its_name() {
    for (gate, name) in [
        ("response = 'near=box:1m..2m'", "near"),
        ("response = 'near=box:0m..inf'", "near"),
        ("gate = '1m..2m'\nresponse = 'box'", "box"),
        ("gate = '1m..2m'", "gate"),
        ("gate = '1m..2m'\nresponse = 'gauss:0.1m'", "gauss"),
        ("force = true", "steady"),
    ] {
        let typed = experiment(&format!("emitter.emitters = 'beam'\n[gate]\n{gate}"));
        let first = resolve(&typed, &scene()).unwrap().settings;
        let printed = as_experiment(&typed, &first, &scene()).to_toml();
        assert_eq!(settings_of(&printed), first, "{printed}");
        assert_eq!(first.responses().iter().next().unwrap().name(), name, "{gate}");
    }
}

#[test]
fn leaves_follow_the_estimator() {
    let size = |toml: &str| settings_of(toml).leaf_size();
    assert_eq!(size("render.estimator = 'lcs'"), 16);
    assert_eq!(size("render = { estimator = 'lcs', leaf-size = 4 }"), 4);
    assert_eq!(size("render = { estimator = 'bdpt', leaf-size = 4 }"), 0);
    let typed =
        experiment("emitter.emitters = 'beam'\nrender = { estimator = 'lcs', leaf-size = 8, single-tree = false }");
    for experiment in [typed, experiment("render.estimator = 'bdpt'")] {
        let first = resolve(&experiment, &scene()).unwrap().settings;
        let printed = as_experiment(&experiment, &first, &scene()).to_toml();
        assert_eq!(settings_of(&printed), first, "{printed}");
    }
}

#[test]
fn importance_is_for_lcs() {
    let of = |toml: &str| {
        let resolved = resolve(&experiment(&format!("emitter.emitters = 'beam'\n{toml}")), &scene()).unwrap();
        let printed = as_experiment(&Experiment::default(), &resolved.settings, &scene()).render.importance;
        (resolved.settings.importance(), printed, resolved.warnings.len())
    };
    let some = Importance { cosine: false, ..Importance::ALL };
    assert_eq!(of("render.estimator = 'lcs'"), (Importance::ALL, Some(Importance::ALL), 0));
    assert_eq!(of("render = { estimator = 'lcs', importance = 'overlap, gloss, centre' }"), (some, Some(some), 0));
    assert_eq!(of("render = { estimator = 'lcs-paper', importance = 'none' }"), (Importance::ALL, None, 1));
    let warned = |toml: &str| resolve(&experiment(toml), &scene()).unwrap().warnings.join("; ");
    let many = "queries = 64, frontier = 3, buckets = 2, leaf-size = 3, single-tree = true, splat-paths = 9";
    let of_pt = warned(&format!("render = {{ estimator = 'pt', {many} }}"));
    for flag in ["queries", "frontier", "buckets", "leaf-size", "single-tree", "splat-paths"] {
        assert!(of_pt.contains(&format!("--{flag} is only for")), "{of_pt}");
    }
    assert!(!warned(&format!("render = {{ estimator = 'lcs', {many} }}")).contains("is only for"));
    let of_paper = warned(&format!("render = {{ estimator = 'lcs', strategies = 'paper', {many} }}"));
    assert!(of_paper.contains("--splat-paths has no effect"), "{of_paper}");
    for importance in [Importance::ALL, Importance::NONE, some] {
        assert_eq!(importance.to_string().parse::<Importance>().unwrap(), importance);
    }
    assert_eq!(some.to_string(), "centre,overlap,gloss");
    for bad in ["", "center", "all,cosine", "cosine,"] {
        assert!(bad.parse::<Importance>().unwrap_err().to_string().contains("centre,cosine,overlap,gloss"), "{bad}");
    }
}

#[test]
fn outputs_are_named_after_the_image() {
    let ok = |toml: &str| outputs(&experiment(toml)).unwrap();
    assert_eq!(ok("output = { output = 'a/b.exr', png = true }").png, Some("a/b.png".into()));
    assert_eq!(ok("output = { output = 'a/b.exr' }").png, None);
    let both = ok("output = { output = ['a.npy', 'b.exr'], variance = true, png = true }");
    let files: Vec<PathBuf> = ["b.exr", "a.npy", "a.json", "a.variance.npy", "a.png"].map(PathBuf::from).into();
    assert_eq!((both.files(), both.has_variance()), (files, true));
    let bins = ok("gate.gates = '1m..2m/4096'\noutput.output = 'a.npy'");
    assert_eq!((bins.files(), bins.has_variance()), (vec!["a.npy".into(), "a.json".into()], false));
    let sums = ok("gate.gates = '1m..2m/64'\noutput = { checkpoint = 'a.acc', output = ['b.acc', 'c.png'] }");
    let files: Vec<PathBuf> = ["b.acc", "c.png", "a.acc"].map(PathBuf::from).into();
    assert_eq!((sums.files(), sums.has_variance(), sums.checkpoint), (files, true, Some(("a.acc".into(), 60.0))));
    // Sums of more than 64 gates have variances only if the user wants them.
    for (variance, wanted) in [("", false), (", variance = true", true)] {
        let many = ok(&format!("gate.gates = '1m..2m/65'\noutput = {{ output = 'a.acc'{variance} }}"));
        assert_eq!(many.has_variance(), wanted);
    }
    for (toml, part) in [
        ("", "-o OUT.exr"),
        ("output.output = 'a.jpg'", "must end in .exr, .npy, .png or .acc"),
        ("output = { output = 'a.png', png = true }", "keep one"),
        ("output = { checkpoint = 'a.acc', png = true }", "write --png FILE.png"),
        ("output.checkpoint = 'a.exr'", "the file of --checkpoint, a.exr, must end in .acc"),
        ("output = { output = 'a.exr', resume = 'b.npy' }", "the file of --resume, b.npy, must end in .acc"),
        ("output = { output = 'a.exr', every = '5s' }", "add --checkpoint FILE.acc"),
        ("output = { output = 'a.exr', shard = '0/2' }", "add -o OUT.acc"),
        ("output = { output = 'a.acc', shard = '0/2', strategy-images = 'b' }", "all iterations in one run"),
        ("output.output = ['a.exr', 'b.exr']", "would hold the same image"),
        ("gate.gates = '1m..2m/65'\noutput.output = 'a.exr'", "write -o OUT.npy"),
        ("output = { output = 'a.exr', variance = true }", "--variance is for an array"),
        ("output = { output = 'a.npy', aov = 'depth' }", "--aov adds layers to an image file or to sums"),
        ("gate.gates = '1m..2m/2'\noutput = { output = 'a.exr', strategy-images = 'b' }", "needs a single gate"),
        (
            "gate = { gate = '1m..2m', repeat = '9m' }\noutput = { output = 'a.exr', strategy-images = 'b' }",
            "without --response and --repeat",
        ),
        (
            "gate = { gate = '1m..2m', response = 'gauss:1cm' }\noutput = { output = 'a.exr', strategy-images = 'b' }",
            "without --response and --repeat",
        ),
        ("output = { output = 'a.exr', png = 'a.jpg' }", "must end in .png"),
        ("output = { output = 'a.exr', stats = 'a.exr' }", "must end in .json"),
    ] {
        let message = outputs(&experiment(toml)).expect_err(toml).to_string();
        assert!(message.contains(part), "{toml}: {message}");
    }
}

/// In a scene that moves, the camera may be away from the origin of render space. Coordinates near the camera then have coarser steps.
#[test]
fn thin_gates_of_scenes_that_move_are_judged_by_the_shifted_origin() {
    let mut scene = scene();
    // The unit of render space is 4096 m, so the points of the grid are 1024 m apart.
    scene.instances[0].transform = DAffine3::from_translation(5000.0 * DVec3::X);
    scene.cameras[0].transform = DAffine3::from_translation(500.0 * DVec3::X);
    let experiment = experiment("gate.gate = '2m..2.005m'\nemitter.emitters = ['lamp']");
    assert_eq!(resolve(&experiment, &scene).unwrap().warnings, Vec::<String>::new());
    scene.moving = Some([].into());
    let warnings = resolve(&experiment, &scene).unwrap().warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("steps of 32-bit travel times"), "{warnings:?}");
    // The unit is now 2048 m, and the points of the grid are 512 m apart. The camera is at one of them, so it is at the origin.
    scene.cameras[0].transform = DAffine3::from_translation(1024.0 * DVec3::X);
    assert_eq!(resolve(&experiment, &scene).unwrap().warnings, Vec::<String>::new());
}

#[test]
fn the_default_estimator_depends_on_the_fog() {
    let diagonal = scene().diagonal();
    let of = |sigma: f64, toml: &str| {
        let media = vec![Medium { sigma_s: [0.0, sigma, 0.0], ..Medium::default() }];
        resolve(&experiment(toml), &Scene { media, ..scene() }).unwrap().settings.estimator()
    };
    let steady = "emitter.emitters = 'lamp'";
    let wide = format!("{steady}\ngate.gate = '0m..{}m'", 0.9 * diagonal);
    assert_eq!([0.0, 2.9, 3.1].map(|x| of(x / diagonal, steady)), [Estimator::Bdpt, Estimator::Bdpt, Estimator::Lcs]);
    assert_eq!([0.0, 2.9, 3.1].map(|x| of(x / diagonal, &wide)), [Estimator::Bdpt, Estimator::Bdpt, Estimator::Lcs]);
}

/// Fog that fills all space has no diagonal, and neither has a scene without surfaces.
#[test]
fn fog_without_surfaces_is_as_thick_as_the_gate_is_late() {
    let of = |sigma: f64, toml: &str| {
        let media = vec![Medium { sigma_s: [sigma; 3], ..Medium::default() }];
        let mut foggy = Scene { media, cameras: scene().cameras, ..Scene::default() };
        let kind = LightKind::Point { intensity: [1.0; 3] };
        foggy.lights.push(Light { node: "bulb".into(), position: DVec3::ONE, direction: DVec3::NEG_Y, kind });
        resolve(&experiment(toml), &foggy).unwrap().settings.estimator()
    };
    let wide = "gate.gate = '0m..10m'";
    assert_eq!([0.29, 0.31].map(|sigma| of(sigma, wide)), [Estimator::Bdpt, Estimator::Lcs]);
    assert_eq!([0.01, 0.31].map(|sigma| of(sigma, "gate.gate = '7m..10m'")), [Estimator::Lcs, Estimator::Lcs]);
    assert_eq!([0.0, 0.01].map(|sigma| of(sigma, "")), [Estimator::Bdpt, Estimator::Lcs]);
}

use super::*;
use crate::settings::Emitters;
use crate::settings::numbers::{Fov, Height, Numbers};
use crate::settings::units::{Depth, Gate};
use crate::settings::values::{Files, Folders, Png};

const FULL: &str = r#"
scene = "room.glb"
[camera]
camera = "front"
resolution = "640x480"
crop = "0,10,0,20"
[emitter]
emitters = ["beam", "lamp, left"]
[input]
double-sided = true
allow-path = "../textures"
[gate]
depth = "6.25m..6.4m"
[render]
estimator = "bdpt"
strategies = "paper"
time = "30s"
max-depth = 7
no-cull = true
[output]
output = "out.exr"
png = true
"#;

#[test]
fn a_full_file_is_read_and_survives_printing() {
    let read = Experiment::parse(FULL).unwrap();
    assert_eq!(read.gate.depth, Some(Depth(Gate { lo: 12.5, hi: 12.8 })));
    assert_eq!(read.emitter.emitters, Some(Emitters::Nodes(vec!["beam".into(), "lamp, left".into()])));
    assert_eq!(read.output.png, Some(Png::Wanted(true)));
    assert_eq!(read.input.allow_path, Some(Folders(vec!["../textures".into()])));
    assert_eq!(Experiment::parse(&read.to_toml()).unwrap(), read);
}

#[test]
fn mistakes_are_reported_where_they_stand() {
    let table = [
        ("scene = \"a.glb\"\nscne = 1\n", 2, 1, "no key scne"),
        ("[render]\nspp = 4\n  sppp = 5\n", 3, 3, "no key sppp"),
        ("[render]\nmax_dept = 5\n", 2, 1, "no key max-dept"),
        ("\n[render]\nmax-depth = 5\nmax_depth = 6\n", 2, 1, "max-depth twice"),
        ("[render]\nmax_depth = -1\n", 2, 13, "a whole number"),
        ("render = 3\n", 1, 10, "write [render]"),
        ("[render]\nspp = -4\n", 2, 7, "the number -4"),
        ("[render]\nspp = \"four\"\n", 2, 7, "the text"),
        ("[render]\nestimator = \"magic\"\n", 2, 13, "choose pt, bdpt, epc, lcs-paper or lcs"),
        ("[gate]\ngate = \"1..2\"\n", 2, 8, "no unit"),
        ("[gate]\ngate = \"1m..2m\"\ndepth = \"1m..2m\"\n", 3, 1, "keep one"),
        ("[gate]\ngates = \"1m..2m/4\"\ndepth = \"1m..2m\"\n", 3, 1, "depth and gates both set the gates: keep one"),
        (
            "[gate]\ngate-keys = [[0, \"1m..2m\"]]\ngate = \"1m..2m\"\n",
            3,
            1,
            "gate and gate-keys both set the gate: keep one",
        ),
        ("[gate]\ndepth = \"1m..2m\"\ngate_keys = [[0, \"1m..2m\"]]\n", 3, 1, "depth and gate-keys both"),
        ("[gate]\ngates = \"1m..2m/4\"\ngate-keys = [[0, \"1m..2m\"]]\n", 3, 1, "gates and gate-keys both"),
        (
            "[gate]\ncw = 20\ngate-keys = [[0, \"1m..2m\"]]\n",
            3,
            1,
            "gate-keys and cw both say which light counts: keep one",
        ),
        (
            "[input]\nat = 1\n[output]\nframes = \"0..2\"\n",
            4,
            1,
            "at and frames both set the time of the scene: keep one",
        ),
        ("[gate]\ngates = \"1m..2m\"\n", 2, 9, "how many gates"),
        ("[render]\ntime = \"3s\"\nspp = 4\n", 3, 1, "keep one"),
        ("[camera]\nresolution = \"big\"\n", 2, 14, "640x480"),
        ("[medium]\nsigma = 1.0\n", 2, 1, "no key sigma"),
        ("scene = \"a.glb\n", 1, 15, "invalid basic string"),
        ("[emitter]\nemitters = 3\n", 2, 12, "list of node names"),
        ("[output]\npng = 3\n", 2, 7, "true, false or a file name"),
        ("[camera]\nlook-from = [1, 2]\n", 2, 13, "not a list of 3 numbers"),
        ("[camera]\nup = true\n", 2, 6, "must be numbers"),
        ("[camera]\nfov = 200\n", 2, 7, "between 0 and 180"),
        ("[camera]\northo = -2\n", 2, 9, "metres above 0"),
        ("[camera]\northo = true\n", 2, 9, "a number of metres"),
        ("[camera]\northo = 2\nfov = 30\n", 3, 1, "fov and ortho both set the view of the camera: keep one"),
        ("[emitter]\nheadlamp = false\n", 2, 12, "remove the key"),
        ("[emitter]\nlamp = [[1, 2, 3]]\n", 2, 8, "X,Y,Z,INTENSITY"),
        ("\n[[light]]\ntype = \"point\"\nposition = [1, 2, 3]\n", 2, 1, "needs an intensity"),
    ];
    for (text, line, column, part) in table {
        let error = Experiment::parse(text).expect_err(text);
        assert!(error.mistake.to_string().contains(part), "{text}: {error}");
        assert_eq!((error.line, error.column), (line, column), "{text}: {error}");
    }
}

#[test]
fn lists_and_text_are_alike() {
    let of = |text: &str| Experiment::parse(text).unwrap_or_else(|e| panic!("{text}: {e}"));
    for (text, list) in [
        ("camera.resolution = '640x480'", "camera.resolution = [640, 480]"),
        ("camera.crop = '0,10,0,20'", "camera.crop = [0, 10, 0, 20]"),
        ("camera.up = '0,0,1'", "camera.up = [0, 0, 1]"),
        ("emitter.emitters = 'a,b'", "emitter.emitters = ['a', 'b']"),
        ("emitter.lamp = '0,1,2,3'", "emitter.lamp = [[0, 1, 2, 3]]"),
        ("input.allow-path = 'a'", "input.allow-path = ['a']"),
        ("render.importance = 'centre,gloss'", "render.importance = ['centre', 'gloss']"),
        ("render.importance = 'all'", "render.importance = ['all']"),
        ("output.aov = 'depth,normal'", "output.aov = ['depth', 'normal']"),
    ] {
        assert_eq!(of(text), of(list), "{text}");
    }
}

#[test]
fn underscores_count_as_dashes_in_keys() {
    let of = |text: &str| Experiment::parse(text).unwrap();
    let dashes = of("render = { max-depth = 5, no-cull = true }\n[output]\nstrategy-images = 'a_b'\n");
    assert_eq!(of("render = { max_depth = 5, no_cull = true }\n[output]\nstrategy_images = 'a_b'\n"), dashes);
    assert_eq!((dashes.render.max_depth, dashes.output.strategy_images), (Some(5), Some("a_b".into())));
}

#[test]
fn flags_win_and_alternatives_replace_each_other() {
    let file = Experiment::parse(FULL).unwrap();
    let mut flags = Experiment::default();
    flags.gate.gate = Some(Gate { lo: 1.0, hi: 2.0 });
    flags.render.spp = Some(3);
    flags.render.seed = Some(9);
    let merged = flags.over(file);
    assert_eq!((merged.gate.gate, merged.gate.depth), (Some(Gate { lo: 1.0, hi: 2.0 }), None));
    assert_eq!((merged.render.spp, merged.render.time), (Some(3), None));
    assert_eq!((merged.render.seed, merged.render.max_depth), (Some(9), Some(7)));
    assert_eq!(merged.camera.camera.as_deref(), Some("front"));

    let file = Experiment::parse("camera = { camera = 'auto', look-from = '1,2,3', crop = '0,1,0,1' }").unwrap();
    let mut flags = Experiment::default();
    flags.camera.fov = Some(Fov(30.0));
    assert_eq!(flags.clone().over(file.clone()).camera.look_from, Some(Numbers([1.0, 2.0, 3.0])));
    flags.camera.camera = Some("front".into());
    let merged = flags.over(file).camera;
    assert_eq!((merged.look_from, merged.fov, merged.crop.is_some()), (None, Some(Fov(30.0)), true));

    let file = Experiment::parse("camera.fov = 30").unwrap();
    let mut flags = Experiment::default();
    flags.camera.ortho = Some(Height(2.0));
    let merged = flags.over(file).camera;
    assert_eq!((merged.fov, merged.ortho), (None, Some(Height(2.0))));
}

#[test]
fn a_moment_replaces_the_frames_of_the_file() {
    let file = "[output]\nframes = '0..16'\nfps = 8\nshard = '0/2'\noutput = 'a.##.exr'\ngif = 'a.gif'\ncontact-sheet = 'a.png'\n\
                [gate]\ngate-keys = [[0, '1m..2m'], [16, '3m..4m']]\n";
    let merged = |flags: &str, file: &str| Experiment::parse(flags).unwrap().over(Experiment::parse(file).unwrap());
    let moment = merged("input.at = 1", file);
    assert_eq!(
        moment,
        Experiment::parse("input.at = 1\ngate.gate = '2m..3m'\noutput.output = 'a.##.exr'").unwrap(),
        "the gate is that of frame 8"
    );
    assert_eq!(
        merged("input.at = 1\ngate.depth = '4m..5m'", file).gate,
        Experiment::parse("gate.depth = '4m..5m'").unwrap().gate
    );
    let frames = merged("output.frames = '2..3'", "input.at = 1\n");
    assert_eq!((frames.input.at, frames.output.frames.is_some()), (None, true));
}

#[test]
fn outputs_replace_what_does_not_fit_them() {
    let merged = |flags: &str, file: &str| {
        let parse = |keys: &str| Experiment::parse(&format!("[output]\n{keys}\n")).unwrap();
        parse(flags).over(parse(file)).output
    };
    let of = |keys: &str| Experiment::parse(&format!("[output]\n{keys}\n")).unwrap().output;
    let all = "output = ['a.exr', 'a.npy']\naov = 'depth'\nvariance = true\npng = true\nexposure = 2";
    for (flags, file, both) in [
        ("output = 'b.png'", all, "output = 'b.png'\nexposure = 2"),
        ("output = 'b.exr'", all, "output = 'b.exr'\naov = 'depth'\npng = true\nexposure = 2"),
        ("output = 'b.npy'", all, "output = 'b.npy'\nvariance = true\npng = true\nexposure = 2"),
        ("output = 'b.acc'", all, "output = 'b.acc'\naov = 'depth'\nvariance = true\npng = true\nexposure = 2"),
        ("output = 'b.exr'\npng = false", all, "output = 'b.exr'\naov = 'depth'\npng = false\nexposure = 2"),
        ("output = 'b.exr'", "output = ['a.exr', 'a.png']\nexposure = 2", "output = 'b.exr'"),
        ("png = 'b.png'", "output = ['a.exr', 'a.png']\nexposure = 2", "output = 'a.exr'\npng = 'b.png'\nexposure = 2"),
        ("png = true", "output = 'a.png'", "output = 'a.png'\npng = true"),
        // A mistake of the file alone stays one, and so does a mistake of the flags alone.
        ("output = 'b.exr'", "exposure = 2", "output = 'b.exr'\nexposure = 2"),
        (
            "output = 'b.exr'\nvariance = true",
            all,
            "output = 'b.exr'\nvariance = true\naov = 'depth'\npng = true\nexposure = 2",
        ),
    ] {
        assert_eq!(merged(flags, file), of(both), "{flags} over {file}");
    }
    let moment = Experiment { input: Experiment::parse("input.at = 1").unwrap().input, ..Experiment::default() };
    let file = Experiment::parse("[output]\nframes = '0..2'\noutput = 'a#.exr'\ngif = 'a.gif'\nexposure = 2").unwrap();
    assert_eq!(moment.over(file).output, of("output = 'a#.exr'"));
    let checkpoint = merged("output = 'b.npy'", "output = 'a.exr'\naov = 'depth'\ncheckpoint = 'c.acc'");
    assert_eq!(checkpoint, of("output = 'b.npy'\naov = 'depth'\ncheckpoint = 'c.acc'"));
}

#[test]
fn a_gate_replaces_the_responses_of_the_file_that_have_gates() {
    let merged = |flags: &str, file: &str| {
        let parse = |keys: &str| Experiment::parse(&format!("[gate]\n{keys}\n")).unwrap();
        parse(flags).over(parse(file)).gate
    };
    let of = |keys: &str| Experiment::parse(&format!("[gate]\n{keys}\n")).unwrap().gate;
    let slices = "response = ['near=box:1m..2m', 'slice.csv']";
    for gate in ["gate = '5m..6m'", "depth = '5m..6m'", "gates = '5m..6m/4'", "gate-keys = [[0, '5m..6m']]"] {
        assert_eq!(merged(gate, slices), of(gate));
        // The edges of the file belong to any gate.
        assert_eq!(merged(gate, "response = 'gauss:0.1m'"), of(&format!("{gate}\nresponse = 'gauss:0.1m'")));
        assert_eq!(merged(slices, gate), of(slices));
    }
    let mixed = "response = ['near=box:1m..2m', 'gauss:0.1m']";
    assert_eq!(merged("gate = '5m..6m'", mixed), of(&format!("gate = '5m..6m'\n{mixed}")));
    assert_eq!(merged("gates = '5m..6m/4'", mixed), of("gates = '5m..6m/4'"), "--gates takes one response");
    assert_eq!(merged("response = 'gauss:0.1m'", "gate = '5m..6m'"), of("gate = '5m..6m'\nresponse = 'gauss:0.1m'"));
}

#[test]
fn paths_are_taken_from_the_folder_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("e.toml");
    std::fs::write(
        &path,
        "scene = \"s/a.glb\"\ninput.allow-path = ['t', '/u']\n[output]\noutput = \"/abs.exr\"\npng = \"p.png\"\n",
    )
    .unwrap();
    let read = Experiment::read(&path).unwrap();
    assert_eq!(read.scene, Some(folder.path().join("s/a.glb")));
    assert_eq!(read.input.allow_path, Some(Folders(vec![folder.path().join("t"), "/u".into()])));
    assert_eq!(read.output.output, Some(Files(vec!["/abs.exr".into()])));
    assert_eq!(read.output.png, Some(Png::File(folder.path().join("p.png"))));
}

#[test]
fn empty_names_of_outputs_count_as_not_given() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("e.toml");
    let read = |output: &str| {
        std::fs::write(&path, format!("scene = ''\n[output]\noutput = {output}\npng = ''\nstats = ''\n")).unwrap();
        let Experiment { scene, output, .. } = Experiment::read(&path).unwrap();
        assert_eq!((scene, output.png, output.stats), (None, None, None));
        output.output
    };
    assert_eq!(read("['', '/a.exr', '', '/a.npy']"), Some(Files(vec!["/a.exr".into(), "/a.npy".into()])));
    assert_eq!((read("''"), read("['', '']")), (None, None));
}

use glam::{DAffine3, DVec3};

use super::*;
use crate::generate::parts::{add, camera, diffuse, light, material};
use crate::generate::shapes::{cuboid, quad};
use crate::input::resolve::{as_experiment, resolve};
use crate::scene::{Camera, LightKind, Projection};
use crate::settings::Emitters;
use crate::settings::numbers::Headlamp;

const LO: DVec3 = DVec3::new(-1.0, 0.0, -3.0);
const HI: DVec3 = DVec3::new(2.0, 1.0, 4.0);
const CENTRE: DVec3 = DVec3::new(0.5, 0.5, 0.5);

/// A white block without camera and light.
fn block() -> Scene {
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [1.0; 3]));
    add(&mut scene, "block", white, cuboid(LO, HI));
    scene
}

/// The block with a camera at (0.5, 0.5, 10) that looks along -Z, and a point lamp. The lamp is called `sky`, so that added skies and
/// lights collide with its name.
fn staged() -> Scene {
    let mut scene = block();
    camera(&mut scene, CENTRE.with_z(10.0), CENTRE, 1.0, [40, 30]);
    light(&mut scene, "sky", DVec3::Y * 9.0, DVec3::NEG_Y, LightKind::Point { intensity: [2.0; 3] });
    scene
}

fn experiment(toml: &str) -> Experiment {
    Experiment::parse(toml).unwrap_or_else(|e| panic!("{toml}: {e}"))
}

/// Applies `toml`. Returns the scene, the completed experiment and the notes.
fn applied(toml: &str, mut scene: Scene) -> (Scene, Experiment, Vec<String>) {
    let mut experiment = experiment(toml);
    let notes = apply(&mut experiment, &mut scene).unwrap_or_else(|e| panic!("{toml}: {e}"));
    (scene, experiment, notes)
}

fn close(a: DVec3, b: DVec3) -> bool {
    a.distance(b) < 1e-9
}

/// The unit vector along which a camera looks.
fn view(camera: &Camera) -> DVec3 {
    camera.transform.transform_vector3(DVec3::NEG_Z)
}

#[test]
fn a_scene_with_camera_and_light_stays_as_it_is() {
    let (scene, experiment, notes) = applied("", staged());
    let debug = |scene: &Scene| format!("{:?} {:?}", scene.cameras, scene.lights);
    assert_eq!(debug(&scene), debug(&staged()));
    assert_eq!((experiment, notes), (Experiment::default(), vec![]));
}

#[test]
fn an_automatic_camera_frames_the_scene() {
    for (resolution, fov) in [([512, 512], 40.0f64), ([640, 360], 40.0), ([200, 900], 40.0), ([64, 64], 100.0)] {
        let [width, height] = resolution;
        let toml = format!("camera = {{ camera = 'auto', fov = {fov}, resolution = '{width}x{height}' }}");
        let (scene, _, _) = applied(&toml, staged());
        let camera = scene.cameras.last().unwrap();
        let yfov = fov.to_radians();
        assert_eq!((camera.name.as_str(), &camera.projection), ("auto", &Projection::Perspective { yfov }));
        assert!(camera.transform.translation.cmpgt(HI.with_x(0.5)).all(), "not in front and above: {camera:?}");
        let tangent = (0.5 * yfov).tan();
        let extent = [tangent * f64::from(width) / f64::from(height), tangent];
        let corners = [LO, HI].map(|x| x.x).into_iter().flat_map(|x| {
            let ys = [LO.y, HI.y].into_iter();
            ys.flat_map(move |y| [LO.z, HI.z].map(|z| DVec3::new(x, y, z)))
        });
        let inverse = camera.transform.inverse();
        let farthest = corners
            .map(|corner| {
                let p = inverse.transform_point3(corner);
                assert!(p.z < 0.0);
                (p.x / p.z / extent[0]).abs().max((p.y / p.z / extent[1]).abs())
            })
            .fold(0.0, f64::max);
        assert!((farthest - 0.95).abs() < 1e-5, "{resolution:?}, {fov} degrees: {farthest} of the image");
    }
}

/// All corners of the block are in front of the sensor plane, and the view has the height that the user gave.
#[test]
fn an_automatic_orthographic_camera_stands_before_the_scene() {
    let (scene, experiment, _) = applied("camera = { camera = 'auto', ortho = 3, resolution = '64x32' }", staged());
    let camera = scene.cameras.last().unwrap();
    assert_eq!((camera.name.as_str(), &camera.projection), ("auto", &Projection::Orthographic { height: 3.0 }));
    assert_eq!(experiment.camera.fov, None);
    assert!(view(camera).dot(CENTRE - camera.transform.translation) > 0.0, "{camera:?}");
    for corner in 0..8u32 {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { LO[axis] } else { HI[axis] };
        let point = DVec3::new(pick(0), pick(1), pick(2));
        assert!(view(camera).dot(point - camera.transform.translation) > 0.5, "{point}");
    }
    // A file's camera keeps its place; its view becomes orthographic, and back.
    let changed = applied("camera.ortho = 2.5", staged()).0;
    assert_eq!(changed.cameras[0].projection, Projection::Orthographic { height: 2.5 });
    assert_eq!(changed.cameras[0].transform, staged().cameras[0].transform);
    let back = applied("camera.fov = 30", changed).0;
    assert_eq!(back.cameras[0].projection, Projection::Perspective { yfov: 30f64.to_radians() });
}

#[test]
fn scenes_without_size_get_a_camera_too() {
    let mut dot = block();
    dot.instances[0].transform = DAffine3::from_scale(DVec3::splat(1e-200));
    for scene in [Scene::default(), dot] {
        let (scene, _, notes) = applied("", scene);
        assert!(scene.cameras[0].transform.translation.length() > 0.9 && notes.len() == 2, "{:?}", scene.cameras);
    }
}

#[test]
fn a_scene_without_camera_and_light_gets_both_and_says_so() {
    let (scene, experiment, notes) = applied("scene = 'a.glb'", block());
    assert!(notes.len() == 2 && notes[0].contains("--look-from") && notes[1].contains("--headlamp"), "{notes:?}");
    let eye = scene.cameras[0].transform.translation;
    assert_eq!((scene.lights[0].node.as_str(), scene.lights[0].position), ("headlamp", eye));
    // A white surface at the distance of the centre has radiance 1.
    let Some(Headlamp::Intensity(intensity)) = experiment.emitter.headlamp else { panic!("{experiment:?}") };
    let radiance = intensity / std::f64::consts::PI / eye.distance_squared(CENTRE);
    assert!((radiance - 1.0).abs() < 5e-3, "{radiance}");
    assert_eq!(scene.lights[0].kind, LightKind::Point { intensity: [intensity as f32; 3] });
    // A light that cannot be rendered does not count. With a gate, a sun cannot be rendered.
    let sun = LightKind::Directional { irradiance: [1.0; 3] };
    let gated = "gate.gate = '1m..2m'";
    for (kind, keys, lights) in [(LightKind::Point { intensity: [0.0; 3] }, "", 2), (sun, "", 1), (sun, gated, 2)] {
        let mut dark = block();
        light(&mut dark, "dark", DVec3::Y, DVec3::NEG_Y, kind);
        assert_eq!(applied(keys, dark).0.lights.len(), lights, "{kind:?} {keys}");
    }
}

#[test]
fn a_model_that_glows_gets_no_headlamp_but_a_note() {
    let mut scene = block();
    scene.materials[0].emission = [0.0, 0.1, 0.0];
    let (lit, _, notes) = applied("", scene.clone());
    assert!(lit.lights.is_empty() && notes.len() == 2 && notes[1].contains("add --headlamp"), "{notes:?}");
    assert_eq!(applied("camera.camera = 'auto'", scene).2.len(), 0);
}

#[test]
fn flags_place_the_chosen_camera_or_a_new_one() {
    let (scene, _, notes) =
        applied("camera = { look-from = [0.5, 0.5, -20], fov = 30, principal-point = [0.2, 0.7] }", staged());
    let [camera] = &scene.cameras[..] else { panic!("{:?}", scene.cameras) };
    assert_eq!((camera.name.as_str(), camera.resolution), ("camera", Some([40, 30])));
    let projection = Projection::Perspective { yfov: 30f64.to_radians() };
    assert_eq!((&camera.projection, camera.principal_point), (&projection, [0.2, 0.7]));
    assert_eq!(camera.transform.translation, CENTRE.with_z(-20.0));
    assert!(close(view(camera), DVec3::Z) && notes.is_empty(), "{camera:?} {notes:?}");

    // A target alone turns the camera; a direction upwards alone rolls it.
    let turned = &applied("camera.look-at = '100,0.5,10'", staged()).0.cameras[0];
    assert!(close(view(turned), DVec3::X) && turned.transform.translation.z == 10.0);
    let rolled = &applied("camera.up = [1, 0, 0]", staged()).0.cameras[0];
    assert!(close(view(rolled), DVec3::NEG_Z) && close(rolled.transform.transform_vector3(DVec3::Y), DVec3::X));
    // Straight down.
    let down = &applied("camera = { look_from = [0.5, 9, 0.5], up = '0,0,-1' }", staged()).0.cameras[0];
    assert!(close(view(down), DVec3::NEG_Y) && close(down.transform.transform_vector3(DVec3::Y), DVec3::NEG_Z));

    let (scene, _, notes) = applied("camera = { look-from = '9,0,0', look-at = '8,0,0' }", block());
    assert_eq!((scene.cameras[0].name.as_str(), notes.len()), ("look", 1));
    assert!(close(view(&scene.cameras[0]), DVec3::NEG_X));
}

#[test]
fn lamps_are_added_to_those_of_the_scene() {
    let toml = "[emitter]\nlamp = ['0,5,0,3', '1,5,0,4']\nheadlamp = 7\nheadlamp_offset = [0.1, 0.2, 0.3]\n
        [[light]]\ntype = 'point'\nposition = [0, 8, 0]\nintensity = 1\n
        [[light]]\nname = 'sky'\ntype = 'spot'\nposition = [0, 8, 0]\ntarget = [0, 0, 0]\nintensity = 1\n";
    let (scene, _, notes) = applied(toml, staged());
    let names: Vec<&str> = scene.lights.iter().map(|light| light.node.as_str()).collect();
    assert_eq!(names, ["sky", "light-1", "sky", "lamp-1", "lamp-2", "headlamp"]);
    assert_eq!(scene.lights[4].kind, LightKind::Point { intensity: [4.0; 3] });
    assert!(close(scene.lights[5].position, DVec3::new(0.6, 0.7, 10.3)) && notes.is_empty(), "{notes:?}");
    // A lamp of the user's own makes a headlamp unnecessary.
    assert_eq!(applied("emitter.lamp = [0, 5, 0, 3]", block()).0.lights.len(), 1);
    assert_eq!(applied("emitter.headlamp-offset = [0, 1, 0]", staged()).0.lights.len(), 2);
}

/// A sky is a light, so it makes a headlamp unnecessary, except with a gate, where it cannot be rendered.
#[test]
fn a_sky_is_added_to_the_lights_of_the_scene() {
    let (scene, _, notes) = applied("emitter = { sky = 2, sky-scale = 3 }", block());
    assert!(scene.lights.len() == 1 && notes.len() == 1 && notes[0].contains("no camera"), "{notes:?}");
    assert_eq!(scene.lights[0].kind, LightKind::Sky { radiance: [6.0; 3] });
    assert_eq!((scene.lights[0].node.as_str(), &scene.sky), ("sky", &None));
    let (scene, _, _) = applied("emitter.sky = 2\ngate.gate = '1m..2m'", block());
    assert_eq!(scene.lights[1].node, "headlamp");
}

/// A gated render leaves out suns and skies by their names. Lights and surfaces with the same names must stay.
#[test]
fn suns_and_skies_have_names_of_their_own() {
    let mut scene = staged();
    scene.materials[0].emission = [1.0; 3];
    let node = scene.instances[0].node.clone();
    let sun = LightKind::Directional { irradiance: [1.0; 3] };
    light(&mut scene, "sky", DVec3::Y, DVec3::NEG_Y, sun);
    light(&mut scene, &node, DVec3::Y, DVec3::NEG_Y, sun);
    light(&mut scene, &node, DVec3::X, DVec3::NEG_X, sun);
    let (scene, experiment, _) = applied("gate.gate = '1m..2m'\nemitter.sky = 2", scene);
    let names: Vec<&str> = scene.lights.iter().map(|light| light.node.as_str()).collect();
    let second = format!("{node}#2");
    assert_eq!(names, ["sky", "sky#2", &second, &second, "sky#3"]);
    let resolved = resolve(&experiment, &scene).unwrap();
    assert_eq!(*resolved.settings.emitters(), Emitters::Nodes(vec!["sky".into(), node]));
}

#[test]
fn the_image_of_a_sky_is_read_and_checked() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("sky.exr");
    let toml = format!("emitter = {{ sky = '{}', sky-scale = 2 }}", file.display());
    let with = |rgb: [f32; 6]| {
        crate::image::exr_file::write_plain(&file, 2, 1, &rgb).unwrap();
        let mut scene = block();
        apply(&mut experiment(&toml), &mut scene).map(|_| scene).map_err(|e| e.to_string())
    };
    let scene = with([1.0, 2.0, 3.0, 4.0, 0.0, 0.0]).unwrap();
    let sky = scene.sky.unwrap();
    assert_eq!((sky.width, sky.height, &sky.rgb[..]), (2, 1, &[[1.0, 2.0, 3.0], [4.0, 0.0, 0.0]][..]));
    assert_eq!(scene.lights[0].kind, LightKind::Sky { radiance: [2.0; 3] });
    use exr::prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, IntegerBounds, Layer, LayerAttributes, Vec2, WritableImage,
    };
    // Only the lower half of this sky is stored, so the upper half is black.
    let half = AnyChannels::sort(
        ["R", "G", "B"].map(|name| AnyChannel::new(name, FlatSamples::F32(vec![1.0; 2]))).into_iter().collect(),
    );
    let attributes = LayerAttributes { layer_position: Vec2(0, 1), ..LayerAttributes::default() };
    let mut image = exr::prelude::Image::from_layer(Layer::new((2, 1), attributes, Encoding::UNCOMPRESSED, half));
    image.attributes.display_window = IntegerBounds::new((0, 0), (2, 2));
    image.write().to_file(&file).unwrap();
    let mut scene = block();
    apply(&mut experiment(&toml), &mut scene).unwrap();
    let sky = scene.sky.unwrap();
    assert_eq!((sky.height, &sky.rgb[..]), (2, &[[0.0; 3], [0.0; 3], [1.0; 3], [1.0; 3]][..]));
    assert!(sky.irradiance_from_above().iter().all(|x| x.abs() < 1e-12));
    for (bad, part) in [
        ([0.0; 6], "is black"),
        ([1.0, 1.0, 1.0, 1.0, -1.0, 1.0], "negative or not finite at column 1, row 0"),
        ([1.0, f32::INFINITY, 1.0, 1.0, 1.0, 1.0], "negative or not finite at column 0, row 0"),
        ([1e20, 1.0, 1.0, 1.0, 1.0, 1.0], "above 1e20"),
    ] {
        let message = with(bad).expect_err(part);
        assert!(message.contains(part) && message.contains("sky.exr"), "{message}");
    }
}

#[test]
fn the_image_of_a_sky_may_be_radiance_hdr() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("sky.HDR");
    let toml = format!("emitter.sky = '{}'", file.display());
    let with = |bytes: &[u8]| {
        std::fs::write(&file, bytes).unwrap();
        let mut scene = block();
        apply(&mut experiment(&toml), &mut scene).map(|_| scene.sky.unwrap()).map_err(|e| e.to_string())
    };
    // A texel of the bytes r, g, b, e has the radiance r 2^(e - 136), and so on.
    let (header, size) = ("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n", "\n-Y 1 +X 2\n");
    let texels = [128, 64, 0, 129, 255, 0, 1, 136];
    let sky = with(&[header.as_bytes(), size.as_bytes(), &texels].concat()).unwrap();
    assert_eq!((sky.width, sky.height, &sky.rgb[..]), (2, 1, &[[1.0, 0.5, 0.0], [255.0, 0.0, 1.0]][..]));
    let sky = with(&[header.as_bytes(), b"EXPOSURE=2\n", size.as_bytes(), &texels].concat()).unwrap();
    assert_eq!(sky.rgb, [[0.5, 0.25, 0.0], [127.5, 0.0, 0.5]]);
    // The factors of several lines multiply.
    let factors = b"EXPOSURE=2\nCOLORCORR=2 1 4\nEXPOSURE=0.5\nCOLORCORR= 1 0.5 1\n";
    let sky = with(&[header.as_bytes(), factors, size.as_bytes(), &texels].concat()).unwrap();
    assert_eq!(sky.rgb, [[0.5, 1.0, 0.0], [127.5, 0.0, 0.25]]);
    for signature in ["#?RGBE\n", "#?RGBE\n# made by hand\nFORMAT=32-bit_rle_rgbe\n", "#?RADIANCE\n"] {
        let sky = with(&[signature.as_bytes(), size.as_bytes(), &texels].concat()).unwrap();
        assert_eq!(sky.rgb, [[1.0, 0.5, 0.0], [255.0, 0.0, 1.0]], "{signature}");
    }
    let dim = [header.as_bytes(), b"COLORCORR=1 0 1\n", size.as_bytes(), &texels].concat();
    let negative = [header.as_bytes(), b"EXPOSURE=-2\n", size.as_bytes(), &texels].concat();
    let cie = [b"#?RGBE\nFORMAT=32-bit_rle_xyze\n", size.as_bytes(), &texels].concat();
    let black = [header.as_bytes(), size.as_bytes(), &[0; 8]].concat();
    let vast = [header.as_bytes(), b"\n-Y 8000 +X 8000\n", &texels].concat();
    let empty = [header.as_bytes(), b"\n-Y 0 +X 8\n"].concat();
    for (bad, part) in [
        (&black[..], "is black"),
        (&vast, "too many for its"),
        (&empty, "reads 1 to 64 megapixels"),
        (b"GIF89a", "is not a Radiance HDR image"),
        (&dim, "an EXPOSURE or a COLORCORR that is not above 0"),
        (&negative, "an EXPOSURE or a COLORCORR that is not above 0"),
        (&cie, "is not a Radiance HDR image"),
        (&black[..black.len() - 3], "is not a Radiance HDR image"),
    ] {
        let message = with(bad).expect_err(part);
        assert!(message.contains(part) && message.contains("sky.HDR"), "{message}");
    }
}

/// The distance to the centre is 0, so a part of the scene's size counts instead.
#[test]
fn a_headlamp_at_the_centre_has_a_sensible_intensity() {
    let (scene, _, _) = applied("camera = { look-from = [0.5, 0.5, 0.5], look-at = [9, 0, 0] }", block());
    let LightKind::Point { intensity } = scene.lights[0].kind else { panic!() };
    let expected = std::f32::consts::PI * (0.25 * (HI - LO).length() as f32).powi(2);
    assert!((intensity[0] / expected - 1.0).abs() < 5e-3, "{intensity:?} {expected}");
}

#[test]
fn a_printed_experiment_gives_the_same_camera_and_lights() {
    let light = "[[light]]\ntype = 'beam'\nposition = [0, 8, 0]\ntarget = [0.3, 0, 0]\npower = 1.7\nradius = 0.1\n";
    let table = [
        ("".to_string(), block()),
        ("camera.camera = 'auto'".into(), staged()),
        ("camera = { look-from = [5.1, 2.2, 0.3] }".into(), block()),
        ("camera = { look-at = [5.1, 2.2, 0.3], fov = 33.3 }".into(), block()),
        ("camera = { camera = 'auto', ortho = 7.3 }".into(), block()),
        ("camera = { look-at = [5.1, 2.2, 0.3], ortho = 0.7 }".into(), staged()),
        ("camera = { look-from = [5.1, 2.2, 0.3], up = [0.1, 0.9, 0] }".into(), staged()),
        ("camera = { camera = 'auto', resolution = '64x32', principal-point = [0.3, 0.4] }".into(), staged()),
        ("emitter = { lamp = ['0,5.5,0,3'], headlamp = true, headlamp-offset = [0.1, 0, 0] }".into(), staged()),
        ("emitter = { sky = [0.1, 0.2, 0.3], sky-scale = 3 }".into(), staged()),
        (format!("render.estimator = 'bdpt'\nemitter.emitters = ['light-1']\n{light}"), staged()),
    ];
    for (toml, scene) in table {
        let (first, experiment, _) = applied(&toml, scene.clone());
        let settings = resolve(&experiment, &first).unwrap().settings;
        let printed = as_experiment(&experiment, &settings, &first);
        let (second, again, notes) = applied(&printed.to_toml(), scene);
        assert!(notes.is_empty() && again == printed, "{toml}: {notes:?} {}", printed.to_toml());
        assert_eq!(resolve(&again, &second).unwrap().settings, settings, "{toml}");
        let debug = |scene: &Scene| format!("{:?} {:?}", scene.cameras, scene.lights);
        assert_eq!(debug(&second), debug(&first), "{toml}");
    }
}

#[test]
fn mistakes_name_the_flag_and_the_remedy() {
    let table = [
        ("camera = { look-from = [1, 2, 3], look-at = [1, 2, 3] }", "stands at 1,2,3 and looks at the same point"),
        ("camera = { look-from = [0.5, 0.5, 0.5] }", "give another --look-from or --look-at"),
        ("camera = { look-at = [0.5, 0.5, 0], up = [0, 0, 3] }", "--up points along the view"),
        ("camera.up = [0, 0, 0]", "--up has no length"),
        ("camera.camera = 'look'", "no camera is called 'look'; choose one of camera, auto"),
        ("camera = { camera = 'no', look-from = [1, 2, 3] }", "no camera is called 'no'"),
        ("camera = { look-from = [1e16, 2, 3] }", "camera 'camera' has an invalid transform"),
        ("camera.principal-point = [320, 240]", "give fractions"),
        ("camera.ortho = 1e16", "use a height above 0, up to 1e15 m"),
        ("camera = { camera = 'auto', resolution = '0x5' }", "--resolution is 0x5"),
        ("emitter.lamp = [1e16, 0, 0, 1]", "--lamp: light 'lamp-1' has a position farther than"),
        ("emitter = { headlamp = 1, headlamp-offset = [0, 1e16, 0] }", "--headlamp: light 'headlamp'"),
        ("emitter.sky-scale = 2", "add --sky"),
        ("emitter = { sky = 1e10, sky-scale = 1e11 }", "--sky: light 'sky' has a radiance above 1e20"),
        ("emitter.sky = 'no-such-file.exr'", "no-such-file.exr"),
    ];
    for (toml, part) in table {
        let message = apply(&mut experiment(toml), &mut staged()).expect_err(toml).to_string();
        assert!(message.contains(part), "{toml}: {message}");
    }
}

/// A wall seen from the front: the flat box has no extent along one axis.
#[test]
fn a_flat_scene_is_framed() {
    let mut wall = Scene::default();
    let white = material(&mut wall, diffuse("white", [1.0; 3]));
    add(&mut wall, "wall", white, quad(DVec3::ZERO, DVec3::X, DVec3::Y, [1.0; 2]));
    let camera = &applied("", wall).0.cameras[0];
    assert!(camera.transform.translation.z > 1.0 && view(camera).z < -0.8, "{camera:?}");
}

#[test]
fn all_surfaces_become_double_sided_if_the_user_wants_it() {
    let sided = |toml: &str| {
        let mut scene = staged();
        scene.materials[0].double_sided = false;
        applied(toml, scene).0.materials[0].double_sided
    };
    assert!(sided("input.double-sided = true"));
    assert!(!sided("input.double-sided = false") && !sided(""));
}

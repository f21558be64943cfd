//! All settings. Each entry gives the key and the flag, the type, the help text, limits, the settings that it excludes, the parts of the
//! program that take it, and the estimators that use it.
//!
//! All other code reads these tables: experiment files, the command line, Python, the viewer, merging, checks and notes.

#![warn(missing_docs)]

use std::path::PathBuf;

use serde::Serialize;

use crate::settings::aov::Aov;
use crate::settings::exposure::Exposure;
use crate::settings::frames::{Frames, GateKeys};
use crate::settings::frequencies::Frequencies;
use crate::settings::gates::Gates;
use crate::settings::medium::{
    Alpha, Bounds, Coefficient, Distance, DropletDiameter, MeanCosine, RefractiveIndex, Share,
};
use crate::settings::moment::Moment;
use crate::settings::numbers::{Fov, Headlamp, Height, Lamps, Numbers};
use crate::settings::optical_path::OpticalPath;
use crate::settings::phase::Phase;
use crate::settings::pixels::Pixels;
use crate::settings::response_specs::ResponseSpecs;
use crate::settings::setting::Taker::{Info, Page, Python, View};
use crate::settings::setting::{Form, Setting, table};
use crate::settings::shard::Shard;
use crate::settings::sky::{Sky, SkyScale};
use crate::settings::tev::{DEFAULT_TEV, TevAddress};
use crate::settings::units::{Depth, Gate};
use crate::settings::values::{Files, Folders, Png, Resolution, Seconds};
use crate::settings::*;

/// Maximum number of frames per second.
const MAX_FPS: u32 = 10_000;

const BARE_TRUE: Form = Form::Optional { bare: "true", equals: true };

/// One light subpath per pixel, within bounds. The lower bound keeps the trees a good representation of the light; more subpaths
/// than the upper bound are not worth their time.
fn default_light_paths(settings: &Settings) -> u32 {
    let [width, height] = settings.resolution();
    (width * height).clamp(MIN_DEFAULT_LIGHT_PATHS, settings.estimator().record().max_default_light_paths)
}

fn traces_light(estimator: Estimator) -> bool {
    estimator.record().light_subpaths
}

table! {
    /// `[camera]`: the camera and the image size. At most one of `fov` and `ortho`.
    CameraTable = "camera" {
        /// Name of the camera in the scene; NAME#2 is the second camera of this name; auto: a view of the whole scene, slightly
        /// from above [default: the first camera, or auto if there is none]
        camera: String, Setting::scene("camera", "NAME|auto").also(Page).resets(&["look-from", "look-at", "up", "fov", "ortho", "principal-point"]);

        /// Place of the camera in metres, instead of its own; without --look-at the camera looks at the centre of the scene
        look_from: Numbers<3>, Setting::scene("look-from", "X,Y,Z").form(Form::Signed).also(Page);

        /// Point at which the camera looks, in metres
        look_at: Numbers<3>, Setting::scene("look-at", "X,Y,Z").form(Form::Signed).also(Page);

        /// Direction that is upwards in the image [default with --look-from or --look-at: 0,1,0]
        up: Numbers<3>, Setting::scene("up", "X,Y,Z").form(Form::Signed).also(Page);

        /// Vertical field of view of a perspective camera in degrees [default: that of the camera, else 40]
        fov: Fov, Setting::scene("fov", "DEGREES").also(Page);

        /// Orthographic view of this height in metres: parallel camera rays, which start on a plane through the camera
        ortho: Height, Setting::scene("ortho", "HEIGHT").excludes(&["fov"], "set the view of the camera").also(Page);

        /// Where the axis of the camera meets the image, as fractions of its width and height from the top left corner [default:
        /// that of the camera, else 0.5,0.5]
        principal_point: Numbers<2>, Setting::scene("principal-point", "X,Y").form(Form::Signed);

        /// Image size in pixels [default: the resolution of the camera, else 512 pixels wide]
        resolution: Resolution, Setting::scene("resolution", "WxH").also(Page);

        /// Render only the pixels x0 <= x < x1, y0 <= y < y1; they have the same values as in the whole image (with --sampling
        /// adaptive, the same except for noise)
        crop: Crop, Setting::scene("crop", "x0,x1,y0,y1").except(View);
    }
}

table! {
    /// `[emitter]`: the emitters that are switched on, and lights to add.
    EmitterTable = "emitter" {
        /// Emitters that are switched on: scene for all, or names of nodes; may be repeated [default: scene]
        emitters: Emitters, Setting::scene("emitters", "scene|NODE,...").form(Form::Repeated).also(Page);

        /// Add a point light at the camera, called headlamp, with this intensity; without a number, a white surface that faces
        /// it at the distance of the scene's centre has radiance 1 [default: only if the scene has no light]
        headlamp: Headlamp, Setting::scene("headlamp", "W/sr").form(Form::Optional { bare: "auto", equals: false }).also(Page);

        /// Place of the headlamp, in metres to the right, upwards and backwards from the camera; switches the headlamp on
        /// [default: 0,0,0]
        headlamp_offset: Numbers<3>, Setting::scene("headlamp-offset", "X,Y,Z").form(Form::Signed).also(Page);

        /// Add a point light at X,Y,Z (metres) with this intensity in W/sr, called lamp-1, lamp-2, ...; may be repeated
        lamp: Lamps, Setting::scene("lamp", "X,Y,Z,INTENSITY").form(Form::SignedRepeated);

        /// Add light from all directions, called sky: its radiance in W/(m^2 sr), as one number or R,G,B, or the file of an
        /// equirectangular image (.exr, .hdr) with +Y up; gated renders leave it out, because it has no travel time
        sky: Sky, Setting::scene("sky", "RADIANCE|FILE.exr").form(Form::Signed);

        /// Factor on the radiance of --sky [default: 1]
        sky_scale: SkyScale, Setting::scene("sky-scale", "FACTOR").form(Form::Signed);
    }
}

table! {
    /// `[input]`: how the scene is read.
    InputTable = "input" {
        /// All surfaces reflect and emit on both sides; without this flag the back of a surface is black, unless the scene marks it
        /// as double-sided
        double_sided: bool, Setting::scene("double-sided", "").form(Form::Switch).also(Page);

        /// Glass that is thin: light passes straight on, as through a window that is modelled as one plane; other glass is solid and
        /// refracts light. auto: glass of open meshes, and glass whose material has extras.thin = true [default: auto]
        thin_glass: ThinGlass, Setting::scene("thin-glass", "auto|all|none");

        /// Also read files of a .gltf scene that lie in this folder or below, such as ../textures; other files must lie in the folder
        /// of the scene or below; may be repeated
        allow_path: Folders, Setting::scene("allow-path", "DIR").form(Form::Repeated).affects_no_image();

        /// Play the animations of the scene up to this time in seconds, from 0 on, such as 1.5s; without it, nodes keep the transforms
        /// in the file
        at: Moment, Setting::scene("at", "TIME").form(Form::Signed);

        /// Name of the animation to play; NAME#2 is the second animation of this name; none: no animation [default: all of them
        /// together]
        animation: String, Setting::scene("animation", "NAME");
    }
}

table! {
    /// `[medium]`: fog, smoke or water, instead of the media of the scene.
    MediumTable = "medium" {
        /// Scattering coefficient per metre, one number or three for red, green and blue [default: 0]
        sigma_s: Coefficient, Setting::medium("sigma-s", "1/m").also(Page);

        /// Absorption coefficient per metre, one number or three [default: 0]
        sigma_a: Coefficient, Setting::medium("sigma-a", "1/m").also(Page);

        /// Meteorological visibility: the distance at which a black object keeps 2 % of its contrast, such as 60m. Together with
        /// --albedo, it gives the coefficients
        visibility: Distance, Setting::medium("visibility", "LENGTH").excludes(&["sigma-s", "sigma-a"], "set the coefficients of the medium").also(Page);

        /// Meteorological optical range: as --visibility, but with 5 % of the contrast
        mor: Distance, Setting::medium("mor", "LENGTH").excludes(&["sigma-s", "sigma-a", "visibility"], "set the coefficients of the medium").also(Page);

        /// Share of the light that an event scatters instead of absorbing it, for --visibility and --mor [default: 0.99]
        albedo: Share, Setting::medium("albedo", "0..1").excludes(&["sigma-s", "sigma-a"], "set the coefficients of the medium").also(Page);

        /// How light is scattered: isotropic, hg (Henyey-Greenstein), double-hg, draine (droplets of water), rayleigh, or a table
        /// of cosines and values in a CSV file [default: draine if there is a --droplet-diameter, hg if there is a --phase-g, else
        /// isotropic]
        phase: Phase, Setting::medium("phase", "NAME|FILE.csv");

        /// Mean cosine of the scattering angle, for hg and the first lobe of double-hg and draine; positive is forwards
        phase_g: MeanCosine, Setting::medium("phase-g", "-1..1").form(Form::Signed).old_key("g").also(Page);

        /// Mean cosine of the second lobe of double-hg, or parameter g of the second lobe of draine
        phase_g2: MeanCosine, Setting::medium("phase-g2", "-1..1").form(Form::Signed).old_key("g2");

        /// Share of the first lobe of double-hg and draine
        phase_weight: Share, Setting::medium("phase-weight", "0..1").old_key("weight");

        /// Parameter alpha of the second lobe of draine
        phase_alpha: Alpha, Setting::medium("phase-alpha", "ALPHA").old_key("alpha");

        /// Diameter of water droplets, from 5 to 50 micrometres; it sets all parameters of draine
        droplet_diameter: DropletDiameter, Setting::medium("droplet-diameter", "MICROMETRES").excludes(&["phase-g", "phase-g2", "phase-weight", "phase-alpha"], "set the phase function");

        /// Index of refraction of a medium that fills all space, like 1.33 for water: solids refract relative to it [default: 1]
        medium_ior: RefractiveIndex, Setting::medium("medium-ior", "1..5").old_key("ior");

        /// Group index of a medium that fills all space: light takes this many times the distance outside of solids [default:
        /// --medium-ior]
        medium_group_ior: RefractiveIndex, Setting::medium("medium-group-ior", "1..5").old_key("group-ior");

        /// Densities that multiply the coefficients: a Mitsuba volume (.vol), or a NumPy array (.npy) of shape (nz, ny, nx) with
        /// --medium-bounds, the box of the grid
        density_grid: PathBuf, Setting::medium("density-grid", "FILE.vol|FILE.npy").old_key("grid");

        /// Density between the centres of voxels: linear, or nearest for voxels of constant density [default: linear]
        grid_filter: Filter, Setting::medium("grid-filter", "FILTER");

        /// Places the grid in the scene: the three rows of a 3 x 4 matrix, 12 numbers [default: no change]
        grid_transform: Numbers<12>, Setting::medium("grid-transform", "NUMBERS").form(Form::Signed);

        /// Box that the medium or its grid fills, given by two corners in metres [default: all space, or the bounds of the .vol file]
        medium_bounds: Bounds, Setting::medium("medium-bounds", "X,Y,Z,X,Y,Z").form(Form::Signed).old_key("bounds");

        /// Render without the media of the scene
        no_medium: bool, Setting::medium("no-medium", "").form(Form::Switch).also(Page);
    }
}

table! {
    /// `[gate]`: the travel times that count. At most one of `gate`, `depth` and `gates`.
    GateTable = "gate" {
        /// Travel times that count, from A up to but not including B: A..B, CENTER+-HALF or A+WIDTH with um, mm, cm, m, km
        /// (optical path) or ps, ns, us (time), such as 12.5m..12.8m [default: all travel times, the steady state]
        gate: Gate, Setting::gate("gate", "A..B").form(Form::Signed).also(Page);

        /// The gate as a range of depths (one way): half the optical path, in units of length
        depth: Depth, Setting::gate("depth", "A..B").form(Form::Signed).excludes(&["gate"], "set the gate").also(Page);

        /// Divide A..B into N gates of equal width (1 to 4096) and render an image for each of them, all from the same light
        /// paths: a histogram of travel times per pixel
        gates: Gates, Setting::gate("gates", "A..B/N").form(Form::Signed).excludes(&["gate", "depth"], "set the gates").also(Page);

        /// Response of the sensor: box, or trapezoid:RISE or gauss:SIGMA for the edges of the gates (convolved with a box or a
        /// Gaussian of that length or time), or FILE.csv with travel times and weights; with a name and a gate of its own it is an
        /// image of its own, such as near=gauss:10m..11m,0.1m; may be repeated [default: box]
        response: ResponseSpecs, Setting::gate("response", "[NAME=]SPEC").form(Form::Repeated);

        /// Period of a pulsed laser, as optical path or time, such as 100m: light of all pulses falls into the gates (range folding)
        repeat: OpticalPath, Setting::gate("repeat", "LENGTH").form(Form::Signed).also(Page);

        /// Gate of a frame, for --frames: FRAME=A..B. Between two of them the ends of the gate move linearly; may be repeated
        gate_keys: GateKeys, Setting::gate("gate-keys", "FRAME=A..B").form(Form::Repeated).except(View).excludes(&["gate", "depth", "gates"], "set the gate");

        /// Continuous-wave sensor: modulation frequencies in MHz, one or two. Four images per frequency, with the weights (1 + cos(2 pi
        /// F tau / c + k pi / 2)) / 2 for k = 0 to 3, and layers of phase, amplitude and depth in metres
        cw: Frequencies, Setting::gate("cw", "MHZ[,MHZ]").excludes(&["gate", "depth", "gates", "response", "repeat", "gate-keys"], "say which light counts").also(Page);

        /// Render even if the gate is narrower than 16 steps of 32-bit travel times, or if no light arrives inside the gate
        force: bool, Setting::gate("force", "").form(Form::Switch).also(Page).affects_no_image();
    }
}

table! {
    /// `[render]`: how the image is computed. At most one of `spp` and `time`.
    impl Settings for RenderTable = "render" {
        /// Estimator: pt (path tracing), bdpt (bidirectional path tracing), epc (ellipsoidal path connections), lcs-paper (light-cone
        /// shell queries of the paper), lcs (light-cone shell queries with importance and resampling) [default: lcs for gates up to 0.4
        /// times the scene's diagonal, and in thick fog; bdpt for wider gates; without a gate pt, or bdpt if the scene has mirrors,
        /// glass, sharp gloss, a beam or fog]
        estimator: Estimator, Setting::sampling("estimator", "NAME").also(Page);

        /// Strategies (s, t) that connect subpaths: all, or paper (s >= 1 and t >= 2: no sensor path that hits an emitter, no
        /// light vertex that connects to the camera) [default: all]
        strategies: Strategies = |_| DEFAULT_STRATEGIES, Setting::sampling("strategies", "all|paper");

        /// Samples per pixel [default: 64]
        spp: u32, Setting::sampling("spp", "N").within(1, MAX_SPP);

        /// Render for this time instead of a number of samples, such as 30s, 5min or 2h
        time: Seconds, Setting::sampling("time", "DURATION").excludes(&["spp"], "limit the render");

        /// Seed of the random numbers; the same seed gives the same image, bit by bit [default: 0]
        seed: u32 = |_| DEFAULT_SEED, Setting::sampling("seed", "N").also(Page);

        /// Maximum number of segments of a path [default: 24]
        max_depth: u32 = |_| DEFAULT_MAX_DEPTH, Setting::sampling("max-depth", "N").within(1, MAX_DEPTH).also(Page).also(Info);

        /// Light subpaths per iteration whose vertices are stored [default: one per pixel, at least 4096 and at most 50000; lcs:
        /// at most 8192]
        light_paths: u32 = default_light_paths, Setting::sampling("light-paths", "N").within(1, MAX_LIGHT_PATHS).also(Page).also(Info);

        /// Additional light subpaths per iteration, which only connect to the camera (t = 1); for caustics [default: 0]
        splat_paths: u32 = |_| 0, Setting::sampling("splat-paths", "N").within(0, MAX_LIGHT_PATHS).only_for(traces_light);

        /// Queries per shade point and tree, 1 to 64; with several gates that are together wider than a tenth of the scene's
        /// diagonal, lcs draws two light vertices per query by their travel times, without trees [default: 1; lcs: 16]
        queries: u32 = |s| s.estimator().default_queries(), Setting::sampling("queries", "N").within(1, MAX_QUERIES).only_for(Estimator::has_trees).also(Page);

        /// Travel-time buckets of power per tree node, 1 to 8 [default: 8]
        buckets: u32 = |_| DEFAULT_BUCKETS, Setting::sampling("buckets", "N").within(1, MAX_BUCKETS).only_for(Estimator::has_trees);

        /// Maximum number of light vertices in a leaf of a tree, 1 to 16 [default: lcs-paper: 1; lcs: 16]
        leaf_size: u32 = |s| s.estimator().leaf_size(), Setting::sampling("leaf-size", "N").within(1, MAX_LEAF_SIZE).only_for(Estimator::has_trees);

        /// For lcs: maximum number of subtrees from which the queries of a shade point start, 1 (the whole tree) to 32; the mean
        /// image is the same [default: 32]
        frontier: u32 = |_| MAX_FRONTIER, Setting::sampling("frontier", "N").within(1, MAX_FRONTIER).only_for(Estimator::by_importance);

        /// Build one tree over emitter points and scattered light together, instead of a tree for each; the mean image is the
        /// same [default: false; lcs: true]
        single_tree: bool = |s| s.estimator().default_single_tree(), Setting::sampling("single-tree", "true|false").form(BARE_TRUE).only_for(Estimator::has_trees);

        /// For lcs: factors of a tree node's importance beside its power: all, none, or some of centre,cosine,overlap,gloss
        /// (distance to the centre, maximum cosine, part of a bucket inside the gate, glossy lobe); the mean image is the same
        /// [default: all]
        importance: Importance = |_| Importance::ALL, Setting::sampling("importance", "NAME,...").only_for(Estimator::by_importance);

        /// For lcs: ellipsoidal connections, which find light in the thinnest gates: auto, on or off. With auto they are on in gates below
        /// 0.04 % of the scene's diagonal and of their own end, without participating media, but not on the driver SwiftShader. The mean
        /// image is the same [default: auto]
        ellipsoids: UseEllipsoids = |_| UseEllipsoids::Auto, Setting::sampling("ellipsoids", "auto|on|off").only_for(Estimator::by_importance);

        /// Gather light that no strategy forms: a lamp without a surface sends it over smooth glass or mirrors to a surface, which the
        /// camera sees over glass or mirrors too. Merging takes photons of its own. auto or off [default: auto]
        merge: Merge = |_| Merge::Auto, Setting::sampling("merge", "auto|off").also(Page);

        /// Radius in pixels within which merging gathers light in the first iteration. It falls with the sixth root of the number of
        /// iterations, and its bias with the cube root [default: 1.5]
        merge_radius: Pixels = |_| Pixels::DEFAULT_MERGE_RADIUS, Setting::sampling("merge-radius", "PIXELS");

        /// Distribution of samples over the image: uniform, or adaptive (more samples for pixels with more error so far)
        /// [default: adaptive; lcs-paper: uniform]
        sampling: Sampling = |s| Sampling::default_of(s.estimator()), Setting::sampling("sampling", "NAME").also(Page);

        /// Also trace subpaths that can no longer meet the gate; slower, and the mean image is the same
        no_cull: bool = |_| false, Setting::sampling("no-cull", "").form(Form::Switch);

        /// Vulkan device by index or part of its name, see taugate devices [default: the fastest kind of device]
        device: String, Setting::diagnostics("device", "INDEX|NAME").also(Info);

        /// Fail at the first sample that is not finite; else such samples are dropped and counted
        strict: bool, Setting::diagnostics("strict", "").form(Form::Switch).except(View);
    }
}

table! {
    /// `[output]`: the files that a render writes.
    OutputTable = "output" {
        /// Image file (.exr): R, G, B, their variance, and the settings; with up to 64 --gates, R, G, B show the first gate, and layers
        /// the others. NumPy array (.npy) of shape (height, width, 3) or (height, width, gates, 3), with a JSON file that describes it.
        /// Picture (.png). Sums (.acc) for --resume, merge and develop. May be repeated
        output: Files, Setting::output("output", "OUT.exr|npy|png|acc").short('o').form(Form::Repeated);

        /// Also write the variances of an array OUT.npy, to OUT.variance.npy; with many gates, they take as much memory as the images
        variance: bool, Setting::output("variance", "").form(Form::Switch).also(Python);

        /// Also write a tone-mapped picture [default name: the output file with .png]
        png: Png, Setting::output("png", "FILE.png").form(Form::Optional { bare: "", equals: false });

        /// What the picture shows if there are several gates. sum: all gates together; each: a picture per gate, OUT.NAME.png; strip:
        /// all gates side by side. All gates have one exposure [default: sum]
        png_gates: GatePictures, Setting::output("png-gates", "sum|each|strip");

        /// Exposure of the picture: auto, or a number of stops (values are multiplied by 2 to this power), so that several
        /// pictures have the same. With auto, all frames of a sequence have one exposure, except with --shard [default: auto]
        exposure: Exposure, Setting::output("exposure", "EV|auto").form(Form::Signed);

        /// Also write auxiliary layers to the image file: all, or some of depth,normal,albedo,object,arrival (distance, unit
        /// normal, colour and object of the first surface at the centre of each pixel; optical path of the first light)
        aov: Aov, Setting::output("aov", "NAME,...").also(Python);

        /// Also write statistics: rays, times, the mean and its error, dropped samples, the fraction of light inside the gate
        stats: PathBuf, Setting::output("stats", "FILE.json");

        /// Also show the image in the viewer tev while it is rendered, with its gates and variances as layers; if no tev
        /// answers, there is only a warning [default address: 127.0.0.1:14158]
        tev: TevAddress, Setting::output("tev", "HOST:PORT").form(Form::Optional { bare: DEFAULT_TEV, equals: true }).also(View);

        /// Also write the sums so far to this file: regularly (see --every), at the end, and at an interrupt. If the file exists, the
        /// render goes on from it, with the same image as if it had never stopped
        checkpoint: PathBuf, Setting::long_render("checkpoint", "FILE.acc");

        /// Time between two writes of --checkpoint; more if the writes would take over 1 % of the time [default: 60s]
        every: Seconds, Setting::long_render("every", "DURATION");

        /// Go on from these sums, which --checkpoint, -o OUT.acc or merge wrote; --spp and --time count from the beginning of
        /// the render. Without SCENE, its scene and settings are used
        resume: PathBuf, Setting::long_render("resume", "FILE.acc");

        /// Render part I of N (I from 0), every Nth iteration, to a file OUT.acc; taugate merge joins the parts. --spp is that of
        /// all parts together, --time that of each. With --frames, every Nth frame
        shard: Shard, Setting::long_render("shard", "I/N");

        /// Render the frames A, A + 1, ... up to but not including B, each to a file of its own: # in the name of an output stands for
        /// the number. Frames that are there with the same settings are kept. The scene has the pose at the time of the frame
        frames: Frames, Setting::output("frames", "A..B").excludes(&["at"], "set the time of the scene");

        /// Frames per second of the animations [default: 24]
        fps: u32, Setting::output("fps", "N").within(1, MAX_FPS);

        /// Also write a picture of all frames side by side
        contact_sheet: PathBuf, Setting::output("contact-sheet", "FILE.png");

        /// Also write the frames as an animated picture
        gif: PathBuf, Setting::output("gif", "FILE.gif");

        /// Also render the image again and write the contribution of each strategy to this folder: for s = 2 light vertices and t
        /// = 3 sensor vertices, s02_t03_weighted.exr (with MIS weights; the sum over all strategies is the image) and
        /// s02_t03_unweighted.exr
        strategy_images: PathBuf, Setting::output("strategy-images", "DIR");
    }
}

impl InputTable {
    /// The folders of `allow-path`; empty if the user gave none.
    pub fn allowed(&self) -> Vec<PathBuf> {
        self.allow_path.clone().map_or(vec![], |folders| folders.0)
    }
}

impl RenderTable {
    /// A note for every setting that the user gave and that `estimator` does not use.
    pub fn without_effect(&self, estimator: Estimator) -> Vec<String> {
        self.given().into_iter().filter_map(|setting| setting.without_effect(estimator)).collect()
    }
}

/// All settings, in the order of the help text.
pub fn all() -> impl Iterator<Item = &'static Setting> {
    let tables = [
        CameraTable::SETTINGS,
        EmitterTable::SETTINGS,
        InputTable::SETTINGS,
        MediumTable::SETTINGS,
        GateTable::SETTINGS,
        RenderTable::SETTINGS,
        OutputTable::SETTINGS,
    ];
    tables.into_iter().flatten()
}

/// The setting with this name or this old key; `None` if there is none.
pub fn find(name: &str) -> Option<&'static Setting> {
    all().find(|setting| setting.name == name || setting.old_key == Some(name))
}

/// Names of the settings that cannot be given together with the setting `name`.
pub fn excluding(name: &str) -> impl Iterator<Item = &'static str> {
    let own = find(name).map_or(&[][..], |setting| setting.excludes);
    let others = all().filter(move |setting| setting.excludes.contains(&name));
    own.iter().copied().chain(others.map(|setting| setting.name))
}

/// The tables of an experiment on which an image depends.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tables {
    /// `[camera]`
    pub camera: CameraTable,
    /// `[emitter]`
    pub emitter: EmitterTable,
    /// `[gate]`
    pub gate: GateTable,
    /// `[render]`
    pub render: RenderTable,
}

impl Tables {
    /// The tables as TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("tables are plain text and numbers")
    }
}

#[cfg(test)]
mod tests;

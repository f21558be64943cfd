//! The settings of the files that a render writes, and of long renders.

use std::path::PathBuf;

use crate::settings::GatePictures;
use crate::settings::aov::Aov;
use crate::settings::exposure::Exposure;
use crate::settings::frames::Frames;
use crate::settings::setting::Taker::{Python, View};
use crate::settings::setting::{Form, Setting, table};
use crate::settings::shard::Shard;
use crate::settings::tev::{DEFAULT_TEV, TevAddress};
use crate::settings::values::{Files, Png, Seconds};

/// Maximum number of frames per second.
const MAX_FPS: u32 = 10_000;

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
        /// normal, colour and object of the first surface at the centre of each pixel; optical path of the first light); for scans also velocity
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

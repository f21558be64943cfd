//! The settings of the gate, and of the response of the sensor.

use crate::settings::chirp::Chirp;
use crate::settings::frames::GateKeys;
use crate::settings::frequencies::{Frequencies, Heterodyne};
use crate::settings::gates::Gates;
use crate::settings::optical_path::OpticalPath;
use crate::settings::response_specs::ResponseSpecs;
use crate::settings::setting::Taker::{Page, View};
use crate::settings::setting::{Form, Setting, table};
use crate::settings::units::{Depth, Gate};

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

        /// Heterodyne continuous-wave sensor (Doppler time of flight): its modulation is faster than that of the light by this frequency,
        /// such as 30Hz. The phases of --cw then turn while the --shutter is open
        heterodyne: Heterodyne, Setting::gate("heterodyne", "HZ").form(Form::Signed).except(View);

        /// Frequency-modulated continuous-wave (FMCW) sensor: wavelength, bandwidth and duration of a sweep, such as 1550nm,1GHz,10us, or
        /// -10us for a frequency that falls. Gates then count beat frequencies, as the lengths of paths at rest that have them: 1 m is
        /// bandwidth / duration / c
        fmcw: Chirp, Setting::gate("fmcw", "LAMBDA,HZ,TIME").excludes(&["cw", "repeat"], "say how light is modulated").except(View);

        /// Render even if the gate is narrower than 16 steps of 32-bit travel times, or if no light arrives inside the gate
        force: bool, Setting::gate("force", "").form(Form::Switch).also(Page).affects_no_image();
    }
}

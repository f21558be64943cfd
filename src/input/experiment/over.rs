//! Merges experiments: flags have priority over the file.

use super::Experiment;
use crate::files::has_extension;
use crate::input::sequence::{DEFAULT_FPS, has_pictures, is_picture};
use crate::settings::moment::Moment;
use crate::settings::setting::LeaveOut;
use crate::settings::table::{OutputTable, excluding};
use crate::settings::values::{Files, Png};

impl Experiment {
    /// Merges two experiments: the settings of `self`, and those of `below` that `self` does not give. The list of lights counts
    /// as one setting.
    pub fn over(self, mut below: Experiment) -> Experiment {
        let was_exposed = is_exposed(&below.output);
        if let Some(Moment(seconds)) = self.input.at {
            below.render_only(seconds);
        }
        leave_outputs_to(&mut below.output, &self.output);
        if was_exposed && !is_exposed(&below.output) && !is_exposed(&self.output) {
            below.output.exposure = None;
        }
        if !has_pictures(&below.output) && !has_pictures(&self.output) {
            below.output.png_gates = None;
        }
        below.gate.leave_responses_to(&self.gate);
        self.medium.replace_in(&mut below.medium);
        // Settings that exclude each other count as one: a depth given as a flag also replaces the gate of the file.
        let given = self.given();
        let replaced = given.iter().flat_map(|setting| excluding(setting.name).chain(setting.resets.iter().copied()));
        below.visit(&mut LeaveOut(&replaced.collect::<Vec<_>>()));
        Experiment {
            scene: self.scene.or(below.scene),
            camera: self.camera.over(below.camera),
            emitter: self.emitter.over(below.emitter),
            input: self.input.over(below.input),
            gate: self.gate.over(below.gate),
            render: self.render.over(below.render),
            output: self.output.over(below.output),
            medium: self.medium.over(below.medium),
            light: if self.light.is_empty() { below.light } else { self.light },
            scan: self.scan.or(below.scan),
            response: vec![],
        }
    }

    /// Turns a sequence of frames into the single moment at `seconds`, with the gate that the keys of the sequence give then.
    fn render_only(&mut self, seconds: f64) {
        let OutputTable { frames, fps, shard, contact_sheet, gif, .. } = &mut self.output;
        let fps = fps.take().unwrap_or(DEFAULT_FPS);
        if let Some(keys) = self.gate.gate_keys.take() {
            self.gate.gate = Some(keys.gate(seconds * f64::from(fps)));
        }
        if frames.take().is_some() {
            // The shard of a sequence is a part of its frames.
            *shard = None;
        }
        (*contact_sheet, *gif) = (None, None);
    }
}

/// Removes from `below` what does not fit the outputs of the flags: a picture that they name too, and settings of files that they
/// replace.
fn leave_outputs_to(below: &mut OutputTable, flags: &OutputTable) {
    if let (Some(Png::Wanted(true) | Png::File(_)), Some(Files(files))) = (&flags.png, &mut below.output) {
        // A picture may be the only output, which then gives the other picture its name.
        if !files.iter().all(|path| is_picture(path)) {
            files.retain(|path| !is_picture(path));
        }
    }
    if let Some(Files(files)) = &flags.output {
        let has = |extension| files.iter().any(|path| has_extension(path, extension));
        let keeps_sums = has("acc") || flags.checkpoint.is_some() || below.checkpoint.is_some();
        if has("png") {
            below.png = None;
        }
        if !has("exr") && !keeps_sums {
            below.aov = None;
        }
        if !has("npy") && !keeps_sums {
            below.variance = None;
        }
        below.output = None;
    }
}

/// Whether a render writes a picture that has an exposure.
fn is_exposed(output: &OutputTable) -> bool {
    has_pictures(output) || output.gif.is_some() || output.contact_sheet.is_some()
}

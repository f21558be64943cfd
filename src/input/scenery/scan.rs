//! The laser and the sensor of a scan.

use crate::error::{Error, Result};
use crate::input::experiment::Experiment;
use crate::input::scan_table::{LASER, SENSOR, ScanTable};
use crate::scene::Scene;
use crate::settings::Emitters;
use crate::settings::aov::Aov;
use crate::settings::values::Resolution;

/// Adds the laser and the sensor of `table` to the scene, aimed at their first points, and selects them in `experiment`.
pub(super) fn apply(table: &ScanTable, experiment: &mut Experiment, scene: &mut Scene) -> Result<()> {
    check(experiment)?;
    let scan = table.scan().map_err(|message| Error::settings(format!("[scan]: {message}")))?;
    scene.add_camera(scan.camera(0));
    scene.lights.push(scan.light(0));
    experiment.camera.camera = Some(SENSOR.into());
    experiment.camera.resolution = Some(Resolution([scan.sensor_count() as u32, 1]));
    experiment.emitter.emitters = Some(Emitters::Nodes(vec![LASER.into()]));
    Ok(())
}

/// Fails if the experiment has settings that a scan does not have: a camera, lights, frames, or files that a scan does not write.
fn check(experiment: &Experiment) -> Result<()> {
    let output = &experiment.output;
    let has_lights = !experiment.light.is_empty() || experiment.emitter != Default::default();
    let has_arrival = output.aov.is_some_and(|aov| aov.arrival && aov != Aov::ALL);
    let given = [
        ("a camera", experiment.camera != Default::default(), "the sensor of [scan] is the camera"),
        ("lights", has_lights, "the laser of [scan] is the only light"),
        ("--frames", output.frames.is_some(), "render the scans of a sequence one by one, with --at"),
        ("--fps", output.fps.is_some(), "it is a single moment, which --at chooses"),
        ("--gate-keys", experiment.gate.gate_keys.is_some(), "give it gates with --gates"),
        ("--aov arrival", has_arrival, "its histograms show when light arrives"),
        ("--png", output.png.is_some(), "a scan has no image"),
        ("--png-gates", output.png_gates.is_some(), "a scan has no image"),
        ("--gif", output.gif.is_some(), "a scan has no image"),
        ("--contact-sheet", output.contact_sheet.is_some(), "a scan has no image"),
        ("--stats", output.stats.is_some(), "a scan has no statistics"),
        ("--strategy-images", output.strategy_images.is_some(), "a scan has no image"),
    ];
    match given.iter().find(|(_, is_given, _)| *is_given) {
        Some((what, _, why)) => Err(Error::settings(format!("a scan cannot have {what}: {why}"))),
        None => Ok(()),
    }
}

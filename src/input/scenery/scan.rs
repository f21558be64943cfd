//! The laser and the sensor of a scan.

use crate::error::{Error, Result};
use crate::input::experiment::Experiment;
use crate::input::scan_table::{LASER, SENSOR, ScanTable};
use crate::scene::Scene;
use crate::settings::Emitters;
use crate::settings::values::Resolution;

/// Adds the laser and the sensor of `table` to the scene, aimed at their first points, and selects them in `experiment`.
pub(super) fn apply(table: &ScanTable, experiment: &mut Experiment, scene: &mut Scene) -> Result<()> {
    ScanTable::check_experiment(experiment)?;
    let scan = table.scan().map_err(|message| Error::Settings(format!("[scan]: {message}")))?;
    scene.add_camera(scan.camera(0));
    scene.lights.push(scan.light(0));
    experiment.camera.camera = Some(SENSOR.into());
    experiment.camera.resolution = Some(Resolution([scan.sensor_count() as u32, 1]));
    experiment.emitter.emitters = Some(Emitters::Nodes(vec![LASER.into()]));
    Ok(())
}

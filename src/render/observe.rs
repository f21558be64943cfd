//! An iteration that reports every contribution instead of an image, for travel times and for strategy images.

use super::Renderer;
use super::light::Splat;
use super::plan::Observe;
use super::samples::SampleCounts;
use super::sensor::SensorContribution;
use super::stats::computes_wrongly;
use crate::error::Result;
use crate::wgsl::layout::NONE;
use crate::wgsl::layout::constants::{SKY_VERTEX, VERTEX_DEPTH};

/// A contribution to the image.
pub struct Contribution {
    /// Contribution to the mean of the pixel. With [`Observe::Strategies`] the MIS weight is not included.
    pub rgb: [f32; 3],
    /// Row-major index in the crop. NONE for t = 1 with [`Observe::Times`], where the device does not report the pixel.
    pub pixel: u32,
    /// Number of vertices of the light subpath, the point on the emitter included.
    pub s: u32,
    /// Number of vertices of the sensor subpath, the one on the sensor included.
    pub t: u32,
    /// Whether an auxiliary vertex lies between the two subpaths, so that the path has s + t + 1 vertices.
    pub ellipsoidal: bool,
    /// With [`Observe::Times`] the travel time in units of the render space; with [`Observe::Strategies`] the MIS weight.
    pub tau_or_weight: f32,
}

impl Renderer {
    /// Runs the phases of [`Renderer::iterate`] for a plan that observes contributions, and calls `visit` with each
    /// contribution. The film does not change.
    pub(super) fn observe(&mut self, samples: u32, visit: &mut impl FnMut(Contribution)) -> Result<()> {
        let iteration = self.next_iteration(samples);

        // Phases 1 and 2: light tracing, hierarchy construction.
        let times = self.plan.observe == Observe::Times;
        let show = &mut |splat: Splat| {
            let Splat { rgb, pixel_or_tau, weight_or_tau, s } = splat;
            let (pixel, tau_or_weight) =
                if times { (NONE, f32::from_bits(pixel_or_tau)) } else { (pixel_or_tau, weight_or_tau) };
            visit(Contribution { rgb, pixel, s, t: 1, ellipsoidal: false, tau_or_weight });
        };
        let pool = self.build_pool(&iteration, show)?;

        // Phase 3: sensor tracing and connection.
        let Renderer { plan, scene, sensor, stats, .. } = self;
        let share = 1.0 / samples as f32;
        let mut missing = 0u64;
        let show = &mut |seen: SensorContribution| {
            let s = match seen.vertex {
                None => 0,
                Some(SKY_VERTEX) => 1,
                Some(vertex) => match pool.vertices.get(vertex as usize) {
                    Some(vertex) => (vertex.flags & VERTEX_DEPTH) + 1,
                    None => return missing += 1,
                },
            };
            let rgb = seen.rgb.map(|x| x * share);
            let SensorContribution { pixel, t, ellipsoidal, tau_or_weight, .. } = seen;
            visit(Contribution { rgb, pixel, s, t, ellipsoidal, tau_or_weight });
        };
        sensor.prepare(plan, &iteration, scene, &pool, stats)?.observe(plan, &SampleCounts::Uniform(samples), show)?;

        if missing > 0 {
            return Err(computes_wrongly(&format!("it connected {missing} light vertices that do not exist")));
        }

        self.finish_iteration(samples);
        Ok(())
    }
}

//! A contribution to the image, with everything that the host may learn about it.

use super::responses::Arrival;

/// The light of one path, found by one strategy.
pub struct Contribution {
    /// Contribution to the mean of the pixel. With [`Observe::Strategies`](super::plan::Observe) the MIS weight is not included.
    pub rgb: [f32; 3],
    /// Row-major index in the crop. NONE for t = 1 with [`Observe::Times`](super::plan::Observe): the device does not report it.
    pub pixel: u32,
    /// Travel time in units of the render space, 0 for light from the sky. NaN if the plan observes no travel times.
    pub tau: f32,
    /// The MIS weight if the plan observes strategies, else 1.
    pub mis_weight: f32,
    /// Number of vertices of the light subpath, the point on the emitter included.
    pub s: u32,
    /// Number of vertices of the sensor subpath, the one on the sensor included.
    pub t: u32,
    /// Whether an auxiliary vertex lies between the two subpaths, so that the path has s + t + 1 vertices.
    pub ellipsoidal: bool,
}

impl Contribution {
    /// Adds the contribution to the RGB image of the crop.
    pub fn add_to(&self, image: &mut [f32]) {
        let at = self.pixel as usize * 3;
        (0..3).for_each(|k| image[at + k] += self.rgb[k]);
    }

    /// The part that the images of several responses need.
    pub fn arrival(&self) -> Arrival {
        Arrival { pixel: self.pixel, tau: self.tau, rgb: self.rgb }
    }
}

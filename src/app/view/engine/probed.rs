//! The settings on which the measurements beside the image depend.

use taugate::internals::settings::Settings;

/// What the histogram of arriving light depends on, apart from the scene, the emitters, the camera and noise.
#[derive(Clone, Copy)]
pub struct Probed {
    resolution: [u32; 2],
    max_depth: u32,
}

impl Probed {
    pub fn new(settings: &Settings) -> Probed {
        Probed { resolution: settings.resolution(), max_depth: settings.max_depth() }
    }

    /// Whether depths and objects of pixels are the same.
    pub fn has_size_of(&self, other: &Probed) -> bool {
        self.resolution == other.resolution
    }

    /// Whether the same light arrives.
    pub fn has_light_of(&self, other: &Probed) -> bool {
        let [a, b] = [self.resolution, other.resolution].map(|size| size.map(u64::from));
        // The field of view depends on the aspect ratio.
        a[0] * b[1] == a[1] * b[0] && self.max_depth == other.max_depth
    }
}

//! The renderers of the viewer: one for the image, and others for previews. All share the scene on the device.

use taugate::Result;
use taugate::internals::gpu::Device;
use taugate::internals::job::memory;
use taugate::internals::render::{PreparedScene, Renderer, missing_light_at_any_time};
use taugate::internals::scene::Scene;
use taugate::internals::settings::{Responses, Settings};

use super::engine::Preview;

/// The sides of the image are divided by these numbers to give the sides of the previews, the coarsest first.
const DIVISORS: [u32; 3] = [8, 4, 2];
/// A preview has at most one light subpath per so many pixels, but it may have this number of them.
const PIXELS_PER_LIGHT_PATH: u32 = 16;
const FEW_LIGHT_PATHS: u32 = 1024;
/// Minimum side of a preview in pixels.
const MIN_SIDE: u32 = 32;

/// The renderers for one set of settings.
pub struct Renderers {
    pub prepared: PreparedScene,
    /// Renders the image, with the same bits as `taugate render`.
    pub full: Renderer,
    /// Render smaller images, the coarsest first. The last one has the size of the image, for fast devices; it takes memory only if it is
    /// used.
    pub previews: Vec<Renderer>,
    /// Warnings about the surfaces of the scene.
    pub warnings: Vec<String>,
}

impl Renderers {
    /// Prepares the scene and uploads it. Fails like [`PreparedScene::new`] and [`Renderer::from_prepared`].
    pub fn new(device: &Device, scene: &Scene, settings: &Settings) -> Result<Renderers> {
        let prepared = PreparedScene::new(scene, settings)?;
        let mut full = Renderer::from_prepared(device, scene, settings, &prepared)?;
        estimate_variance(&mut full, settings);
        let previews = previews(&full, scene, settings, &prepared)?;
        let warnings = warnings(&prepared, scene, settings);
        Ok(Renderers { prepared, full, previews, warnings })
    }

    /// Makes new renderers for new settings with the same camera and emitters. The scene on the device stays.
    pub fn replace(&mut self, scene: &Scene, settings: &Settings) -> Result<()> {
        self.previews.clear();
        self.full = self.full.sibling(scene, settings, &self.prepared)?;
        // Only now, because the old images are free here.
        estimate_variance(&mut self.full, settings);
        self.previews = previews(&self.full, scene, settings, &self.prepared)?;
        self.warnings = warnings(&self.prepared, scene, settings);
        Ok(())
    }

    /// The sizes and samples of the previews of an image of the size `whole`.
    pub fn list_previews(&self, whole: [u32; 2]) -> Vec<Preview> {
        let of = |preview: &Renderer| Preview::new([preview.film().width(), preview.film().height()], whole);
        self.previews.iter().map(of).collect()
    }

    /// Begins again with another seed and other responses.
    pub fn restart(&mut self, seed: u32, responses: &Responses) -> Result<()> {
        let all = self.previews.iter_mut().chain([&mut self.full]);
        for renderer in all {
            renderer.restart(seed, responses.clone())?;
            renderer.clear_stats();
        }
        Ok(())
    }

    /// Begins the previews again with the camera, seed and responses of `settings`. `with_lights`: also moves the lights, such as a
    /// headlamp. Returns false if there are no previews, if the camera is too far from the one that the scene was prepared for, or if
    /// other lights emit than before. The full image keeps its camera and lights.
    pub fn aim_previews(&mut self, scene: &Scene, settings: &Settings, with_lights: bool) -> Result<bool> {
        if with_lights && !self.prepared.follow_nearby(scene, settings)? {
            return Ok(false);
        }
        for preview in &mut self.previews {
            if !preview.set_camera(&scene.cameras[settings.camera()])? {
                return Ok(false);
            }
            if with_lights {
                preview.set_lights(&self.prepared)?;
            }
            preview.restart(settings.seed(), settings.responses().clone())?;
        }
        Ok(!self.previews.is_empty())
    }
}

/// Warnings about the scene, and about light that is missing at any time: the user may change the gate next.
fn warnings(prepared: &PreparedScene, scene: &Scene, settings: &Settings) -> Vec<String> {
    let missing = missing_light_at_any_time(scene, settings, prepared).map(|missing| missing.describe());
    prepared.scene_warnings(scene, settings).into_iter().chain(missing).collect()
}

/// Also estimates the variance of the images of several gates if there is enough memory, as `taugate render` does for image files.
fn estimate_variance(renderer: &mut Renderer, settings: &Settings) {
    if memory::check(settings, memory::ImageParts { variance: true, exr: true }, memory::free()).is_ok() {
        renderer.estimate_response_variance();
    }
}

fn previews(full: &Renderer, scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Result<Vec<Renderer>> {
    let preview = |size @ [width, height]: [u32; 2]| {
        let few = (width * height / PIXELS_PER_LIGHT_PATH).max(FEW_LIGHT_PATHS);
        let settings = settings.change().resolution(size).build()?;
        let paths = settings.light_paths().min(few);
        full.sibling(scene, &settings.change().light_paths(paths).build()?, prepared)
    };
    preview_sizes(settings.resolution(), settings.responses().len()).into_iter().map(preview).collect()
}

/// Sizes of the previews of an image in pixels, the smallest first. The images of several gates would need twice the memory in a preview
/// of the whole size, so they have none.
fn preview_sizes([width, height]: [u32; 2], gates: usize) -> Vec<[u32; 2]> {
    let sizes = DIVISORS.map(|divisor| [width.div_ceil(divisor), height.div_ceil(divisor)]);
    let mut sizes: Vec<_> = sizes.into_iter().filter(|[width, height]| width.min(height) >= &MIN_SIDE).collect();
    if !sizes.is_empty() && gates == 1 {
        sizes.push([width, height]);
    }
    sizes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn previews_are_not_tiny() {
        let sizes = |size| preview_sizes(size, 1);
        assert_eq!(sizes([512, 512]), [[64, 64], [128, 128], [256, 256], [512, 512]]);
        assert_eq!(sizes([640, 360]), [[80, 45], [160, 90], [320, 180], [640, 360]]);
        assert_eq!(sizes([100, 70]), [[50, 35], [100, 70]]);
        assert_eq!(preview_sizes([100, 70], 2), [[50, 35]]);
        assert!(sizes([63, 1000]).len() == 2 && sizes([60, 60]).is_empty() && sizes([1, 1]).is_empty());
    }
}

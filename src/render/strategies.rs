//! One image per strategy (s, t), with and without its MIS weight, which shows what each strategy adds to the image.

use super::Renderer;
use super::contribution::Contribution;
use super::plan::{Observe, Plan};
use super::prepared_scene::PreparedScene;
use crate::error::{Error, Result};
use crate::estimators::Ellipsoids;
use crate::gpu::Device;
use crate::image::film::Film;
use crate::scene::Scene;
use crate::settings::{Sampling, Settings, Strategies};

/// Host bytes per pixel and strategy: two films with 32 bytes per channel, and two images of an iteration.
const PIXEL_BYTES: u64 = 2 * (96 + 12);
/// Maximum number of host bytes for all strategies.
const MAX_BYTES: u64 = 2 << 30;

/// The contributions of strategy (s, t) to the image.
pub struct StrategyImage {
    /// Number of vertices of the light subpath, the point on the emitter included.
    pub s: u32,
    /// Number of vertices of the sensor subpath, the one on the sensor included.
    pub t: u32,
    /// Whether an auxiliary vertex lies between the two subpaths, so that the paths have s + t + 1 vertices.
    pub ellipsoidal: bool,
    /// Contributions times their MIS weights. The sum over all strategies is the image.
    pub weighted: Film,
    /// Contributions with weight 1: the image that this strategy alone would render, from the paths that it can find.
    pub unweighted: Film,
}

/// A render of strategy images in progress. It traces the same subpaths and connections as [`Renderer`] with the same settings.
pub struct StrategyImages {
    renderer: Renderer,
    images: Vec<StrategyImage>,
}

/// The strategies (s, t) that a render forms, sorted by path length. For each length, the direct connections (false, s + t - 1
/// segments) come before the ellipsoidal ones (true, one segment more); both are sorted by s. A strategy in the list may still
/// find no light in this scene: no ray hits a point light.
pub fn strategies(settings: &Settings, forms_ellipsoids: bool) -> Vec<(u32, u32, bool)> {
    let (all, light_subpaths) =
        (settings.strategies() == Strategies::All, settings.estimator().record().light_subpaths);
    let kept =
        |s: u32, t: u32| (s, t) != (1, 1) && (all || (s >= 1 && t >= 2)) && (light_subpaths || (s <= 1 && t >= 2));
    let of_length = |k: u32| (0..=k).map(move |s| (s, k + 1 - s));
    let direct = |k: u32| of_length(k).filter(|&(s, t)| kept(s, t)).map(|(s, t)| (s, t, false));
    let ellipsoidal = |k: u32| {
        let all = if forms_ellipsoids { 1..k - 1 } else { 0..0 };
        all.map(move |s| (s, k - s, true))
    };
    (1..=settings.max_depth()).flat_map(|k| direct(k).chain(ellipsoidal(k))).collect()
}

impl StrategyImages {
    /// Fails where [`Renderer::new`] fails, and where [`StrategyImages::check`] does.
    pub fn new(
        device: &Device,
        scene: &Scene,
        settings: &Settings,
        prepared: &PreparedScene,
    ) -> Result<StrategyImages> {
        StrategyImages::check(settings)?;
        let [width, height] = [settings.crop().width(), settings.crop().height()];
        let mut plan = Plan::new(scene, settings, prepared, device.info().quirks)?;
        plan.observe(Observe::Strategies);
        let strategies = strategies(settings, plan.estimator.ellipsoids != Ellipsoids::None);
        check_memory(settings, strategies.len())?;
        let renderer = Renderer::from_plan(device, plan, [1, 1], scene, prepared)?;
        let film = || Film::new(width, height);
        let image = |(s, t, ellipsoidal)| StrategyImage { s, t, ellipsoidal, weighted: film(), unweighted: film() };
        Ok(StrategyImages { renderer, images: strategies.into_iter().map(image).collect() })
    }

    /// Fails if the images of all strategies take more than 2 GiB, or if the sampling is adaptive: a render that observes
    /// contributions measures no error per pixel.
    pub fn check(settings: &Settings) -> Result<()> {
        if settings.sampling() == Sampling::Adaptive {
            return Err(Error::advice(
                "--strategy-images needs the same number of samples in every pixel; ",
                "add --sampling uniform",
            ));
        }
        // This is a lower bound: for a thin gate, the render forms more strategies.
        check_memory(settings, strategies(settings, settings.estimator().record().ellipsoids != Ellipsoids::None).len())
    }

    /// Renders one iteration with `samples` samples per pixel; see [`Renderer::iterate`].
    pub fn iterate(&mut self, samples: u32) -> Result<()> {
        let pixels = self.renderer.plan.crop_pixels as usize;
        let longest = self.renderer.plan.max_depth as usize + 2;
        let mut index = vec![[None; 2]; longest * longest];
        for (i, image) in self.images.iter().enumerate() {
            index[image.s as usize * longest + image.t as usize][usize::from(image.ellipsoidal)] = Some(i);
        }
        let mut sums = vec![[vec![0.0f32; 3 * pixels], vec![0.0f32; 3 * pixels]]; self.images.len()];
        self.renderer.observe(samples, &mut |seen: Contribution| {
            let weight = seen.mis_weight;
            if !(seen.rgb.iter().all(|x| x.is_finite()) && weight.is_finite()) {
                return;
            }
            let i = index[seen.s as usize * longest + seen.t as usize][usize::from(seen.ellipsoidal)]
                .expect("`strategies` lists every strategy that the kernels form");
            let [weighted, unweighted] = &mut sums[i];
            for (k, x) in seen.rgb.into_iter().enumerate() {
                let at = 3 * seen.pixel as usize + k;
                unweighted[at] += x;
                weighted[at] += x * weight;
            }
        })?;
        for (image, [weighted, unweighted]) in self.images.iter_mut().zip(&sums) {
            image.weighted.add(weighted, samples);
            image.unweighted.add(unweighted, samples);
        }
        Ok(())
    }

    /// The images so far, in the order of [`strategies`].
    pub fn images(&self) -> &[StrategyImage] {
        &self.images
    }
}

/// Fails if the images of `count` strategies take more than 2 GiB.
fn check_memory(settings: &Settings, count: usize) -> Result<()> {
    let bytes = count as u64 * PIXEL_BYTES * u64::from(settings.crop().width()) * u64::from(settings.crop().height());
    if bytes <= MAX_BYTES {
        return Ok(());
    }
    Err(Error::settings(format!(
        "--strategy-images: the images of {count} strategies take {} MiB, and the maximum is {} MiB; use a smaller \
         --max-depth (now {}), a smaller --resolution or a --crop",
        bytes >> 20,
        MAX_BYTES >> 20,
        settings.max_depth()
    )))
}

//! `shared/sky.wgsl`: the device sees the texels that the image has, and samples directions with the density that it states.

use std::f64::consts::PI;

use bytemuck::{Pod, Zeroable};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::render::sky_table;
use taugate::internals::scene::SkyImage;

use crate::shader_function::{ShaderFunction, contents};
use crate::values::{direction, dvec, frame, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&TOWARDS, &SAMPLE];

const TOWARDS: ShaderFunction = ShaderFunction {
    imports: &["sky"],
    input: "w: vec3<f32>, pad: u32",
    result: "radiance: vec3<f32>, pdf: f32",
    body: "let seen = sky_towards(input.w); result.radiance = seen.radiance; result.pdf = seen.pdf;",
};

const SAMPLE: ShaderFunction = ShaderFunction {
    imports: &["sky"],
    input: "words: vec4<u32>",
    result: "direction: vec3<f32>, pdf: f32, radiance: vec3<f32>, pad: u32",
    body: "let seen = sample_sky(input.words); result.direction = seen.direction; result.pdf = seen.pdf;
        result.radiance = seen.radiance;",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Direction {
    w: [f32; 3],
    pad: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Seen {
    radiance: [f32; 3],
    pdf: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Sampled {
    direction: [f32; 3],
    pdf: f32,
    radiance: [f32; 3],
    pad: u32,
}

/// Images of different sizes. Some have black texels and black rows, and one texel that is much brighter than the others.
fn images() -> Vec<SkyImage> {
    let mut pcg = Pcg::new(77);
    let mut images = vec![SkyImage::constant()];
    for (width, height) in [(1, 2), (2, 1), (5, 3), (64, 33), (300, 150)] {
        let mut texel = |i: u32| match pcg.below(4) {
            _ if height > 2 && i / width == 1 => [0.0; 3],
            0 if i > 0 => [0.0; 3],
            _ => [0, 1, 2].map(|_| pcg.range(0.1, 2.0) as f32),
        };
        let mut rgb: Vec<[f32; 3]> = (0..width * height).map(&mut texel).collect();
        rgb[0] = rgb[0].map(|x| 50.0 * x);
        images.push(SkyImage { width, height, rgb });
    }
    images
}

const RADIANCE: [f32; 3] = [2.0, 1.0, 0.5];

fn luminance(image: &SkyImage, texel: [f32; 3]) -> f64 {
    assert!(image.width > 0);
    [0.2126, 0.7152, 0.0722].iter().zip(texel).zip(RADIANCE).map(|((w, x), r)| w * f64::from(x * r)).sum()
}

/// Integral of the luminance over all directions.
fn total(image: &SkyImage) -> f64 {
    let row = |i: usize| image.solid_angle((i / image.width as usize) as u32);
    image.rgb.iter().enumerate().map(|(i, texel)| row(i) * luminance(image, *texel)).sum()
}

/// Whether `w` is so close to the edge of a texel that rounding may choose either side.
fn is_at_an_edge(image: &SkyImage, w: glam::DVec3) -> bool {
    let across = (w.z.atan2(w.x) / (2.0 * PI) + 0.5) * f64::from(image.width);
    let down = w.y.acos() / PI * f64::from(image.height);
    // An azimuth is less precise near the poles.
    let sine = (1.0 - w.y * w.y).sqrt().max(1e-9);
    let near = |x: f64, tolerance: f64| (x - x.round()).abs() < tolerance;
    near(across, 1e-6 / sine + 2e-6 * f64::from(image.width)) || near(down, 4e-6 * f64::from(image.height))
}

#[test]
fn the_device_sees_the_texels_of_the_image() {
    let mut pcg = Pcg::new(78);
    for image in images() {
        let table = sky_table(&image, RADIANCE, 0.5, 0.25);
        let inputs: Vec<Direction> = (0..20_000).map(|_| Direction { w: vec3(direction(&mut pcg)), pad: 0 }).collect();
        let seen: Vec<Seen> = TOWARDS.run(&inputs, &[contents("sky", &table), frame(|_| ())]);
        let total = total(&image);
        let mut checked = 0;
        for (input, seen) in inputs.iter().zip(&seen) {
            let w = dvec(&input.w).normalize();
            if is_at_an_edge(&image, w) {
                continue;
            }
            checked += 1;
            let texel = image.towards(w);
            assert_eq!(seen.radiance, [0, 1, 2].map(|k| texel[k] * RADIANCE[k]), "{w} of {}", image.width);
            let pdf = luminance(&image, texel) / total;
            assert!((f64::from(seen.pdf) - pdf).abs() <= 1e-4 * pdf, "{w}: {} instead of {pdf}", seen.pdf);
        }
        assert!(checked > 19_000, "only {checked} directions were checked");
    }
}

/// Sampled directions lie in texels as often as the density says, also at the poles.
#[test]
fn directions_are_sampled_with_the_stated_density() {
    const SAMPLES: usize = 400_000;
    let mut pcg = Pcg::new(79);
    for image in images() {
        let table = sky_table(&image, RADIANCE, 0.5, 0.25);
        let inputs: Vec<[u32; 4]> =
            (0..SAMPLES).map(|_| [0; 4].map(|_| (pcg.uniform() * 4_294_967_296.0) as u32)).collect();
        let samples: Vec<Sampled> = SAMPLE.run(&inputs, &[contents("sky", &table), frame(|_| ())]);
        let total = total(&image);
        // Cells are quarters of texels, so that the position in the texel is tested too.
        let (width, height) = (2 * image.width as usize, 2 * image.height as usize);
        let mut counts = vec![0.0f64; width * height];
        let mut weight = 0.0f64;
        for s in &samples {
            let w = dvec(&s.direction);
            assert!((w.length() - 1.0).abs() < 1e-6 && s.pdf >= 0.0, "{s:?}");
            let w = w.normalize();
            let across = ((w.z.atan2(w.x) / (2.0 * PI) + 0.5) * width as f64) as usize;
            // A texel is halved where its two parts have the same solid angle.
            let row = ((w.y.acos() / PI * f64::from(image.height)) as u32).min(image.height - 1);
            let edge = |row: u32| (PI * f64::from(row) / f64::from(image.height)).cos();
            let lower = w.y < 0.5 * (edge(row) + edge(row + 1));
            counts[(2 * row as usize + usize::from(lower)) * width + across.min(width - 1)] += 1.0;
            if s.pdf > 0.0 {
                weight += luminance(&image, image.towards(w)) / f64::from(s.pdf);
            }
        }
        let mean = weight / SAMPLES as f64;
        assert!((mean / total - 1.0).abs() < 1e-3, "{} texels across: {mean} instead of {total}", image.width);
        let mut chi2 = 0.0f64;
        let mut cells = 0.0f64;
        for (i, count) in counts.iter().enumerate() {
            let (row, column) = (i / width / 2, i % width / 2);
            let texel = image.rgb[row * image.width as usize + column];
            let share = luminance(&image, texel) * image.solid_angle(row as u32) / 4.0 / total;
            let expected = share * SAMPLES as f64;
            if expected > 8.0 {
                chi2 += (count - expected) * (count - expected) / expected;
                cells += 1.0;
            }
        }
        // The sum has the mean `cells` and the variance 2 `cells`.
        assert!(cells >= 4.0 && chi2 < cells + 5.0 * (2.0 * cells).sqrt() + 10.0, "{chi2} for {cells} cells");
    }
}

//! Compares FLIP with values of the published program (flip-evaluator 1.7, HDR, defaults) on procedural images.

use super::*;

const WIDTH: usize = 40;
const HEIGHT: usize = 28;

/// `scale u^power` per channel, with u from a linear congruential generator.
fn noise(seed: u64, power: i32, scale: f64) -> Vec<f32> {
    let mut state = seed;
    let mut next = || {
        state = (1_103_515_245 * state + 12_345) % (1 << 31);
        state as f64 / f64::from(1u32 << 31)
    };
    (0..3 * WIDTH * HEIGHT).map(|_| (scale * next().powi(power)) as f32).collect()
}

/// Gradients on a chequerboard of light and dark squares.
fn board() -> Vec<f32> {
    let value = |x: usize, y: usize, c: usize| {
        let gradient = (1 + x * (c + 1) + 2 * y) as f64 / (WIDTH * (c + 1) + 2 * HEIGHT) as f64;
        (gradient * if (x / 8 + y / 8) % 2 == 1 { 4.0 } else { 0.5 }) as f32
    };
    (0..HEIGHT).flat_map(|y| (0..WIDTH).flat_map(move |x| (0..3).map(move |c| value(x, y, c)))).collect()
}

fn scaled(image: &[f32], factors: &[f32], from: f32, by: f32) -> Vec<f32> {
    image.iter().zip(factors).map(|(x, f)| x * (from + by * f)).collect()
}

/// Checks the mean, the value of the pixel (5, 3), and the exposures.
fn assert_published(image: &[f32], reference: &[f32], mean: f64, pixel: f32, exposures: (f64, f64, usize)) {
    let flip = hdr(image, reference, WIDTH);
    assert!((flip.mean() - mean).abs() < 2e-5, "{} instead of {mean}", flip.mean());
    let at = flip.map[3 * WIDTH + 5];
    assert!((at - pixel).abs() < 5e-5, "{at} instead of {pixel}");
    let (first, last, count) = flip.exposures;
    assert!((first - exposures.0).abs() < 1e-4 && (last - exposures.1).abs() < 1e-4, "{first} {last}");
    assert_eq!(count, exposures.2);
}

#[test]
fn published_values() {
    let reference = noise(1, 4, 5.0);
    let image = scaled(&reference, &noise(2, 1, 1.0), 0.5, 1.0);
    assert_published(&image, &reference, 0.142616, 0.13831, (-1.05636, 1.74821, 3));

    let reference = board();
    let image = scaled(&reference, &noise(3, 1, 1.0), 0.8, 0.4);
    assert_published(&image, &reference, 0.077028, 0.07936, (-0.88484, 2.31355, 4));
}

#[test]
fn published_values_of_an_image_that_is_mostly_black() {
    let mut reference = vec![0.0; 3 * WIDTH * HEIGHT];
    for y in 10..14 {
        reference[3 * (y * WIDTH + 20)..3 * (y * WIDTH + 24)].fill(1.0);
    }
    let mut image = reference.clone();
    image[3 * (12 * WIDTH + 22)..][..3].copy_from_slice(&[0.5, 0.2, 0.9]);
    image[3 * (3 * WIDTH + 5)..][..3].copy_from_slice(&[0.01, 0.02, 0.001]);
    assert_published(&image, &reference, 0.020067, 0.88252, (1.08330, 24.08330, 23));

    // At a millionth of the brightness the error must be the same. There is no published value for this image.
    let dark = |rgb: &[f32]| rgb.iter().map(|v| v * 1e-6).collect::<Vec<_>>();
    assert!((hdr(&dark(&image), &dark(&reference), WIDTH).mean() - 0.020067).abs() < 2e-5);
}

#[test]
fn the_greatest_difference_is_one() {
    let flat = |rgb: [f32; 3]| -> Vec<Pixel> { vec![rgb; WIDTH * HEIGHT] };
    let map = ldr(&flat([0.0, 0.0, 1.0]), &flat([0.0, 1.0, 0.0]), WIDTH, &Filters::new());
    assert!(map.iter().all(|v| (v - 1.0).abs() < 1e-4), "{}", map[0]);
    // For green and blue that are a thousand times brighter, the published program gives 0.996163.
    let flat = |rgb: [f32; 3]| -> Vec<f32> { rgb.map(|v| 1000.0 * v).repeat(WIDTH * HEIGHT) };
    let mean = hdr(&flat([0.0, 0.0, 1.0]), &flat([0.0, 1.0, 0.0]), WIDTH).mean();
    assert!((mean - 0.996163).abs() < 2e-5, "{mean}");
}

#[test]
fn odd_images() {
    let noisy = noise(4, 2, 3.0);
    assert_eq!(hdr(&noisy, &noisy, WIDTH).mean(), 0.0);
    assert_eq!(hdr(&[0.0; 3], &[0.0; 3], 1).mean(), 0.0);
    for (image, reference) in [([1e30; 3], [1e-30; 3]), ([-1.0, 0.0, f32::MAX], [1.0; 3]), ([1.0; 3], [0.0; 3])] {
        let flip = hdr(&image, &reference, 1);
        assert!((0.0..=1.0).contains(&flip.mean()) && flip.mean() > 0.0, "{flip:?}");
    }
    // Images of one column and of one row.
    for width in [1, 7] {
        assert!(hdr(&noisy[..21], &noisy[21..42], width).map.iter().all(|v| (0.0..=1.0).contains(v)));
    }
}

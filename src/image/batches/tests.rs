use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::SeedableRng;

use super::*;
use crate::image::film::Film;
use crate::render::schedule::{samples_before, samples_in};

#[test]
fn cells_pool_what_iterations_share() {
    // An image of 20 x 3 pixels has cells of 16 x 3 and 4 x 3. Both rise and fall together.
    let mut batches = CellBatches::new(20, 3);
    for (x, samples) in [(1.0, 4), (3.0, 4), (6.0, 2)] {
        batches.add(&[x; 180], samples);
    }
    assert_eq!((batches.grid(), batches.pixels(0), batches.pixels(1)), ([2, 1], 48, 12));
    for cells in [&[0][..], &[1], &[0, 1]] {
        let (mean, variance) = batches.pooled(cells, 2);
        // 0.4^2 1.8^2 / 0.6 + 0.4^2 0.2^2 / 0.6 + 0.2^2 3.2^2 / 0.8.
        assert!((mean - 2.8).abs() < 1e-12 && (variance - 1.386_667).abs() < 1e-6, "{mean} {variance}");
    }
    let read = CellBatches::from_floats(20, 3, &batches.to_floats()).unwrap();
    assert!((read.pooled(&[0, 1], 1).1 - 1.386_667).abs() < 1e-5);
    assert!(CellBatches::from_floats(21, 40, &batches.to_floats()).is_err());
    let mut odd = batches.to_floats();
    odd[5] = f32::NAN;
    assert!(CellBatches::from_floats(20, 3, &odd).is_err());
    assert!(CellBatches::from_floats(20, 3, &[]).is_err());
}

/// The mean of the stated variances over the true variance, for cells and for the mean of an image with `spp` samples per pixel.
/// The noise of an iteration has the variance `of_samples` / samples + `of_paths`.
fn stated_over_true(spp: u64, of_samples: f64, of_paths: f64) -> [f64; 2] {
    let lengths: Vec<u32> =
        (0..).map(samples_in).take((0..).find(|&i| samples_before(i) >= spp).unwrap() as usize).collect();
    let deviations: Vec<f64> = lengths.iter().map(|&w| (of_samples / f64::from(w) + of_paths).sqrt()).collect();
    let parts = || lengths.iter().map(|&w| f64::from(w) / spp as f64);
    let truth: f64 = parts().zip(&deviations).map(|(p, d)| (p * d).powi(2)).sum();
    let (mut random, renders) = (Pcg64Mcg::seed_from_u64(spp), 12_000);
    let mut stated = [0.0; 2];
    for _ in 0..renders {
        let mut film = Film::new(1, 1);
        for (&samples, deviation) in lengths.iter().zip(&deviations) {
            let noise: f64 = StandardNormal.sample(&mut random);
            film.add(&[(deviation * noise) as f32; 3], samples);
        }
        stated[0] += film.cells().pooled(&[0], 1).1;
        stated[1] += film.image_mean().1.unwrap().powi(2);
    }
    stated.map(|sum| sum / f64::from(renders) / truth)
}

#[test]
fn variances_are_right_for_the_noise_of_samples_and_of_light_subpaths() {
    for spp in [16, 32, 128, 256] {
        for (of_samples, of_paths) in [(1.0, 0.0), (0.0, 1.0)] {
            let ratios = stated_over_true(spp, of_samples, of_paths);
            assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.02), "{spp} {of_paths}: {ratios:?}");
        }
    }
}

#[test]
fn batches_of_equal_length_have_most_freedom() {
    let of = |weights: &[u32]| {
        let mut batches = CellBatches::new(1, 1);
        weights.iter().for_each(|&samples| batches.add(&[1.0; 3], samples));
        batches.freedom()
    };
    assert!((of(&[8; 10]) - 9.0).abs() < 1e-9, "{}", of(&[8; 10]));
    // 128 samples per pixel: the 8 iterations of 2 samples and 12 of 4 count little beside those of 8.
    let lengths: Vec<u32> = (0..28).map(samples_in).collect();
    assert!((13.0..17.0).contains(&of(&lengths)), "{}", of(&lengths));
}

#[test]
fn cells_know_their_pixels() {
    let mut batches = CellBatches::new(20, 3);
    let image = |scale: f32| -> Vec<f32> { (0..180).map(|k| scale * (k as f32 + 0.1)).collect() };
    batches.add(&image(1.0), 4);
    batches.add(&image(3.0), 4);
    let read = CellBatches::from_floats(20, 3, &batches.to_floats()).unwrap();
    assert!(read.are_of(&image(2.0)));
    for changed in [image(4.0), image(2.001), vec![0.0; 180]] {
        assert!(!read.are_of(&changed));
        let moved = read.clone().moved_to(&changed);
        assert!(moved.are_of(&changed));
        let ((mean, spread), old) = (moved.pooled(&[1], 0), read.pooled(&[1], 0));
        assert!((spread / old.1 - 1.0).abs() < 1e-6 && (mean - old.0).abs() > 1e-4, "{mean} {spread}");
    }
    let mut one_pixel = image(2.0);
    one_pixel[179] += 1.0;
    assert!(!read.are_of(&one_pixel));
}

#[test]
fn merged_renders_are_one() {
    let (mut a, mut b, mut all) = (CellBatches::new(20, 3), CellBatches::new(20, 3), CellBatches::new(20, 3));
    for (i, (x, samples)) in [(1.0, 4), (3.0, 4), (6.0, 2), (2.0, 5)].into_iter().enumerate() {
        let image: Vec<f32> = (0..180).map(|k| x + k as f32).collect();
        if i % 2 == 0 {
            a.add(&image, samples)
        } else {
            b.add(&image, samples)
        }
        all.add(&image, samples);
    }
    a.merge(&b);
    assert_eq!(a.len(), 4);
    for cells in [&[0][..], &[0, 1]] {
        let ((mean, variance), (m, v)) = (a.pooled(cells, 1), all.pooled(cells, 1));
        assert!((mean - m).abs() < 1e-9 && (variance - v).abs() < 1e-9);
    }
}

#[test]
fn many_merged_batches_stay_few() {
    let mut parts = [0, 1, 2].map(|part| {
        let mut batches = CellBatches::new(2, 1);
        (0..30).for_each(|i| batches.add(&[(30 * part + i) as f32; 6], 1));
        batches
    });
    let [a, b, c] = &mut parts;
    a.merge(b);
    // The 60 batches become 30 of two iterations each, and the next iteration begins another one.
    a.add(&[100.0; 6], 1);
    assert_eq!(a.len(), 31);
    a.merge(c);
    assert!(a.len() <= MAX_BATCHES && a.len() >= MAX_BATCHES / 2, "{}", a.len());
    assert!((a.pooled(&[0], 0).0 - (44.5 * 90.0 + 100.0) / 91.0).abs() < 1e-9);
}

#[test]
fn many_iterations_are_merged_evenly() {
    let mut batches = CellBatches::new(2, 1);
    for i in 0..100 {
        batches.add(&[i as f32; 6], 1);
    }
    // At 33 iterations, 32 batches merge to 16 of two; at 65, to 16 of four. So 100 iterations are 25 batches of four.
    assert_eq!(batches.len(), 25);
    assert!((batches.pooled(&[0], 0).0 - 49.5).abs() < 1e-9);
    let means: Vec<f32> = batches.to_floats()[2..].chunks(4).map(|b| b[1]).collect();
    assert_eq!((means[0], means[24]), (1.5, 97.5));
}

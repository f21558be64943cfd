//! Checks that the same seed gives the same bits in a second render, and with other sizes of tiles and workgroups.

use super::{Method, Verdict};
use crate::error::Result;
use crate::generate::{Kind, build, zoo::Light};
use crate::gpu::Device;
use crate::render::{Renderer, Tuning};
use crate::settings::units::Gate;

/// A gate in which every estimator finds light.
const GATE: Gate = Gate { lo: 7.0, hi: 9.0 };
const SEED: u32 = 3;

pub fn check(device: &Device, method: Method) -> Result<Verdict> {
    let scene = build(Kind::Zoo(Light::Area));
    let settings = method.settings(&scene, "light-paths = 1000")?;
    let usual = Tuning::default();
    let mut images = vec![];
    for tuning in [usual, usual, Tuning { workgroup: 32, tile: Some(100), ..usual }] {
        let mut renderer = Renderer::with_tuning(device, &scene, &settings, tuning)?;
        renderer.restart(SEED, GATE)?;
        // Adaptive sampling uses the measured error from the second iteration on.
        for samples in [2, 4] {
            renderer.iterate(samples)?;
        }
        images.push(renderer.film().mean().iter().map(|x| x.to_bits()).collect::<Vec<u32>>());
    }
    if images[0].iter().all(|&bits| bits == 0) {
        return Ok(Verdict::Wrong("expected light, found a black image".into()));
    }
    let differing = |a: &[u32], b: &[u32]| a.iter().zip(b).filter(|(a, b)| a != b).count();
    let [again, tuned] = [1, 2].map(|i| differing(&images[0], &images[i]));
    let values = images[0].len();
    Ok(match (again, tuned) {
        (0, 0) => Verdict::Right(format!("all {values} values are the same")),
        (0, n) => Verdict::Wrong(format!("expected the same bits, but {n} of {values} values differ")),
        (n, _) => {
            Verdict::Wrong(format!("expected the same bits when rendered again, but {n} of {values} values differ"))
        }
    })
}

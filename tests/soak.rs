//! An hour of renders in one process: memory and open files must stay flat. Linux only. The environment variable TAUGATE_SOAK sets the
//! time in seconds, 3600 by default. The time begins after a first round that compiles the kernels. Rounds in the first quarter are a
//! warm-up and are not judged.

#![cfg(target_os = "linux")]

use std::path::Path;
use std::time::{Duration, Instant};

use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::generate::{Kind, build, glb};
use taugate::internals::image::exr_file;
use taugate::internals::render::Renderer;
use taugate::internals::scene::{Scene, gltf};
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Budget, Estimator, Sampling, Settings};
use taugate::{Device, load_scene};

/// Maximum growth of the resident memory after the warm-up, as a fraction: median of the last quarter of the rounds over that of the
/// first.
const GROWTH: f64 = 0.01;

/// Resident memory of this process in kB.
fn resident() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}

fn open_files() -> usize {
    std::fs::read_dir("/proc/self/fd").unwrap().count()
}

/// Writes and loads each scene once. For each estimator: renders three gates one after the other, writes the image, and renders 16 gates
/// at once. The work is the same for every seed.
fn round(device: &Device, scenes: &[Scene], folder: &Path, seed: u32) {
    let gates = Gates::new(Gate { lo: 5.0, hi: 9.0 }, 16).unwrap();
    for scene in scenes {
        let path = folder.join("scene.glb");
        std::fs::write(&path, glb::write(scene)).unwrap();
        let loaded = load_scene(&path).unwrap();
        assert!(gltf::load_slice(b"glTF no scene", &path).is_err());
        for (estimator, sampling) in
            Estimator::ALL.into_iter().zip([Sampling::Uniform, Sampling::Adaptive].into_iter().cycle())
        {
            let settings = Settings::builder().estimator(estimator).sampling(sampling).resolution([16, 12]);
            let settings = settings.budget(Budget::Spp(4)).light_paths(200).seed(seed).max_depth(6);
            let one = settings.clone().build().unwrap();
            let mut renderer = Renderer::new(device, &loaded, &one).unwrap();
            for gate in [Gate::OPEN, Gate { lo: 6.0, hi: 7.0 }, Gate { lo: 7.5, hi: 7.6 }] {
                renderer.restart(seed, gate).unwrap();
                (0..2).for_each(|_| renderer.iterate(2).unwrap());
            }
            exr_file::write_film(&folder.join("out.exr"), renderer.film(), None, &one, Duration::from_secs(1)).unwrap();
            let mut many = Renderer::new(device, &loaded, &settings.responses(gates).build().unwrap()).unwrap();
            many.iterate(2).unwrap();
        }
    }
}

/// `TAUGATE_SOAK=3600 cargo test --release --test soak -- --ignored --nocapture`
#[test]
#[ignore = "takes an hour"]
fn memory_and_open_files_stay_flat() {
    let seconds = std::env::var("TAUGATE_SOAK").map_or(3600.0, |text| text.parse().expect("TAUGATE_SOAK in seconds"));
    let device = Device::open(None).unwrap();
    let scenes = [build(Kind::CornellBox), zoo(Light::Punctual)];
    let folder = tempfile::tempdir().unwrap();
    // Compiles the kernels.
    round(&device, &scenes, folder.path(), 0);
    let start = Instant::now();
    // Time in seconds, resident memory in kB, and number of open files, after each round.
    let mut samples: Vec<(f64, f64, usize)> = vec![];
    for seed in 1.. {
        round(&device, &scenes, folder.path(), seed);
        let time = start.elapsed().as_secs_f64();
        samples.push((time, resident(), open_files()));
        if time > seconds {
            break;
        }
    }
    samples.retain(|(time, ..)| *time > 0.25 * seconds);
    assert!(samples.len() >= 4, "only {} rounds after the warm-up: raise TAUGATE_SOAK", samples.len());
    let quarter = samples.len() / 4;
    let median = |part: &[(f64, f64, usize)]| {
        let mut memory: Vec<f64> = part.iter().map(|sample| sample.1).collect();
        memory.sort_by(f64::total_cmp);
        memory[memory.len() / 2]
    };
    let [first, last] = [&samples[..quarter], &samples[samples.len() - quarter..]].map(median);
    let files = samples.iter().map(|sample| sample.2);
    let (fewest, most) = (files.clone().min().unwrap(), files.max().unwrap());
    println!("{} rounds: {first} kB, then {last} kB; {fewest} to {most} open files", samples.len());
    assert!(last <= (1.0 + GROWTH) * first, "memory grows from {first} kB to {last} kB");
    assert_eq!(fewest, most, "open files");
}

//! Random and degenerate inputs, conversions, and frames for test kernels.

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::lightcone::gate::rounding_allowance;
use taugate::internals::settings::units::Gate;
use taugate::internals::wgsl::layout::Frame;

use crate::shader_function::{Contents, contents};

pub fn dvec(v: &[f32]) -> DVec3 {
    DVec3::new(v[0].into(), v[1].into(), v[2].into())
}

pub fn vec3(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

/// A uniformly distributed unit vector.
pub fn direction(pcg: &mut Pcg) -> DVec3 {
    let z = pcg.range(-1.0, 1.0);
    let angle = pcg.range(0.0, std::f64::consts::TAU);
    let r = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(r * angle.cos(), r * angle.sin(), z)
}

/// The six axis directions, 18 directions close to them, then `n` random unit vectors. All are rounded to f32, which moves
/// them by up to about 1e-7.
pub fn directions(seed: u64, n: usize) -> Vec<DVec3> {
    let mut pcg = Pcg::new(seed);
    let mut all = vec![];
    for axis in DVec3::AXES {
        all.extend([axis, -axis]);
        for tiny in [1e-3, 1e-5, 1e-7] {
            let aside = tiny * DVec3::new(0.6, -0.8, 1.0);
            all.extend([(axis + aside).normalize(), (aside - axis).normalize()]);
        }
    }
    all.extend((0..n).map(|_| direction(&mut pcg)));
    all.iter().map(|d| d.as_vec3().as_dvec3()).collect()
}

/// The unit vector whose z coordinate is `cosine`, at the angle `azimuth` around the z axis.
pub fn polar(cosine: f64, azimuth: f64) -> DVec3 {
    let r = (1.0 - cosine * cosine).max(0.0).sqrt();
    DVec3::new(r * azimuth.cos(), r * azimuth.sin(), cosine)
}

/// The buffer `frame`: zeros and a `query_sample_count` of 1, then changed by `change`.
pub fn frame(change: impl FnOnce(&mut Frame)) -> Contents {
    let mut frame = Frame { query_sample_count: 1.0, ..bytemuck::Zeroable::zeroed() };
    change(&mut frame);
    contents("frame", &[frame])
}

/// The buffer `frame` with the ends of a gate and the rounding allowance of a sensor at the origin. 3e38 stands for infinity.
pub fn frame_with_gate(gate: Gate) -> Contents {
    frame(|f| {
        (f.gate_lo, f.gate_hi) = (gate.lo as f32, (gate.hi as f32).min(3e38));
        f.rounding_allowance = rounding_allowance(gate, 0.0);
    })
}

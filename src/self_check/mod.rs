//! Small scenes whose images are known, rendered on a device that nobody has tried yet: `taugate devices --check`.
//!
//! Every estimator renders each of them, with as many samples in every pixel and with samples that follow the error. A driver that
//! miscompiles a kernel is found by its images; it need not report an error.

mod bits;
mod lamp;
mod means;

use crate::error::{Error, Result};
use crate::gpu::Device;
use crate::input::experiment::Experiment;
use crate::input::resolve::resolve;
use crate::scene::Scene;
use crate::settings::{Estimator, Sampling, Settings};

/// What a check found. The texts are clauses for one line of output.
#[derive(Debug)]
pub enum Verdict {
    Right(String),
    /// The image is wrong: what was expected and what was found.
    Wrong(String),
    /// There is no image.
    Failed(Error),
}

/// A check that was done.
#[derive(Debug)]
pub struct Outcome {
    pub name: String,
    pub verdict: Verdict,
}

/// How a scene is rendered.
#[derive(Clone, Copy)]
struct Method {
    estimator: Estimator,
    sampling: Sampling,
}

impl Method {
    /// Every estimator, sampling uniformly and adaptively.
    fn all() -> impl Iterator<Item = Method> {
        Estimator::ALL
            .into_iter()
            .flat_map(|estimator| Sampling::ALL.into_iter().map(move |sampling| Method { estimator, sampling }))
    }

    /// Settings of a small render; `keys` are further lines of an experiment's `[render]`.
    fn settings(self, scene: &Scene, keys: &str) -> Result<Settings> {
        let Method { estimator, sampling } = self;
        let text = format!("[render]\nestimator = '{estimator}'\nsampling = '{sampling}'\n{keys}\n");
        let experiment = Experiment::parse(&text).expect("the experiment is well-formed");
        Ok(resolve(&experiment, scene)?.settings)
    }
}

/// Runs all checks on a device; calls `visit` with each of them as soon as it is done.
pub fn check(device: &Device, visit: &mut dyn FnMut(Outcome)) {
    let cases = means::cases();
    for method in Method::all() {
        let mut done = |what: &str, verdict: Result<Verdict>| {
            let name = format!("{}, {}, {what}", method.estimator, method.sampling);
            visit(Outcome { name, verdict: verdict.unwrap_or_else(Verdict::Failed) });
        };
        done("a lamp seen directly", lamp::check(device, method, lamp::RADIANCE));
        for case in cases.iter().filter(|case| case.is_for(method.estimator)) {
            case.check(device, method, &mut done);
        }
        done("bits with other tiles and workgroups", bits::check(device, method));
    }
}

#[cfg(test)]
mod tests;

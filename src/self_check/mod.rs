//! Checks of a device that may be untested so far: `taugate devices --check`. Each check renders a small scene whose image is
//! known.
//!
//! Every estimator renders every scene whose light it finds in a short time, with uniform and with adaptive sampling. So the
//! checks find a driver that miscompiles a kernel, even if the driver reports no error.

mod bits;
pub mod fog;
mod lamp;
mod means;
pub mod sphere;

use crate::error::{Error, Result};
use crate::gpu::{Device, RaySupport};
use crate::input::experiment::Experiment;
use crate::input::resolve::resolve;
use crate::scene::Scene;
use crate::settings::{Estimator, Rays, Sampling, Settings};

/// Result of a check. Each text is a clause for one line of output.
#[derive(Debug)]
pub enum Verdict {
    Right(String),
    /// The image is wrong. The text gives the expected and the actual values.
    Wrong(String),
    /// The render failed, so there is no image.
    Failed(Error),
}

/// A finished check: its name, and its result.
#[derive(Debug)]
pub struct Outcome {
    pub name: String,
    pub verdict: Verdict,
}

/// An estimator with a sampling mode, and what traces its rays.
#[derive(Clone, Copy)]
struct Method {
    estimator: Estimator,
    sampling: Sampling,
    rays: Rays,
}

impl Method {
    /// Every estimator with every sampling mode. With `ray_queries`, also every estimator with rays by them, in one sampling mode.
    fn all(ray_queries: bool) -> impl Iterator<Item = Method> {
        let of = |estimator| Sampling::ALL.map(|sampling| Method { estimator, sampling, rays: Rays::Software });
        let again = |estimator| Method { estimator, sampling: Sampling::Uniform, rays: Rays::Hardware };
        let queried = Estimator::ALL.into_iter().filter(move |_| ray_queries).map(again);
        Estimator::ALL.into_iter().flat_map(of).chain(queried)
    }

    fn name(self) -> String {
        let by = if self.rays == Rays::Hardware { ", ray queries" } else { "" };
        format!("{}, {}{by}", self.estimator, self.sampling)
    }

    /// Settings of a small render. `keys` are additional lines for the table `[render]` of the experiment.
    fn settings(self, scene: &Scene, keys: &str) -> Result<Settings> {
        let Method { estimator, sampling, rays } = self;
        let text = format!("[render]\nestimator = '{estimator}'\nsampling = '{sampling}'\nrays = '{rays}'\n{keys}\n");
        let experiment = Experiment::parse(&text).expect("the experiment is well-formed");
        Ok(resolve(&experiment, scene)?.settings)
    }
}

/// Runs all checks on `device`, and calls `visit` after each check.
pub fn check(device: &Device, visit: &mut dyn FnMut(Outcome)) {
    let cases = means::cases();
    // A software driver would take minutes, and nobody renders with its ray queries.
    let ray_queries = device.info().quirks.rays == RaySupport::Hardware;
    Method::all(ray_queries).for_each(|method| check_method(device, method, &cases, visit));
}

fn check_method(device: &Device, method: Method, cases: &[means::Case], visit: &mut dyn FnMut(Outcome)) {
    let mut done = |what: &str, verdict: Result<Verdict>| {
        let name = format!("{}, {what}", method.name());
        visit(Outcome { name, verdict: verdict.unwrap_or_else(Verdict::Failed) });
    };
    done("a lamp seen directly", lamp::check(device, method, lamp::RADIANCE));
    for case in cases.iter().filter(|case| case.is_for(method.estimator)) {
        case.check(device, method, &mut done);
    }
    done("bits with other tiles and workgroups", bits::check(device, method));
}

#[cfg(test)]
mod tests;

//! The kernels of the sensor subpaths and their descriptor sets.

use std::sync::Arc;

use super::buffers::Buffers;
use crate::error::Result;
use crate::estimators::Ellipsoids;
use crate::gpu::{Bindings, Buffer, Device, Kernel};
use crate::render::compaction::{Compaction, CompactionBindings};
use crate::render::plan::Plan;
use crate::render::pool::DevicePool;

/// The compiled kernels. They do not depend on any buffer.
pub struct Kernels {
    pub list_samples: Kernel,
    pub start: Kernel,
    pub trace: Kernel,
    pub compaction: Arc<Compaction>,
    /// The kernel of the estimator, and its name.
    pub query: Kernel,
    pub query_name: &'static str,
    /// Only if the estimator forms ellipsoidal connections.
    pub ellipsoids: Option<Kernel>,
    pub connect: Kernel,
    /// Only if the render merges.
    pub merge: Option<Kernel>,
    pub gather: Kernel,
    pub resolve: Kernel,
}

/// Descriptor sets for one pool. Of two sets, `[0]` is for even and `[1]` for odd bounces.
pub struct SensorBindings {
    pub list_samples: Bindings,
    pub start: Bindings,
    pub trace: [Bindings; 2],
    pub compact_paths: [CompactionBindings; 2],
    pub query: Bindings,
    pub compact_candidates: CompactionBindings,
    pub ellipsoids: Option<Bindings>,
    pub connect: Bindings,
    pub merge: Option<Bindings>,
    pub gather: Bindings,
    pub resolve: Bindings,
}

/// File of the kernel that draws auxiliary vertices, if the estimator forms ellipsoidal connections.
pub fn ellipsoid_file(plan: &Plan) -> Option<&'static str> {
    match plan.estimator.ellipsoids {
        Ellipsoids::None => None,
        Ellipsoids::Enumerated => Some("ellipsoid_triangles"),
        Ellipsoids::Resampled => Some("ellipsoid_resample"),
    }
}

impl Kernels {
    pub fn new(device: &Device, plan: &Plan, compaction: Arc<Compaction>) -> Result<Kernels> {
        let constants = plan.constants();
        let make = |file: &'static str| Kernel::new(device, file, file, &constants);
        Ok(Kernels {
            list_samples: make("list_samples")?,
            start: make("sensor_start")?,
            trace: make("sensor_trace")?,
            compaction,
            query: make(plan.estimator.query_kernel)?,
            query_name: plan.estimator.query_kernel,
            ellipsoids: ellipsoid_file(plan).map(make).transpose()?,
            connect: make("connect")?,
            merge: plan.merging.is_some().then(|| make("merge")).transpose()?,
            gather: make("gather")?,
            resolve: make("resolve")?,
        })
    }

    /// Creates the descriptor sets over the buffers of the scene (group 0), a pool and the buffers of a tracer.
    pub fn bind(&self, b: &Buffers, scene: &[(&str, &Buffer)], pool: &DevicePool) -> Result<SensorBindings> {
        let k = self;
        let shared = || [scene, &pool.bindings(), &b.bindings()].concat();
        let living = |parity: usize| {
            let mut all = shared();
            all.extend([("list", &b.living[parity]), ("source", &b.living[parity])]);
            all.extend([("list_a", &b.living[1 - parity]), ("list_b", &b.shade_list)]);
            all
        };
        let candidates = || {
            let mut all = shared();
            all.extend([("source", &b.shade_list), ("list_a", &b.slot_list), ("list_b", &b.shade_list)]);
            all
        };
        let shade = || {
            let mut all = shared();
            all.push(("list", &b.shade_list));
            all
        };
        Ok(SensorBindings {
            list_samples: k.list_samples.bind(&shared())?,
            start: k.start.bind(&living(0))?,
            trace: [k.trace.bind(&living(0))?, k.trace.bind(&living(1))?],
            compact_paths: [k.compaction.bind(&living(0))?, k.compaction.bind(&living(1))?],
            query: k.query.bind(&shade())?,
            compact_candidates: k.compaction.bind(&candidates())?,
            ellipsoids: k.ellipsoids.as_ref().map(|kernel| kernel.bind(&shade())).transpose()?,
            connect: k.connect.bind(&shade())?,
            merge: k.merge.as_ref().map(|kernel| kernel.bind(&shade())).transpose()?,
            gather: k.gather.bind(&shade())?,
            resolve: k.resolve.bind(&shared())?,
        })
    }
}

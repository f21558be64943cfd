//! Kernels: compiled entry points. A kernel has a variant for every set of arrays that are too large for texel buffers.

use std::sync::{Arc, Mutex, PoisonError};

use super::bindings::{Bindings, DescriptorSets};
use super::bounds;
use super::buffer::Buffer;
use super::compiling::Compiling;
use super::device::Device;
use super::pipeline::Pipeline;
use super::shader::Source;
use crate::error::Result;

/// A compiled entry point. A device keeps the kernels that it compiled last, so a second kernel of the same source and constants
/// costs nothing.
pub struct Kernel {
    device: Device,
    compiled: Arc<Compiled>,
}

/// The pipelines of a kernel. They do not refer to the [`Device`], which keeps them.
struct Compiled {
    /// The pipeline that reads every array of texels from a texel buffer.
    usual: Arc<Pipeline>,
    /// Pipelines that read some arrays of texels from storage buffers, because the arrays are too large for texel buffers.
    variants: Mutex<Vec<Arc<Pipeline>>>,
}

/// Maximum number of kernels that a device keeps. A renderer has at most 23.
const MAX_KEPT: usize = 128;

/// The kernels that a device compiled last; the most recently used one is at the end.
#[derive(Default)]
pub(super) struct KernelCache {
    kept: Vec<Arc<Compiled>>,
}

impl KernelCache {
    /// The kernel made from `source`, if it is kept.
    fn find(&mut self, source: &Source) -> Option<Arc<Compiled>> {
        let at = self.kept.iter().position(|kernel| *kernel.usual.source == *source)?;
        let found = self.kept.remove(at);
        self.kept.push(found.clone());
        Some(found)
    }

    fn keep(&mut self, kernel: Arc<Compiled>) {
        if self.kept.len() == MAX_KEPT {
            self.kept.remove(0);
        }
        self.kept.push(kernel);
    }
}

impl Device {
    /// Whether the device keeps kernels for later use. It keeps none that check their indices.
    pub fn keeps_kernels(&self) -> bool {
        !bounds::checked()
    }

    /// Number of compiled kernels that the device keeps.
    #[cfg(test)]
    pub fn kernels_kept(&self) -> usize {
        self.kernels.lock().unwrap_or_else(PoisonError::into_inner).kept.len()
    }
}

impl Kernel {
    /// Compiles entry point `entry` of `shaders/<file>.wgsl`. `constants` are values of override constants; a constant that the
    /// file does not declare is ignored. Fails if the source is wrong or the driver cannot compile it.
    pub fn new(device: &Device, file: &'static str, entry: &str, constants: &[(&str, f64)]) -> Result<Kernel> {
        Kernel::compile(device, Source::of_file(file, entry, constants)?)
    }

    /// As [`Kernel::new`], from a text that may import modules of `shaders/`. `path` is the name of the text in messages.
    pub fn from_source(
        device: &Device,
        path: &'static str,
        text: &str,
        entry: &str,
        constants: &[(&str, f64)],
    ) -> Result<Kernel> {
        Kernel::compile(device, Source::new(path, text, entry, constants))
    }

    fn compile(device: &Device, source: Source) -> Result<Kernel> {
        let quirks = device.info().quirks.constants();
        let source = quirks.into_iter().fold(source, |source, (name, value)| source.with_default(name, value));
        let cache = || device.kernels.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = cache().find(&source);
        let compiled = match kept {
            Some(kept) => kept,
            None => {
                let _compiling = Compiling::begin();
                let usual = Pipeline::new(device, Arc::new(source), vec![])?;
                let is_kept = usual.violation.is_none();
                let compiled = Arc::new(Compiled { usual: Arc::new(usual), variants: Mutex::default() });
                // A kernel with index checks has a buffer, and a buffer keeps its device open.
                if is_kept {
                    cache().keep(compiled.clone());
                }
                compiled
            }
        };
        Ok(Kernel { device: device.clone(), compiled })
    }

    /// Minimum number of workgroups for `threads` threads.
    pub fn groups(&self, threads: usize) -> u32 {
        (threads as u32).div_ceil(self.compiled.usual.workgroup)
    }

    /// Binds the buffers that the kernel uses, by name. `buffers` may hold more buffers; a missing name is an error. If a buffer
    /// is larger than the device's maximum for texel buffers, a variant of the kernel reads it as a storage buffer.
    pub fn bind(&self, buffers: &[(&str, &Buffer)]) -> Result<Bindings> {
        let pipeline = self.variant_for(buffers)?;
        Ok(Bindings { bound: Arc::new(DescriptorSets::new(&pipeline, buffers)?) })
    }

    fn variant_for(&self, buffers: &[(&str, &Buffer)]) -> Result<Arc<Pipeline>> {
        let largest = self.device.info().largest_texel_buffer();
        let is_too_large = |name: &str| buffers.iter().any(|(n, buffer)| *n == name && buffer.size() > largest);
        let texels = self.compiled.usual.bindings.iter().filter(|b| b.texels && is_too_large(&b.name));
        let storage: Vec<String> = texels.map(|b| b.name.clone()).collect();
        if storage.is_empty() {
            return Ok(self.compiled.usual.clone());
        }
        let mut variants = self.compiled.variants.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(variant) = variants.iter().find(|v| v.storage == storage) {
            return Ok(variant.clone());
        }
        let variant = Arc::new(Pipeline::new(&self.device, self.compiled.usual.source.clone(), storage)?);
        variants.push(variant.clone());
        Ok(variant)
    }

    /// Whether `bound` was made by this kernel.
    pub(super) fn is_bound_by(&self, bound: &DescriptorSets) -> bool {
        Arc::ptr_eq(&self.compiled.usual.source, &bound.pipeline.source)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "override FACTOR: u32 = 2u;
@group(0) @binding(0) var<storage, read_write> word: u32;
@compute @workgroup_size(1)
fn scale() {
    word *= FACTOR;
}
";

    fn kernel(device: &Device, factor: f64) -> Kernel {
        Kernel::from_source(device, "test", TEXT, "scale", &[("FACTOR", factor)]).unwrap()
    }

    #[test]
    fn a_device_keeps_the_kernels_used_last() {
        let device = Device::open(None).expect("this test needs a Vulkan device: run ./setup.sh");
        let first = kernel(&device, 3.0);
        let same = |other: &Kernel| Arc::ptr_eq(&first.compiled, &other.compiled);
        assert!(same(&kernel(&device, 3.0)));
        assert!(!same(&kernel(&device, 4.0)), "another constant is another kernel");
        for factor in 0..MAX_KEPT {
            kernel(&device, 10.0 + factor as f64);
        }
        assert_eq!(device.kernels.lock().unwrap().kept.len(), MAX_KEPT);
        assert!(!same(&kernel(&device, 3.0)), "the device has dropped it");
    }

    #[test]
    fn kept_kernels_do_not_keep_the_device_open() {
        let device = Device::open(None).expect("this test needs a Vulkan device: run ./setup.sh");
        let shared = Arc::downgrade(&device.shared);
        drop(kernel(&device, 3.0));
        drop(device);
        assert!(shared.upgrade().is_none());
    }
}

//! Kernels: compiled entry points. A kernel has a variant for every set of arrays that are too large for texel buffers.

use std::sync::{Arc, Mutex, PoisonError};

use super::bindings::{Bindings, DescriptorSets};
use super::buffer::Buffer;
use super::device::Device;
use super::pipeline::Pipeline;
use super::shader::Source;
use crate::error::Result;

/// A compiled entry point.
pub struct Kernel {
    /// The pipeline that reads every array of texels from a texel buffer.
    usual: Arc<Pipeline>,
    /// Pipelines that read some arrays of texels from storage buffers, because the arrays are too large for texel buffers.
    variants: Mutex<Vec<Arc<Pipeline>>>,
}

impl Kernel {
    /// Compiles entry point `entry` of `shaders/<file>.wgsl`. `constants` are values of override constants; those that the file
    /// does not declare are ignored. Fails if the source is wrong or the driver cannot compile it.
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
        let usual = Pipeline::new(device, Arc::new(source), vec![])?;
        Ok(Kernel { usual: Arc::new(usual), variants: Mutex::default() })
    }

    /// Minimum number of workgroups for `threads` threads.
    pub fn groups(&self, threads: usize) -> u32 {
        (threads as u32).div_ceil(self.usual.workgroup)
    }

    /// Binds the buffers that the kernel uses, by name. `buffers` may hold more buffers; a missing name is an error. If a buffer
    /// is larger than the device's maximum for texel buffers, a variant of the kernel reads it as a storage buffer.
    pub fn bind(&self, buffers: &[(&str, &Buffer)]) -> Result<Bindings> {
        let pipeline = self.variant_for(buffers)?;
        Ok(Bindings { bound: Arc::new(DescriptorSets::new(&pipeline, buffers)?) })
    }

    fn variant_for(&self, buffers: &[(&str, &Buffer)]) -> Result<Arc<Pipeline>> {
        let largest = self.usual.device.info().largest_texel_buffer();
        let is_too_large = |name: &str| buffers.iter().any(|(n, buffer)| *n == name && buffer.size() > largest);
        let texels = self.usual.bindings.iter().filter(|b| b.texels && is_too_large(&b.name));
        let storage: Vec<String> = texels.map(|b| b.name.clone()).collect();
        if storage.is_empty() {
            return Ok(self.usual.clone());
        }
        let mut variants = self.variants.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(variant) = variants.iter().find(|v| v.storage == storage) {
            return Ok(variant.clone());
        }
        let variant = Arc::new(Pipeline::new(&self.usual.device, self.usual.source.clone(), storage)?);
        variants.push(variant.clone());
        Ok(variant)
    }

    /// Whether `bound` was made by this kernel.
    pub(super) fn is_bound_by(&self, bound: &DescriptorSets) -> bool {
        Arc::ptr_eq(&self.usual.source, &bound.pipeline.source)
    }
}

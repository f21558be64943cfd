//! Compute pipelines.

use std::ffi::CString;
use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;

use super::bindings::{Bindings, Bound};
use super::bounds;
use super::buffer::Buffer;
use super::device::Device;
use super::shader::{self, Binding, Source};
use crate::error::{Error, Result};

/// A compiled entry point.
pub struct Kernel {
    /// With a texel buffer for every array that is read as texels.
    usual: Arc<Pipeline>,
    /// With storage buffers for arrays that were too large.
    variants: Mutex<Vec<Arc<Pipeline>>>,
}

/// The Vulkan objects of a kernel, which its bindings keep alive.
pub(super) struct Pipeline {
    pub device: Device,
    pub source: Arc<Source>,
    /// Arrays that are read as texels and bound as storage buffers.
    storage: Vec<String>,
    pub handle: vk::Pipeline,
    pub layout: vk::PipelineLayout,
    pub sets: Vec<vk::DescriptorSetLayout>,
    pub bindings: Vec<Binding>,
    pub constants_size: u32,
    workgroup: u32,
    /// With index checks: the word the kernel writes when one fails, and what its numbers stand for.
    pub violation: Option<(Buffer, Vec<String>)>,
}

impl Kernel {
    /// Compiles `entry` of `shaders/<file>.wgsl`. Override constants the file does not have are left out.
    pub fn new(device: &Device, file: &'static str, entry: &str, constants: &[(&str, f64)]) -> Result<Kernel> {
        Kernel::compile(device, Source::of_file(file, entry, constants)?)
    }

    /// As [`Kernel::new`], from a text that imports modules of `shaders/`; `path` stands for it in messages.
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

    /// Workgroups that give every one of `threads` threads a place.
    pub fn groups(&self, threads: usize) -> u32 {
        (threads as u32).div_ceil(self.usual.workgroup)
    }

    /// Binds every buffer the kernel uses. `buffers` may hold more than that; a name that is missing is an error. Where a buffer
    /// is larger than the device's texel buffers may be, a variant of the kernel reads it as a storage buffer.
    pub fn bind(&self, buffers: &[(&str, &Buffer)]) -> Result<Bindings> {
        let pipeline = self.variant_for(buffers)?;
        Ok(Bindings { bound: Arc::new(Bound::new(&pipeline, buffers)?) })
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

    /// Whether the bindings belong to this kernel.
    pub(super) fn is_bound_by(&self, bound: &Bound) -> bool {
        Arc::ptr_eq(&self.usual.source, &bound.pipeline.source)
    }
}

impl Pipeline {
    fn new(device: &Device, source: Arc<Source>, storage: Vec<String>) -> Result<Pipeline> {
        let compiled = shader::compile(&source, &storage)?;
        let shared = &device.shared;
        let groups = compiled.bindings.iter().map(|b| b.group + 1).max().unwrap_or(0);
        let violation = match compiled.places.is_empty() {
            true => None,
            false => Some((Buffer::from_slice(device, bounds::VIOLATION, &[0u32; 4], "")?, compiled.places)),
        };
        let entry_name = CString::new(&*source.entry).map_err(|e| Error::Shader(e.to_string()))?;
        // From here on `drop` destroys what exists; Vulkan ignores null handles.
        let mut new = Pipeline {
            device: device.clone(),
            source,
            storage,
            handle: vk::Pipeline::null(),
            layout: vk::PipelineLayout::null(),
            sets: vec![],
            bindings: compiled.bindings,
            constants_size: compiled.constants_size,
            workgroup: compiled.workgroup,
            violation,
        };
        // SAFETY: structures outlive the calls; the module is destroyed after the pipeline was made from it.
        unsafe {
            for group in 0..groups {
                let of_group: Vec<_> = new
                    .bindings
                    .iter()
                    .filter(|b| b.group == group)
                    .map(|b| {
                        vk::DescriptorSetLayoutBinding::default()
                            .binding(b.binding)
                            .descriptor_type(b.descriptor_type())
                            .descriptor_count(1)
                            .stage_flags(vk::ShaderStageFlags::COMPUTE)
                    })
                    .collect();
                let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&of_group);
                let set = shared.device.create_descriptor_set_layout(&info, None);
                new.sets.push(set.map_err(|e| shared.error("creating a descriptor layout", e))?);
            }
            let range = [vk::PushConstantRange {
                stage_flags: vk::ShaderStageFlags::COMPUTE,
                offset: 0,
                size: new.constants_size,
            }];
            let mut info = vk::PipelineLayoutCreateInfo::default().set_layouts(&new.sets);
            if new.constants_size > 0 {
                info = info.push_constant_ranges(&range);
            }
            new.layout = shared
                .device
                .create_pipeline_layout(&info, None)
                .map_err(|e| shared.error("creating a pipeline layout", e))?;
            let module = shared
                .device
                .create_shader_module(&vk::ShaderModuleCreateInfo::default().code(&compiled.words), None)
                .map_err(|e| shared.error("loading a kernel", e))?;
            let stage = vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(module)
                .name(&entry_name);
            let create = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(new.layout)];
            let pipelines = shared.device.create_compute_pipelines(shared.cache, &create, None);
            shared.device.destroy_shader_module(module, None);
            new.handle = pipelines.map_err(|(_, e)| shared.error("compiling a kernel", e))?[0];
        }
        Ok(new)
    }

    /// Ends the process, as a message of the validation layers does, if the kernel found an index out of range.
    fn report_violation(&self) {
        let Some((word, places)) = &self.violation else { return };
        let mut number = [0u32];
        if word.read(0, &mut number).is_ok() && number[0] > 0 {
            eprintln!("kernel {}: index out of range at {}", self.source.entry, places[number[0] as usize - 1]);
            std::process::abort();
        }
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        self.report_violation();
        let d = &self.device.shared.device;
        // SAFETY: recorders hold what they use until the device is done with it, so nothing uses the pipeline any more.
        unsafe {
            d.destroy_pipeline(self.handle, None);
            d.destroy_pipeline_layout(self.layout, None);
            for &set in &self.sets {
                d.destroy_descriptor_set_layout(set, None);
            }
        }
    }
}

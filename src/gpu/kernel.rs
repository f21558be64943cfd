//! Compute pipelines and their bindings, by name.

use std::ffi::CString;

use ash::vk;

use super::bounds;
use super::buffer::Buffer;
use super::device::Device;
use super::shader::{self, Binding, Compiled};
use crate::error::{Error, Result};

/// A compiled entry point.
pub struct Kernel {
    device: Device,
    pub(super) pipeline: vk::Pipeline,
    pub(super) layout: vk::PipelineLayout,
    sets: Vec<vk::DescriptorSetLayout>,
    bindings: Vec<Binding>,
    pub(super) constants_size: u32,
    workgroup: u32,
    name: String,
    /// With index checks: the word the kernel writes when one fails, and what its numbers stand for.
    violation: Option<(Buffer, Vec<String>)>,
}

/// Buffers bound to a kernel. The buffers must outlive every submit that uses this.
pub struct Bindings {
    device: Device,
    pool: vk::DescriptorPool,
    views: Vec<vk::BufferView>,
    pub(super) sets: Vec<vk::DescriptorSet>,
}

impl Kernel {
    /// Compiles `entry` of `shaders/<file>.wgsl`. Override constants the file does not have are left out.
    pub fn new(device: &Device, file: &'static str, entry: &str, constants: &[(&str, f64)]) -> Result<Kernel> {
        Kernel::from_compiled(device, shader::compile(file, entry, constants)?, entry)
    }

    /// As [`Kernel::new`], from a text that imports modules of `shaders/`; `path` stands for it in messages.
    pub fn from_source(
        device: &Device,
        path: &'static str,
        text: &str,
        entry: &str,
        constants: &[(&str, f64)],
    ) -> Result<Kernel> {
        Kernel::from_compiled(device, shader::compile_source(path, text, entry, constants)?, entry)
    }

    fn from_compiled(device: &Device, compiled: Compiled, entry: &str) -> Result<Kernel> {
        let shared = &device.shared;
        let groups = compiled.bindings.iter().map(|b| b.group + 1).max().unwrap_or(0);
        let violation = match compiled.places.is_empty() {
            true => None,
            false => Some((Buffer::from_slice(device, bounds::VIOLATION, &[0u32; 4], "")?, compiled.places)),
        };
        // SAFETY: structures outlive the calls; the module is destroyed after the pipeline was made from it; on an error
        // `kernel` destroys what exists so far.
        unsafe {
            let mut kernel = Kernel {
                device: device.clone(),
                pipeline: vk::Pipeline::null(),
                layout: vk::PipelineLayout::null(),
                sets: vec![],
                bindings: compiled.bindings,
                constants_size: compiled.constants_size,
                workgroup: compiled.workgroup,
                name: entry.to_string(),
                violation,
            };
            for group in 0..groups {
                let of_group: Vec<_> = kernel
                    .bindings
                    .iter()
                    .filter(|b| b.group == group)
                    .map(|b| {
                        vk::DescriptorSetLayoutBinding::default()
                            .binding(b.binding)
                            .descriptor_type(descriptor_type(b))
                            .descriptor_count(1)
                            .stage_flags(vk::ShaderStageFlags::COMPUTE)
                    })
                    .collect();
                let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&of_group);
                let set = shared.device.create_descriptor_set_layout(&info, None);
                kernel.sets.push(set.map_err(|e| shared.error("creating a descriptor layout", e))?);
            }
            let range = [vk::PushConstantRange {
                stage_flags: vk::ShaderStageFlags::COMPUTE,
                offset: 0,
                size: kernel.constants_size,
            }];
            let mut info = vk::PipelineLayoutCreateInfo::default().set_layouts(&kernel.sets);
            if kernel.constants_size > 0 {
                info = info.push_constant_ranges(&range);
            }
            kernel.layout = shared
                .device
                .create_pipeline_layout(&info, None)
                .map_err(|e| shared.error("creating a pipeline layout", e))?;
            let module = shared
                .device
                .create_shader_module(&vk::ShaderModuleCreateInfo::default().code(&compiled.words), None)
                .map_err(|e| shared.error("loading a kernel", e))?;
            let entry_name = CString::new(entry).map_err(|_| Error::Shader(format!("entry point {entry:?}")))?;
            let stage = vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(module)
                .name(&entry_name);
            let create = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(kernel.layout)];
            let pipelines = shared.device.create_compute_pipelines(shared.cache, &create, None);
            shared.device.destroy_shader_module(module, None);
            kernel.pipeline = pipelines.map_err(|(_, e)| shared.error("compiling a kernel", e))?[0];
            Ok(kernel)
        }
    }

    /// Workgroups that give every one of `threads` threads a place.
    pub fn groups(&self, threads: usize) -> u32 {
        (threads as u32).div_ceil(self.workgroup)
    }

    /// Binds every buffer the kernel uses. `buffers` may hold more than that; a name that is missing is an error.
    pub fn bind(&self, buffers: &[(&str, &Buffer)]) -> Result<Bindings> {
        let shared = &self.device.shared;
        let count = self.bindings.len().max(1) as u32;
        let sizes = [vk::DescriptorType::STORAGE_BUFFER, vk::DescriptorType::UNIFORM_TEXEL_BUFFER]
            .map(|ty| vk::DescriptorPoolSize { ty, descriptor_count: count });
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(self.sets.len().max(1) as u32).pool_sizes(&sizes);
        // SAFETY: sets are written before they are used; the pool is destroyed with `Bindings`.
        unsafe {
            let pool = shared
                .device
                .create_descriptor_pool(&info, None)
                .map_err(|e| shared.error("creating a descriptor pool", e))?;
            let mut bound = Bindings { device: self.device.clone(), pool, views: vec![], sets: vec![] };
            if self.sets.is_empty() {
                return Ok(bound);
            }
            let allocate = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&self.sets);
            bound.sets = shared
                .device
                .allocate_descriptor_sets(&allocate)
                .map_err(|e| shared.error("allocating descriptors", e))?;
            for binding in &self.bindings {
                let own = self.violation.as_ref().map(|(buffer, _)| (bounds::VIOLATION, buffer));
                let mut all = buffers.iter().copied().chain(own);
                let (_, buffer) = all.find(|(name, _)| *name == binding.name).ok_or_else(|| {
                    Error::Shader(format!("kernel {} needs a buffer named {}", self.name, binding.name))
                })?;
                bound.write(binding, buffer)?;
            }
            Ok(bound)
        }
    }
}

fn descriptor_type(binding: &Binding) -> vk::DescriptorType {
    if binding.texels { vk::DescriptorType::UNIFORM_TEXEL_BUFFER } else { vk::DescriptorType::STORAGE_BUFFER }
}

impl Bindings {
    fn write(&mut self, binding: &Binding, buffer: &Buffer) -> Result<()> {
        let shared = &self.device.shared;
        let write = vk::WriteDescriptorSet::default()
            .dst_set(self.sets[binding.group as usize])
            .dst_binding(binding.binding)
            .descriptor_type(descriptor_type(binding));
        let range = [vk::DescriptorBufferInfo { buffer: buffer.handle, offset: 0, range: vk::WHOLE_SIZE }];
        // SAFETY: the sets are not in use yet; the view lives as long as the sets.
        unsafe {
            if binding.texels {
                let info = vk::BufferViewCreateInfo::default()
                    .buffer(buffer.handle)
                    .format(vk::Format::R32G32B32A32_UINT)
                    .range(vk::WHOLE_SIZE);
                let view = shared.device.create_buffer_view(&info, None);
                let view = [view.map_err(|e| shared.error("creating a view of a buffer", e))?];
                self.views.extend(view);
                shared.device.update_descriptor_sets(&[write.texel_buffer_view(&view)], &[]);
            } else {
                shared.device.update_descriptor_sets(&[write.buffer_info(&range)], &[]);
            }
        }
        Ok(())
    }
}

impl Kernel {
    /// Ends the process, as a message of the validation layers does, if the kernel found an index out of range.
    fn report_violation(&self) {
        let Some((word, places)) = &self.violation else { return };
        let mut number = [0u32];
        if word.read(0, &mut number).is_ok() && number[0] > 0 {
            eprintln!("kernel {}: index out of range at {}", self.name, places[number[0] as usize - 1]);
            std::process::abort();
        }
    }
}

impl Drop for Kernel {
    fn drop(&mut self) {
        self.report_violation();
        let d = &self.device.shared.device;
        // SAFETY: recorders wait for their submits, so no command buffer uses the pipeline any more.
        unsafe {
            d.destroy_pipeline(self.pipeline, None);
            d.destroy_pipeline_layout(self.layout, None);
            for &set in &self.sets {
                d.destroy_descriptor_set_layout(set, None);
            }
        }
    }
}

impl Drop for Bindings {
    fn drop(&mut self) {
        let d = &self.device.shared.device;
        // SAFETY: as above.
        unsafe {
            d.destroy_descriptor_pool(self.pool, None);
            for &view in &self.views {
                d.destroy_buffer_view(view, None);
            }
        }
    }
}

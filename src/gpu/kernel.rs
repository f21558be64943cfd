//! Compute pipelines and their bindings, by name.

use std::ffi::CString;
use std::sync::Arc;

use ash::vk;

use super::allocation::Allocation;
use super::bounds;
use super::buffer::Buffer;
use super::device::Device;
use super::shader::{self, Binding, Compiled};
use crate::error::{Error, Result};

/// A compiled entry point.
pub struct Kernel {
    pub(super) pipeline: Arc<Pipeline>,
}

/// The Vulkan objects of a kernel, which its bindings keep alive.
pub(super) struct Pipeline {
    pub device: Device,
    pub handle: vk::Pipeline,
    pub layout: vk::PipelineLayout,
    sets: Vec<vk::DescriptorSetLayout>,
    bindings: Vec<Binding>,
    pub constants_size: u32,
    workgroup: u32,
    name: String,
    /// With index checks: the word the kernel writes when one fails, and what its numbers stand for.
    violation: Option<(Buffer, Vec<String>)>,
}

/// Buffers bound to a kernel. They live as long as this does, and as a recorder that works with it.
pub struct Bindings {
    pub(super) bound: Arc<Bound>,
}

/// Descriptor sets, and what they refer to.
pub(super) struct Bound {
    pub pipeline: Arc<Pipeline>,
    pool: vk::DescriptorPool,
    views: Vec<vk::BufferView>,
    pub sets: Vec<vk::DescriptorSet>,
    /// Kept alive; nobody reads it.
    _buffers: Vec<Arc<Allocation>>,
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
        Ok(Kernel { pipeline: Arc::new(Pipeline::new(device, compiled, entry)?) })
    }

    /// Workgroups that give every one of `threads` threads a place.
    pub fn groups(&self, threads: usize) -> u32 {
        (threads as u32).div_ceil(self.pipeline.workgroup)
    }

    /// Binds every buffer the kernel uses. `buffers` may hold more than that; a name that is missing is an error.
    pub fn bind(&self, buffers: &[(&str, &Buffer)]) -> Result<Bindings> {
        Ok(Bindings { bound: Arc::new(Bound::new(&self.pipeline, buffers)?) })
    }
}

impl Pipeline {
    fn new(device: &Device, compiled: Compiled, entry: &str) -> Result<Pipeline> {
        let shared = &device.shared;
        let groups = compiled.bindings.iter().map(|b| b.group + 1).max().unwrap_or(0);
        let violation = match compiled.places.is_empty() {
            true => None,
            false => Some((Buffer::from_slice(device, bounds::VIOLATION, &[0u32; 4], "")?, compiled.places)),
        };
        let entry_name = CString::new(entry).map_err(|_| Error::Shader(format!("entry point {entry:?}")))?;
        // From here on `drop` destroys what exists; Vulkan ignores null handles.
        let mut new = Pipeline {
            device: device.clone(),
            handle: vk::Pipeline::null(),
            layout: vk::PipelineLayout::null(),
            sets: vec![],
            bindings: compiled.bindings,
            constants_size: compiled.constants_size,
            workgroup: compiled.workgroup,
            name: entry.to_string(),
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
                            .descriptor_type(descriptor_type(b))
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
            eprintln!("kernel {}: index out of range at {}", self.name, places[number[0] as usize - 1]);
            std::process::abort();
        }
    }
}

fn descriptor_type(binding: &Binding) -> vk::DescriptorType {
    if binding.texels { vk::DescriptorType::UNIFORM_TEXEL_BUFFER } else { vk::DescriptorType::STORAGE_BUFFER }
}

impl Bound {
    fn new(pipeline: &Arc<Pipeline>, buffers: &[(&str, &Buffer)]) -> Result<Bound> {
        let shared = &pipeline.device.shared;
        let count = pipeline.bindings.len().max(1) as u32;
        let sizes = [vk::DescriptorType::STORAGE_BUFFER, vk::DescriptorType::UNIFORM_TEXEL_BUFFER]
            .map(|ty| vk::DescriptorPoolSize { ty, descriptor_count: count });
        let sets = pipeline.sets.len().max(1) as u32;
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(sets).pool_sizes(&sizes);
        // From here on `drop` destroys what exists; Vulkan ignores null handles.
        let mut bound = Bound {
            pipeline: pipeline.clone(),
            pool: vk::DescriptorPool::null(),
            views: vec![],
            sets: vec![],
            _buffers: vec![],
        };
        // SAFETY: structures outlive the calls; the pool frees its sets when it is destroyed.
        unsafe {
            bound.pool = shared
                .device
                .create_descriptor_pool(&info, None)
                .map_err(|e| shared.error("creating a descriptor pool", e))?;
            if pipeline.sets.is_empty() {
                return Ok(bound);
            }
            let allocate =
                vk::DescriptorSetAllocateInfo::default().descriptor_pool(bound.pool).set_layouts(&pipeline.sets);
            bound.sets = shared
                .device
                .allocate_descriptor_sets(&allocate)
                .map_err(|e| shared.error("allocating descriptors", e))?;
        }
        for binding in &pipeline.bindings {
            let own = pipeline.violation.as_ref().map(|(buffer, _)| (bounds::VIOLATION, buffer));
            let mut all = buffers.iter().copied().chain(own);
            let (_, buffer) = all.find(|(name, _)| *name == binding.name).ok_or_else(|| {
                Error::Shader(format!("kernel {} needs a buffer named {}", pipeline.name, binding.name))
            })?;
            bound.write(binding, &buffer.allocation)?;
        }
        Ok(bound)
    }

    fn write(&mut self, binding: &Binding, buffer: &Arc<Allocation>) -> Result<()> {
        let shared = &self.pipeline.device.shared;
        assert!(Arc::ptr_eq(shared, &buffer.shared), "{}: a buffer of another device", binding.name);
        let write = vk::WriteDescriptorSet::default()
            .dst_set(self.sets[binding.group as usize])
            .dst_binding(binding.binding)
            .descriptor_type(descriptor_type(binding));
        let range = [vk::DescriptorBufferInfo { buffer: buffer.handle, offset: 0, range: vk::WHOLE_SIZE }];
        // SAFETY: the sets are not in use yet; the view and the buffer live as long as the sets.
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
        self._buffers.push(buffer.clone());
        Ok(())
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

impl Drop for Bound {
    fn drop(&mut self) {
        let d = &self.pipeline.device.shared.device;
        // SAFETY: as above; the buffers go after the views.
        unsafe {
            d.destroy_descriptor_pool(self.pool, None);
            for &view in &self.views {
                d.destroy_buffer_view(view, None);
            }
        }
    }
}

//! Compute pipelines: the Vulkan objects behind a kernel.

use std::ffi::CString;
use std::sync::Arc;

use ash::vk;

use super::bounds;
use super::buffer::Buffer;
use super::device::Device;
use super::info::BufferCounts;
use super::shader::{self, Binding, Source};
use super::shared::Shared;
use crate::error::{Error, Result};

impl Binding {
    pub(super) fn descriptor_type(&self) -> vk::DescriptorType {
        match self {
            Binding { structure: true, .. } => vk::DescriptorType::ACCELERATION_STRUCTURE_KHR,
            Binding { texels: true, .. } => vk::DescriptorType::UNIFORM_TEXEL_BUFFER,
            _ => vk::DescriptorType::STORAGE_BUFFER,
        }
    }
}

/// The Vulkan objects of a kernel. Bindings of the kernel keep them alive.
pub(super) struct Pipeline {
    pub shared: Arc<Shared>,
    pub source: Arc<Source>,
    /// Names of the arrays of texels that this variant reads from storage buffers.
    pub storage: Vec<String>,
    pub handle: vk::Pipeline,
    pub layout: vk::PipelineLayout,
    pub sets: Vec<vk::DescriptorSetLayout>,
    pub bindings: Vec<Binding>,
    pub constants_size: u32,
    pub workgroup: u32,
    /// With index checks: the buffer to which the kernel writes the number of the place where a check failed, and a description
    /// of each place.
    pub violation: Option<(Buffer, Vec<String>)>,
}

impl Pipeline {
    pub fn new(device: &Device, source: Arc<Source>, storage: Vec<String>) -> Result<Pipeline> {
        let compiled = shader::compile(&source, &storage)?;
        let shared = &device.shared;
        let texels = compiled.bindings.iter().filter(|b| b.texels).count() as u32;
        let all = compiled.bindings.len() as u32;
        let structures = compiled.bindings.iter().filter(|b| b.structure).count() as u32;
        if !(BufferCounts { storage: all - texels - structures, texels, all }).fits(shared.info.max_buffers) {
            return Err(Error::Device(format!(
                "{} lets a kernel use too few buffers at a time; choose another device with --device",
                shared.info.name
            )));
        }
        let groups = compiled.bindings.iter().map(|b| b.group + 1).max().unwrap_or(0);
        let violation = match compiled.places.is_empty() {
            true => None,
            false => Some((Buffer::from_slice(device, bounds::VIOLATION, &[0u32; 4], "")?, compiled.places)),
        };
        let entry_name = CString::new(&*source.entry).map_err(|e| Error::Shader(e.to_string()))?;
        // From here on, `drop` destroys the objects that exist, even after an error. Vulkan ignores null handles.
        let mut new = Pipeline {
            shared: shared.clone(),
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
        // SAFETY: the structures outlive the calls. The module is destroyed after the pipeline is made from it.
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

    /// Aborts the process if the kernel found an index out of range.
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
        let d = &self.shared.device;
        // SAFETY: recorders keep the pipelines that they use alive until their submit has ended, so the device no longer uses
        // this pipeline.
        unsafe {
            d.destroy_pipeline(self.handle, None);
            d.destroy_pipeline_layout(self.layout, None);
            for &set in &self.sets {
                d.destroy_descriptor_set_layout(set, None);
            }
        }
    }
}

//! Buffers bound to a kernel, by name.

use std::sync::Arc;

use ash::vk;

use super::allocation::Allocation;
use super::bounds;
use super::buffer::Buffer;
use super::buffer_desc::mebibytes;
use super::pipeline::Pipeline;
use super::shader::Binding;
use crate::error::{Error, Result};

/// Buffers bound to a kernel. The bindings keep the buffers alive; a recorder that uses the bindings does so too, until its
/// submit has ended.
pub struct Bindings {
    pub(super) bound: Arc<DescriptorSets>,
}

/// Descriptor sets, and the objects that they refer to.
pub(super) struct DescriptorSets {
    pub pipeline: Arc<Pipeline>,
    pool: vk::DescriptorPool,
    views: Vec<vk::BufferView>,
    pub sets: Vec<vk::DescriptorSet>,
    /// The bound buffers.
    pub buffers: Vec<Arc<Allocation>>,
}

impl DescriptorSets {
    pub fn new(pipeline: &Arc<Pipeline>, buffers: &[(&str, &Buffer)]) -> Result<DescriptorSets> {
        let shared = &pipeline.shared;
        let count = pipeline.bindings.len().max(1) as u32;
        let mut types = vec![vk::DescriptorType::STORAGE_BUFFER, vk::DescriptorType::UNIFORM_TEXEL_BUFFER];
        // A device without ray queries does not know this type.
        if pipeline.bindings.iter().any(|binding| binding.structure) {
            types.push(vk::DescriptorType::ACCELERATION_STRUCTURE_KHR);
        }
        let sizes: Vec<_> =
            types.into_iter().map(|ty| vk::DescriptorPoolSize { ty, descriptor_count: count }).collect();
        let sets = pipeline.sets.len().max(1) as u32;
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(sets).pool_sizes(&sizes);
        // From here on, `drop` destroys the objects that exist, even after an error. Vulkan ignores null handles.
        let mut bound = DescriptorSets {
            pipeline: pipeline.clone(),
            pool: vk::DescriptorPool::null(),
            views: vec![],
            sets: vec![],
            buffers: vec![],
        };
        // SAFETY: the structures outlive the calls. The pool frees its sets when the pool is destroyed.
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
                Error::Shader(format!("kernel {} needs a buffer named {}", pipeline.source.entry, binding.name))
            })?;
            bound.write(binding, &buffer.allocation)?;
        }
        Ok(bound)
    }

    fn write(&mut self, binding: &Binding, buffer: &Arc<Allocation>) -> Result<()> {
        let shared = &self.pipeline.shared;
        assert!(Arc::ptr_eq(shared, &buffer.shared), "{} is a buffer of another device", binding.name);
        let limit = shared.info.max_storage_buffer_range;
        if !binding.texels && !binding.structure && buffer.size > limit {
            return Err(Error::Device(format!(
                "the {} take {}, but a storage buffer on {} has at most {}; choose another device with --device",
                binding.name,
                mebibytes(buffer.size),
                shared.info.name,
                mebibytes(limit)
            )));
        }
        let write = vk::WriteDescriptorSet::default()
            .dst_set(self.sets[binding.group as usize])
            .dst_binding(binding.binding)
            .descriptor_type(binding.descriptor_type());
        let range = [vk::DescriptorBufferInfo { buffer: buffer.handle, offset: 0, range: vk::WHOLE_SIZE }];
        // SAFETY: the sets are not in use yet. The view and the buffer live as long as the sets.
        unsafe {
            if binding.structure {
                let top = buffer.structures.last().expect("only an acceleration structure is bound as one");
                let mut structure = vk::WriteDescriptorSetAccelerationStructureKHR::default()
                    .acceleration_structures(std::slice::from_ref(top));
                let write = write.descriptor_count(1).push_next(&mut structure);
                shared.device.update_descriptor_sets(&[write], &[]);
            } else if binding.texels {
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
        self.buffers.push(buffer.clone());
        Ok(())
    }
}

impl Drop for DescriptorSets {
    fn drop(&mut self) {
        let d = &self.pipeline.shared.device;
        // SAFETY: the device no longer uses the sets: recorders keep them alive until their submit has ended. The buffers are
        // dropped after the views.
        unsafe {
            d.destroy_descriptor_pool(self.pool, None);
            for &view in &self.views {
                d.destroy_buffer_view(view, None);
            }
        }
    }
}

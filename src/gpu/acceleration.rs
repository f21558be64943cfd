//! Acceleration structures, in which the device traces rays by itself (VK_KHR_acceleration_structure, VK_KHR_ray_query).

use std::ffi::CStr;
use std::sync::Arc;

use ash::vk;

use super::allocation::Allocation;
use super::buffer::Buffer;
use super::commands::Commands;
use super::device::Device;
use super::instance::has_extension;
use super::shared::Shared;
use crate::error::{Error, Result};

/// The extensions of a device with ray queries. The last one is needed by the first one.
pub(super) const EXTENSIONS: [&CStr; 3] =
    [ash::khr::acceleration_structure::NAME, ash::khr::ray_query::NAME, ash::khr::deferred_host_operations::NAME];

/// Alignment in bytes of acceleration structures in a buffer, from the Vulkan specification.
const ALIGNMENT: u64 = 256;

/// The features that ray queries need.
pub(super) struct RayFeatures {
    addresses: vk::PhysicalDeviceBufferDeviceAddressFeatures<'static>,
    structures: vk::PhysicalDeviceAccelerationStructureFeaturesKHR<'static>,
    queries: vk::PhysicalDeviceRayQueryFeaturesKHR<'static>,
}

impl RayFeatures {
    /// All of them switched on.
    pub fn all() -> RayFeatures {
        RayFeatures {
            addresses: vk::PhysicalDeviceBufferDeviceAddressFeatures::default().buffer_device_address(true),
            structures: vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default().acceleration_structure(true),
            queries: vk::PhysicalDeviceRayQueryFeaturesKHR::default().ray_query(true),
        }
    }

    /// `create` with these features.
    pub fn enable<'a>(&'a mut self, create: vk::DeviceCreateInfo<'a>) -> vk::DeviceCreateInfo<'a> {
        create.push_next(&mut self.addresses).push_next(&mut self.structures).push_next(&mut self.queries)
    }
}

/// Whether the device `physical`, which has at least Vulkan 1.2, offers ray queries.
pub(super) fn is_offered(instance: &ash::Instance, physical: vk::PhysicalDevice) -> bool {
    // SAFETY: `physical` belongs to `instance`.
    let offered = unsafe { instance.enumerate_device_extension_properties(physical) }.unwrap_or_default();
    if !EXTENSIONS.iter().all(|name| has_extension(&offered, name)) {
        return false;
    }
    let mut addresses = vk::PhysicalDeviceBufferDeviceAddressFeatures::default();
    let mut structures = vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default();
    let mut queries = vk::PhysicalDeviceRayQueryFeaturesKHR::default();
    let mut features = vk::PhysicalDeviceFeatures2::default()
        .push_next(&mut addresses)
        .push_next(&mut structures)
        .push_next(&mut queries);
    // SAFETY: the chain lives until the call returns, and the device has the extensions of its structures.
    unsafe { instance.get_physical_device_features2(physical, &mut features) };
    let has = [addresses.buffer_device_address, structures.acceleration_structure, queries.ray_query];
    has.iter().all(|&feature| feature == vk::TRUE)
}

/// The functions that build acceleration structures, and what they need to know of the device.
pub(super) struct RayFunctions {
    pub functions: ash::khr::acceleration_structure::Device,
    /// Alignment of the address of scratch memory, in bytes.
    scratch_alignment: u64,
}

impl RayFunctions {
    /// The functions of `device`, which was made from `physical` with [`EXTENSIONS`].
    pub fn new(instance: &ash::Instance, physical: vk::PhysicalDevice, device: &ash::Device) -> RayFunctions {
        let mut limits = vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut limits);
        // SAFETY: the chain lives until the call returns; `physical` belongs to `instance`.
        unsafe { instance.get_physical_device_properties2(physical, &mut properties) };
        RayFunctions {
            functions: ash::khr::acceleration_structure::Device::new(instance, device),
            scratch_alignment: limits.min_acceleration_structure_scratch_offset_alignment.max(1).into(),
        }
    }
}

/// Triangles of an acceleration structure that rays treat alike. In kernels, the number of a group is the custom data of its hits.
pub struct TriangleGroup {
    /// Three corners for each triangle.
    pub corners: Vec<[f32; 3]>,
    /// Whether the triangles stop every ray. Otherwise they are candidates, about which the kernel decides.
    pub is_opaque: bool,
    /// Bits of which a ray's mask must have one.
    pub mask: u8,
}

/// A part of the structure: its geometry, its number of primitives, and the memory that it needs.
struct Part<'a> {
    geometry: [vk::AccelerationStructureGeometryKHR<'a>; 1],
    kind: vk::AccelerationStructureTypeKHR,
    count: u32,
    sizes: vk::AccelerationStructureBuildSizesInfoKHR<'static>,
}

impl<'a> Part<'a> {
    fn new(
        rays: &RayFunctions,
        geometry: vk::AccelerationStructureGeometryKHR<'a>,
        kind: vk::AccelerationStructureTypeKHR,
        count: u32,
    ) -> Part<'a> {
        let mut part = Part { geometry: [geometry], kind, count, sizes: Default::default() };
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        let on_device = vk::AccelerationStructureBuildTypeKHR::DEVICE;
        // SAFETY: the structures outlive the call; it reads no memory of the device.
        unsafe {
            rays.functions.get_acceleration_structure_build_sizes(on_device, &part.info(), &[count], &mut sizes);
        }
        part.sizes = sizes;
        part
    }

    fn info(&self) -> vk::AccelerationStructureBuildGeometryInfoKHR<'_> {
        vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(self.kind)
            .flags(vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE)
            .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
            .geometries(&self.geometry)
    }
}

impl Buffer {
    /// An acceleration structure over the triangles of `groups`, which a kernel binds as `acceleration_structure`. Returns when the device
    /// has built it. Fails if the device has no ray queries or too little memory.
    pub fn acceleration_structure(device: &Device, name: &'static str, groups: &[TriangleGroup]) -> Result<Buffer> {
        let shared = &device.shared;
        let Some(rays) = &shared.rays else {
            return Err(Error::Device(format!("{} has no ray queries", shared.info.name)));
        };
        let corners = groups.iter().map(|group| input(device, "corners for ray queries", &group.corners));
        let corners: Vec<Buffer> = corners.collect::<Result<_>>()?;
        let of_group = |(group, corners): (&TriangleGroup, &Buffer)| {
            let count = (group.corners.len() / 3) as u32;
            let geometry = triangles(address(corners), count, group.is_opaque);
            Part::new(rays, geometry, vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL, count)
        };
        let mut parts: Vec<Part> = groups.iter().zip(&corners).map(of_group).collect();
        let mut instances = input(device, "groups for ray queries", &vec![[0u32; 16]; groups.len()])?;
        parts.push(Part::new(
            rays,
            instances_at(address(&instances)),
            vk::AccelerationStructureTypeKHR::TOP_LEVEL,
            groups.len() as u32,
        ));
        let memory = structures(shared, rays, name, &parts)?;
        let words: Vec<[u32; 16]> = groups
            .iter()
            .enumerate()
            .map(|(number, group)| {
                instance(number as u32, group.mask, structure_address(rays, memory.structures[number]))
            })
            .collect();
        instances.write(0, &words)?;
        let scratch = parts.iter().map(|part| part.sizes.build_scratch_size).max().unwrap_or(0);
        let scratch = allocate(device, "scratch for ray queries", scratch + rays.scratch_alignment)?;
        let scratch_address = address(&scratch).next_multiple_of(rays.scratch_alignment);
        let mut commands = Commands::new(shared)?;
        commands.begin()?;
        build(&commands, rays, &parts, &memory, scratch_address);
        device.submit(&mut commands)?;
        Ok(Buffer::of_allocation(device, memory))
    }
}

/// Memory for all `parts`, and their structures in it, which are not built yet.
fn structures(shared: &Arc<Shared>, rays: &RayFunctions, name: &'static str, parts: &[Part]) -> Result<Allocation> {
    let sizes = parts.iter().map(|part| part.sizes.acceleration_structure_size.next_multiple_of(ALIGNMENT));
    let usage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
    let total: u64 = sizes.clone().sum();
    let mut memory = Allocation::with_usage(shared, name, total, vk::MemoryPropertyFlags::DEVICE_LOCAL, usage)?;
    let mut offset = 0;
    for (part, size) in parts.iter().zip(sizes) {
        let info = vk::AccelerationStructureCreateInfoKHR::default()
            .buffer(memory.handle)
            .offset(offset)
            .size(part.sizes.acceleration_structure_size)
            .ty(part.kind);
        // SAFETY: the range lies in the buffer. `memory` destroys the structure before the buffer.
        let structure = unsafe { rays.functions.create_acceleration_structure(&info, None) };
        memory.structures.push(structure.map_err(|e| shared.error("creating an acceleration structure", e))?);
        offset += size;
    }
    Ok(memory)
}

/// Records the builds of all parts, one after the other, and that later dispatches wait for them.
fn build(commands: &Commands, rays: &RayFunctions, parts: &[Part], memory: &Allocation, scratch: u64) {
    let stage = vk::PipelineStageFlags::ACCELERATION_STRUCTURE_BUILD_KHR;
    let access = vk::AccessFlags::ACCELERATION_STRUCTURE_READ_KHR | vk::AccessFlags::ACCELERATION_STRUCTURE_WRITE_KHR;
    commands.barrier(
        (
            vk::PipelineStageFlags::HOST | vk::PipelineStageFlags::TRANSFER,
            vk::AccessFlags::HOST_WRITE | vk::AccessFlags::TRANSFER_WRITE,
        ),
        (stage, access | vk::AccessFlags::SHADER_READ),
    );
    for (part, &structure) in parts.iter().zip(&memory.structures) {
        let info = part
            .info()
            .dst_acceleration_structure(structure)
            .scratch_data(vk::DeviceOrHostAddressKHR { device_address: scratch });
        let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(part.count);
        // SAFETY: recording has begun. The inputs, the structures and the scratch memory live until the submit has ended.
        unsafe { rays.functions.cmd_build_acceleration_structures(commands.buffer, &[info], &[&[range]]) };
        commands.barrier((stage, access), (stage | vk::PipelineStageFlags::COMPUTE_SHADER, access));
    }
}

/// A buffer of at least 16 bytes that the device can address.
fn allocate(device: &Device, name: &'static str, size: u64) -> Result<Buffer> {
    let usage = vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS
        | vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR;
    let memory = vk::MemoryPropertyFlags::DEVICE_LOCAL;
    let allocation = Allocation::with_usage(&device.shared, name, size.max(16), memory, usage)?;
    Ok(Buffer::of_allocation(device, allocation))
}

/// A buffer that a build reads, with a copy of `data`.
fn input<T: bytemuck::NoUninit>(device: &Device, name: &'static str, data: &[T]) -> Result<Buffer> {
    let mut buffer = allocate(device, name, size_of_val(data) as u64)?;
    buffer.write(0, data)?;
    Ok(buffer)
}

/// The address of a buffer that [`allocate`] made.
fn address(buffer: &Buffer) -> u64 {
    let allocation = &buffer.allocation;
    let info = vk::BufferDeviceAddressInfo::default().buffer(allocation.handle);
    // SAFETY: the buffer has the usage for device addresses.
    unsafe { allocation.shared.device.get_buffer_device_address(&info) }
}

fn structure_address(rays: &RayFunctions, structure: vk::AccelerationStructureKHR) -> u64 {
    let info = vk::AccelerationStructureDeviceAddressInfoKHR::default().acceleration_structure(structure);
    // SAFETY: the structure exists.
    unsafe { rays.functions.get_acceleration_structure_device_address(&info) }
}

/// Geometry of `count` triangles, whose corners lie one after the other at `address`.
fn triangles(address: u64, count: u32, is_opaque: bool) -> vk::AccelerationStructureGeometryKHR<'static> {
    let data = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
        .vertex_format(vk::Format::R32G32B32_SFLOAT)
        .vertex_data(vk::DeviceOrHostAddressConstKHR { device_address: address })
        .vertex_stride(size_of::<[f32; 3]>() as u64)
        .max_vertex((3 * count).saturating_sub(1))
        .index_type(vk::IndexType::NONE_KHR);
    let flags = if is_opaque { vk::GeometryFlagsKHR::OPAQUE } else { vk::GeometryFlagsKHR::empty() };
    vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { triangles: data })
        .flags(flags)
}

fn instances_at(address: u64) -> vk::AccelerationStructureGeometryKHR<'static> {
    let data = vk::AccelerationStructureGeometryInstancesDataKHR::default()
        .data(vk::DeviceOrHostAddressConstKHR { device_address: address });
    vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::INSTANCES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { instances: data })
}

/// The words of a VkAccelerationStructureInstanceKHR: the identity, the number of the group with its mask, no culling by facing, and the
/// address of the structure.
fn instance(number: u32, mask: u8, address: u64) -> [u32; 16] {
    let mut words = [0; 16];
    for diagonal in [0, 5, 10] {
        words[diagonal] = 1f32.to_bits();
    }
    words[12] = number | (u32::from(mask) << 24);
    words[13] = vk::GeometryInstanceFlagsKHR::TRIANGLE_FACING_CULL_DISABLE.as_raw() << 24;
    [words[14], words[15]] = [address as u32, (address >> 32) as u32];
    words
}

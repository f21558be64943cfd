//! Vulkan compute: device, buffers, kernels. All unsafe code of the package is in this module, except two calls in
//! `app/interrupts.rs`. Nothing in the module knows about rendering.

mod acceleration;
mod allocate;
mod allocation;
mod bindings;
mod bounds;
mod buffer;
pub mod buffer_desc;
mod commands;
mod compiling;
mod device;
mod drive;
mod info;
mod instance;
mod kernel;
mod pipeline;
mod prune;
mod quirks;
mod reachable;
mod read_back;
mod recorder;
pub mod shader;
mod shared;
mod spirv;
mod staging;
mod texels;
mod turns;

pub use acceleration::TriangleGroup;
pub use allocate::{Allocate, BufferList};
pub use bindings::Bindings;
pub use buffer::Buffer;
pub use buffer_desc::BufferDesc;
pub use compiling::compiling_for;
pub use device::Device;
pub use drive::Drive;
pub use info::{BufferCounts, DeviceInfo, DeviceKind};
pub use kernel::Kernel;
pub use quirks::{Quirks, RaySupport};
pub use read_back::ReadBack;
pub use recorder::{Recorder, Timing};

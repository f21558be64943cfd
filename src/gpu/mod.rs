//! Vulkan compute: device, buffers, kernels. All the unsafe code is here, and nothing here knows rendering.

mod bounds;
mod buffer;
mod commands;
mod device;
mod info;
mod kernel;
pub mod need;
mod recorder;
pub mod shader;
mod spirv;

pub use buffer::Buffer;
pub use device::Device;
pub use info::{DeviceInfo, DeviceKind};
pub use kernel::{Bindings, Kernel};
pub use need::Need;
pub use recorder::{Recorder, Timing};

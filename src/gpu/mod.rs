//! Vulkan compute: device, buffers, kernels. All the unsafe code is here, and nothing here knows rendering.

mod bounds;
mod buffer;
mod device;
mod kernel;
pub mod need;
mod recorder;
pub mod shader;
mod spirv;

pub use buffer::Buffer;
pub use device::{Device, DeviceInfo};
pub use kernel::{Bindings, Kernel};
pub use need::Need;
pub use recorder::{Recorder, Timing};

//! Drivers that do less than kernels would like, or more than Vulkan promises.

use ash::vk;

/// What is known of a driver. Each field sets an override constant, whose default is right for a driver of which nothing is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Quirks {
    /// Sine and cosine are right to the last digits; Vulkan promises 2^-11. Else kernels compute their own.
    pub exact_sines: bool,
    /// A loop must be left at its top. SwiftShader repeats the last iteration of threads that have left a loop while others go on,
    /// and reads 0 from storage buffers for them: the result of a loop that is left at its end is lost.
    pub exit_at_top: bool,
}

impl Quirks {
    pub const NONE: Quirks = Quirks { exact_sines: false, exit_at_top: false };

    pub(super) fn of(driver: vk::DriverId) -> Quirks {
        match driver {
            vk::DriverId::MESA_LLVMPIPE => Quirks { exact_sines: true, ..Quirks::NONE },
            vk::DriverId::GOOGLE_SWIFTSHADER => Quirks { exit_at_top: true, ..Quirks::NONE },
            _ => Quirks::NONE,
        }
    }

    /// Override constants of kernels.
    pub(super) fn constants(self) -> [(&'static str, f64); 2] {
        [("EXACT_SINES", self.exact_sines.into()), ("EXIT_AT_TOP", self.exit_at_top.into())]
    }
}

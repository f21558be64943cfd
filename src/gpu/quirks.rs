//! Properties of drivers that renders must know: defects, accuracy beyond Vulkan's guarantees, and slow compilers.

#![warn(missing_docs)]

use ash::vk;

/// Whether kernels can trace rays by ray queries (VK_KHR_ray_query).
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RaySupport {
    /// The device has no ray queries.
    Absent,
    /// A software device has them, and computes them more slowly than kernels trace rays.
    Software,
    /// A card has them.
    Hardware,
}

/// Known properties of a driver. All fields but `slow_ellipsoids` and `rays` set an override constant of kernels. The defaults are
/// safe for an unknown driver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Quirks {
    /// Sine and cosine are accurate to the last digits of f32, while Vulkan guarantees an absolute error of 2^-11. If false,
    /// kernels compute sine and cosine themselves.
    pub exact_sines: bool,
    /// Kernels must leave a loop at its top. SwiftShader repeats the last iteration for threads that have left a loop while other
    /// threads continue. In the repetition these threads read 0 from storage buffers. So a thread that leaves a loop at the end
    /// of the body loses its result.
    pub exit_at_top: bool,
    /// The kernel of ellipsoidal connections takes minutes to compile, so a render has such connections only if its settings demand them.
    pub slow_ellipsoids: bool,
    /// Whether the device has ray queries.
    pub rays: RaySupport,
}

impl Quirks {
    /// An unknown driver: no accuracy beyond Vulkan's guarantees, and no known defect or weakness.
    pub const NONE: Quirks =
        Quirks { exact_sines: false, exit_at_top: false, slow_ellipsoids: false, rays: RaySupport::Absent };

    pub(super) fn of(driver: vk::DriverId) -> Quirks {
        match driver {
            vk::DriverId::MESA_LLVMPIPE => Quirks { exact_sines: true, ..Quirks::NONE },
            vk::DriverId::GOOGLE_SWIFTSHADER => Quirks { exit_at_top: true, slow_ellipsoids: true, ..Quirks::NONE },
            _ => Quirks::NONE,
        }
    }

    /// Names and values of the override constants of kernels.
    pub(super) fn constants(self) -> [(&'static str, f64); 2] {
        [("EXACT_SINES", self.exact_sines.into()), ("EXIT_AT_TOP", self.exit_at_top.into())]
    }
}

//! A device that was lost, for example because its driver was reset.

use taugate::Result;
use taugate::internals::gpu::Device;

use super::Engine;

/// Follows the error of a lost device.
pub const REMEDY: &str = "; change a setting to open the device again";

impl Engine {
    /// Opens the device again if it was lost. No renderer may use it any more.
    pub(super) fn reopen_lost_device(&mut self) -> Result<()> {
        if self.device.is_lost() {
            self.device = Device::open(self.viewed.start().render.device.as_deref())?;
            // These measurements may have failed with the old device.
            (self.work.has_arrivals, self.work.has_surfaces) = (false, false);
        }
        Ok(())
    }
}

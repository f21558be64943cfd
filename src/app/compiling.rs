//! Tells the user that the driver is compiling kernels. Without a word, a command would seem to hang.

use std::thread::sleep;
use std::time::Duration;

use taugate::Error;
use taugate::internals::gpu::compiling_for;
use taugate::internals::threads::spawn;

/// Compilations that take less time need no words.
const PATIENCE: Duration = Duration::from_secs(2);
/// Time between two looks.
const PERIOD: Duration = Duration::from_millis(200);

/// Prints one line on stderr as soon as kernels have been compiled for a while. The thread that looks ends with the process.
pub fn announce() -> Result<(), Error> {
    spawn("compiling", || {
        while compiling_for().is_none_or(|time| time < PATIENCE) {
            sleep(PERIOD);
        }
        super::say(
            "note: the driver compiles kernels for this combination of materials and settings, which may take a minute; most \
             drivers keep them for later commands",
        );
    })?;
    Ok(())
}

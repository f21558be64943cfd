//! Messages about flags that taugate does not have.

use clap::Error;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use taugate::internals::settings::missing;

/// Prints the message of clap and ends the process. A flag that other renderers have gets the reason why it is missing.
pub fn exit_with(error: &Error) -> ! {
    let flag = match error.get(ContextKind::InvalidArg) {
        Some(ContextValue::String(flag)) if error.kind() == ErrorKind::UnknownArgument => flag.trim_start_matches('-'),
        _ => "",
    };
    if let Some(reason) = missing::reason(flag) {
        crate::app::say(&format!("error: there is no flag --{flag}: {reason}"));
        std::process::exit(error.exit_code());
    }
    error.exit()
}

//! The log of the process on standard error.

use std::io;
use std::str::FromStr;

use tracing::Level;

use crate::config::settings::{LogFormat, LogSettings};

/// Writes the log of this process to standard error from now on. A second call has no effect.
pub(crate) fn start_log(settings: &LogSettings) {
    let level = Level::from_str(&settings.level).unwrap_or(Level::INFO);
    let log = tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(io::stderr)
        .with_target(false)
        // A closed standard error is no reason to stop.
        .log_internal_errors(false);
    // Only the first log of a process counts, so that an error says that there is one.
    let _ = match settings.format {
        LogFormat::Text => tracing::subscriber::set_global_default(log.with_ansi(false).finish()),
        LogFormat::Json => tracing::subscriber::set_global_default(log.json().flatten_event(true).finish()),
    };
}

//! Python binding of the program and library `pingmap`. The package `pingmap` in `python/` builds on everything here.
//!
//! Commands run in the process, with the arguments of the command line. Tables cross the border as CSV. Numbers and
//! messages are therefore those of the command line.

#![forbid(unsafe_code)]

// In the order of the data flow: each module uses only those above it.
mod errors;
mod work;
mod commands;
mod agent;

use pyo3::prelude::*;

/// Maps of acoustic reception: the compiled part of the package `pingmap`.
#[pymodule]
mod _pingmap {
    #[pymodule_export]
    use crate::agent::Agent;
    #[pymodule_export]
    use crate::commands::{main, read_log, run};
    #[pymodule_export]
    use crate::errors::Error;
}

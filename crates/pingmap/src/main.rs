//! The program `pingmap`; its code is in the library of the same name.

use std::process::ExitCode;

/// Reuses freed memory. Matrices are allocated and freed often, and the system's allocator would take a quarter of the
/// run time of many commands.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    pingmap::main()
}

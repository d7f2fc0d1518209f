//! The program `pingmap`; all of it is in the library of the same name.

use std::process::ExitCode;

/// Keeps the memory of matrices at hand: to get it from the system anew for each of them would take a quarter of the time of
/// many a command.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    pingmap::main()
}

//! Runs one benchmark for each line of its input. Each line of the output contains the processor time of one repetition in seconds, and
//! the measure of the result. `--list` lists all benchmarks, `--data FOLDER` writes the data for `peers`, and `--growth` prints time and
//! memory as a function of the size.

use std::io::{BufRead, Write};
use std::path::Path;
use std::process::ExitCode;

use pingmap_bench::{WORKS, Work, growth, growth_at, write_all};
use rustix::time::{ClockId, clock_gettime};

/// The allocator of the program `pingmap`.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let result = match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["--list"] => list(),
        ["--data", folder] => write_all(Path::new(folder)),
        ["--growth"] => growth(&mut std::io::stdout()),
        ["--growth", number, size] => match (number.parse(), size.parse()) {
            (Ok(number), Ok(size)) => growth_at(number, size, processor_s).map(|said| println!("{said}")),
            _ => return usage("expected two numbers"),
        },
        [name] => match WORKS.iter().find(|work| work.name == *name) {
            Some(work) => serve(work),
            None => return usage(&format!("there is no work `{name}`")),
        },
        _ => return usage("expected one argument"),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn usage(wrong: &str) -> ExitCode {
    eprintln!("error: {wrong}; usage: pingmap-bench --list | --data FOLDER | --growth | WORK");
    ExitCode::from(2)
}

fn list() -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    WORKS.iter().try_for_each(|work| writeln!(out, "{}\t{}", work.name, if work.short { "short" } else { "long" }))
}

fn serve(work: &Work) -> std::io::Result<()> {
    let mut run = (work.start)();
    let mut out = std::io::stdout().lock();
    writeln!(out, "ready")?;
    out.flush()?;
    for line in std::io::stdin().lock().lines() {
        line?;
        let begin = processor_s();
        let how_well = run();
        let took_s = (processor_s() - begin) / work.repeats as f64;
        writeln!(out, "{took_s:e} {how_well}")?;
        out.flush()?;
    }
    Ok(())
}

/// Returns the processor time of all threads of this process.
fn processor_s() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

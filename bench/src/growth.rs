//! How time and memory grow: the exponents between the smallest and the largest of several sizes.

use std::io::Write;

use crate::works::{dense_fits, predictions, selections, sparse_iterations_on};

/// An operation, its sizes, and the promised exponent of time as a function of the size.
struct Growth {
    what: &'static str,
    sizes: &'static [usize],
    promised: f64,
    work: fn(usize) -> Box<dyn FnMut() -> f64>,
}

const GROWTHS: &[Growth] = &[
    Growth { what: "dense fit, N", sizes: &[250, 500, 1000, 2000], promised: 3.0, work: dense_fits },
    Growth {
        what: "ten sparse iterations, M = 100, N",
        sizes: &[1000, 10_000, 100_000, 1_000_000],
        promised: 1.0,
        work: |size| sparse_iterations_on(size, 100),
    },
    Growth {
        what: "ten sparse iterations, N = 50 000, M",
        sizes: &[10, 50, 100, 500],
        promised: 2.0,
        work: |points| sparse_iterations_on(50_000, points),
    },
    Growth { what: "10 000 predictions, n", sizes: &[250, 500, 1000, 2000], promised: 2.0, work: predictions },
    Growth {
        what: "greedy 50 of N, 1500 judges",
        sizes: &[2000, 5000, 10_000, 50_000],
        promised: 1.0,
        work: selections,
    },
];

/// Prints a table of times, peak memory at each size, and the exponents. Each size is measured in a separate process,
/// `pingmap-bench --growth WHAT SIZE`, so that its memory is measured alone.
///
/// # Errors
/// Errors of the operating system.
pub fn growth(out: &mut impl Write) -> std::io::Result<()> {
    let program = std::env::current_exe()?;
    writeln!(out, "| what grows | sizes | time, ms | most memory, MB | exponent of time, promised | of memory |")?;
    writeln!(out, "|---|---|---|---|---|---|")?;
    for (number, growth) in GROWTHS.iter().enumerate() {
        let mut measured = Vec::new();
        for size in growth.sizes {
            let arguments = ["--growth".to_owned(), number.to_string(), size.to_string()];
            let said = std::process::Command::new(&program).args(arguments).output()?.stdout;
            let numbers: Vec<f64> =
                String::from_utf8_lossy(&said).split_whitespace().filter_map(|word| word.parse().ok()).collect();
            measured.push((*size as f64, numbers[0], numbers[1]));
        }
        let (first, last) = (measured[0], measured[measured.len() - 1]);
        let exponent = |a: f64, b: f64| (b / a).ln() / (last.0 / first.0).ln();
        let list = |of: &dyn Fn(&(f64, f64, f64)) -> String| measured.iter().map(of).collect::<Vec<_>>().join(", ");
        writeln!(
            out,
            "| {} | {} | {} | {} | {:.2} (≤ {}) | {:.2} |",
            growth.what,
            list(&|at| format!("{}", at.0)),
            list(&|at| format!("{:.3}", 1e3 * at.1)),
            list(&|at| format!("{:.0}", at.2)),
            exponent(first.1, last.1),
            growth.promised,
            exponent(first.2, last.2),
        )?;
        out.flush()?;
    }
    Ok(())
}

/// Runs one operation at one size. Returns the shortest processor time in seconds, and the peak memory of the process in megabytes.
///
/// # Errors
/// Errors of the operating system.
pub fn growth_at(number: usize, size: usize, processor_s: fn() -> f64) -> std::io::Result<String> {
    let Some(growth) = GROWTHS.get(number) else { return Ok(String::new()) };
    let mut run = (growth.work)(size);
    let took_s = || {
        let begin = processor_s();
        run();
        processor_s() - begin
    };
    let best_s = std::iter::repeat_with(took_s).take(3).fold(f64::INFINITY, f64::min);
    let status = std::fs::read_to_string("/proc/self/status")?;
    let most = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes: f64 = most.and_then(|most| most.split_whitespace().next()?.parse().ok()).unwrap_or(f64::NAN);
    Ok(format!("{best_s:e} {}", kilobytes / 1000.0))
}

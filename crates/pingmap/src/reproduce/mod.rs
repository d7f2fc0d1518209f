//! `pingmap reproduce`: the paper's experiment, beside its published figures.

mod cells;
mod json;
mod page;
mod pictures;
mod published;
mod results;
mod tables;

use std::path::{Path, PathBuf};

use pingmap_trial::EventLog;
use pingmap_trial::paper::{DataSet, Experiment};

use crate::cli::{self, Exhibit, name_of};
use crate::output::{BadInput, note, print, print_json, spinner, use_threads, warn, write_file};
use crate::{report, survey};
use results::Results;
use tables::Table;

/// The trials in the places of data sets 1, 2 and 3 (`data/README.md`).
const TRIALS: [(&str, &[u8]); 3] = [
    ("bay2", include_bytes!("../../../../data/bay2.csv")),
    ("lake2", include_bytes!("../../../../data/lake2.csv")),
    ("bay3", include_bytes!("../../../../data/bay3.csv")),
];

pub fn run(options: &cli::Reproduce) -> anyhow::Result<()> {
    use_threads(options.threads)?;
    let sets = data_sets(&options.data)?;
    let figures = options.out.join(page::FIGURES);
    if options.exhibit.has_pictures() {
        report::make_folder(&figures)?;
    }
    let bar = spinner("learning the length-scale");
    let experiment = Experiment::new(sets, options.permutations, options.seed)?;
    bar.finish_and_clear();
    let results = Results::compute(experiment, options.data.is_empty(), options.seed, options.exhibit)?;
    write(options, &results, &figures)?;
    if options.json {
        return print_json(&json::of(&results));
    }
    let tables: Vec<String> = tables(&results, options.exhibit).iter().map(Table::text).collect();
    print(&format!("{}\n\n{}\n\n{}", page::caveat(&results), page::kernel_line(&results), tables.join("\n")))
}

/// Writes the figures that were asked for, and with everything the page.
fn write(options: &cli::Reproduce, results: &Results, figures: &Path) -> anyhow::Result<()> {
    let exhibit = options.exhibit;
    if !exhibit.has_pictures() {
        return Ok(());
    }
    let pictures = pictures::draw(results, exhibit);
    if pictures.is_empty() {
        warn("no figures: every permutation of the first data set leaves a region without training or held-out events");
    } else {
        pictures.iter().try_for_each(|picture| picture.write(figures))?;
        note(format_args!("figures: {}", figures.display()));
    }
    if exhibit == Exhibit::All {
        let page = options.out.join("reproduction.md");
        write_file(&page, page::markdown(results, &pictures, &command(options)).as_bytes())?;
        note(format_args!("page: {}", page.display()));
    }
    Ok(())
}

fn tables(results: &Results, exhibit: Exhibit) -> Vec<Table> {
    let all = exhibit == Exhibit::All;
    let mut tables = Vec::new();
    if all || exhibit == Exhibit::Events {
        tables.push(tables::events(results));
    }
    if !results.radii.is_empty() {
        tables.push(tables::regions(results));
        tables.extend(results.radii.iter().flat_map(|at| tables::claims(results, at)));
    }
    for at in &results.radii {
        if all || exhibit == Exhibit::Local {
            tables.extend(tables::local(results, at));
        }
        if all || exhibit == Exhibit::Team {
            tables.extend(tables::team(results, at));
        }
        if all || exhibit == Exhibit::Certificate {
            tables.extend(tables::certificate(results, at));
        }
    }
    tables.extend(tables::sweep(results));
    tables
}

/// The event logs in the places of the paper's data sets.
fn data_sets(paths: &[PathBuf]) -> anyhow::Result<Vec<DataSet>> {
    if paths.is_empty() {
        let built_in = |(name, csv): (&str, &[u8])| {
            let log = EventLog::read(csv, Path::new(&format!("{name}.csv (built in)")))?;
            Ok(DataSet::new(name, log)?)
        };
        return TRIALS.into_iter().map(built_in).collect();
    }
    let mut sets = Vec::new();
    for path in paths {
        let files = if path.is_dir() { csv_files(path)? } else { vec![path.clone()] };
        for file in files {
            let name = file.file_stem().map_or_else(|| file.display().to_string(), |name| name.display().to_string());
            sets.push(DataSet::new(name, survey::open_log(&file)?)?);
        }
    }
    Ok(sets)
}

/// The event logs of a folder, by name; files of splits lie beside them.
fn csv_files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let bad = |why: String| BadInput(format!("{}: {why}", folder.display()));
    let entries = std::fs::read_dir(folder).map_err(|error| bad(format!("cannot read the folder: {error}")))?;
    let paths = entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<Vec<_>, _>>();
    let mut files = paths.map_err(|error| bad(format!("cannot read the folder: {error}")))?;
    let is_log = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.ends_with(".csv") && !name.ends_with(".splits.csv")
    };
    files.retain(is_log);
    files.sort();
    if files.is_empty() {
        return Err(bad("no event logs; expected files that end in .csv".into()).into());
    }
    Ok(files)
}

/// The command that these options were.
fn command(options: &cli::Reproduce) -> String {
    let mut command = format!("pingmap reproduce {}", name_of(&options.exhibit));
    for path in &options.data {
        command += &format!(" --data {}", quoted(path));
    }
    let out = quoted(&options.out);
    command += &format!(" --permutations {} --seed {} --out {out}", options.permutations, options.seed);
    command
}

/// A path as a shell takes it.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = text.chars().all(|letter| letter.is_alphanumeric() || "._-/".contains(letter));
    if is_plain { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

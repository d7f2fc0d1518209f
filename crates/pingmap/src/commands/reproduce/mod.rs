//! `pingmap reproduce`: repeats the paper's experiment and compares the results with the published figures.

mod exhibit;
mod published;
mod results;
mod cells;
mod table;
mod tables;
mod claims;
mod sweep;
mod pictures;
mod page;
pub mod json;
mod scores;

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use pingmap_trial::paper::{DataSet, Experiment};
use pingmap_trial::{BUILT_IN, built_in};

use crate::cli_enums::name_of;
use crate::cli_parsers::{repeats, threads};
use crate::files::{make_folder, write_file};
use crate::log::open_log;
use crate::output::{BadInput, Results, note, print_json, print_text, spinner, warn};
use crate::output_target::{Overwrite, RESULT};
use exhibit::Exhibit;
use results::Computed;
use table::Table;

/// Repeat the experiment of the paper, and compare the results with the published ones
#[derive(Args)]
#[command(
    after_long_help = "Examples:\n  pingmap reproduce --out docs\n  pingmap reproduce team --data log.csv --permutations 10"
)]
pub struct Options {
    /// Part of the experiment to compute
    #[arg(value_enum, default_value_t = Exhibit::All)]
    pub exhibit: Exhibit,
    /// Event log in place of the paper's next data set, or a folder of CSV files
    ///
    /// Repeat the option for each data set. Files of a folder are read in alphabetical order. Depths are ignored. Three
    /// built-in simulated trials are used if the option is not given.
    #[arg(long, value_name = "DIR|FILE")]
    pub data: Vec<PathBuf>,
    /// Number of random divisions of each data set
    ///
    /// A division assigns each event to the training or the held-out events.
    #[arg(long, default_value_t = 100, value_parser = repeats, allow_negative_numbers = true)]
    pub permutations: usize,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder for the figures and, with `all`, the page reproduction.md
    #[arg(help_heading = RESULT, long, default_value = "pingmap-reproduction", value_name = "DIR")]
    pub out: PathBuf,
    /// Continue even if a log contains only one outcome, or coordinates that look like degrees
    #[arg(long)]
    pub accept_bad_log: bool,
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Print one JSON object instead of tables
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
    /// Worker threads; 0 uses one per core. Results do not depend on it
    #[arg(long, default_value_t = 0, value_parser = threads)]
    pub threads: usize,
}

impl Options {
    pub fn threads(&self) -> usize {
        self.threads
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        run(self, results)
    }
}

fn run(options: &Options, out: Results) -> anyhow::Result<()> {
    let sets = data_sets(&options.data, options.accept_bad_log)?;
    let figures = options.out.join(page::FIGURES);
    let inputs: Vec<&Path> = options.data.iter().map(PathBuf::as_path).collect();
    if options.exhibit.has_pictures() {
        make_folder(&figures)?;
    }
    if options.exhibit == Exhibit::All {
        options.overwrite.target(&options.out.join("reproduction.md"), &inputs)?;
    }
    for name in options.exhibit.pictures() {
        for ending in ["svg", "png"] {
            options.overwrite.target(&figures.join(format!("{name}.{ending}")), &inputs)?;
        }
    }
    let bar = spinner("learning the length-scale");
    let experiment = Experiment::new(sets, options.permutations, options.seed)?;
    bar.finish_and_clear();
    let results = Computed::compute(experiment, options.data.is_empty(), options.seed, options.exhibit)?;
    write(options, &results, &figures)?;
    if options.json {
        return print_json(out, &json::ReproductionJson::of(&results));
    }
    let tables: Vec<String> = tables(&results, options.exhibit).iter().map(Table::text).collect();
    print_text(out, &format!("{}\n\n{}\n\n{}", page::caveat(&results), page::kernel_line(&results), tables.join("\n")))
}

/// Writes the requested figures, and the page with `all`.
fn write(options: &Options, results: &Computed, figures: &Path) -> anyhow::Result<()> {
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

fn tables(results: &Computed, exhibit: Exhibit) -> Vec<Table> {
    let all = exhibit == Exhibit::All;
    let mut tables = Vec::new();
    if all || exhibit == Exhibit::Events {
        tables.push(tables::events(results));
    }
    if !results.radii.is_empty() {
        tables.push(tables::regions(results));
        tables.extend(results.radii.iter().flat_map(|at| claims::claims(results, at)));
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
    tables.extend(sweep::sweep(results));
    tables
}

/// Returns the event logs in place of the paper's data sets.
fn data_sets(paths: &[PathBuf], accept_bad_log: bool) -> anyhow::Result<Vec<DataSet>> {
    if paths.is_empty() {
        let set = |name: &str| {
            let log = built_in(name).with_context(|| format!("{name} is built in"))??;
            Ok(DataSet::new(name, log)?)
        };
        return BUILT_IN.into_iter().map(set).collect();
    }
    let mut sets = Vec::new();
    for path in paths {
        let files = if path.is_dir() { csv_files(path)? } else { vec![path.clone()] };
        for file in files {
            let name = file.file_stem().map_or_else(|| file.display().to_string(), |name| name.display().to_string());
            sets.push(DataSet::new(name, open_log(&file, accept_bad_log)?)?);
        }
    }
    Ok(sets)
}

/// Returns the event logs of a folder, ordered by name. Files of splits in the folder are skipped.
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

/// Returns the command line of these options.
fn command(options: &Options) -> String {
    let mut command = format!("pingmap reproduce {}", name_of(&options.exhibit));
    for path in &options.data {
        command += &format!(" --data {}", quoted(path));
    }
    let out = quoted(&options.out);
    command += &format!(" --permutations {} --seed {} --out {out}", options.permutations, options.seed);
    command
}

/// Quotes a path for the shell.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = text.chars().all(|letter| letter.is_alphanumeric() || "._-/".contains(letter));
    if is_plain { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

//! The options that `-h` shows.

use clap::Command;

/// The most common options of commands with many options, by the name of the command.
const COMMON_OPTIONS: [(&str, &[&str]); 13] = [
    ("import", &["records", "ids", "schedule", "always_transmits", "correct_clocks", "output", "overwrite", "json"]),
    ("replay", &["logs", "model", "frames", "team", "online", "report", "overwrite", "json"]),
    ("learn", &["logs", "output", "overwrite", "test_share", "site_prior", "json"]),
    ("predict", &["logs", "links", "model", "output", "overwrite", "json"]),
    ("map", &["logs", "at", "seen", "model", "output", "overwrite", "json"]),
    ("plan standoff", &["logs", "at", "probability", "seen", "model", "output", "overwrite", "json"]),
    ("plan track", &["logs", "at", "along", "probability", "every_s", "model", "output", "overwrite", "json"]),
    ("plan gateway", &["logs", "among", "along", "probability", "every_s", "model", "output", "overwrite", "json"]),
    ("select", &["logs", "vehicle", "points", "radius_m", "model", "json"]),
    ("reproduce", &["exhibit", "data", "permutations", "out", "overwrite", "json"]),
    ("simulate", &["vehicles", "slots", "area_m", "seed", "folder", "output", "overwrite", "json"]),
    ("team", &["logs", "model", "key_file", "frame_bytes", "output", "overwrite", "json"]),
    ("packet schema", &["report", "proto", "json"]),
];

/// Hides all but the common options from the short help of every command, so that it fits on one screen.
pub fn with_short_help(command: Command) -> Command {
    command.mut_subcommands(|command| shortened(command, ""))
}

/// Hides options of a command and its subcommands. `above` is the name of the command above it.
fn shortened(command: Command, above: &str) -> Command {
    let name = format!("{above} {}", command.get_name()).trim_start().to_owned();
    let command = command.mut_subcommands(|command| shortened(command, &name));
    match COMMON_OPTIONS.iter().find(|(of, _)| *of == name) {
        None => command,
        Some((_, common)) => command.mut_args(|option| {
            let is_hidden = !common.contains(&option.get_id().as_str());
            option.hide_short_help(is_hidden)
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn all_common_options_exist() {
        let program = crate::Arguments::command();
        for (name, common) in COMMON_OPTIONS {
            let find = |above, name| Command::find_subcommand(above, name).expect("a command");
            let command = name.split(' ').fold(&program, find);
            let options: Vec<&str> = command.get_arguments().map(|option| option.get_id().as_str()).collect();
            assert!(common.iter().all(|option| options.contains(option)), "{name}: {common:?} {options:?}");
        }
    }
}

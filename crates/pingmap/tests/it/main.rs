//! Tests of the program and of the library, in one binary. Each file tests one subject.
//!
//! Tests that need the shared data folder read its path from `PINGMAP_SHARED`, and print a message if they are skipped
//! without it. `PINGMAP_WRITE_GOLDEN=1` rewrites the schemas in docs.

#![allow(clippy::unwrap_used)]

mod common;

mod bad_input;
mod check_command;
mod command_line;
mod documentation;
mod documents;
mod evaluation;
mod film;
mod fleet;
mod help;
mod hostile_files;
mod import;
mod import_logs;
mod import_times;
mod import_modems;
mod import_positions;
mod import_tables;
mod learning;
mod library;
mod machine_interface;
mod maps;
mod options;
mod output_files;
mod packets;
mod plan;
mod report;
mod reproduce;
mod simulate;
mod tutorial;
mod unusual_input;
#[cfg(unix)]
mod vehicle;

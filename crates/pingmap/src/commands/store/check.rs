//! `pingmap store check`: verifies a store.

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_packet::to_hex;
use pingmap_vehicle::inspect;
use schemars::JsonSchema;
use serde::Serialize;

use crate::output::{BadInput, Results, print_json, print_text};

/// Verify every checksum of a store, and print what it holds. The file is not changed
#[derive(Args)]
#[command(after_long_help = "Example:\n  pingmap store check auv1.redb")]
pub struct Options {
    /// The store. No vehicle may have it open
    #[arg(value_name = "FILE")]
    store: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The content of a store in JSON.
#[derive(Serialize, JsonSchema)]
pub struct StoreJson<'a> {
    /// Version of this object.
    schema: u32,
    /// The store.
    file: &'a Path,
    /// The vehicle.
    vehicle: String,
    /// Digest of the team configuration.
    team_digest: String,
    /// Version of the layout of the file.
    format: u32,
    /// Records after the base.
    records: usize,
    /// Bytes of these records.
    record_bytes: usize,
    /// Bytes of the base; absent before the first one.
    base_bytes: Option<usize>,
    /// Bytes of the file.
    file_bytes: u64,
}

impl Options {
    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let report = inspect(&self.store).map_err(|error| BadInput(error.to_string()))?;
        let json = StoreJson {
            schema: 1,
            file: &self.store,
            vehicle: report.identity.vehicle,
            team_digest: to_hex(&report.identity.team_digest),
            format: report.format,
            records: report.entry_count,
            record_bytes: report.entry_bytes,
            base_bytes: report.base_bytes,
            file_bytes: report.file_bytes,
        };
        if self.json { print_json(results, &json) } else { print_text(results, &text(&json)) }
    }
}

fn text(store: &StoreJson) -> String {
    let StoreJson { vehicle, team_digest, format, records, record_bytes, file_bytes, .. } = store;
    let base = store.base_bytes.map_or("none".to_owned(), |bytes| format!("{bytes} bytes"));
    format!(
        "intact\nvehicle  {vehicle}\nteam     {team_digest}\nformat   {format}\nbase     {base}\nrecords  {records}, {record_bytes} bytes\nfile     {file_bytes} bytes"
    )
}

//! `pingmap team`: writes a team configuration.

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::{Grid, Slots, Team, TeamError, TeamFile, VehicleId};
use pingmap_packet::{TIME_CELLS, to_hex};
use pingmap_trial::{EventLog, schedule};
use schemars::JsonSchema;
use serde::Serialize;

use crate::cli_parsers::{frame_bytes, mission_s, positive, time};
use crate::log::Logs;
use crate::model::{InputDigests, log_digest, open_model};
use crate::options::RESULT;
use crate::output::{BadInput, Results, count, note, print_json, warn};
use crate::output_target::Overwrite;
use crate::team::open_key;

/// Write the team configuration: members, grid, frames, and the model of the packets
///
/// The configuration is fixed before the mission.
#[derive(Args)]
#[command(after_help = "Example:\n  pingmap team log.csv --model model.toml --frame-bytes 32 -o team.toml")]
pub struct Options {
    #[command(flatten)]
    pub logs: Logs,
    /// Model file, as `pingmap learn` writes it
    #[arg(long, value_name = "FILE", default_value = "model.toml")]
    pub model: PathBuf,
    /// File with the team's key of 64 hexadecimal digits, if packets are to be authenticated
    #[arg(long, value_name = "FILE")]
    pub key_file: Option<PathBuf>,
    /// Bytes of a frame
    #[arg(long, default_value_t = 32, value_parser = frame_bytes)]
    pub frame_bytes: usize,
    /// Number of the key epoch. Raise it if a key is used for another mission, or if a vehicle lost its memory
    #[arg(long, default_value_t = 0)]
    pub epoch: u32,
    /// Side of a cell of the grid; the finest that covers the log if not given
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub cell_m: Option<f64>,
    /// Start of the mission in seconds of the events' clock, from which packets count time; the log's first event if
    /// not given
    #[arg(long, value_parser = time, allow_negative_numbers = true)]
    pub start_s: Option<f64>,
    /// Longest duration of the mission; later receptions are encoded without a time. The duration of the log if not
    /// given
    #[arg(long, value_parser = mission_s, allow_negative_numbers = true)]
    pub duration_s: Option<f64>,
    /// File for the team
    ///
    /// The file contains the path of the model file relative to its own folder.
    #[arg(help_heading = RESULT, long, short, value_name = "FILE", default_value = "team.toml")]
    pub output: PathBuf,
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Print the configuration as one JSON object
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

/// A team configuration in JSON.
#[derive(Serialize, JsonSchema)]
pub struct TeamJson<'a> {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    digests: InputDigests,
    /// The team file that was written.
    file: &'a Path,
    /// Digest of the team configuration.
    team_digest: String,
    /// Members and their numbers in packets.
    members: Vec<MemberJson<'a>>,
    /// Bytes of a frame.
    frame_bytes: usize,
    /// Number of the key epoch. Packets of another epoch are refused.
    epoch: u32,
    /// Whether packets are authenticated with a key.
    is_authenticated: bool,
    /// Side of a cell east and north in metres.
    cell_m: f64,
    /// Height of a cell in metres.
    depth_cell_m: f64,
    /// Start of the first time cell in seconds.
    start_s: f64,
    /// Length of a time cell in seconds.
    time_cell_s: f64,
    /// Start of the first slot in seconds.
    slots_start_s: f64,
    /// Length of a slot in seconds.
    slot_s: f64,
    /// Whether the log contains a transmission schedule, which is then the team's.
    slots_from_log: bool,
    /// Reference system of the metres; `unknown` if the log does not name it.
    reference_system: String,
}

#[derive(Serialize, JsonSchema)]
pub struct MemberJson<'a> {
    /// Number of the member.
    member: u8,
    /// Name of the vehicle.
    vehicle: &'a str,
}

impl Options {
    pub fn threads(&self) -> usize {
        1
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        write(self, results)
    }
}

fn write(options: &Options, results: Results) -> anyhow::Result<()> {
    let mut inputs = options.logs.paths();
    inputs.extend(options.key_file.as_deref().into_iter().chain([options.model.as_path()]));
    let target = options.overwrite.target(&options.output, &inputs)?.with_json(options.json)?;
    let log = options.logs.open()?;
    let file = open_model(&options.model, &log)?;
    let key = options.key_file.as_deref().map(open_key).transpose()?;
    let positions = log.events.iter().flat_map(|event| event.link.ends());
    let team = Team::new(log.vehicles(), file.model.clone(), positions).map_err(bad_team)?;
    let mut team = Team { key, epoch: options.epoch, ..team.with_frames(options.frame_bytes) };
    if let Some(cell_m) = options.cell_m {
        team.grid.cell_m = cell_m;
        let outside = log.events.iter().filter(|event| !team.quantizer().holds(&event.link)).count();
        if outside > 0 {
            warn(format_args!("{} outside the grid: they cannot be shared", count(outside, "event")));
        }
    }
    team.grid = team.grid.spanning(log.events.iter().map(|event| event.time_s));
    team.grid.start_s = options.start_s.unwrap_or(team.grid.start_s);
    if let Some(duration_s) = options.duration_s {
        team.grid.time_cell_s = duration_s / f64::from(TIME_CELLS - 1);
    }
    let schedule = schedule(&log);
    let is_kept = schedule.is_some();
    team.slots = schedule.unwrap_or(team.slots).aligned_before(team.grid.start_s);
    let key_name = options.key_file.as_ref().map(|path| relative_path(path, &options.output)).transpose()?;
    let model_name = relative_path(&options.model, &options.output)?;
    let text = TeamFile::write(&team, &model_name, key_name.as_deref(), log_digest(&file));
    let text = text.map_err(bad_team)?;
    if options.json {
        let written = target.write(text.as_bytes(), results);
        print_json(results, &TeamJson::of(options, &log, &team, is_kept))?;
        written?;
    } else {
        target.write_or_print(&text, results)?;
    }
    let Grid { cell_m, start_s, time_cell_s, .. } = team.grid;
    let output = options.output.display();
    note(format_args!("team: {output}, cells of {cell_m} m, and of {time_cell_s} s from {start_s} s on"));
    let Slots { start_s, duration_s, .. } = team.slots;
    if is_kept {
        note(format_args!("slots: from the log, {duration_s} s each, from {start_s} s on"));
    } else {
        warn(format_args!(
            "no TDMA schedule found in the log. Add one under [slots]; without it missed receptions cannot be shared as reports"
        ));
    }
    Ok(())
}

impl<'a> TeamJson<'a> {
    fn of(options: &'a Options, log: &EventLog, team: &'a Team, slots_from_log: bool) -> Self {
        let member = |(&member, vehicle): (&u8, &'a VehicleId)| MemberJson { member, vehicle: vehicle.as_str() };
        let Grid { cell_m, depth_cell_m, start_s, time_cell_s } = team.grid;
        Self {
            schema: 1,
            digests: InputDigests { log_digest: log.digest(), model_digest: Some(team.model.digest()) },
            file: &options.output,
            team_digest: to_hex(&team.digest()),
            members: team.members.iter().map(member).collect(),
            frame_bytes: team.frame_bytes,
            epoch: team.epoch,
            is_authenticated: team.key.is_some(),
            cell_m,
            depth_cell_m,
            start_s,
            time_cell_s,
            slots_start_s: team.slots.start_s,
            slot_s: team.slots.duration_s,
            slots_from_log,
            reference_system: team.model.chart.reference.to_string(),
        }
    }
}

/// Returns the path of a file relative to the folder of the team file.
fn relative_path(path: &Path, team_file: &Path) -> anyhow::Result<String> {
    let absolute = std::path::absolute(path)?;
    let team_file = std::path::absolute(team_file)?;
    let mut folder = team_file.parent().unwrap_or(Path::new("/"));
    let mut name = PathBuf::new();
    loop {
        if let Ok(below) = absolute.strip_prefix(folder) {
            return Ok(name.join(below).display().to_string());
        }
        let Some(above) = folder.parent() else { return Ok(absolute.display().to_string()) };
        folder = above;
        name.push("..");
    }
}

fn bad_team(error: TeamError) -> BadInput {
    BadInput(error.to_string())
}

//! The files that the vehicles of a simulated trial would have recorded.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::{Args, ValueEnum};
use pingmap_agent::{Position, ReferenceSystem};
use pingmap_import::{Reference, parse_time, time_in_words};
use pingmap_trial::simulate::{Simulated, Simulation};

use super::bag::bag;
use super::modem::{BROADCAST, DELAY_S, Fix, SOUND_M_PER_S, capture, moos_log, sentences};
use crate::cli_parsers::origin;
use crate::files::{make_folder, write_file};
use crate::output::BadInput;
use crate::output_target::Overwrite;

#[derive(Args)]
#[command(next_help_heading = "Files")]
pub struct Files {
    /// Folder for files as the vehicles would have recorded them
    ///
    /// The files are positions in latitude and longitude, receptions, the schedule, and the modem ids, for `pingmap
    /// import`. The event log then uses the times of these files.
    #[arg(long = "as-files", value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// Kind of these files: tables; MOOS logs; a table of navigation and a capture of modem sentences; or ROS 2 bags
    #[arg(long, value_enum, requires = "folder", default_value_t = FileKind::Tables)]
    files: FileKind,
    /// Offset of the clocks in seconds, except the first vehicle's; vehicles are alternately ahead and behind
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub clock_off_s: f64,
    /// A vehicle that stops recording receptions, and the share of the mission after which it stops
    #[arg(long, value_name = "NAME=SHARE", requires = "folder", value_parser = stop)]
    stops: Option<(String, f64)>,
    /// Also write the transmissions of each vehicle
    #[arg(long, requires = "folder")]
    with_sent: bool,
    /// Latitude and longitude of (0, 0) of the log
    #[arg(long, value_name = "LAT,LON", requires = "folder", value_parser = origin, allow_hyphen_values = true, default_value = "41.52,-70.67")]
    origin: ReferenceSystem,
    /// Start of the mission
    #[arg(long, value_name = "TIME", requires = "folder", value_parser = time, default_value = "2026-05-03T12:00:00Z")]
    start: f64,
}

/// Kinds of files that vehicles record.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FileKind {
    Tables,
    Alog,
    Capture,
    Mcap,
}

fn time(text: &str) -> Result<f64, String> {
    parse_time(text).ok_or_else(|| format!("expected {}", pingmap_import::TIME))
}

fn stop(text: &str) -> Result<(String, f64), String> {
    let parts = text.split_once('=').and_then(|(name, share)| Some((name.to_owned(), share.parse::<f64>().ok()?)));
    parts.filter(|(_, share)| (0.0..=1.0).contains(share)).ok_or_else(|| "expected NAME=SHARE, such as auv2=0.7".into())
}

impl Files {
    /// Refuses a folder that contains files, unless they may be replaced.
    pub fn check(&self, overwrite: Overwrite) -> anyhow::Result<()> {
        self.folder.as_deref().map_or(Ok(()), |folder| overwrite.empty_folder(folder))
    }

    /// Writes the files, if a folder was given, and changes the log's times and reference system to those of the files.
    pub fn write(&self, simulation: &Simulation, trial: &mut Simulated) -> anyhow::Result<()> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let reference = Reference::new(self.origin).map_err(|error| BadInput(error.to_string()))?;
        let known =
            trial.vehicles.iter().any(|(id, _)| self.stops.as_ref().is_none_or(|(name, _)| name == id.as_str()));
        if !known {
            let names: Vec<&str> = trial.vehicles.iter().map(|(id, _)| id.as_str()).collect();
            return Err(BadInput(format!("--stops: expected one of {}", names.join(", "))).into());
        }
        make_folder(folder)?;
        let write = |name: &str, text: String| write_file(&folder.join(name), text.as_bytes());
        for (vehicle, (id, _)) in trial.vehicles.iter().enumerate() {
            let fixes = self.fixes(simulation, trial, vehicle, &reference)?;
            let sentences = || sentences(simulation, trial, vehicle, self.until_s(simulation, id.as_str()));
            let ahead_s = simulation.clock_ahead_s(vehicle);
            if matches!(self.files, FileKind::Tables | FileKind::Capture) {
                write(&format!("{id}.nav.csv"), self.navigation(simulation, vehicle, &fixes))?;
            }
            match self.files {
                FileKind::Alog => {
                    write(&format!("{id}.alog"), moos_log(id.as_str(), &sentences(), &fixes, (self.start, ahead_s)))?;
                }
                FileKind::Mcap => {
                    let bytes = bag(id.as_str(), &sentences(), &fixes, (self.start, ahead_s)).context("a bag")?;
                    write_file(&folder.join(format!("{id}.mcap")), &bytes)?;
                }
                FileKind::Capture => write(&format!("{id}.nmea"), capture(&sentences(), self.start, ahead_s))?,
                FileKind::Tables => write(&format!("{id}.heard.csv"), self.heard(simulation, trial, vehicle))?,
            }
            if self.with_sent && self.files == FileKind::Tables {
                write(&format!("{id}.sent.csv"), self.sent(simulation, vehicle))?;
            }
        }
        write("schedule.toml", self.schedule(simulation, trial))?;
        write("ids.csv", ids(trial))?;
        trial.log.events.iter_mut().for_each(|event| event.time_s += self.start);
        trial.log.reference = reference.system();
        Ok(())
    }

    /// Formats a time as the vehicle's clock shows it.
    fn stamp(&self, simulation: &Simulation, vehicle: usize, time_s: f64) -> String {
        time_in_words(self.start + time_s + simulation.clock_ahead_s(vehicle))
    }

    /// Returns the time at which a vehicle stops recording sentences of its modem.
    fn until_s(&self, simulation: &Simulation, name: &str) -> f64 {
        let stop = self.stops.as_ref().filter(|(stops, _)| stops == name);
        stop.map_or(f64::INFINITY, |(_, share)| share * simulation.slot_s * simulation.slots as f64)
    }

    /// Returns the positions of a vehicle, one per second.
    fn fixes(
        &self,
        simulation: &Simulation,
        trial: &Simulated,
        vehicle: usize,
        reference: &Reference,
    ) -> anyhow::Result<Vec<Fix>> {
        let mut fixes = Vec::new();
        // No clock is so far ahead that another slot begins before this time.
        let end_s = simulation.slot_s * (simulation.slots as f64 + 0.4);
        for second in 0..=end_s as u64 {
            let time_s = second as f64;
            let Position { east_m, north_m, depth_m, .. } = trial.position(vehicle, time_s);
            let place = reference.geographic(east_m, north_m);
            let place = place.ok_or_else(|| {
                BadInput(format!("--origin: no projection covers an area of {} m there", simulation.area_m))
            })?;
            let (latitude_deg, longitude_deg) = (place.latitude_deg, place.longitude_deg);
            let depth_m = depth_m.unwrap_or_default();
            fixes.push(Fix { time_s, east_m, north_m, depth_m, latitude_deg, longitude_deg });
        }
        Ok(fixes)
    }

    fn navigation(&self, simulation: &Simulation, vehicle: usize, fixes: &[Fix]) -> String {
        let mut text = String::from("time,latitude,longitude,depth_m\n");
        for Fix { time_s, depth_m, latitude_deg, longitude_deg, .. } in fixes {
            let stamp = self.stamp(simulation, vehicle, *time_s);
            let _ = writeln!(text, "{stamp},{latitude_deg:.7},{longitude_deg:.7},{depth_m:.1}");
        }
        text
    }

    fn heard(&self, simulation: &Simulation, trial: &Simulated, vehicle: usize) -> String {
        let name = &trial.vehicles[vehicle].0;
        let until_s = self.until_s(simulation, name.as_str());
        let mut text = String::from("time,source,destination\n");
        for event in trial.log.events.iter().filter(|event| event.receiver_id == *name && event.success) {
            let time_s = event.time_s + event.link.range_m() / SOUND_M_PER_S + DELAY_S;
            let source = trial.vehicles.iter().position(|(id, _)| *id == event.transmitter_id).unwrap_or_default() + 1;
            if time_s <= until_s {
                let _ = writeln!(text, "{},{source},{BROADCAST}", self.stamp(simulation, vehicle, time_s));
            }
        }
        text
    }

    fn sent(&self, simulation: &Simulation, vehicle: usize) -> String {
        let own = (0..simulation.slots).filter(|slot| slot % simulation.vehicles == vehicle);
        let line = |slot: usize| {
            let time_s = simulation.slot_s * (slot + 1) as f64 - simulation.clock_ahead_s(vehicle);
            format!("{},{BROADCAST}\n", self.stamp(simulation, vehicle, time_s))
        };
        format!("time,destination\n{}", own.map(line).collect::<String>())
    }

    fn schedule(&self, simulation: &Simulation, trial: &Simulated) -> String {
        let order: Vec<String> = trial.vehicles.iter().map(|(id, _)| format!("\"{id}\"")).collect();
        format!(
            "[slots]\nstart_s = \"{}\"\nduration_s = {}\norder = [{}]\n",
            time_in_words(self.start + simulation.slot_s),
            simulation.slot_s,
            order.join(", ")
        )
    }
}

fn ids(trial: &Simulated) -> String {
    let line = |(number, (id, _)): (usize, &(pingmap_agent::VehicleId, f64))| format!("{},{id}\n", number + 1);
    let vehicles: String = trial.vehicles.iter().enumerate().map(line).collect();
    format!("id,name\n{vehicles}{BROADCAST},broadcast\n")
}

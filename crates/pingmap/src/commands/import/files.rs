//! The input files of an import, and the options that describe them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::{Geographic, ReferenceSystem, VehicleId};
use pingmap_import::{
    EventRecords, ExclusionReason, Fix, IsolatedFixes, MOOS_PREFIX, ModemIds, Place, RecordKind, RecordReader,
    Recordings, Reference, Schedule, SkipCounts, TIME, TableKind, TimeZone, exclude_isolated_fixes, parse_time,
    resolve_modem_ids,
};

use super::input_checks::{check_sqlite_logs, check_vehicles};
use super::origin::{OriginSource, choose_reference, has_metres};
use super::records::{self, RecordFile, Records, note_conversions, open, split_vehicle};
use super::unpacked::Unpacked;
use crate::cli_parsers::{crs, origin, place, positive};
use crate::log::STANDARD_INPUT;
use crate::output::{BadInput, note, progress_of_bytes};

#[derive(Args)]
#[command(next_help_heading = "Files")]
pub struct Files {
    /// Recorded files, or folders or archives of them
    ///
    /// Kinds of files: MOOS logs (.alog) and mission files, Micro-Modem sentences with a time before each, ROS 2 bags
    /// (MCAP, SQLite), LCM logs, tables, ids and a schedule. Archives are ZIP, tar and gzip. Tables have names such as
    /// auv1.nav.csv, auv1.heard.csv and auv1.sent.csv. #TOPIC selects the topics of a bag with this prefix. Without
    /// NAME= the file names its vehicle; - is standard input.
    #[arg(value_name = "[NAME=]FILE[#TOPIC]")]
    records: Vec<String>,
    /// Tables of a vehicle's positions: time, and latitude and longitude or metres. Without NAME= a column names the
    /// vehicle
    #[arg(long, value_name = "[NAME=]FILE", num_args = 1..)]
    pub(super) nav: Vec<String>,
    /// Tables of messages that a vehicle's modem received: time and source
    #[arg(long, value_name = "[NAME=]FILE", num_args = 1..)]
    pub(super) heard: Vec<String>,
    /// Tables of messages that a vehicle sent: time
    #[arg(long, value_name = "[NAME=]FILE", num_args = 1..)]
    pub(super) sent: Vec<String>,
    /// Tables of events with their outcomes, instead of recordings: time, sender, receiver, positions of both, and
    /// whether the message was received
    #[arg(
        long, value_name = "FILE", num_args = 1..,
        conflicts_with_all = [
            "records", "nav", "heard", "sent", "fixed", "schedule", "listening", "not_listening", "always_transmits", "correct_clocks",
            "clock_offset_s_max", "match_s", "message_s", "nav_gap_s_max", "sound_m_per_s", "overhear", "any_frame", "surfaced_above_m",
        ]
    )]
    pub(super) events: Vec<PathBuf>,
    /// Position of a vehicle without navigation: metres, or degrees such as 41.52N,70.67W; and a depth in metres
    #[arg(long, value_name = "NAME=PLACE", value_parser = parse_station)]
    fixed: Vec<(String, Fix)>,
    /// Transmission schedule
    ///
    /// The file is a team file, its part [slots], a table of time_s and source, or the MAC configuration of Goby.
    #[arg(long, value_name = "FILE")]
    schedule: Option<PathBuf>,
    /// Names of modem ids
    ///
    /// The file is a table of id and name. The name broadcast stands for all vehicles.
    #[arg(long, value_name = "FILE")]
    ids: Option<PathBuf>,
    /// Largest size of all files in archives, and of standard input, in GB
    #[arg(long, value_name = "GB", default_value_t = 8.0, value_parser = positive, allow_negative_numbers = true)]
    unpacked_max: f64,
    /// Interval in which a modem was listening; outside of its intervals it was not
    ///
    /// Without the option, a modem was listening from its first to its last record in each file.
    #[arg(long, value_name = "NAME=FROM/TO", num_args = 1.., value_parser = parse_interval)]
    listening: Vec<(String, (f64, f64))>,
    /// Interval in which a modem was not listening
    #[arg(long, value_name = "NAME=FROM/TO", num_args = 1.., value_parser = parse_interval)]
    not_listening: Vec<(String, (f64, f64))>,
    /// Prefix of the modem's variables in MOOS logs: …NMEA_IN, …MODEM_RECEIVE
    #[arg(long, value_name = "PREFIX", default_value = MOOS_PREFIX)]
    acomms_prefix: String,
    /// Zone of dates and times in tables of recordings and events that name none, such as Europe/Berlin or +02:00
    #[arg(long, value_name = "ZONE", default_value = "UTC", allow_hyphen_values = true)]
    time_zone: TimeZone,
    /// Name of a column, such as heard.source=from
    ///
    /// VEHICLE:heard.source=from and FILE:heard.source=from apply to the tables of one vehicle, or to one file. After
    /// an empty name the role has no column.
    #[arg(long, value_name = "ROLE=COLUMN", num_args = 1.., value_parser = split_value)]
    pub(super) column: Vec<(String, String)>,
    /// Names of columns from a TOML file: [heard], source = "from"
    #[arg(long, value_name = "FILE")]
    pub(super) columns: Option<PathBuf>,
    /// Position of (0, 0) of the log; if not given, that of the files, or the rounded mean of all positions in degrees
    #[arg(long, value_name = "LAT,LON", value_parser = origin, allow_hyphen_values = true, conflicts_with = "crs")]
    origin: Option<ReferenceSystem>,
    /// Reference system of metres in the files and the log, such as EPSG:32619
    #[arg(long, value_name = "EPSG:CODE", value_parser = crs)]
    crs: Option<ReferenceSystem>,
}

/// Content of all input files.
pub struct Inputs {
    pub recordings: Recordings,
    /// Events of tables with outcomes. There are no recordings then.
    pub events: Option<EventRecords>,
    pub schedule: Option<Schedule>,
    pub reference: Reference,
    /// Position of (0, 0) of the log, if known, and its source.
    pub origin: Option<(Geographic, OriginSource)>,
    /// Positions that were excluded because they lie far from the rest of their track.
    pub isolated_fixes: Vec<IsolatedFixes>,
    pub skipped: SkipCounts,
    /// Number of messages per source for which nothing else was recorded.
    pub unknown_sources: BTreeMap<VehicleId, usize>,
    /// Files in folders whose kind is unknown.
    pub unknown_files: Vec<PathBuf>,
}

fn split_value(text: &str) -> Result<(String, String), String> {
    let (name, value) = text.split_once('=').ok_or("expected a name, = and a value")?;
    Ok((name.to_owned(), value.to_owned()))
}

fn parse_interval(text: &str) -> Result<(String, (f64, f64)), String> {
    let (name, interval) = split_value(text)?;
    let interval = interval.split_once('/').and_then(|(from, to)| Some((parse_time(from)?, parse_time(to)?)));
    let interval =
        interval.filter(|(from_s, to_s)| from_s <= to_s).ok_or_else(|| format!("expected NAME=FROM/TO with {TIME}"))?;
    Ok((name, interval))
}

fn parse_station(text: &str) -> Result<(String, Fix), String> {
    let (name, value) = split_value(text)?;
    let (place, depth_m) = place(&value).map_err(|error| format!("NAME=PLACE: {error}"))?;
    Ok((name, Fix { time_s: 0.0, place, depth_m }))
}

impl Files {
    /// Reads all files.
    pub fn read(&self) -> anyhow::Result<Inputs> {
        if self.events.is_empty() { self.read_recordings() } else { self.read_events() }
    }

    /// Reads tables of events.
    fn read_events(&self) -> anyhow::Result<Inputs> {
        let mut reader = self.reader()?;
        if let Some(path) = &self.ids {
            reader.ids = ModemIds::read(open(path)?, path)?;
        }
        let mut events = EventRecords::default();
        for path in &self.events {
            let conversions = reader.read_events(open(path)?, path, &mut events)?;
            note_conversions(path, &conversions);
        }
        self.check_scopes(&reader, &Recordings::new(), &[])?;
        let places: Vec<Place> = events.events.iter().flat_map(|event| event.ends.map(|(place, _)| place)).collect();
        let records = Records { has_metres: has_metres(&places), ..Records::default() };
        let (reference, origin) = choose_reference(self.origin.or(self.crs), &places, &records)?;
        let skipped = SkipCounts { missing_positions: events.missing_positions, ..SkipCounts::default() };
        Ok(Inputs {
            recordings: Recordings::new(),
            events: Some(events),
            schedule: None,
            reference,
            origin,
            isolated_fixes: Vec::new(),
            skipped,
            unknown_sources: BTreeMap::new(),
            unknown_files: Vec::new(),
        })
    }

    /// Reads all recordings.
    fn read_recordings(&self) -> anyhow::Result<Inputs> {
        let mut reader = self.reader()?;
        let mut unpacked = Unpacked::new((self.unpacked_max * 1e9) as u64);
        let mut files = records::unpack_archives(records::list_files(&self.records)?, &mut unpacked)?;
        records::detect_kinds(&mut files, &reader)?;
        check_sqlite_logs(&files)?;
        let find = |given: &Option<PathBuf>, kinds: &[RecordKind], option| match given {
            Some(path) => Ok(Some(RecordFile::given(path))),
            None => records::single_file(&files, kinds, option),
        };
        if let Some(file) = find(&self.ids, &[RecordKind::ModemIds], "--ids")? {
            reader.ids = ModemIds::read(file.open()?, &file.name)?;
        }
        let schedule = find(&self.schedule, &[RecordKind::Schedule, RecordKind::TeamFile], "--schedule")?;
        let schedule = schedule.map(|file| Schedule::read(file.open()?, &file.name, &reader.ids)).transpose()?;
        for file in files.iter().filter(|file| file.kind == Some(RecordKind::LcmTypes)) {
            reader.read_lcm_types(file.open()?, &file.name)?;
        }
        let (mut recordings, mut records) = (Recordings::new(), Records::default());
        self.read_records(&files, &reader, &mut records, &mut recordings)?;
        let unknown_sources = resolve_modem_ids(&mut recordings)?;
        for (name, fix) in &self.fixed {
            recordings.entry(VehicleId::new(name)).or_default().station = Some(*fix);
        }
        self.set_listening(&mut recordings)?;
        let isolated_fixes = exclude_isolated_fixes(&mut recordings);
        self.check_scopes(&reader, &recordings, &files)?;
        let fixes = recordings.values().flat_map(|recording| recording.fixes.iter().chain(&recording.station));
        let places: Vec<Place> = fixes.map(|fix| fix.place).collect();
        let (reference, origin) = choose_reference(self.origin.or(self.crs), &places, &records)?;
        let Records { skipped, unknown_files, .. } = records;
        let events = None;
        Ok(Inputs {
            recordings,
            events,
            schedule,
            reference,
            origin,
            isolated_fixes,
            skipped,
            unknown_sources,
            unknown_files,
        })
    }

    /// Adds the intervals in which modems were listening or not, as stated by the user.
    fn set_listening(&self, recordings: &mut Recordings) -> anyhow::Result<()> {
        for (option, intervals) in [("--listening", &self.listening), ("--not-listening", &self.not_listening)] {
            for (name, interval) in intervals {
                let receiver = recordings.get_mut(&VehicleId::new(name));
                let Some(recording) = receiver.filter(|recording| recording.arrivals.is_some()) else {
                    let message = format!("{option} {name}: expected a vehicle with recorded receptions");
                    return Err(BadInput(message).into());
                };
                if option == "--listening" {
                    recording.listening.push(*interval);
                } else {
                    recording.deaf_intervals.push((interval.0, interval.1, ExclusionReason::NotListening));
                }
            }
        }
        Ok(())
    }

    /// Reads all recorded files, and the tables of `--nav`, `--heard` and `--sent`.
    fn read_records(
        &self,
        files: &[RecordFile],
        reader: &RecordReader,
        records: &mut Records,
        recordings: &mut Recordings,
    ) -> anyhow::Result<()> {
        let (tables, logs): (Vec<&RecordFile>, Vec<&RecordFile>) =
            files.iter().partition(|file| matches!(file.kind, Some(RecordKind::Table(_))));
        let option_tables = || {
            let kinds = [
                (TableKind::Navigation, &self.nav),
                (TableKind::Receptions, &self.heard),
                (TableKind::Transmissions, &self.sent),
            ];
            kinds.into_iter().flat_map(|(kind, files)| files.iter().map(move |file| (kind, split_vehicle(file))))
        };
        let lengths = option_tables().filter_map(|(_, (_, path))| Some(path.metadata().ok()?.len()));
        let bar = progress_of_bytes(files.iter().filter_map(RecordFile::length).chain(lengths).sum(), "reading");
        for file in logs {
            records.read_file(file, bar.wrap_read(file.open()?), reader, recordings)?;
            check_vehicles(&file.name, recordings)?;
        }
        // Metres in tables may use --crs. Metres of logs that name their own (0, 0) do not.
        let log_fixes = recordings.values().flat_map(|recording| &recording.fixes);
        records.has_metres = has_metres(log_fixes.map(|fix| &fix.place));
        for file in tables {
            records.read_file(file, bar.wrap_read(file.open()?), reader, recordings)?;
            check_vehicles(&file.name, recordings)?;
        }
        for (kind, (vehicle, path)) in option_tables() {
            let table = (bar.wrap_read(open(path)?), path);
            let summary = reader.read_table(kind, table, vehicle.as_ref(), recordings)?;
            records.skipped = records.skipped.sum(summary.skipped);
            note_conversions(path, &summary.conversions);
            check_vehicles(path, recordings)?;
        }
        bar.finish_and_clear();
        records.detected_tables.iter().for_each(note);
        Ok(())
    }

    /// Returns the paths of all input files.
    pub fn paths(&self) -> anyhow::Result<Vec<PathBuf>> {
        let tables =
            [&self.nav, &self.heard, &self.sent].into_iter().flatten().map(|file| split_vehicle(file).1.to_owned());
        let other_files = [&self.schedule, &self.ids, &self.columns].into_iter().flatten().chain(&self.events).cloned();
        let (reader, records) = (self.reader()?, records::list_files(&self.records)?);
        let records = records.into_iter().filter(|file| records::is_read(file, &reader)).map(|file| file.path);
        let all: Vec<PathBuf> = records.chain(tables).chain(other_files).collect();
        if all.iter().filter(|path| *path == Path::new(STANDARD_INPUT)).count() > 1 {
            return Err(BadInput("standard input (-) is named twice; expected once".into()).into());
        }
        Ok(all)
    }

    /// Returns the options of reading, without the names of ids.
    fn reader(&self) -> anyhow::Result<RecordReader> {
        let moos_prefix = self.acomms_prefix.clone();
        let (columns, time_zone) = (self.columns()?, self.time_zone.clone());
        Ok(RecordReader { columns, time_zone, moos_prefix, ..RecordReader::default() })
    }
}

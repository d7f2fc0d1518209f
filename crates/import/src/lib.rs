//! Imports the recordings of underwater vehicles into one event log.
//!
//! After a mission, each vehicle leaves files in the time of its own clock. They hold its positions, the messages that
//! it received, and perhaps those that it transmitted. A TDMA schedule may exist as well.
//!
//! [`RecordReader`] reads the files into one [`Recording`] for each vehicle. [`join`] aligns the clocks and assigns
//! receptions to transmissions. The result lists every transmission with each receiver that could have decoded it. An
//! event holds both positions, and whether the message was decoded.
//!
//! The log serves to estimate the probability that a message, *once transmitted*, is decoded by a *listening* receiver.
//! A transmission counts only with evidence that it took place ([`TransmissionEvidence`]). It counts only for receivers
//! that were listening. Every exclusion criterion ([`ExclusionReason`]) is independent of the outcome, so that it
//! removes successes and misses alike.
//!
//! ```
//! use std::path::Path;
//! use pingmap_agent::VehicleId;
//! use pingmap_import::{RecordReader, Recordings, Reference, Rules, TableKind, join};
//!
//! let (a, b) = (VehicleId::new("a"), VehicleId::new("b"));
//! let mut recordings = Recordings::new();
//! let mut read = |kind, vehicle, text: &str| {
//!     RecordReader::default().read_table(kind, (text.as_bytes(), Path::new("table")), Some(vehicle), &mut recordings)
//! };
//! read(TableKind::Navigation, &a, "time,x,y\n0,0,0\n60,90,0\n")?;
//! read(TableKind::Navigation, &b, "time,x,y\n0,300,0\n60,300,0\n")?;
//! read(TableKind::Transmissions, &a, "time\n10\n20\n30\n40\n")?;
//! read(TableKind::Receptions, &b, "time,source\n10.2,a\n20.2,a\n40.2,a\n")?;
//! let rules = Rules { nav_gap_s_max: 60.0, ..Rules::default() };
//! let imported = join(&recordings, None, &Reference::unknown(), &rules)?;
//! let outcomes: Vec<bool> = imported.log.events.iter().map(|event| event.success).collect();
//! // The first and the last reception define when b's modem was active. They depend on the outcome and do not count.
//! assert_eq!(outcomes, [true, false]);
//! # Ok::<(), pingmap_import::ImportError>(())
//! ```

#![forbid(unsafe_code)]

// In the order of the flow: each folder uses only those above it.
mod model;
mod readers;
mod assemble;

pub use assemble::clock_estimate::ClockEstimate;
pub use assemble::clocks::clock::{Clock, ClockSegment};
pub use assemble::clocks::fleet_clocks::ClockAmbiguity;
pub use assemble::isolated_fixes::{IsolatedFixes, exclude_isolated_fixes};
pub use assemble::join::join;
pub use assemble::pair_counts::PairCounts;
pub use assemble::recorded_events::join_events;
pub use assemble::resolve_ids::resolve_modem_ids;
pub use assemble::result::{EvidenceCounts, ImportResult, LeftOutCounts};
pub use assemble::rules::{Rules, SlotUse};
pub use assemble::vehicles::transmission::TransmissionEvidence;
pub use assemble::verdict::{Contradiction, compare_with_schedule};
pub use model::error::ImportError;
pub use model::exclusion::ExclusionReason;
pub use model::modem_ids::ModemIds;
pub use model::parsed_file::{SentenceCounts, SkipCounts};
pub use model::recording::{Arrival, Fix, Recording, Recordings, Reply, TransmissionRecord};
pub use model::reference::{Place, Reference, ReferenceError};
pub use model::schedule::Schedule;
pub use model::time::{EpochUnit, TIME, TimeZone, date_in_words, parse_time, time_in_words};
pub use model::utm_zone::UtmZone;
pub use readers::event_table::{EventRecord, EventRecords};
pub use readers::file_kind::{RecordKind, read_head};
pub use readers::lcm::types::LcmTypes;
pub use readers::modem::nmea::nmea_checksum;
pub use readers::modem::stream::{ModemNews, ModemStream};
pub use readers::moos::MOOS_PREFIX;
pub use readers::record_file::{FileSource, FileSummary};
pub use readers::record_reader::RecordReader;
pub use readers::table_records::TableSummary;
pub use readers::tables::columns::Columns;
pub use readers::tables::conversion::Conversion;
pub use readers::tables::roles::{Role, TableKind};
pub use readers::tables::waypoints::{Waypoint, read_waypoints};

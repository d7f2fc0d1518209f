//! The settings of one vehicle.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pingmap_agent::bounds::{INTERVAL_S, LENGTH_M, QUEUE, SETTLE_S, SIGMA_M};
use pingmap_agent::{AgentOptions, Bounds, Sharing, VehicleId};
use pingmap_import::ModemIds;
use serde::{Deserialize, Serialize};

/// Schema version of `vehicle.toml`. Others are refused.
pub const VEHICLE_SCHEMA: u32 = 1;

/// A `vehicle.toml` with every key and its default.
pub const VEHICLE_EXAMPLE: &str = include_str!("example.toml");

/// The content of `vehicle.toml`. Paths are relative to the folder of the file. Keys without a value have the default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleConfig {
    /// Version of the layout of this file: 1.
    pub schema: u32,
    /// Name of this vehicle, a member of the team.
    pub vehicle: VehicleId,
    /// The team file. It names the model, and the key file if the team has a key.
    pub team: PathBuf,
    /// Range with even odds, in metres: the answer before any event, and by range alone with few events. Without it
    /// these answers come from the model of the team, and from the share heard so far.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conservative_range_m: Option<f64>,
    /// Members whose frames have no effect.
    #[serde(default)]
    pub muted: Vec<VehicleId>,
    /// The store.
    #[serde(default)]
    pub store: StoreSettings,
    /// Clocks.
    #[serde(default)]
    pub clock: ClockSettings,
    /// Slots and listening.
    #[serde(default)]
    pub slots: SlotSettings,
    /// Modem ids and the vehicles behind them, for `nmea` messages. An id that is not listed is itself a name.
    #[serde(default)]
    pub modem_ids: BTreeMap<String, VehicleId>,
    /// Kinds of frames that the vehicle sends.
    #[serde(default)]
    pub sharing: SharingSettings,
    /// Navigation.
    #[serde(default)]
    pub navigation: NavigationSettings,
    /// The connection to the host.
    #[serde(default)]
    pub host: HostSettings,
    /// The log of the process.
    #[serde(default)]
    pub log: LogSettings,
}

/// See [`VehicleConfig::store`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StoreSettings {
    /// Path of the store; `NAME.redb` if absent, with the name of the vehicle.
    pub path: Option<PathBuf>,
    /// Path of the snapshot; `NAME.snapshot` next to the store if absent.
    pub snapshot: Option<PathBuf>,
    /// Seconds between snapshots.
    pub snapshot_interval_s: f64,
}

impl Default for StoreSettings {
    fn default() -> Self {
        Self { path: None, snapshot: None, snapshot_interval_s: 600.0 }
    }
}

/// See [`VehicleConfig::clock`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClockSettings {
    /// Standard deviation of the clock of the host in seconds, unless a message states one.
    pub sigma_s: f64,
    /// Slots do not count while the standard deviation exceeds this number of seconds. A quarter of a slot if absent.
    pub sigma_max_s: Option<f64>,
    /// Slots do not count across a gap of this number of seconds without a message that moves the clock: the host or
    /// its clock had stopped.
    pub gap_s: f64,
}

impl Default for ClockSettings {
    fn default() -> Self {
        Self { sigma_s: 0.1, sigma_max_s: None, gap_s: 30.0 }
    }
}

/// See [`VehicleConfig::slots`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SlotSettings {
    /// Whether the vehicle listens unless the host reports that it does not. False: it listens only in the intervals
    /// that the host reports.
    pub listens: bool,
    /// Whether the host reports every own transmission (`sent`, `departed`). The vehicle then tells the team which of
    /// its slots it did not use.
    pub reports_transmissions: bool,
    /// Seconds after the end of a slot at which it is counted. Receptions that arrive later do not count. Two seconds
    /// cover the travel of sound over three kilometres.
    pub settle_s: f64,
}

impl Default for SlotSettings {
    fn default() -> Self {
        Self { listens: true, reports_transmissions: true, settle_s: 5.0 }
    }
}

/// See [`VehicleConfig::sharing`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SharingSettings {
    /// Whether the vehicle sends reports: single outcomes by slot, and its track.
    pub reports: bool,
    /// Whether the vehicle sends summaries, for events that no report carries.
    pub summaries: bool,
}

impl Default for SharingSettings {
    fn default() -> Self {
        Self { reports: true, summaries: true }
    }
}

/// See [`VehicleConfig::navigation`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NavigationSettings {
    /// Seconds between stored positions. Positions in between are used and not stored.
    pub interval_s: f64,
    /// Positions with a larger standard deviation do not count, in metres.
    pub sigma_max_m: f64,
}

impl Default for NavigationSettings {
    fn default() -> Self {
        Self { interval_s: 5.0, sigma_max_m: 100.0 }
    }
}

/// See [`VehicleConfig::host`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HostSettings {
    /// Where the host connects: `stdio`, `unix:PATH`, or `tcp:ADDRESS:PORT`.
    pub listen: String,
    /// Messages that wait in each direction, at most.
    pub queue: usize,
}

impl Default for HostSettings {
    fn default() -> Self {
        Self { listen: "stdio".into(), queue: 1000 }
    }
}

/// See [`VehicleConfig::log`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LogSettings {
    /// Least severe level: `error`, `warn`, `info`, `debug` or `trace`.
    pub level: String,
    /// Form of the lines on standard error: `text` or `json`.
    pub format: LogFormat,
}

impl Default for LogSettings {
    fn default() -> Self {
        Self { level: "info".into(), format: LogFormat::Text }
    }
}

/// Form of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// One line of text for each entry.
    Text,
    /// One JSON object for each entry.
    Json,
}

/// Error in `vehicle.toml`.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The text is not TOML, or a key is unknown, missing or of the wrong type.
    #[error("{0}")]
    Syntax(String),
    /// The schema is not that of this version.
    #[error("schema {0}, but this version reads schema {VEHICLE_SCHEMA}")]
    OtherSchema(u32),
    /// A number is out of bounds.
    #[error("{key} must be {expected}, found {found}")]
    OutOfBounds {
        /// The key.
        key: &'static str,
        /// The bounds.
        expected: Bounds,
        /// The number that was found.
        found: f64,
    },
    /// A text has no valid meaning.
    #[error("{key} must be {expected}, found {found:?}")]
    WrongText {
        /// The key.
        key: &'static str,
        /// The valid texts.
        expected: &'static str,
        /// The text that was found.
        found: String,
    },
}

/// Where the host connects.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Listen {
    /// Standard input and output.
    Stdio,
    /// A Unix socket.
    Unix(PathBuf),
    /// A TCP address with its port.
    Tcp(String),
}

impl VehicleConfig {
    /// Returns a configuration with all defaults.
    pub fn new(vehicle: VehicleId, team: PathBuf) -> Self {
        Self {
            schema: VEHICLE_SCHEMA,
            vehicle,
            team,
            conservative_range_m: None,
            muted: Vec::new(),
            store: StoreSettings::default(),
            clock: ClockSettings::default(),
            slots: SlotSettings::default(),
            modem_ids: BTreeMap::new(),
            sharing: SharingSettings::default(),
            navigation: NavigationSettings::default(),
            host: HostSettings::default(),
            log: LogSettings::default(),
        }
    }

    /// Reads the text of `vehicle.toml`.
    ///
    /// # Errors
    /// [`ConfigError`] that names the key.
    pub fn parse(text: &str) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text).map_err(|error| ConfigError::Syntax(error.to_string()))?;
        if config.schema != VEHICLE_SCHEMA {
            return Err(ConfigError::OtherSchema(config.schema));
        }
        let numbers = [
            ("conservative_range_m", LENGTH_M, config.conservative_range_m),
            ("store.snapshot_interval_s", INTERVAL_S, Some(config.store.snapshot_interval_s)),
            ("clock.sigma_s", INTERVAL_S, Some(config.clock.sigma_s)),
            ("clock.sigma_max_s", INTERVAL_S, config.clock.sigma_max_s),
            ("clock.gap_s", INTERVAL_S, Some(config.clock.gap_s)),
            ("slots.settle_s", SETTLE_S, Some(config.slots.settle_s)),
            ("navigation.interval_s", INTERVAL_S, Some(config.navigation.interval_s)),
            ("navigation.sigma_max_m", SIGMA_M, Some(config.navigation.sigma_max_m)),
            ("host.queue", QUEUE, Some(config.host.queue as f64)),
        ];
        for (key, expected, value) in numbers {
            if let Some(found) = value.filter(|&value| expected.check(value).is_none()) {
                return Err(ConfigError::OutOfBounds { key, expected, found });
            }
        }
        let level = config.log.level.as_str();
        if !["error", "warn", "info", "debug", "trace"].contains(&level) {
            let expected = "error, warn, info, debug or trace";
            return Err(ConfigError::WrongText { key: "log.level", expected, found: level.into() });
        }
        config.listen()?;
        Ok(config)
    }

    /// Returns where the host connects.
    ///
    /// # Errors
    /// [`ConfigError::WrongText`] for another text than those of [`HostSettings::listen`].
    pub fn listen(&self) -> Result<Listen, ConfigError> {
        let text = self.host.listen.as_str();
        let wrong = || ConfigError::WrongText {
            key: "host.listen",
            expected: "stdio, unix:PATH, or tcp:ADDRESS:PORT",
            found: text.into(),
        };
        match text.split_once(':') {
            None if text == "stdio" => Ok(Listen::Stdio),
            Some(("unix", path)) if !path.is_empty() => Ok(Listen::Unix(path.into())),
            Some(("tcp", address)) => match address.rsplit_once(':') {
                Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok() => {
                    Ok(Listen::Tcp(address.into()))
                }
                _ => Err(wrong()),
            },
            _ => Err(wrong()),
        }
    }

    /// Returns the options of the agent.
    pub(crate) fn agent_options(&self) -> AgentOptions {
        let SharingSettings { reports, summaries } = self.sharing;
        AgentOptions { sharing: Sharing { reports, summaries, ..Sharing::default() }, ..AgentOptions::default() }
    }

    /// Returns the vehicles behind modem ids.
    pub(crate) fn modem_ids(&self) -> ModemIds {
        ModemIds::from_pairs(self.modem_ids.clone())
    }

    /// Returns the paths of the store and of its snapshot. `folder` is that of the configuration.
    pub fn store_paths(&self, folder: &Path) -> (PathBuf, PathBuf) {
        let StoreSettings { path, snapshot, .. } = &self.store;
        let path = path.clone().unwrap_or_else(|| format!("{}.redb", self.vehicle).into());
        let snapshot = snapshot.clone().unwrap_or_else(|| path.with_file_name(format!("{}.snapshot", self.vehicle)));
        (folder.join(path), folder.join(snapshot))
    }
}

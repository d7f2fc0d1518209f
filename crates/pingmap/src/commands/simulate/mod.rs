//! `pingmap simulate`: simulates a field trial.

mod bag;
mod files;
mod modem;

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use pingmap_agent::{Interrupt, VehicleId};
use pingmap_trial::EventLog;
use pingmap_trial::simulate::{
    self, Absorption, CLEARANCE_M, Seawater, Simulated, Simulation, wind_of_sea_state_m_per_s,
};
use schemars::JsonSchema;
use serde::Serialize;

use self::files::Files;
use crate::cli_parsers::{sea_state, whole_number};
use crate::interruptible::Interruptible;
use crate::model::InputDigests;
use crate::output::{BadInput, Results, count, print_json, table};
use crate::output_target::{Overwrite, RESULT};

/// Simulate a field trial with an acoustic channel of published formulas
///
/// The vehicles follow survey legs and transmit in the slots of a schedule.
#[derive(Args)]
#[command(
    after_long_help = "Examples:\n  pingmap simulate --vehicles 3 -o log.csv\n  pingmap simulate --files alog --as-files mission -o truth.csv"
)]
pub struct Options {
    /// Number of vehicles
    ///
    /// Vehicles transmit in cyclic slots, and all others listen.
    #[arg(long, default_value_t = Simulation::default().vehicles, value_parser = whole_number, allow_negative_numbers = true)]
    pub vehicles: usize,
    /// Number of transmissions
    #[arg(long, default_value_t = Simulation::default().slots, value_parser = whole_number, allow_negative_numbers = true)]
    pub slots: usize,
    /// Seconds from one transmission to the next
    #[arg(long, default_value_t = Simulation::default().slot_s, allow_negative_numbers = true)]
    pub slot_s: f64,
    /// Side of the square that is surveyed
    #[arg(long, default_value_t = Simulation::default().area_m, allow_negative_numbers = true)]
    pub area_m: f64,
    /// Speed of the vehicles
    #[arg(long, default_value_t = Simulation::default().speed_m_per_s, allow_negative_numbers = true)]
    pub speed_m_per_s: f64,
    /// Depth of the vehicles; they rise over shallow floor
    #[arg(long, default_value_t = Simulation::default().depth_m, allow_negative_numbers = true)]
    pub depth_m: f64,
    /// Seed of sea floor, tracks, noise and outcomes
    #[arg(long, default_value_t = Simulation::default().seed)]
    pub seed: u64,
    /// File for the event log
    #[arg(help_heading = RESULT, long, short, value_name = "FILE", default_value = "trial.csv")]
    pub output: PathBuf,
    /// Also write the depths of both ends; pingmap then learns from six inputs instead of four
    #[arg(long)]
    pub depths: bool,
    #[command(flatten)]
    pub sound: Sound,
    #[command(flatten)]
    pub floor: Floor,
    #[command(flatten)]
    pub files: Files,
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Print one JSON object instead of a summary
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

#[derive(Args)]
#[command(next_help_heading = "Sound")]
pub struct Sound {
    /// Centre of the band
    #[arg(long, default_value_t = simulate::Sound::default().frequency_khz, allow_negative_numbers = true)]
    pub frequency_khz: f64,
    /// Width of the band
    #[arg(long, default_value_t = simulate::Sound::default().bandwidth_khz, allow_negative_numbers = true)]
    pub bandwidth_khz: f64,
    /// Source level, dB re 1 µPa at 1 m
    #[arg(long, default_value_t = simulate::Sound::default().source_level_db, allow_negative_numbers = true)]
    pub source_level_db: f64,
    /// Exponent of spreading: 1 for a cylinder, 2 for a sphere
    #[arg(long, default_value_t = simulate::Sound::default().spreading, allow_negative_numbers = true)]
    pub spreading: f64,
    /// Formula of absorption
    #[arg(long, value_enum, default_value_t = AbsorptionName::FrancoisGarrison)]
    pub absorption: AbsorptionName,
    /// Temperature of the water
    #[arg(long, default_value_t = Seawater::default().temperature_c, allow_negative_numbers = true)]
    pub temperature_c: f64,
    /// Salinity, grams per kilogram; 0 in a lake
    #[arg(long, default_value_t = Seawater::default().salinity, allow_negative_numbers = true)]
    pub salinity: f64,
    /// Acidity
    #[arg(long, default_value_t = Seawater::default().ph, allow_negative_numbers = true)]
    pub ph: f64,
    /// Sea state, 0 to 6
    #[arg(long, default_value_t = 3.0, value_parser = sea_state, allow_negative_numbers = true)]
    pub sea_state: f64,
    /// Wind speed in place of the sea state's
    #[arg(long, conflicts_with = "sea_state", allow_negative_numbers = true)]
    pub wind_m_per_s: Option<f64>,
    /// Distant shipping: 0 none, 1 heavy
    #[arg(long, default_value_t = simulate::Sound::default().shipping, allow_negative_numbers = true)]
    pub shipping: f64,
    /// Noise of a receiving vehicle, dB re 1 µPa²/Hz; the mean over vehicles
    #[arg(long, default_value_t = Simulation::default().self_noise_db, allow_negative_numbers = true)]
    pub self_noise_db: f64,
    /// Standard deviation of the noise over vehicles
    #[arg(long, default_value_t = Simulation::default().self_noise_spread_db, allow_negative_numbers = true)]
    pub self_noise_spread_db: f64,
    /// Signal-to-noise ratio at which half of the messages are received
    #[arg(long, default_value_t = simulate::Sound::default().threshold_db, allow_negative_numbers = true)]
    pub threshold_db: f64,
    /// Standard deviation of the level about its mean
    #[arg(long, default_value_t = simulate::Sound::default().fading_db, allow_negative_numbers = true)]
    pub fading_db: f64,
    /// Loss of a message that travels against the favoured bearing; across it half as much
    #[arg(long, default_value_t = simulate::Sound::default().direction_loss_db, allow_negative_numbers = true)]
    pub direction_loss_db: f64,
    /// Bearing of messages without that loss, degrees clockwise from north
    #[arg(long, default_value_t = simulate::Sound::default().favoured_bearing_deg, allow_negative_numbers = true)]
    pub favoured_bearing_deg: f64,
    /// Amplitude of a slow change of the noise: a sine over time about its mean
    #[arg(long, default_value_t = simulate::Sound::default().noise_swing_db, allow_negative_numbers = true)]
    pub noise_swing_db: f64,
    /// Period of that change
    #[arg(long, default_value_t = simulate::Sound::default().noise_period_s, allow_negative_numbers = true)]
    pub noise_period_s: f64,
}

#[derive(Args)]
#[command(next_help_heading = "Sea floor")]
pub struct Floor {
    /// Depth of the flat floor
    #[arg(long, default_value_t = Simulation::default().water_depth_m, allow_negative_numbers = true)]
    pub water_depth_m: f64,
    /// Height of a ridge across the area; if not given, four fifths of the depth, limited by the vehicles' clearance
    #[arg(long, allow_negative_numbers = true)]
    pub ridge_m: Option<f64>,
    /// Height of a mound; three quarters of the depth if not given
    #[arg(long, allow_negative_numbers = true)]
    pub mound_m: Option<f64>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AbsorptionName {
    /// Thorp 1967: sea water at 4 °C
    Thorp,
    /// Francois and Garrison 1982: sea water of any temperature, salinity and acidity
    FrancoisGarrison,
}

impl Options {
    pub fn threads(&self) -> usize {
        1
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        run(self, results)
    }

    /// Returns the simulated mission.
    pub fn simulation(&self) -> Simulation {
        let Self { vehicles, slots, slot_s, area_m, speed_m_per_s, depth_m, seed, .. } = *self;
        let Sound { self_noise_db, self_noise_spread_db, .. } = self.sound;
        let Floor { water_depth_m, ridge_m, mound_m } = self.floor;
        let share = |share: f64| (share * water_depth_m).min(water_depth_m - CLEARANCE_M).max(0.0);
        let (ridge_m, mound_m) = (ridge_m.unwrap_or(share(0.8)), mound_m.unwrap_or(share(0.75)));
        Simulation {
            vehicles,
            slots,
            slot_s,
            area_m,
            speed_m_per_s,
            depth_m,
            self_noise_db,
            self_noise_spread_db,
            water_depth_m,
            ridge_m,
            mound_m,
            clock_off_s: self.files.clock_off_s,
            seed,
        }
    }

    /// Returns the properties of source, water and receivers.
    pub fn sound(&self) -> simulate::Sound {
        let Sound { frequency_khz, bandwidth_khz, source_level_db, spreading, shipping, .. } = self.sound;
        let Sound { direction_loss_db, favoured_bearing_deg, noise_swing_db, noise_period_s, .. } = self.sound;
        let Sound { threshold_db, fading_db, temperature_c, salinity, ph, sea_state, .. } = self.sound;
        let absorption = match self.sound.absorption {
            AbsorptionName::Thorp => Absorption::Thorp,
            AbsorptionName::FrancoisGarrison => Absorption::FrancoisGarrison,
        };
        simulate::Sound {
            source_level_db,
            frequency_khz,
            bandwidth_khz,
            spreading,
            absorption,
            water: Seawater { temperature_c, salinity, ph, depth_m: self.depth_m },
            wind_m_per_s: self.sound.wind_m_per_s.unwrap_or(wind_of_sea_state_m_per_s(sea_state)),
            shipping,
            threshold_db,
            fading_db,
            direction_loss_db,
            favoured_bearing_deg,
            noise_swing_db,
            noise_period_s,
        }
    }
}

/// Disclaimer about simulated trials.
const STAND_IN: &str =
    "simulated, a stand-in for a field trial: sound travels in straight lines, without refraction or multipath";

fn run(options: &Options, results: Results) -> anyhow::Result<()> {
    let simulation = options.simulation();
    let target = options.overwrite.target(&options.output, &[])?.with_json(options.json)?;
    options.files.check(options.overwrite)?;
    let mut trial = simulation.run(&options.sound()).map_err(|error| BadInput(error.to_string()))?;
    trial.log.has_depths = options.depths;
    Interrupt::check()?;
    options.files.write(&simulation, &mut trial)?;
    let text = trial.log.to_csv();
    Interrupt::check()?;
    let written = target.write(text.as_bytes(), results);
    if options.json {
        // The JSON describes the log as a reader gets it: numbers are rounded, and depths may be missing.
        let log = EventLog::read(Interruptible(text.as_bytes()), &options.output)?;
        print_json(results, &SimulatedJson::of(&simulation, &trial, &log))?;
    } else {
        target.print_message(&format!("{}: {}", options.output.display(), summary(&simulation, &trial)), results)?;
    }
    written
}

fn summary(simulation: &Simulation, trial: &Simulated) -> String {
    let row = |(id, noise_db): &(VehicleId, f64)| {
        let (events, heard) = events_and_heard(trial, id);
        vec![
            id.to_string(),
            format!("{noise_db:.1}"),
            format!("{:.0}", trial.channel.even_odds_range_m(*noise_db)),
            events.to_string(),
            if events > 0 { format!("{:.3}", heard as f64 / events as f64) } else { "–".into() },
        ]
    };
    let header = ["vehicle", "own noise (dB)", "even odds at (m)", "events", "heard"];
    format!(
        "{} of {} in {:.1} hours.\n\n{}\n\nEven odds: over a flat floor. This log is {STAND_IN}.",
        count(trial.log.events.len(), "event"),
        count(simulation.vehicles, "vehicle"),
        simulation.slots as f64 * simulation.slot_s / 3600.0,
        table(&header, &trial.vehicles.iter().map(row).collect::<Vec<_>>()),
    )
}

/// A simulated trial in JSON.
#[derive(Serialize, JsonSchema)]
pub struct SimulatedJson {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    digests: InputDigests,
    /// Disclaimer about simulated trials.
    note: &'static str,
    /// Seed of all random numbers.
    seed: u64,
    /// Number of events of the log.
    events: usize,
    /// Vehicles of the trial.
    vehicles: Vec<VehicleJson>,
    /// A ridge across the area.
    ridge: RidgeJson,
    /// A mound in the area.
    mound: MoundJson,
}

#[derive(Serialize, JsonSchema)]
pub struct VehicleJson {
    /// Name of the vehicle.
    vehicle: String,
    /// Spectrum level of the vehicle's own noise, in dB re 1 µPa²/Hz.
    self_noise_db: f64,
    /// Range in metres at which the vehicle hears half of all messages over a flat floor.
    even_odds_range_m: f64,
    /// Number of messages to the vehicle.
    events: usize,
    /// Number of these messages that it heard.
    successes: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct RidgeJson {
    /// Easting of a point on the crest in metres.
    easting_m: f64,
    /// Northing of a point on the crest in metres.
    northing_m: f64,
    /// Direction of the crest in radians, from east to north.
    direction_rad: f64,
    /// Height in metres.
    height_m: f64,
    /// Standard deviation of the profile in metres.
    width_m: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct MoundJson {
    /// Easting of the top in metres.
    easting_m: f64,
    /// Northing of the top in metres.
    northing_m: f64,
    /// Height in metres.
    height_m: f64,
    /// Standard deviation of the profile in metres.
    width_m: f64,
}

impl SimulatedJson {
    fn of(simulation: &Simulation, trial: &Simulated, log: &EventLog) -> Self {
        let vehicle = |(id, noise_db): &(VehicleId, f64)| {
            let (events, successes) = events_and_heard(trial, id);
            VehicleJson {
                vehicle: id.to_string(),
                self_noise_db: *noise_db,
                even_odds_range_m: trial.channel.even_odds_range_m(*noise_db),
                events,
                successes,
            }
        };
        let (ridge, mound) = (&trial.channel.floor.ridge, &trial.channel.floor.mound);
        Self {
            schema: 1,
            digests: InputDigests { log_digest: log.digest(), model_digest: None },
            note: STAND_IN,
            seed: simulation.seed,
            events: trial.log.events.len(),
            vehicles: trial.vehicles.iter().map(vehicle).collect(),
            ridge: RidgeJson {
                easting_m: ridge.east_m,
                northing_m: ridge.north_m,
                direction_rad: ridge.direction_rad,
                height_m: ridge.height_m,
                width_m: ridge.width_m,
            },
            mound: MoundJson {
                easting_m: mound.east_m,
                northing_m: mound.north_m,
                height_m: mound.height_m,
                width_m: mound.width_m,
            },
        }
    }
}

/// Returns the number of events that a vehicle received or missed, and the number that it heard.
fn events_and_heard(trial: &Simulated, id: &VehicleId) -> (usize, usize) {
    let own = || trial.log.events.iter().filter(|event| event.receiver_id == *id);
    (own().count(), own().filter(|event| event.success).count())
}

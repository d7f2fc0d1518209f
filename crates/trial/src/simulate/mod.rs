//! Simulated field trials: vehicles on survey legs, a slot schedule, and an acoustic channel of published formulas
//! (docs/method/simulation.md). A simulation is a stand-in for measured data: sound travels in straight lines, without
//! refraction or multipath.

mod error;
mod acoustics;
mod sea_floor;
mod channel;
mod survey;

use pingmap_agent::{Event, Link, Position, ReferenceSystem, VehicleId};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

pub use acoustics::{
    Seawater, ambient_noise_db, diffraction_unit_m, francois_garrison_db_per_km, knife_edge_loss_db, spreading_loss_db,
    thorp_db_per_km, wind_of_sea_state_m_per_s,
};
pub use channel::{Absorption, Channel, Sound};
pub use error::SimulationError;
pub use sea_floor::{Mound, Ridge, SeaFloor};

use crate::event_log::EventLog;
use crate::streams::{self, stream};
use error::within;
use survey::Legs;

/// Largest number of vehicles of a simulated team.
pub const VEHICLES_MAX: usize = 64;

/// Largest number of events of a simulated trial.
pub const EVENTS_MAX: usize = 1_000_000;

/// Smallest altitude of a vehicle above the floor; vehicles rise over obstacles.
const ALTITUDE_MIN_M: f64 = 3.0;

/// Smallest depth of a vehicle below the surface.
const DEPTH_MIN_M: f64 = 0.5;

/// Smallest water depth over ridge and mound, metres.
pub const CLEARANCE_M: f64 = ALTITUDE_MIN_M + DEPTH_MIN_M;

/// Streams of random numbers: sea floor, events, then one for each vehicle.
const FLOOR_STREAM: u64 = streams::SIMULATION;
const EVENT_STREAM: u64 = FLOOR_STREAM + 1;
const VEHICLE_STREAMS: u64 = FLOOR_STREAM + 2;

/// Parameters of a simulated mission.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// Number of vehicles, 2 to [`VEHICLES_MAX`].
    pub vehicles: usize,
    /// Number of transmissions; limited to [`EVENTS_MAX`] events. Vehicles transmit in cyclic slots, and all others
    /// listen.
    pub slots: usize,
    /// Seconds from one transmission to the next.
    pub slot_s: f64,
    /// Side of the square that is surveyed, metres.
    pub area_m: f64,
    /// Speed of the vehicles, m/s.
    pub speed_m_per_s: f64,
    /// Depth of the vehicles in metres; less over shallow floor.
    pub depth_m: f64,
    /// Spectrum level of a vehicle's own noise, dB re 1 µPa²/Hz; the mean over vehicles.
    pub self_noise_db: f64,
    /// Standard deviation of the own noise over vehicles, dB.
    pub self_noise_spread_db: f64,
    /// Depth of the flat sea floor, metres.
    pub water_depth_m: f64,
    /// Height of a ridge across the area, metres; its course is random.
    pub ridge_m: f64,
    /// Height of a mound, metres; its position is random.
    pub mound_m: f64,
    /// Offset of the clocks in seconds. The first vehicle's clock is right; the others are alternately ahead and
    /// behind. Each vehicle transmits by its own clock.
    pub clock_off_s: f64,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for Simulation {
    /// Returns a mission of three vehicles in a bay with a ridge and a mound, which shadow links.
    fn default() -> Self {
        Self {
            vehicles: 3,
            slots: 400,
            slot_s: 10.0,
            area_m: 1400.0,
            speed_m_per_s: 1.5,
            depth_m: 10.0,
            self_noise_db: 45.0,
            self_noise_spread_db: 3.0,
            water_depth_m: 30.0,
            ridge_m: 24.0,
            mound_m: 22.5,
            clock_off_s: 0.0,
            seed: 1,
        }
    }
}

/// A simulated trial.
#[derive(Debug, Clone)]
pub struct Simulated {
    /// Events with depths and true probabilities.
    pub log: EventLog,
    /// Vehicles with the spectrum level of their own noise, dB re 1 µPa²/Hz.
    pub vehicles: Vec<(VehicleId, f64)>,
    /// The channel with the random sea floor.
    pub channel: Channel,
    tracks: Vec<Legs>,
    simulation: Simulation,
}

impl Simulated {
    /// Returns the position of a vehicle at a time. `vehicle` counts from 0.
    pub fn position(&self, vehicle: usize, time_s: f64) -> Position {
        self.simulation.place(&self.tracks[vehicle], time_s, &self.channel.floor)
    }
}

impl Simulation {
    /// Simulates a trial. Sea floor, own noise and starts of tracks are random. Positions are rounded to a tenth of a
    /// metre and probabilities to 1e-4; outcomes are drawn from the rounded numbers. O(vehicles · slots).
    ///
    /// ```
    /// use pingmap_trial::simulate::{Simulation, Sound};
    ///
    /// let trial = Simulation { vehicles: 2, slots: 100, ..Default::default() }.run(&Sound::default())?;
    /// assert_eq!(trial.log.events.len(), 100);
    /// assert!(trial.log.true_probability.is_some());
    /// # Ok::<(), pingmap_trial::simulate::SimulationError>(())
    /// ```
    ///
    /// # Errors
    /// Returns [`SimulationError`] for impossible numbers.
    pub fn run(&self, sound: &Sound) -> Result<Simulated, SimulationError> {
        self.check()?;
        sound.check()?;
        let channel = Channel { sound: *sound, floor: self.floor() };
        let (tracks, vehicles): (Vec<Legs>, Vec<(VehicleId, f64)>) =
            (0..self.vehicles).map(|vehicle| self.vehicle(vehicle)).unzip();
        let mut rng = stream(self.seed, EVENT_STREAM);
        let mut events = Vec::with_capacity(self.slots * (self.vehicles - 1));
        let mut probabilities = Vec::with_capacity(events.capacity());
        for slot in 0..self.slots {
            let transmitter = slot % self.vehicles;
            let time_s = self.slot_s * (slot + 1) as f64 - self.clock_ahead_s(transmitter);
            let places: Vec<Position> = tracks.iter().map(|legs| self.place(legs, time_s, &channel.floor)).collect();
            for receiver in (0..self.vehicles).filter(|&receiver| receiver != transmitter) {
                let link = Link { transmitter: places[transmitter], receiver: places[receiver] };
                let (receiver_id, self_noise_db) = vehicles[receiver].clone();
                let probability = rounded(channel.probability_at_time(&link, self_noise_db, time_s), 1e4);
                let transmitter_id = vehicles[transmitter].0.clone();
                let success = rng.random::<f64>() < probability;
                events.push(Event { time_s, transmitter_id, receiver_id, link, kind: None, success });
                probabilities.push(probability);
            }
        }
        let true_probability = Some(probabilities);
        let mut log = EventLog {
            events,
            true_probability,
            has_depths: true,
            has_headings: false,
            unknown_columns: Vec::new(),
            reference: ReferenceSystem::Unknown,
        };
        log.derive_headings();
        Ok(Simulated { log, vehicles, channel, tracks, simulation: self.clone() })
    }

    /// Returns the offset of a vehicle's clock from true time in seconds; positive if ahead. `vehicle` counts from 0.
    pub fn clock_ahead_s(&self, vehicle: usize) -> f64 {
        match vehicle {
            0 => 0.0,
            odd if odd % 2 == 1 => self.clock_off_s,
            _ => -self.clock_off_s,
        }
    }

    fn check(&self) -> Result<(), SimulationError> {
        let height_max_m = self.water_depth_m - CLEARANCE_M;
        within("number of vehicles", self.vehicles as f64, 2.0, VEHICLES_MAX as f64)?;
        within("number of slots", self.slots as f64, 1.0, (EVENTS_MAX / (self.vehicles - 1)) as f64)?;
        within("slot (s)", self.slot_s, 1e-3, 1e6)?;
        within("area (m)", self.area_m, 10.0, 1e6)?;
        within("speed (m/s)", self.speed_m_per_s, 0.0, 100.0)?;
        within("water depth (m)", self.water_depth_m, CLEARANCE_M, 11_000.0)?;
        within("depth of the vehicles (m)", self.depth_m, DEPTH_MIN_M, self.water_depth_m - ALTITUDE_MIN_M)?;
        within("height of the ridge (m)", self.ridge_m, 0.0, height_max_m)?;
        within("clocks off by (s)", self.clock_off_s, 0.0, self.slot_s / 2.0)?;
        within("height of the mound (m)", self.mound_m, 0.0, height_max_m)?;
        within("vehicles' own noise (dB)", self.self_noise_db, -100.0, 250.0)?;
        within("spread of the vehicles' own noise (dB)", self.self_noise_spread_db, 0.0, 50.0)
    }

    fn floor(&self) -> SeaFloor {
        let mut rng = stream(self.seed, FLOOR_STREAM);
        let mut place = |from: f64, to: f64| self.area_m * (from + (to - from) * rng.random::<f64>());
        let (east_m, north_m) = (place(0.35, 0.65), place(0.35, 0.65));
        let ridge_width_m = place(0.02, 0.04);
        let mound = Mound {
            east_m: place(0.2, 0.8),
            north_m: place(0.2, 0.8),
            height_m: self.mound_m,
            width_m: place(0.04, 0.08),
        };
        let direction_rad = rng.random::<f64>() * std::f64::consts::PI;
        let ridge = Ridge { east_m, north_m, direction_rad, height_m: self.ridge_m, width_m: ridge_width_m };
        SeaFloor { depth_m: self.water_depth_m, ridge, mound }
    }

    /// Returns a vehicle's track, name and own noise.
    fn vehicle(&self, vehicle: usize) -> (Legs, (VehicleId, f64)) {
        let mut rng: ChaCha8Rng = stream(self.seed, VEHICLE_STREAMS + vehicle as u64);
        let legs = Legs::of_vehicle(vehicle, self.area_m, &mut rng);
        // The spread was checked to be finite and not negative.
        let noise = Normal::new(self.self_noise_db, self.self_noise_spread_db).map(|normal| normal.sample(&mut rng));
        // Names are padded, so that their alphabetical order is that of their numbers.
        let digits = self.vehicles.to_string().len();
        let id = VehicleId::new(format!("auv{:0digits$}", vehicle + 1));
        (legs, (id, rounded(noise.unwrap_or(self.self_noise_db), 10.0)))
    }

    fn place(&self, legs: &Legs, time_s: f64, floor: &SeaFloor) -> Position {
        let (east_m, north_m) = legs.after_m(self.speed_m_per_s * time_s);
        let (east_m, north_m) = (rounded(east_m, 10.0), rounded(north_m, 10.0));
        let above_floor_m = floor.depth_at_m(east_m, north_m) - ALTITUDE_MIN_M;
        let depth_m = rounded(self.depth_m.min(above_floor_m).max(DEPTH_MIN_M), 10.0);
        Position { depth_m: Some(depth_m), ..Position::new(east_m, north_m) }
    }
}

fn rounded(value: f64, parts: f64) -> f64 {
    (value * parts).round() / parts
}

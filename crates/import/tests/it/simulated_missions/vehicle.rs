//! A simulated vehicle: its motion, its clock, and how it stamps its records.

use pingmap_agent::VehicleId;
use pingmap_import::{Fix, Place};

use super::kinds::MissionKind;
use crate::random::Random;

/// Time between two positions, in seconds.
const FIX_INTERVAL_S: f64 = 4.0;

/// Speed of a vehicle, in metres per second.
const SPEED_M_PER_S: f64 = 1.5;

/// A vehicle that moves on a circle.
#[derive(Debug, Clone)]
pub(super) struct Vehicle {
    centre: (f64, f64),
    radius_m: f64,
    phase: f64,
    ahead_s: f64,
    drift: f64,
    /// True time of a step of the clock, and its size, in seconds.
    pub(super) step: Option<(f64, f64)>,
    /// Whether it records the end of each transmission, not the start.
    pub(super) records_end: bool,
    /// Time from the end of a packet to the record of its reception, in seconds.
    pub(super) late_s: f64,
    /// Period of polling, in seconds.
    pub(super) poll_s: Option<f64>,
    /// Interval in which the modem is off, in true time.
    pub(super) off: Option<(f64, f64)>,
}

impl Vehicle {
    pub(super) fn random(random: &mut Random, kind: MissionKind, clocks_agree: bool) -> Self {
        let clock_scale = if clocks_agree { 0.0 } else { 1.0 };
        let is_mixed = kind == MissionKind::MixedStamps;
        Self {
            centre: (random.between(-900.0, 900.0), random.between(-900.0, 900.0)),
            radius_m: random.between(150.0, 500.0),
            phase: random.between(0.0, 6.0),
            ahead_s: clock_scale * random.between(-4.0, 4.0),
            drift: clock_scale * random.between(-2e-5, 2e-5),
            step: None,
            records_end: is_mixed && random.chance(0.5),
            late_s: if is_mixed && random.chance(0.5) { random.between(0.3, 1.5) } else { 0.0 },
            poll_s: (kind == MissionKind::PollingLoggers).then(|| random.between(1.0, 2.0)),
            off: None,
        }
    }

    /// Draws a step of 2 to 8 s towards the right time and beyond it, so that the offset stays within the usual limit.
    pub(super) fn random_step_s(&self, random: &mut Random) -> f64 {
        -self.ahead_s.signum() * random.between(2.0, 8.0)
    }

    /// Returns the position at a true time.
    pub(super) fn place(&self, true_s: f64) -> (f64, f64) {
        let angle = self.phase + SPEED_M_PER_S * true_s / self.radius_m;
        (self.centre.0 + self.radius_m * angle.cos(), self.centre.1 + self.radius_m * angle.sin())
    }

    /// Returns the time by its own clock.
    pub(super) fn local_s(&self, true_s: f64) -> f64 {
        let step_s = self.step.filter(|step| true_s >= step.0).map_or(0.0, |step| step.1);
        true_s + self.ahead_s + self.drift * true_s + step_s
    }

    /// Returns the true time at which its clock shows `local_s`; `None` if a step skips this reading.
    pub(super) fn true_s(&self, local_s: f64) -> Option<f64> {
        let steps_s = [0.0, self.step.map_or(0.0, |step| step.1)];
        let readings = steps_s.map(|step_s| (local_s - step_s - self.ahead_s) / (1.0 + self.drift));
        readings.into_iter().find(|&true_s| (self.local_s(true_s) - local_s).abs() < 1e-6)
    }

    /// Returns the time by its own clock that the record of a reception carries.
    pub(super) fn record_s(&self, decoded_s: f64) -> f64 {
        let local_s = self.local_s(decoded_s + self.late_s);
        self.poll_s.map_or(local_s, |period_s| (local_s / period_s).ceil() * period_s)
    }

    pub(super) fn is_off(&self, from_s: f64, to_s: f64) -> bool {
        self.off.is_some_and(|(off_s, on_s)| off_s < to_s && from_s < on_s)
    }

    pub(super) fn fixes(&self, duration_s: f64) -> Vec<Fix> {
        let times = (0..).map(|n| FIX_INTERVAL_S * f64::from(n)).take_while(|&true_s| true_s < duration_s);
        let fix = |true_s| {
            let (east_m, north_m) = self.place(true_s);
            Fix { time_s: self.local_s(true_s), place: Place::Metres(east_m, north_m), depth_m: None }
        };
        times.map(fix).collect()
    }
}

pub(super) fn vehicle_name(vehicle: usize) -> VehicleId {
    VehicleId::new(format!("v{vehicle}"))
}

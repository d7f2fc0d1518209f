//! The estimated offset of each clock, with its residuals.

use pingmap_agent::VehicleId;

use crate::assemble::clocks::clock::{Clock, ClockSegment, Comparison};
use crate::assemble::clocks::fleet_clocks::FleetClocks;
use crate::assemble::median::median;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::Reception;

/// The estimated offset of one clock.
#[derive(Debug, Clone, PartialEq)]
pub struct ClockEstimate {
    /// The vehicle that has the clock.
    pub vehicle: VehicleId,
    /// Whether this is the reference of all offsets.
    pub is_reference: bool,
    /// Offsets between the times at which the clock was set; empty if the offset is unknown.
    pub segments: Vec<ClockSegment>,
    /// Number of messages that compare this clock with another.
    pub comparisons: usize,
    /// Median of the absolute residuals of these messages, in seconds.
    pub median_residual_s: f64,
    /// 75 % quantile of the absolute residuals of these messages, in seconds.
    pub upper_residual_s: f64,
}

impl ClockEstimate {
    /// Returns an estimate for each vehicle, in the order of the fleet.
    pub(crate) fn fleet_estimates(fleet: &Fleet, clocks: &FleetClocks, receptions: &[Reception]) -> Vec<Self> {
        let comparisons: Vec<Comparison> =
            clocks.comparisons(fleet, receptions).map(|(_, comparison)| comparison).collect();
        let estimate = |(index, clock): (usize, &Clock)| {
            let own_comparisons =
                comparisons.iter().filter(|comparison| [comparison.start.0, comparison.arrival.0].contains(&index));
            let mut residuals_s: Vec<f64> =
                own_comparisons.map(|comparison| comparison.residual_s(&clocks.clocks).abs()).collect();
            residuals_s.sort_by(f64::total_cmp);
            Self {
                vehicle: fleet.vehicles[index].name.clone(),
                is_reference: index == clocks.reference,
                segments: if clock.is_determined { clock.segments().copied().collect() } else { Vec::new() },
                comparisons: residuals_s.len(),
                upper_residual_s: residuals_s.get(residuals_s.len() * 3 / 4).copied().unwrap_or(0.0),
                median_residual_s: median(residuals_s),
            }
        };
        clocks.clocks.iter().enumerate().map(estimate).collect()
    }
}

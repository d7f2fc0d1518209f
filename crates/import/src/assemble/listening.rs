//! Decides whether a receiver was able to receive a transmission, without regard to the outcome.

use pingmap_agent::Link;

use crate::assemble::clocks::fleet_clocks::FleetClocks;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::{Transmission, TransmissionEvidence};
use crate::model::exclusion::ExclusionReason;
use crate::model::recording::bands_differ;

/// The times at which each vehicle transmitted, by its own clock and in the order of time.
pub(crate) struct TransmissionTimes(Vec<Vec<f64>>);

impl TransmissionTimes {
    /// Collects the transmissions with evidence.
    pub(crate) fn new(fleet: &Fleet, clocks: &FleetClocks, transmissions: &[Vec<Transmission>]) -> Self {
        let sorted_times = |(sender, transmissions): (usize, &Vec<Transmission>)| {
            let confirmed = transmissions
                .iter()
                .filter(|transmission| transmission.evidence != TransmissionEvidence::UnconfirmedSlot);
            let mut times: Vec<f64> = confirmed.map(|transmission| clocks.local_s(transmission, sender)).collect();
            times.sort_by(f64::total_cmp);
            times
        };
        debug_assert_eq!(fleet.vehicles.len(), transmissions.len());
        Self(transmissions.iter().enumerate().map(sorted_times).collect())
    }

    fn has_within(&self, vehicle: usize, from_s: f64, to_s: f64) -> bool {
        let times = &self.0[vehicle];
        times.get(times.partition_point(|time_s| *time_s <= from_s)).is_some_and(|time_s| *time_s < to_s)
    }
}

/// Returns the first reason to exclude a transmission for a receiver; `None` if it counts as heard or missed.
///
/// `link` holds the positions of both vehicles. The function does not use the outcome, so it excludes successes and
/// misses alike.
pub(crate) fn exclusion_reason(
    fleet: &Fleet,
    clocks: &FleetClocks,
    transmission_times: &TransmissionTimes,
    (sender, transmission): (usize, &Transmission),
    (receiver, link): (usize, Option<Link>),
) -> Option<ExclusionReason> {
    if transmission.evidence == TransmissionEvidence::UnconfirmedSlot {
        return Some(ExclusionReason::SlotUseUnknown);
    }
    let rules = fleet.rules;
    if transmission.destination_unknown && !rules.overhear {
        return Some(ExclusionReason::DestinationUnknown);
    }
    let recording = fleet.vehicles[receiver].recording;
    let arrival_s = clocks.expected_s(fleet, (sender, transmission), receiver);
    let start_s = arrival_s - clocks.delay_s;
    let is_active = |span: &(f64, f64)| span.0 <= arrival_s && arrival_s <= span.1;
    if !fleet.vehicles[receiver].active_spans.iter().any(is_active) {
        return Some(ExclusionReason::NotRecording);
    }
    if transmission_times.has_within(receiver, start_s - rules.message_s, start_s + rules.message_s) {
        return Some(ExclusionReason::Transmitting);
    }
    let overlaps =
        |interval: &&(f64, f64, ExclusionReason)| interval.0 <= start_s + rules.message_s && start_s <= interval.1;
    if let Some(interval) = recording.deaf_intervals.iter().find(overlaps) {
        return Some(interval.2);
    }
    let band = |vehicle: usize, time_s| fleet.vehicles[vehicle].recording.band(time_s);
    let sender_band = transmission.band.as_deref().or_else(|| band(sender, clocks.local_s(transmission, sender)));
    let bands = sender_band.zip(band(receiver, start_s));
    if bands.is_some_and(|(sender_band, receiver_band)| bands_differ(sender_band, receiver_band)) {
        return Some(ExclusionReason::OtherMode);
    }
    // The sender's own clock matters only for its position. Its transmission may be timed by another clock,
    // `sent.clock`.
    let is_undetermined = |clock: usize| !clocks.clocks[clock].is_determined;
    if transmission.ambiguous_receivers.contains(&receiver)
        || is_undetermined(transmission.clock)
        || is_undetermined(receiver)
    {
        return Some(ExclusionReason::ClockUncertain);
    }
    let Some(link) = link else { return Some(ExclusionReason::NoNavigation) };
    let is_surfaced = |depth_m: f64| rules.surfaced_above_m.is_some_and(|above_m| depth_m < above_m);
    link.ends().iter().filter_map(|end| end.depth_m).any(is_surfaced).then_some(ExclusionReason::Surfaced)
}

//! Decides whether a transmission counts for a receiver, without regard to the outcome.

use pingmap_agent::{Link, VehicleId};

use crate::assemble::clocks::fleet_clocks::FleetClocks;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::Transmission;
use crate::model::exclusion::ExclusionReason;
use crate::model::recording::bands_differ;

/// Time before the earliest record of a reception from which on a transmission of the receiver may be a reply to it, in
/// seconds.
const REPLY_MARGIN_S: f64 = 0.2;

/// The times at which each vehicle transmitted, by its own clock and in the order of time.
pub(crate) struct TransmissionTimes(Vec<Vec<f64>>);

impl TransmissionTimes {
    /// Collects the transmissions with evidence.
    pub(crate) fn new(fleet: &Fleet, clocks: &FleetClocks, transmissions: &[Vec<Transmission>]) -> Self {
        let sorted_times = |(sender, transmissions): (usize, &Vec<Transmission>)| {
            let confirmed = transmissions.iter().filter(|transmission| transmission.is_confirmed_for(sender));
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

/// One transmission and one receiver, with all that the decision about them may use. The outcome is not part of it.
#[derive(Clone, Copy)]
pub(crate) struct Opportunity<'a> {
    pub(crate) sender: usize,
    pub(crate) transmission: &'a Transmission,
    pub(crate) receiver: usize,
    /// The positions of both vehicles.
    pub(crate) link: Option<Link>,
    /// Time in seconds by which receptions of this pair are recorded earlier than expected, at most.
    pub(crate) early_s: f64,
    /// Whether receptions are the only records of the sender's destinations.
    pub(crate) has_destinations_by_reception: bool,
}

/// The destination of a transmission, as far as a receiver's own reception is not needed to know it.
enum Destination<'a> {
    Broadcast,
    Vehicle(&'a VehicleId),
    Unknown,
}

impl<'a> Opportunity<'a> {
    fn destination(&self) -> Destination<'a> {
        let known =
            |destination: Option<&'a VehicleId>| destination.map_or(Destination::Broadcast, Destination::Vehicle);
        if !self.has_destinations_by_reception {
            return known(self.transmission.destination.as_ref());
        }
        self.transmission.other_witnesses(self.receiver).next().map_or(Destination::Unknown, known)
    }
}

/// The decision about an opportunity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Decision {
    /// The opportunity counts as heard or missed.
    Counts,
    /// The message is for another vehicle.
    OtherDestination,
    /// The outcome is unknown.
    Excluded(ExclusionReason),
}

/// Decides whether an opportunity counts, by the first criterion that applies.
///
/// No argument contains the outcome or a consequence of it, so successes and misses are excluded alike. A reply is a
/// consequence. The receiver's transmissions after the earliest possible time of decoding are therefore ignored. The
/// receiver's own record of the message is no evidence either.
pub(crate) fn decide(
    fleet: &Fleet,
    clocks: &FleetClocks,
    transmission_times: &TransmissionTimes,
    opportunity: Opportunity,
) -> Decision {
    if !fleet.rules.overhear {
        match opportunity.destination() {
            Destination::Vehicle(name) if name != fleet.vehicles[opportunity.receiver].name => {
                return Decision::OtherDestination;
            }
            Destination::Unknown if opportunity.transmission.is_confirmed_for(opportunity.receiver) => {
                return Decision::Excluded(ExclusionReason::DestinationUnknown);
            }
            _ => {}
        }
    }
    exclusion_reason(fleet, clocks, transmission_times, opportunity).map_or(Decision::Counts, Decision::Excluded)
}

/// Returns the first reason for which the outcome of an opportunity is unknown.
fn exclusion_reason(
    fleet: &Fleet,
    clocks: &FleetClocks,
    transmission_times: &TransmissionTimes,
    opportunity: Opportunity,
) -> Option<ExclusionReason> {
    let Opportunity { sender, transmission, receiver, link, early_s, .. } = opportunity;
    let rules = fleet.rules;
    if !transmission.is_confirmed_for(receiver) {
        return Some(ExclusionReason::Unconfirmed);
    }
    let recording = fleet.vehicles[receiver].recording;
    let expected_s = clocks.expected_s(fleet, (sender, transmission), receiver);
    let is_active = |span: &(f64, f64)| span.0 <= expected_s && expected_s <= span.1;
    if !fleet.vehicles[receiver].active_spans.iter().any(is_active) {
        return Some(ExclusionReason::NotRecording);
    }
    let decoded_from_s = expected_s - early_s;
    // A reception at the edge of a span bounds it only because it was heard, so the edges belong to the span.
    let is_lost = |span: &(f64, f64)| span.0 <= expected_s + rules.match_s && decoded_from_s - rules.match_s <= span.1;
    if recording.lost_spans.iter().any(is_lost) {
        return Some(ExclusionReason::DamagedLog);
    }
    let start_s = expected_s - clocks.delays.of_sender_s(sender).max(0.0);
    let own_from_s = start_s.min(decoded_from_s - rules.message_s) - rules.message_s;
    if transmission_times.has_within(receiver, own_from_s, decoded_from_s - REPLY_MARGIN_S) {
        return Some(ExclusionReason::Transmitting);
    }
    let overlaps = |&&(from_s, to_s, reason): &&(f64, f64, ExclusionReason)| {
        let is_reply = reason == ExclusionReason::Transmitting && from_s >= decoded_from_s - REPLY_MARGIN_S;
        from_s <= start_s + rules.message_s && start_s <= to_s && !is_reply
    };
    if let Some(interval) = recording.deaf_intervals.iter().find(overlaps) {
        return Some(interval.2);
    }
    let band = |vehicle: usize, time_s| fleet.vehicles[vehicle].recording.band(time_s);
    let sender_band = transmission.band.as_deref().or_else(|| band(sender, clocks.local_s(transmission, sender)));
    let bands = sender_band.zip(band(receiver, start_s));
    if bands.is_some_and(|(sender_band, receiver_band)| bands_differ(sender_band, receiver_band)) {
        return Some(ExclusionReason::OtherMode);
    }
    // The sender's own clock matters only for its position. Its transmission may be timed by another clock.
    if [transmission.clock, receiver].iter().any(|&clock| !clocks.clocks[clock].is_determined) {
        return Some(ExclusionReason::ClockUncertain);
    }
    let Some(link) = link else { return Some(ExclusionReason::NoNavigation) };
    let is_surfaced = |depth_m: f64| rules.surfaced_above_m.is_some_and(|above_m| depth_m < above_m);
    link.ends().iter().filter_map(|end| end.depth_m).any(is_surfaced).then_some(ExclusionReason::Surfaced)
}

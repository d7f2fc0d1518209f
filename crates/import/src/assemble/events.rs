//! Events from matched transmissions, and counts for each pair of vehicles.

use std::collections::BTreeSet;

use pingmap_agent::{Event, Link, ReferenceSystem};
use pingmap_trial::EventLog;

use crate::assemble::clocks::fleet_clocks::FleetClocks;
use crate::assemble::listening::{Decision, Opportunity, TransmissionTimes, decide};
use crate::assemble::matching::{MatchTable, earliest_s};
use crate::assemble::pair_counts::PairTable;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::Transmission;

/// Makes an event of every transmission with every receiver that was able to receive it, and counts the others by pair.
pub(crate) fn make_events(
    fleet: &Fleet,
    clocks: &FleetClocks,
    transmissions: &[Vec<Transmission>],
    matched: &MatchTable,
    undocumented_destinations: &BTreeSet<usize>,
) -> (EventLog, PairTable) {
    let transmission_times = TransmissionTimes::new(fleet, clocks, transmissions);
    let mut events = Vec::new();
    let mut pairs = PairTable::new();
    for (sender, sender_transmissions) in transmissions.iter().enumerate() {
        for receiver in fleet.receivers().filter(|&receiver| receiver != sender) {
            let [sender_name, receiver_name] = [sender, receiver].map(|vehicle| fleet.vehicles[vehicle].name.clone());
            let pair = pairs.entry((receiver, sender)).or_default();
            let matches = matched.get(&(receiver, sender));
            let early_s = earliest_s(fleet, clocks, matched, transmissions, (sender, receiver));
            for (index, transmission) in sender_transmissions.iter().enumerate() {
                let (time_s, link) = time_and_link(fleet, clocks, (sender, transmission), receiver);
                let has_destinations_by_reception = undocumented_destinations.contains(&sender);
                let opportunity =
                    Opportunity { sender, transmission, receiver, link, early_s, has_destinations_by_reception };
                match decide(fleet, clocks, &transmission_times, opportunity) {
                    Decision::Counts => {}
                    Decision::OtherDestination => {
                        pair.overheard += 1;
                        continue;
                    }
                    Decision::Excluded(reason) => {
                        *pair.excluded.entry(reason).or_default() += 1;
                        continue;
                    }
                }
                let Some(link) = link else { continue };
                let message = matches.and_then(|matches| matches.assigned.get(&index));
                let message = message.map(|&message| &fleet.vehicles[receiver].messages[&sender][message]);
                let success =
                    message.is_some_and(|message| message.is_decoded(transmission.frames, fleet.rules.any_frame));
                *if success { &mut pair.heard } else { &mut pair.missed } += 1;
                let kind = transmission.kind.clone();
                let [transmitter_id, receiver_id] = [sender_name.clone(), receiver_name.clone()];
                events.push(Event { time_s, transmitter_id, receiver_id, link, kind, success });
            }
        }
    }
    (event_log(events), pairs)
}

/// Makes a log of events in the order of time. It has depths only if every position has one.
pub(crate) fn event_log(mut events: Vec<Event>) -> EventLog {
    events.sort_by(|a, b| {
        let time_order = a.time_s.total_cmp(&b.time_s);
        time_order.then_with(|| (&a.transmitter_id, &a.receiver_id).cmp(&(&b.transmitter_id, &b.receiver_id)))
    });
    let mut ends = events.iter().flat_map(|event| event.link.ends());
    let has_depths = !events.is_empty() && ends.all(|end| end.depth_m.is_some());
    if !has_depths {
        for event in &mut events {
            let Link { transmitter, receiver } = &mut event.link;
            (transmitter.depth_m, receiver.depth_m) = (None, None);
        }
    }
    let mut log = EventLog {
        events,
        true_probability: None,
        has_depths,
        has_headings: false,
        unknown_columns: Vec::new(),
        reference: ReferenceSystem::Unknown,
    };
    log.derive_headings();
    log
}

/// Returns the start of a transmission and the positions of both vehicles at that time.
///
/// Times are by the reference clock if the rules name one. Otherwise they stay as recorded.
fn time_and_link(
    fleet: &Fleet,
    clocks: &FleetClocks,
    (sender, transmission): (usize, &Transmission),
    receiver: usize,
) -> (f64, Option<Link>) {
    let recorded_s = clocks.start_s(transmission);
    let is_corrected = fleet.rules.reference_clock.is_some();
    let time_s = if is_corrected { clocks.true_s(transmission) } else { recorded_s };
    let position = |vehicle: usize| {
        let local_s = if is_corrected { clocks.local_s(transmission, vehicle) } else { recorded_s };
        fleet.vehicles[vehicle].track.position(local_s, fleet.rules.nav_gap_s_max)
    };
    let ends = position(sender).zip(position(receiver));
    (time_s, ends.map(|(transmitter, receiver)| Link { transmitter, receiver }))
}

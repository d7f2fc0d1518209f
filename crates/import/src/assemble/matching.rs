//! Assignment of received messages to transmissions.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use crate::assemble::clocks::fleet_clocks::FleetClocks;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::message::Message;
use crate::assemble::vehicles::transmission::{Reception, Transmission};

/// For one sender and receiver: the index of the message for each index of a transmission that has one.
pub(crate) type Matches = BTreeMap<usize, usize>;

/// The matches by receiver and sender.
pub(crate) type MatchTable = BTreeMap<(usize, usize), Matches>;

/// Transmissions with the time at which one receiver should record them, in the order of that time.
type Timeline = Vec<(f64, usize)>;

/// Largest distance, in seconds, at which an unmatched message makes the nearest transmission without a reception
/// ambiguous.
const AMBIGUITY_S: f64 = 10.0;

/// Largest distance, in seconds, at which a broken packet belongs to a transmission, for example as the cycle before
/// its data.
const CYCLE_S: f64 = 5.0;

/// Matches the messages that all receivers have of all senders.
pub(crate) fn match_all(fleet: &Fleet, clocks: &FleetClocks, transmissions: &[Vec<Transmission>]) -> MatchTable {
    let mut table = MatchTable::new();
    for receiver in fleet.receivers() {
        for &sender in fleet.vehicles[receiver].messages.keys() {
            table.insert((receiver, sender), match_pair(fleet, clocks, (sender, &transmissions[sender]), receiver));
        }
    }
    table
}

/// Assigns each message of a sender to the nearest transmission, if one is near enough. A transmission gets one
/// message. O(n log n).
fn match_pair(
    fleet: &Fleet,
    clocks: &FleetClocks,
    (sender, transmissions): (usize, &[Transmission]),
    receiver: usize,
) -> Matches {
    let Some(messages) = fleet.vehicles[receiver].messages.get(&sender) else { return Matches::new() };
    let expected = timeline(fleet, clocks, sender, transmissions.iter().enumerate(), receiver);
    // A decoded message takes precedence over a broken one, however near: the first path may break and a later path may
    // not.
    let mut best: BTreeMap<usize, (bool, f64, usize)> = BTreeMap::new();
    for (index, message) in messages.iter().enumerate() {
        let nearest = nearest(&expected, message.time_s).filter(|(distance_s, _)| *distance_s <= fleet.rules.match_s);
        let Some((distance_s, transmission)) = nearest else { continue };
        let candidate = (!message.is_any_decoded(), distance_s, index);
        let best_candidate = best.entry(transmission).or_insert(candidate);
        if (candidate.0, candidate.1) < (best_candidate.0, best_candidate.1) {
            *best_candidate = candidate;
        }
    }
    best.into_iter().map(|(transmission, (_, _, message))| (transmission, message)).collect()
}

fn timeline<'a>(
    fleet: &Fleet,
    clocks: &FleetClocks,
    sender: usize,
    transmissions: impl Iterator<Item = (usize, &'a Transmission)>,
    receiver: usize,
) -> Timeline {
    let mut times: Timeline = transmissions
        .map(|(index, transmission)| (clocks.expected_s(fleet, (sender, transmission), receiver), index))
        .collect();
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    times
}

/// Returns the distance in seconds to the nearest transmission, and its index.
fn nearest(timeline: &[(f64, usize)], time_s: f64) -> Option<(f64, usize)> {
    let next_index = timeline.partition_point(|entry| entry.0 < time_s);
    let neighbours = timeline[next_index.saturating_sub(1)..].iter().take(2);
    neighbours.map(|&(expected_s, index)| ((expected_s - time_s).abs(), index)).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// Returns the reception of each matched transmission.
pub(crate) fn receptions<'a>(
    fleet: &Fleet,
    transmissions: &'a [Vec<Transmission>],
    matched: &MatchTable,
) -> Vec<Reception<'a>> {
    let mut receptions = Vec::new();
    for (&(receiver, sender), matches) in matched {
        let messages = &fleet.vehicles[receiver].messages[&sender];
        receptions.extend(matches.iter().map(|(&index, &message)| {
            let time_s = messages[message].time_s;
            Reception { sender, transmission: &transmissions[sender][index], receiver, time_s }
        }));
    }
    receptions
}

/// Marks transmissions as ambiguous for a sender that recorded all of its transmissions.
///
/// A decoded message that fits none of them belongs to an unknown one of the open transmissions, those without a
/// message. The outcome of the nearest open transmission is therefore uncertain for this receiver. Returns the number
/// of such messages by receiver.
pub(crate) fn mark_ambiguous(
    fleet: &Fleet,
    clocks: &FleetClocks,
    sender: usize,
    transmissions: &mut [Transmission],
) -> BTreeMap<usize, usize> {
    let mut unmatched = BTreeMap::new();
    for receiver in fleet.receivers().filter(|&receiver| receiver != sender) {
        let Some(messages) = fleet.vehicles[receiver].messages.get(&sender) else { continue };
        let matches = match_pair(fleet, clocks, (sender, transmissions), receiver);
        let matched: BTreeSet<usize> = matches.values().copied().collect();
        let open = transmissions.iter().enumerate().filter(|(index, _)| !matches.contains_key(index));
        let open = timeline(fleet, clocks, sender, open, receiver);
        // A broken packet is a miss, whichever transmission it belongs to. It may be a cycle before the data of the
        // same sender.
        let is_unmatched = |(index, message): &(usize, &Message)| !matched.contains(index) && message.is_any_decoded();
        for (_, message) in messages.iter().enumerate().filter(is_unmatched) {
            *unmatched.entry(receiver).or_default() += 1;
            if let Some((_, index)) =
                nearest(&open, message.time_s).filter(|(distance_s, _)| *distance_s <= AMBIGUITY_S)
            {
                transmissions[index].ambiguous_receivers.insert(receiver);
            }
        }
    }
    unmatched
}

/// Adds a transmission for each unmatched message of a sender, and returns their number.
///
/// Decoded messages come first, then broken ones far from any transmission. If several receivers have one message, the
/// receiver with the most messages of this sender provides the transmission.
pub(crate) fn add_received(
    fleet: &Fleet,
    clocks: &FleetClocks,
    sender: usize,
    transmissions: &mut Vec<Transmission>,
) -> usize {
    let mut receivers: Vec<usize> = fleet.receivers().filter(|&receiver| receiver != sender).collect();
    let count = |receiver: usize| fleet.vehicles[receiver].messages.get(&sender).map_or(0, Vec::len);
    receivers.sort_by_key(|&receiver| Reverse(count(receiver)));
    let documented = transmissions.len();
    for is_decoded in [true, false] {
        for &receiver in &receivers {
            let Some(messages) = fleet.vehicles[receiver].messages.get(&sender) else { continue };
            let matched: BTreeSet<usize> =
                match_pair(fleet, clocks, (sender, transmissions), receiver).into_values().collect();
            let expected = timeline(fleet, clocks, sender, transmissions.iter().enumerate(), receiver);
            let mut latest_s = f64::NEG_INFINITY;
            for (index, message) in messages.iter().enumerate() {
                let is_near = || {
                    nearest(&expected, message.time_s).is_some_and(|(distance_s, _)| distance_s <= CYCLE_S)
                        || message.time_s - latest_s <= CYCLE_S
                };
                let is_open = message.is_any_decoded() == is_decoded && !matched.contains(&index);
                if is_open && (is_decoded || !is_near()) {
                    latest_s = message.time_s;
                    let travel_s = fleet.travel_s(sender, receiver, message.time_s);
                    transmissions.push(Transmission::from_reception(message, receiver, travel_s));
                }
            }
        }
    }
    transmissions.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    transmissions.len() - documented
}

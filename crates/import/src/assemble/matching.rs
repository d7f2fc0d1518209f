//! Assignment of received messages to transmissions.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use crate::assemble::clocks::fleet_clocks::FleetClocks;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::message::Message;
use crate::assemble::vehicles::transmission::{Reception, Transmission};

/// The matches of one sender and receiver.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Matches {
    /// The index of the message for each index of a transmission that has one.
    pub(crate) assigned: BTreeMap<usize, usize>,
    /// Further messages of transmissions that have one already.
    pub(crate) duplicates: usize,
    /// Messages that fit no transmission, in the order of time.
    pub(crate) unassigned: Vec<usize>,
    /// Decoded messages among them.
    pub(crate) unassigned_decoded: usize,
    /// Those before the first or after the last transmission of the sender.
    pub(crate) outside_record: usize,
}

/// The matches by receiver and sender.
pub(crate) type MatchTable = BTreeMap<(usize, usize), Matches>;

/// A message is assigned to the nearest transmission if the distance is at most this share of the gap to the next
/// transmission of the sender.
const GAP_SHARE: f64 = 0.45;

/// Largest distance, in seconds, at which a broken packet belongs to a transmission, for example as the cycle before
/// its data.
const CYCLE_S: f64 = 5.0;

/// Quantile of the time by which receptions are early that counts as the largest one.
const EARLY_QUANTILE: f64 = 0.95;

/// The expected times of a sender's transmissions at one receiver, in their order, with the index of each transmission.
struct Timeline {
    expected: Vec<(f64, usize)>,
    match_s_max: f64,
}

impl Timeline {
    fn new(
        fleet: &Fleet,
        clocks: &FleetClocks,
        (sender, transmissions): (usize, &[Transmission]),
        receiver: usize,
    ) -> Self {
        let expected_s = |transmission| clocks.expected_s(fleet, (sender, transmission), receiver);
        let times = transmissions.iter().enumerate().map(|(index, transmission)| (expected_s(transmission), index));
        let mut expected: Vec<(f64, usize)> = times.collect();
        expected.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self { expected, match_s_max: fleet.rules.match_s }
    }

    /// Returns whether a time lies before the first or after the last transmission.
    fn is_outside(&self, time_s: f64) -> bool {
        self.expected.first().is_none_or(|first| time_s < first.0)
            || self.expected.last().is_none_or(|last| time_s > last.0)
    }

    /// Returns the distance in seconds to the nearest transmission, its index, and the largest distance at which a
    /// message belongs to it.
    ///
    /// The limit follows from the gap to the next transmission on that side, because two messages of one sender in one
    /// gap cannot be told apart better.
    fn nearest(&self, time_s: f64) -> Option<(f64, usize, f64)> {
        let next = self.expected.partition_point(|entry| entry.0 < time_s);
        let distance_s = |place: usize| (self.expected[place].0 - time_s).abs();
        let neighbours = next.saturating_sub(1)..self.expected.len().min(next + 1);
        let place = neighbours.min_by(|&a, &b| distance_s(a).total_cmp(&distance_s(b)))?;
        let beyond = if place == next { place.checked_sub(1) } else { Some(place + 1) };
        let gap_s = beyond
            .and_then(|beyond| self.expected.get(beyond))
            .map(|&(other_s, _)| (other_s - self.expected[place].0).abs());
        let limit_s = gap_s.map_or(self.match_s_max, |gap_s| self.match_s_max.min(GAP_SHARE * gap_s));
        Some((distance_s(place), self.expected[place].1, limit_s))
    }
}

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
    let Some(messages) = fleet.vehicles[receiver].messages.get(&sender) else { return Matches::default() };
    let timeline = Timeline::new(fleet, clocks, (sender, transmissions), receiver);
    let mut matches = Matches::default();
    // A decoded message takes precedence over a broken one, however near: the first path may break and a later path may
    // not.
    let mut best: BTreeMap<usize, (bool, f64, usize)> = BTreeMap::new();
    for (index, message) in messages.iter().enumerate() {
        let kind_s = clocks.delays.delay_s(sender, message.kind.as_ref()) - clocks.delays.of_sender_s(sender);
        let nearest =
            timeline.nearest(message.time_s - kind_s).filter(|(distance_s, _, limit_s)| distance_s <= limit_s);
        let Some((distance_s, transmission, _)) = nearest else {
            matches.unassigned.push(index);
            matches.unassigned_decoded += usize::from(message.is_any_decoded());
            matches.outside_record += usize::from(message.is_any_decoded() && timeline.is_outside(message.time_s));
            continue;
        };
        let candidate = (!message.is_any_decoded(), distance_s, index);
        matches.duplicates += usize::from(best.contains_key(&transmission) && message.is_any_decoded());
        let best_candidate = best.entry(transmission).or_insert(candidate);
        if (candidate.0, candidate.1) < (best_candidate.0, best_candidate.1) {
            *best_candidate = candidate;
        }
    }
    matches.assigned = best.into_iter().map(|(transmission, (_, _, message))| (transmission, message)).collect();
    matches
}

/// Returns the reception of each matched transmission.
pub(crate) fn receptions<'a>(
    fleet: &'a Fleet,
    transmissions: &'a [Vec<Transmission>],
    matched: &MatchTable,
) -> Vec<Reception<'a>> {
    let mut receptions = Vec::new();
    for (&(receiver, sender), matches) in matched {
        let messages = &fleet.vehicles[receiver].messages[&sender];
        receptions.extend(matches.assigned.iter().map(|(&index, &message)| {
            let Message { time_s, ref kind, .. } = messages[message];
            Reception { sender, transmission: &transmissions[sender][index], receiver, time_s, kind: kind.as_ref() }
        }));
    }
    receptions
}

/// Returns how much earlier than expected a receiver records the messages of a sender at most, in seconds.
///
/// This is the 5 % quantile of the residuals, for programs that record receptions late by a varying time.
pub(crate) fn earliest_s(
    fleet: &Fleet,
    clocks: &FleetClocks,
    matched: &MatchTable,
    transmissions: &[Vec<Transmission>],
    (sender, receiver): (usize, usize),
) -> f64 {
    let Some(matches) = matched.get(&(receiver, sender)) else { return 0.0 };
    let messages = &fleet.vehicles[receiver].messages[&sender];
    let early_s = |(&index, &message): (&usize, &usize)| {
        clocks.expected_s(fleet, (sender, &transmissions[sender][index]), receiver) - messages[message].time_s
    };
    let mut early_s: Vec<f64> = matches.assigned.iter().map(early_s).collect();
    early_s.sort_by(f64::total_cmp);
    let quantile = (EARLY_QUANTILE * early_s.len() as f64) as usize;
    early_s.get(quantile.min(early_s.len().saturating_sub(1))).map_or(0.0, |early_s| early_s.max(0.0))
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
            let matches = match_pair(fleet, clocks, (sender, transmissions), receiver);
            let timeline = Timeline::new(fleet, clocks, (sender, transmissions), receiver);
            let mut latest_s = f64::NEG_INFINITY;
            for message in matches.unassigned.into_iter().map(|index| &messages[index]) {
                let is_near = || {
                    timeline.nearest(message.time_s).is_some_and(|(distance_s, ..)| distance_s <= CYCLE_S)
                        || message.time_s - latest_s <= CYCLE_S
                };
                if message.is_any_decoded() == is_decoded && (is_decoded || !is_near()) {
                    latest_s = message.time_s;
                    let travel_s = fleet.travel_s((sender, message.time_s), (receiver, message.time_s));
                    transmissions.push(Transmission::from_reception(message, sender, receiver, travel_s));
                }
            }
        }
    }
    transmissions.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    transmissions.len() - documented
}

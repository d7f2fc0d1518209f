//! Which message came from which transmission.

use std::collections::{BTreeMap, BTreeSet};

use crate::clocks::Clocks;
use crate::fleet::Fleet;
use crate::message::Message;
use crate::transmission::Transmission;

/// Messages by the transmission that they came from, both by their places in lists, of one sender and receiver.
pub(crate) type Matches = BTreeMap<usize, usize>;

/// Gives each message of a sender to the transmission that fits best, if any fits; each gets one. O(n log n).
pub(crate) fn matches(
    fleet: &Fleet,
    clocks: &Clocks,
    (sender, sent): (usize, &[Transmission]),
    receiver: usize,
) -> Matches {
    let Some(messages) = fleet.vehicles[receiver].messages.get(&sender) else { return Matches::new() };
    let mut expected: Vec<(f64, usize)> =
        sent.iter().zip(0..).map(|(sent, place)| (clocks.expected_s(fleet, (sender, sent), receiver), place)).collect();
    expected.sort_by(|a, b| a.0.total_cmp(&b.0));
    // What was decoded goes before what broke, however near that was: a first path may break and a later one not.
    let mut best: BTreeMap<usize, (bool, f64, usize)> = BTreeMap::new();
    for (message, at) in messages.iter().enumerate() {
        let near = nearest(&expected, at.time_s).filter(|near| near.0 <= fleet.rules.match_s);
        let Some((off_s, place)) = near else { continue };
        let found = (!at.is_any_decoded(), off_s, message);
        let known = best.entry(place).or_insert(found);
        if (found.0, found.1) < (known.0, known.1) {
            *known = found;
        }
    }
    best.into_iter().map(|(place, (_, _, message))| (place, message)).collect()
}

/// Of places by time, in the order of time, the one nearest to a time, and how far off it is.
fn nearest(places: &[(f64, usize)], time_s: f64) -> Option<(f64, usize)> {
    let after = places.partition_point(|place| place.0 < time_s);
    let near = places[after.saturating_sub(1)..].iter().take(2);
    near.map(|&(at_s, place)| ((at_s - time_s).abs(), place)).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// All matches, by receiver and sender.
pub(crate) fn all_matches(
    fleet: &Fleet,
    clocks: &Clocks,
    sent: &[Vec<Transmission>],
) -> BTreeMap<(usize, usize), Matches> {
    let mut all = BTreeMap::new();
    for receiver in fleet.receivers() {
        for &sender in fleet.vehicles[receiver].messages.keys() {
            all.insert((receiver, sender), matches(fleet, clocks, (sender, &sent[sender]), receiver));
        }
    }
    all
}

/// A message that fits no transmission of its sender puts those in doubt that began within so many seconds.
const DOUBT_S: f64 = 10.0;

/// Messages that fit no transmission of a sender that recorded all of them, how many, by receiver: of those without a message the
/// nearest to each is neither heard nor missed for certain.
pub(crate) fn doubt(
    fleet: &Fleet,
    clocks: &Clocks,
    sender: usize,
    sent: &mut [Transmission],
) -> BTreeMap<usize, usize> {
    let mut strays = BTreeMap::new();
    for receiver in fleet.receivers().filter(|&receiver| receiver != sender) {
        let Some(messages) = fleet.vehicles[receiver].messages.get(&sender) else { continue };
        let known = matches(fleet, clocks, (sender, sent), receiver);
        let matched: BTreeSet<usize> = known.values().copied().collect();
        let expected = |place: usize, sent: &Transmission| (clocks.expected_s(fleet, (sender, sent), receiver), place);
        let open = sent.iter().enumerate().filter(|(place, _)| !known.contains_key(place));
        let mut open: Vec<(f64, usize)> = open.map(|(place, sent)| expected(place, sent)).collect();
        open.sort_by(|a, b| a.0.total_cmp(&b.0));
        // What broke was missed whichever it belongs to (a cycle breaks before its data, and names the same sender).
        let stray = |(at, message): &(usize, &Message)| !matched.contains(at) && message.is_any_decoded();
        for (_, message) in messages.iter().enumerate().filter(stray) {
            *strays.entry(receiver).or_default() += 1;
            if let Some((_, place)) = nearest(&open, message.time_s).filter(|near| near.0 <= DOUBT_S) {
                sent[place].doubtful_at.insert(receiver);
            }
        }
    }
    strays
}

/// What breaks so soon before or after a transmission, in seconds, is no other one: a cycle that goes before its data.
const CYCLE_S: f64 = 5.0;

/// The transmissions of messages that came from none that is known, added to those that are: first of what was decoded, then of what
/// broke far from all of these. Of several receivers of one the first that has most messages of its sender tells it.
pub(crate) fn add_received(fleet: &Fleet, clocks: &Clocks, sender: usize, sent: &mut Vec<Transmission>) -> usize {
    let mut receivers: Vec<usize> = fleet.receivers().filter(|&receiver| receiver != sender).collect();
    let count = |receiver: usize| fleet.vehicles[receiver].messages.get(&sender).map_or(0, Vec::len);
    receivers.sort_by_key(|&receiver| std::cmp::Reverse(count(receiver)));
    let before = sent.len();
    for is_decoded in [true, false] {
        for &receiver in &receivers {
            let Some(messages) = fleet.vehicles[receiver].messages.get(&sender) else { continue };
            let matched: BTreeSet<usize> = matches(fleet, clocks, (sender, sent), receiver).into_values().collect();
            let mut expected: Vec<(f64, usize)> = sent
                .iter()
                .zip(0..)
                .map(|(sent, place)| (clocks.expected_s(fleet, (sender, sent), receiver), place))
                .collect();
            expected.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut latest_s = f64::NEG_INFINITY;
            for (at, message) in messages.iter().enumerate() {
                let is_near = || {
                    let near = nearest(&expected, message.time_s).is_some_and(|near| near.0 <= CYCLE_S);
                    near || message.time_s - latest_s <= CYCLE_S
                };
                let is_open = message.is_any_decoded() == is_decoded && !matched.contains(&at);
                if is_open && (is_decoded || !is_near()) {
                    latest_s = message.time_s;
                    let travel_s = fleet.travel_s(sender, receiver, message.time_s);
                    sent.push(Transmission::behind(message, receiver, travel_s));
                }
            }
        }
    }
    sent.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    sent.len() - before
}

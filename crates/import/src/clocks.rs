//! The clocks of a fleet, from what it recorded.

use std::collections::{BTreeMap, BTreeSet};

use crate::clock::{Clock, Comparison, Peak, fit, median, peak};
use crate::fleet::Fleet;
use crate::transmission::{Reception, Transmission};

/// How clocks differ, and how long it takes until a message is recorded that has arrived.
pub(crate) struct Clocks {
    pub(crate) clocks: Vec<Clock>,
    /// From the beginning of a message to the record of its reception, beside the time that sound takes.
    pub(crate) delay_s: f64,
    /// The vehicle that others are compared with.
    pub(crate) reference: usize,
    /// Differences that could be others as well, in words.
    pub(crate) doubts: Vec<String>,
}

/// No sound is heard that travelled longer, in seconds.
const TRAVEL_S_MAX: f64 = 60.0;

/// Two clocks, and whether the earlier time is that of a reception, too.
type Pair = (usize, usize, bool);

impl Clocks {
    /// Clocks that do not differ.
    fn equal(fleet: &Fleet, reference: usize) -> Self {
        let clocks = fleet.vehicles.iter().map(|_| Clock::ahead(0.0, &[], true)).collect();
        Self { clocks, delay_s: 0.0, reference, doubts: Vec::new() }
    }

    /// A first idea of all clocks: of each two the difference at which most receptions fit a transmission, put together from the
    /// reference on by those that most speak for.
    pub(crate) fn guess(fleet: &Fleet, sent: &[Vec<Transmission>]) -> Self {
        let peaks = peaks(fleet, sent);
        let mut speaks = vec![0; fleet.vehicles.len()];
        for ((early, late, _), peak) in &peaks {
            speaks[*early] += peak.count;
            speaks[*late] += peak.count;
        }
        let named = fleet.rules.right_clock.as_ref().and_then(|name| fleet.number(name));
        // A clock that was set on the way is no measure for others.
        let merit = |vehicle: usize| (fleet.set_s(vehicle).is_empty(), speaks[vehicle]);
        let most = (0..speaks.len()).rev().max_by_key(|&vehicle| merit(vehicle)).unwrap_or(0);
        let mut found = Self::equal(fleet, named.unwrap_or(most));
        if let Some(vehicle) = named.filter(|&vehicle| !fleet.set_s(vehicle).is_empty()) {
            found.doubts.push(format!(
                "{0}'s clock, which times are corrected to, was set on the way: what it showed before counts as right, too (--correct-clocks \
                 of another, unless these were small steps)",
                fleet.vehicles[vehicle].name
            ));
        }
        if fleet.rules.clock_off_s_max == 0.0 {
            // What messages take is all that there is to see.
            let all =
                candidates(fleet, sent).filter(|(pair, _)| !pair.2).map(|(_, comparison)| comparison.difference_s());
            found.delay_s = peak(all.collect(), fleet.rules.match_s).map_or(0.0, |peak| peak.difference_s.max(0.0));
            return found;
        }
        found.delay_s = delay_s(&peaks);
        let mut ahead_s = BTreeMap::from([(found.reference, 0.0)]);
        loop {
            // Of all pairs of which one clock is known the one that most speaks for.
            let next =
                peaks.iter().filter(|((early, late, _), _)| ahead_s.contains_key(early) != ahead_s.contains_key(late));
            let Some((&(early, late, by_reception), peak)) = next.max_by_key(|(_, peak)| peak.count) else { break };
            let delay_s = if by_reception { 0.0 } else { found.delay_s };
            let difference_s = peak.difference_s - delay_s;
            match ahead_s.get(&early).copied() {
                Some(known_s) => ahead_s.insert(late, known_s + difference_s),
                None => ahead_s.insert(early, ahead_s[&late] - difference_s),
            };
            if let Some(other_s) = peak.other_s {
                let [a, b] = [late, early].map(|vehicle| fleet.vehicles[vehicle].name);
                let [taken, other] = [difference_s, other_s - delay_s];
                found.doubts.push(format!("{a}'s clock may be {other:+.1} s against {b}'s as well as {taken:+.1} s, which was taken: --clock-off-s-max says how far clocks can be off"));
            }
        }
        for (vehicle, clock) in found.clocks.iter_mut().enumerate() {
            let known = ahead_s.get(&vehicle);
            *clock = Clock::ahead(known.copied().unwrap_or(0.0), &fleet.set_s(vehicle), known.is_some());
        }
        found
    }

    /// When a message should be recorded by the receiver's clock.
    pub(crate) fn expected_s(&self, fleet: &Fleet, (sender, sent): (usize, &Transmission), receiver: usize) -> f64 {
        let true_s = self.true_s(sent);
        let travel_s = fleet.travel_s(sender, receiver, true_s);
        true_s + self.clocks[receiver].ahead_s(true_s) + travel_s + self.delay_s
    }

    /// When a transmission began by the clock that its time is of.
    pub(crate) fn begin_s(&self, sent: &Transmission) -> f64 {
        sent.time_s - if sent.by_reception { self.delay_s } else { 0.0 }
    }

    /// When it began by the clock of the reference.
    pub(crate) fn true_s(&self, sent: &Transmission) -> f64 {
        let begin_s = self.begin_s(sent);
        begin_s - self.clocks[sent.clock].ahead_s(begin_s)
    }

    /// When it began by the clock of a vehicle.
    pub(crate) fn local_s(&self, sent: &Transmission, vehicle: usize) -> f64 {
        if sent.clock == vehicle {
            return self.begin_s(sent);
        }
        let true_s = self.true_s(sent);
        true_s + self.clocks[vehicle].ahead_s(true_s)
    }

    /// Improves the clocks by messages and what they come from.
    pub(crate) fn improve(&mut self, fleet: &Fleet, receptions: &[Reception]) {
        let comparisons = self.comparisons(fleet, receptions);
        if fleet.rules.clock_off_s_max > 0.0 {
            fit(&mut self.clocks, &comparisons, self.reference);
        }
    }

    /// What clocks showed when messages were sent and received.
    pub(crate) fn comparisons(&self, fleet: &Fleet, receptions: &[Reception]) -> Vec<Comparison> {
        let of = |&Reception { sender, sent, receiver, time_s }: &Reception| {
            let begin_s = self.begin_s(sent);
            let travel_s = fleet.travel_s(sender, receiver, begin_s);
            Comparison { early: (sent.clock, begin_s), late: (receiver, time_s - travel_s - self.delay_s) }
        };
        receptions.iter().filter(|reception| reception.sent.clock != reception.receiver).map(of).collect()
    }

    /// Sets every stretch between two times at which a clock was set to where most receptions fit, which may be elsewhere than for
    /// the rest of it.
    pub(crate) fn search_pieces(&mut self, fleet: &Fleet, sent: &[Vec<Transmission>]) {
        for vehicle in (0..self.clocks.len()).filter(|&vehicle| vehicle != self.reference) {
            if self.clocks[vehicle].pieces().count() > 1 && self.clocks[vehicle].known {
                let candidates = candidates(fleet, sent).filter(|(pair, _)| [pair.0, pair.1].contains(&vehicle));
                let comparisons: Vec<Comparison> = candidates
                    .map(|(pair, mut comparison)| {
                        comparison.late.1 -= if pair.2 { 0.0 } else { self.delay_s };
                        comparison
                    })
                    .collect();
                let others = self.clocks.clone();
                self.clocks[vehicle].search(vehicle, &comparisons, &others, fleet.rules.match_s);
            }
        }
    }
}

/// Every reception beside every transmission of its sender that it could come from.
fn candidates<'a>(fleet: &'a Fleet, sent: &'a [Vec<Transmission>]) -> impl Iterator<Item = (Pair, Comparison)> + 'a {
    // Beside what clocks differ there is what it takes until a message is recorded.
    let off_s_max = fleet.rules.clock_off_s_max + fleet.rules.message_s;
    fleet.receivers().flat_map(move |receiver| {
        let messages = fleet.vehicles[receiver].messages.iter();
        messages.flat_map(move |(&sender, messages)| {
            messages.iter().flat_map(move |message| {
                let from = sent[sender].partition_point(|sent| sent.time_s < message.time_s - off_s_max - TRAVEL_S_MAX);
                let near =
                    sent[sender][from..].iter().take_while(move |sent| sent.time_s <= message.time_s + off_s_max);
                near.filter(move |sent| sent.clock != receiver).filter_map(move |sent| {
                    let travel_s = fleet.travel_s(sender, receiver, sent.time_s);
                    let late_s = message.time_s - travel_s;
                    let comparison = Comparison { early: (sent.clock, sent.time_s), late: (receiver, late_s) };
                    let near = comparison.difference_s().abs() <= off_s_max;
                    near.then_some(((sent.clock, receiver, sent.by_reception), comparison))
                })
            })
        })
    })
}

fn peaks(fleet: &Fleet, sent: &[Vec<Transmission>]) -> BTreeMap<Pair, Peak> {
    let mut differences_s: BTreeMap<Pair, Vec<f64>> = BTreeMap::new();
    for (pair, comparison) in candidates(fleet, sent) {
        differences_s.entry(pair).or_default().push(comparison.difference_s());
    }
    let peaks = differences_s.into_iter().filter_map(|(pair, all)| Some((pair, peak(all, fleet.rules.match_s)?)));
    peaks.collect()
}

/// Half of what it takes there and back, by the clocks of both ends: the middle of all pairs. Nothing, where nobody answers.
fn delay_s(peaks: &BTreeMap<Pair, Peak>) -> f64 {
    let both: BTreeSet<(usize, usize)> = peaks.keys().filter(|pair| !pair.2).map(|pair| (pair.0, pair.1)).collect();
    let back = |&(early, late): &(usize, usize)| {
        let there_s = peaks.get(&(early, late, false))?.difference_s;
        let back_s = peaks.get(&(late, early, false))?.difference_s;
        (early < late).then_some((there_s + back_s) / 2.0)
    };
    median(both.iter().filter_map(back).collect()).max(0.0)
}

//! Checks of event logs: mistakes in positions, names and clocks, and in the import of the log.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use pingmap_agent::{Event, Link, MainArea, Position, VehicleId};

use crate::baseline::DistanceOnly;
use crate::event_log::EventLog;

/// Smaller logs are reported as few events.
const EVENTS_MIN: usize = 30;

/// Largest speed of a vehicle in metres per second, and largest error of a position fix in metres.
const SPEED_MAX_M_PER_S: f64 = 10.0;
const JUMP_MIN_M: f64 = 100.0;

/// Positions within this distance are taken for degrees if a coordinate exceeds their spread by this factor.
const DEGREES_WIDE: f64 = 2.0;
const DEGREES_TIMES: f64 = 8.0;

/// Smallest evidence that a silence is suspicious: nats of its improbability by range, and number of missed messages.
/// Without other receivers of its senders the nats are multiplied.
const SILENCE_NATS: f64 = 15.0;
const SILENCE_EVENTS_MIN: usize = 10;
const UNWITNESSED_TIMES: f64 = 2.0;

/// Smallest number of missed messages of a pair from which its silence is remarkable.
const SILENT_PAIR_EVENTS_MIN: usize = 20;

/// Two links are near each other within this share of the chart's scale. The probability of a miss is estimated from
/// this many neighbours, for at most this many misses and among at most this many events.
const NEAR_SHARE: f64 = 0.7;
const NEIGHBOURS: usize = 5;
const LOOKED_AT_MAX: usize = 50;
const LOOKED_THROUGH_MAX: usize = 20_000;

/// A log with fewer distinct links than one in this many events is reported.
const REPEATED: usize = 20;

/// A suspicious property of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// Key of the check.
    pub check: &'static str,
    /// Whether a map of the log would be meaningless.
    pub is_nonsense: bool,
    /// Description for the user, with a remedy.
    pub text: String,
}

/// Numbers of messages from one vehicle to another.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PairCount {
    /// Number of heard messages.
    pub heard: usize,
    /// Number of missed messages.
    pub missed: usize,
}

/// Events in a bin of ranges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeBin {
    /// Smallest range in metres.
    pub from_m: f64,
    /// Largest range in metres.
    pub to_m: f64,
    /// Number of events.
    pub events: usize,
    /// Number of heard events.
    pub heard: usize,
}

impl EventLog {
    /// Counts heard and missed messages for each transmitter and receiver.
    pub fn pairs(&self) -> BTreeMap<(VehicleId, VehicleId), PairCount> {
        let mut pairs: BTreeMap<_, PairCount> = BTreeMap::new();
        for event in &self.events {
            let pair = pairs.entry((event.transmitter_id.clone(), event.receiver_id.clone())).or_default();
            *if event.success { &mut pair.heard } else { &mut pair.missed } += 1;
        }
        pairs
    }

    /// Counts events over range, in at most `bins` bins of about equal numbers of events.
    pub fn over_range(&self, bins: usize) -> Vec<RangeBin> {
        let mut events: Vec<(f64, bool)> =
            self.events.iter().map(|event| (event.link.range_m(), event.success)).collect();
        events.sort_by(|a, b| a.0.total_cmp(&b.0));
        let size = events.len().div_ceil(bins.max(1)).max(1);
        let bin = |events: &[(f64, bool)]| RangeBin {
            from_m: events[0].0,
            to_m: events[events.len() - 1].0,
            events: events.len(),
            heard: events.iter().filter(|event| event.1).count(),
        };
        events.chunks(size).map(bin).collect()
    }

    /// Returns all findings. O(n log n).
    pub fn findings(&self) -> Vec<Finding> {
        let checks = [outcomes, positions, names, jumps, silences, silent_pairs, rows];
        checks.iter().flat_map(|check| check(self)).collect()
    }
}

fn odd(check: &'static str, text: String) -> Finding {
    Finding { check, is_nonsense: false, text }
}

fn nonsense(check: &'static str, text: String) -> Finding {
    Finding { check, is_nonsense: true, text }
}

/// Finds logs or receivers with one outcome only, and logs with few events.
fn outcomes(log: &EventLog) -> Vec<Finding> {
    let mut findings = Vec::new();
    let heard = log.events.iter().filter(|event| event.success).count();
    let all = log.events.len();
    if heard == all {
        let text = format!(
            "no event is a miss ({all} heard): such a log contains no information about where messages are lost; add events for messages that were sent \
             and not heard (pingmap import finds them from a schedule or from recorded transmissions)"
        );
        findings.push(nonsense("heard_only", text));
    } else if heard == 0 {
        let text = format!("all of {all} events are misses: the map shows no place where messages are heard");
        findings.push(odd("missed_only", text));
    } else {
        let mut by_receiver: BTreeMap<&VehicleId, PairCount> = BTreeMap::new();
        for event in &log.events {
            let counts = by_receiver.entry(&event.receiver_id).or_default();
            *if event.success { &mut counts.heard } else { &mut counts.missed } += 1;
        }
        for (id, PairCount { heard, .. }) in
            by_receiver.iter().filter(|(_, counts)| counts.missed == 0 && counts.heard >= EVENTS_MIN)
        {
            let text = format!("{id} missed nothing in {heard} events: were its misses recorded?");
            findings.push(odd("receiver_heard_only", text));
        }
    }
    if all < EVENTS_MIN {
        findings.push(odd("few_events", format!("only {all} events: barely enough to learn from")));
    }
    findings
}

/// Finds degrees in place of metres, and positions far from all others.
fn positions(log: &EventLog) -> Vec<Finding> {
    let mut findings = Vec::new();
    let ends = || log.events.iter().flat_map(|event| event.link.ends());
    let middle = |of: fn(&Position) -> f64| {
        let mut values: Vec<f64> = ends().map(|end| of(&end)).collect();
        values.sort_by(f64::total_cmp);
        let wide = values.last().zip(values.first()).map_or(0.0, |(last, first)| last - first);
        (values.get(values.len() / 2).copied().unwrap_or(0.0), wide)
    };
    let ((east_m, wide_m), (north_m, high_m)) = (middle(|end| end.east_m), middle(|end| end.north_m));
    let spread = wide_m.max(high_m);
    let is_degrees = spread > 0.0 && spread < DEGREES_WIDE && east_m.abs().max(north_m.abs()) > DEGREES_TIMES * spread;
    if is_degrees && east_m.abs() <= 180.0 && north_m.abs() <= 90.0 {
        let text = format!(
            "all positions lie within {spread:.3} m of each other, about ({east_m:.3}, {north_m:.3}): these seem to be degrees instead of \
             metres (pingmap import reads latitude and longitude)"
        );
        findings.push(nonsense("degrees", text));
    }
    let area = MainArea::of(&ends().collect::<Vec<_>>());
    let is_far = |event: &&Event| event.link.ends().iter().any(|end| !area.contains(end));
    let far = log.events.iter().filter(is_far).count();
    if let Some(first) = log.events.iter().find(is_far) {
        let text = format!(
            "{far} events have an end more than {:.0} km from the centre of the log, the first at {} s: are their positions right?",
            area.radius_m / 1000.0,
            first.time_s
        );
        findings.push(odd("far_away", text));
    }
    findings
}

/// Finds names that differ in case only, names that stand for all vehicles, and vehicles that receive themselves.
fn names(log: &EventLog) -> Vec<Finding> {
    let mut findings = Vec::new();
    let all: BTreeSet<&VehicleId> =
        log.events.iter().flat_map(|event| [&event.transmitter_id, &event.receiver_id]).collect();
    let mut alike: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for id in &all {
        alike.entry(id.as_str().to_lowercase()).or_default().push(id.as_str());
    }
    for names in alike.values().filter(|names| names.len() > 1) {
        findings.push(odd(
            "names_alike",
            format!("{} differ in case only, and count as different vehicles", names.join(" and ")),
        ));
    }
    for id in all.iter().filter(|id| is_everybody(id.as_str()) || is_broadcast_address(log, id)) {
        let text =
            format!("{id} counts as a vehicle: record a broadcast as one event for each vehicle that could hear it");
        findings.push(odd("broadcast_vehicle", text));
    }
    let own = log.events.iter().filter(|event| event.transmitter_id == event.receiver_id).count();
    if own > 0 {
        findings.push(odd(
            "own_messages",
            format!("{own} events have the same vehicle at both ends: a vehicle does not receive itself"),
        ));
    }
    if let ([only], false) = (log.vehicles().as_slice(), log.events.is_empty()) {
        let text = format!("{only} is the only receiver: there is no vehicle to share with");
        findings.push(odd("one_receiver", text));
    }
    findings
}

/// Whether a name is a broadcast address of modems, and never transmits.
fn is_broadcast_address(log: &EventLog, id: &VehicleId) -> bool {
    matches!(id.as_str(), "0" | "63" | "127" | "255") && log.events.iter().all(|event| event.transmitter_id != *id)
}

/// Whether a name stands for all vehicles.
pub fn is_everybody(name: &str) -> bool {
    ["*", "broadcast", "everybody", "all"].iter().any(|everybody| name.eq_ignore_ascii_case(everybody))
}

/// Finds vehicles that move faster than possible.
fn jumps(log: &EventLog) -> Vec<Finding> {
    let mut tracks: BTreeMap<&VehicleId, Vec<(f64, Position)>> = BTreeMap::new();
    for event in &log.events {
        let Link { transmitter, receiver } = event.link;
        tracks.entry(&event.transmitter_id).or_default().push((event.time_s, transmitter));
        tracks.entry(&event.receiver_id).or_default().push((event.time_s, receiver));
    }
    let mut findings = Vec::new();
    for (id, track) in &mut tracks {
        track.sort_by(|a, b| a.0.total_cmp(&b.0));
        let is_jump = |pair: &&[(f64, Position)]| {
            let far_m = (pair[1].1.east_m - pair[0].1.east_m).hypot(pair[1].1.north_m - pair[0].1.north_m);
            far_m > JUMP_MIN_M && far_m > SPEED_MAX_M_PER_S * (pair[1].0 - pair[0].0)
        };
        let count = track.windows(2).filter(is_jump).count();
        if let Some(first) = track.windows(2).find(is_jump) {
            let text = format!(
                "{id} exceeds {SPEED_MAX_M_PER_S} m/s {count} times, first from ({:.0}, {:.0}) m at {} s to \
                 ({:.0}, {:.0}) m at {} s",
                first[0].1.east_m, first[0].1.north_m, first[0].0, first[1].1.east_m, first[1].1.north_m, first[1].0
            );
            findings.push(odd("jumps", text));
        }
    }
    findings
}

/// Finds receivers with long silences that neither range nor position explains.
fn silences(log: &EventLog) -> Vec<Finding> {
    let links: Vec<Link> = log.events.iter().map(|event| event.link).collect();
    let outcomes: Vec<bool> = log.events.iter().map(|event| event.success).collect();
    let by_distance = DistanceOnly::fit(&links, &outcomes);
    let heard: HashSet<(u64, &VehicleId)> = log.events.iter().filter(|event| event.success).map(transmission).collect();
    let near_m = NEAR_SHARE * log.chart().scale_m;
    let mut findings = Vec::new();
    for id in log.vehicles() {
        let mut own: Vec<&Event> = log.events.iter().filter(|event| event.receiver_id == id).collect();
        own.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        // If another receiver heard a message, the receiver caused the silence, not the water. Without other receivers
        // of its senders, a silence must be much less probable to be reported.
        let senders: HashSet<&VehicleId> = own.iter().map(|event| &event.transmitter_id).collect();
        let is_witness = |event: &Event| event.receiver_id != id && senders.contains(&event.transmitter_id);
        let has_witnesses = log.events.iter().any(is_witness);
        own.retain(|event| !has_witnesses || heard.contains(&transmission(event)));
        let least_nats = if has_witnesses { SILENCE_NATS } else { UNWITNESSED_TIMES * SILENCE_NATS };
        let nats = |event: &&Event| -(1.0 - by_distance.probability(&event.link)).ln();
        let silences = own.split(|event| event.success).filter(|run| run.len() >= SILENCE_EVENTS_MIN);
        let odd_by_range = silences.filter(|run| run.iter().map(nats).sum::<f64>() > least_nats);
        let mut odd_by_place = odd_by_range.filter(|run| nats_by_place(log, run, near_m) > least_nats);
        if let Some(run) = odd_by_place.next() {
            let (count, from_s, to_s) = (run.len(), run[0].time_s, run[run.len() - 1].time_s);
            let others = if has_witnesses { " that others hear" } else { "" };
            let text = format!(
                "{id} hears none of {count} messages from {from_s} to {to_s} s{others}, although messages arrive at its position at other \
                 times: was it recording? If not, these events are not misses (pingmap import --listening)"
            );
            findings.push(odd("silent_receiver", text));
        }
    }
    findings
}

/// Finds pairs that hear nothing while the opposite direction hears half of the messages.
fn silent_pairs(log: &EventLog) -> Vec<Finding> {
    let pairs = log.pairs();
    let silent = pairs.iter().filter_map(|((sender, receiver), pair)| {
        let reverse = pairs.get(&(receiver.clone(), sender.clone()))?;
        let is_silent = pair.heard == 0 && pair.missed >= SILENT_PAIR_EVENTS_MIN;
        let is_reverse_heard = reverse.heard >= reverse.missed && reverse.heard > 0;
        (is_silent && is_reverse_heard).then(|| {
            let text = format!(
                "{receiver} heard none of {} messages from {sender}, and {sender} heard {} of {} from {receiver}: {receiver} may be deaf \
                 (pingmap import --not-listening {receiver}=FROM/TO leaves out a span)",
                pair.missed,
                reverse.heard,
                reverse.heard + reverse.missed
            );
            odd("silent_pair", text)
        })
    });
    silent.collect()
}

/// Returns the improbability of a silence in nats, from the outcomes over nearly equal links at other times, in either
/// direction. Without such outcomes it is 0. O([`LOOKED_AT_MAX`] · [`LOOKED_THROUGH_MAX`]).
fn nats_by_place(log: &EventLog, run: &[&Event], near_m: f64) -> f64 {
    let (from_s, to_s) = (run[0].time_s, run[run.len() - 1].time_s);
    let meanwhile = |event: &&Event| (from_s..=to_s).contains(&event.time_s);
    // A receiver that hears nothing during the silence is not evidence of working links.
    let meanwhile_heard = log.events.iter().filter(meanwhile).filter(|event| event.success);
    let witnesses: HashSet<&VehicleId> = meanwhile_heard.map(|event| &event.receiver_id).collect();
    let elsewhen = |event: &&Event| !meanwhile(event) || witnesses.contains(&event.receiver_id);
    let every = log.events.len().div_ceil(LOOKED_THROUGH_MAX);
    let others: Vec<&Event> = log.events.iter().step_by(every).filter(elsewhen).collect();
    let step = run.len().div_ceil(LOOKED_AT_MAX);
    let of = |event: &&Event| {
        let off_m = |other: &Event| apart_m(&event.link, &other.link).min(apart_m(&event.link, &other.link.swapped()));
        let mut near: Vec<(f64, bool)> = others.iter().map(|other| (off_m(other), other.success)).collect();
        near.retain(|(off_m, _)| *off_m <= near_m);
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(NEIGHBOURS);
        let heard = near.iter().filter(|(_, success)| *success).count() as f64;
        let probability = (heard + 0.5) / (near.len() as f64 + 1.0);
        if near.len() < NEIGHBOURS { 0.0 } else { -(1.0 - probability).ln() }
    };
    step as f64 * run.iter().step_by(step).map(of).sum::<f64>()
}

/// Returns the distance between two links over both ends together.
fn apart_m(a: &Link, b: &Link) -> f64 {
    let ends = a.ends().into_iter().zip(b.ends());
    ends.map(|(a, b)| (a.east_m - b.east_m).hypot(a.north_m - b.north_m)).fold(0.0, f64::hypot)
}

fn transmission(event: &Event) -> (u64, &VehicleId) {
    (event.time_s.to_bits(), &event.transmitter_id)
}

/// Finds repeated and contradicting rows, few distinct links, and unknown columns.
fn rows(log: &EventLog) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut known: HashMap<_, PairCount> = HashMap::new();
    for event in &log.events {
        let counts = known.entry((transmission(event), &event.receiver_id, &event.kind)).or_default();
        *if event.success { &mut counts.heard } else { &mut counts.missed } += 1;
    }
    let again = |counts: &PairCount| counts.heard.saturating_sub(1) + counts.missed.saturating_sub(1);
    let twice: usize = known.values().map(again).sum();
    let both = known.values().filter(|counts| counts.heard > 0 && counts.missed > 0).count();
    if twice > 0 {
        findings.push(odd("duplicate_rows", format!("{twice} events are repeated, and every repetition counts")));
    }
    if both > 0 {
        findings.push(odd("contradictions", format!("{both} events are heard in one row and missed in another")));
    }
    let bits =
        |link: &Link| link.ends().map(|end| [end.east_m, end.north_m, end.depth_m.unwrap_or(0.0)].map(f64::to_bits));
    let distinct: HashSet<_> = log.events.iter().map(|event| bits(&event.link)).collect();
    let all = log.events.len();
    if all >= 100 && distinct.len() * REPEATED < all {
        let text =
            format!("only {} distinct links among {all} events: the map is uncertain between them", distinct.len());
        findings.push(odd("few_links", text));
    }
    if !log.unknown_columns.is_empty() {
        findings.push(odd("unknown_columns", format!("ignoring the column {}", some_of(&log.unknown_columns))));
    }
    findings
}

/// Lists the first 20 names, and the number of the others.
fn some_of(names: &[String]) -> String {
    const NAMED_MAX: usize = 20;
    match names.len().saturating_sub(NAMED_MAX) {
        0 => names.join(", "),
        more => format!("{} and {more} more", names[..NAMED_MAX].join(", ")),
    }
}

//! What is odd about a log: slips of the pen, of the clock and of the join that made it.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use pingmap_agent::{Event, Link, Position, VehicleId};

use crate::baseline::DistanceOnly;
use crate::event_log::EventLog;

/// Fewer events than this say little.
const EVENTS_MIN: usize = 30;

/// No vehicle goes faster, metres a second; and no fix is worse than this, metres.
const SPEED_MAX_M_PER_S: f64 = 10.0;
const JUMP_MIN_M: f64 = 100.0;

/// Places so many times farther from the middle than half of all are far from everything, if they are at least so far, metres.
const FAR_TIMES: f64 = 30.0;
const FAR_MIN_M: f64 = 5_000.0;

/// Places closer together than this that lie so many times farther from (0, 0) are degrees.
const DEGREES_WIDE: f64 = 2.0;
const DEGREES_TIMES: f64 = 8.0;

/// A silence is odd that has this log-probability by range alone, and so many misses.
const SILENCE_NATS: f64 = 15.0;
const SILENCE_EVENTS_MIN: usize = 10;
const UNWITNESSED_TIMES: f64 = 2.0;

/// Links are nearly the same if their ends are apart by this share of the chart's scale; so many of them say what to expect, of so
/// many misses at most.
const NEAR_SHARE: f64 = 0.7;
const NEIGHBOURS: usize = 5;
const LOOKED_AT_MAX: usize = 50;
const LOOKED_THROUGH_MAX: usize = 20_000;

/// A log with fewer distinct links than one in so many events says little between them.
const REPEATED: usize = 20;

/// Something odd about a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// What, for programs.
    pub check: &'static str,
    /// Whether a map of such a log would be nonsense.
    pub is_nonsense: bool,
    /// What, for people, and the way out.
    pub text: String,
}

/// What a log says of the messages from one vehicle to another.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PairCount {
    /// Heard.
    pub heard: usize,
    /// Missed.
    pub missed: usize,
}

/// Share heard over distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeBin {
    /// From here.
    pub from_m: f64,
    /// To here.
    pub to_m: f64,
    /// Events.
    pub events: usize,
    /// Of which heard.
    pub heard: usize,
}

impl EventLog {
    /// Heard and missed for each sender and receiver.
    pub fn pairs(&self) -> BTreeMap<(VehicleId, VehicleId), PairCount> {
        let mut pairs: BTreeMap<_, PairCount> = BTreeMap::new();
        for event in &self.events {
            let pair = pairs.entry((event.transmitter_id.clone(), event.receiver_id.clone())).or_default();
            *if event.success { &mut pair.heard } else { &mut pair.missed } += 1;
        }
        pairs
    }

    /// Share heard over distance, in at most so many bins of about as many events.
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

    /// Everything odd. O(n log n).
    pub fn findings(&self) -> Vec<Finding> {
        let checks = [outcomes, positions, names, jumps, silences, rows];
        checks.iter().flat_map(|check| check(self)).collect()
    }
}

fn odd(check: &'static str, text: String) -> Finding {
    Finding { check, is_nonsense: false, text }
}

fn nonsense(check: &'static str, text: String) -> Finding {
    Finding { check, is_nonsense: true, text }
}

/// One outcome only, of all or of one receiver, and few events.
fn outcomes(log: &EventLog) -> Vec<Finding> {
    let mut findings = Vec::new();
    let heard = log.events.iter().filter(|event| event.success).count();
    let all = log.events.len();
    if heard == all {
        let text = format!(
            "no event is a miss ({all} heard): such a log says nothing about where messages are lost; events are needed of what was sent \
             and not heard (pingmap import finds them from a schedule or from what was sent)"
        );
        findings.push(nonsense("heard_only", text));
    } else if heard == 0 {
        let text = format!("all of {all} events missed: the map can only say so with growing certainty");
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
        findings.push(odd("few_events", format!("only {all} events: hardly enough to learn from")));
    }
    findings
}

/// Degrees in the place of metres, and places far from everything.
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
            "all positions lie within {spread:.3} m of each other, about ({east_m:.3}, {north_m:.3}): these are degrees in the place of \
             metres (pingmap import takes latitude and longitude)"
        );
        findings.push(nonsense("degrees", text));
    }
    let away_m = |end: &Position| (end.east_m - east_m).hypot(end.north_m - north_m);
    let mut distances: Vec<f64> = ends().map(|end| away_m(&end)).collect();
    distances.sort_by(f64::total_cmp);
    let far_m = (FAR_TIMES * distances.get(distances.len() / 2).copied().unwrap_or(0.0)).max(FAR_MIN_M);
    let is_far = |event: &&Event| event.link.ends().iter().any(|end| away_m(end) > far_m);
    let far = log.events.iter().filter(is_far).count();
    if let Some(first) = log.events.iter().find(is_far) {
        let text = format!(
            "{far} events have an end more than {:.0} km from the middle of all, the first at {} s: a slip in its position?",
            far_m / 1000.0,
            first.time_s
        );
        findings.push(odd("far_away", text));
    }
    findings
}

/// Names that mean one vehicle or everybody, and vehicles that hear themselves.
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
            format!("{} differ in case only, and are taken for different vehicles", names.join(" and ")),
        ));
    }
    for id in all.iter().filter(|id| is_everybody(id.as_str()) || may_be_everybody(log, id)) {
        let text = format!("{id} is taken for a vehicle: a message to everybody is an event of each who could hear it");
        findings.push(odd("broadcast_vehicle", text));
    }
    let own = log.events.iter().filter(|event| event.transmitter_id == event.receiver_id).count();
    if own > 0 {
        findings.push(odd(
            "own_messages",
            format!("{own} events have the same vehicle at both ends: no vehicle hears itself"),
        ));
    }
    if let ([only], false) = (log.vehicles().as_slice(), log.events.is_empty()) {
        let text = format!("{only} is the only receiver: there is nobody to share with");
        findings.push(odd("one_receiver", text));
    }
    findings
}

/// Whether it is a number by which modems call everybody, and never sends.
fn may_be_everybody(log: &EventLog, id: &VehicleId) -> bool {
    matches!(id.as_str(), "0" | "63" | "127" | "255") && log.events.iter().all(|event| event.transmitter_id != *id)
}

/// Whether a name means everybody.
pub fn is_everybody(name: &str) -> bool {
    ["*", "broadcast", "everybody", "all"].iter().any(|everybody| name.eq_ignore_ascii_case(everybody))
}

/// Vehicles that move faster than any does.
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
                "{id} jumps {count} times farther than {SPEED_MAX_M_PER_S} m/s would bring it, first from ({:.0}, {:.0}) m at {} s to \
                 ({:.0}, {:.0}) m at {} s",
                first[0].1.east_m, first[0].1.north_m, first[0].0, first[1].1.east_m, first[1].1.north_m, first[1].0
            );
            findings.push(odd("jumps", text));
        }
    }
    findings
}

/// Receivers that hear nothing for so long that neither their range nor their place explains it.
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
        // What another one heard says that the receiver, and not the water, was silent. Where nobody else can have heard its
        // senders, a silence must be much less likely still.
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
                "{id} hears none of {count} messages from {from_s} to {to_s} s{others}, though it is where messages arrive at other \
                 times: was it recording? If not, these are no misses (pingmap import --listening)"
            );
            findings.push(odd("silent_receiver", text));
        }
    }
    findings
}

/// How unlikely a silence is by what became of messages over nearly the same links, either way, at other times. Where there were none
/// nothing is unlikely. O([`LOOKED_AT_MAX`] · [`LOOKED_THROUGH_MAX`]).
fn nats_by_place(log: &EventLog, run: &[&Event], near_m: f64) -> f64 {
    let (from_s, to_s) = (run[0].time_s, run[run.len() - 1].time_s);
    let meanwhile = |event: &&Event| (from_s..=to_s).contains(&event.time_s);
    // Who hears nothing in the meantime, too, is no witness.
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

/// How far both ends of two links are apart together.
fn apart_m(a: &Link, b: &Link) -> f64 {
    let ends = a.ends().into_iter().zip(b.ends());
    ends.map(|(a, b)| (a.east_m - b.east_m).hypot(a.north_m - b.north_m)).fold(0.0, f64::hypot)
}

fn transmission(event: &Event) -> (u64, &VehicleId) {
    (event.time_s.to_bits(), &event.transmitter_id)
}

/// Rows that stand twice, rows that contradict each other, few links, and columns without a meaning.
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
        findings.push(odd("duplicate_rows", format!("{twice} events stand more than once, and count so often")));
    }
    if both > 0 {
        findings.push(odd("contradictions", format!("{both} events are heard in one line and missed in another")));
    }
    let bits =
        |link: &Link| link.ends().map(|end| [end.east_m, end.north_m, end.depth_m.unwrap_or(0.0)].map(f64::to_bits));
    let distinct: HashSet<_> = log.events.iter().map(|event| bits(&event.link)).collect();
    let all = log.events.len();
    if all >= 100 && distinct.len() * REPEATED < all {
        let text =
            format!("only {} distinct links among {all} events: the map says little between them", distinct.len());
        findings.push(odd("few_links", text));
    }
    if !log.unknown_columns.is_empty() {
        findings.push(odd("unknown_columns", format!("ignoring the column {}", some_of(&log.unknown_columns))));
    }
    findings
}

/// The first of some names, and how many more there are.
fn some_of(names: &[String]) -> String {
    const NAMED_MAX: usize = 20;
    match names.len().saturating_sub(NAMED_MAX) {
        0 => names.join(", "),
        more => format!("{} and {more} more", names[..NAMED_MAX].join(", ")),
    }
}

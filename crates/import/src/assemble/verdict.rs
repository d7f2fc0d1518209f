//! The verdict on an import: contradictions between the records, and doubtful properties.

use std::collections::BTreeMap;
use std::fmt;

use pingmap_agent::VehicleId;
use pingmap_trial::EventLog;

use crate::assemble::clock_estimate::ClockEstimate;
use crate::assemble::clocks::fleet_clocks::{ClockAmbiguity, FleetClocks};
use crate::assemble::matching::MatchTable;
use crate::assemble::pair_counts::{PairCounts, PairTable};
use crate::assemble::rules::Rules;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::{Transmission, TransmissionEvidence};
use crate::model::schedule::Schedule;
use crate::model::time::time_in_words;

/// Largest share of receptions that may fit no transmission.
const UNASSIGNED_SHARE_MAX: f64 = 0.1;

/// A clock agrees with another one up to this offset, in seconds.
const ZERO_OFFSET_S: f64 = 1.5;

/// Largest plausible drift of a clock, in seconds per second.
const DRIFT_MAX: f64 = 1e-4;

/// Largest plausible 75 % quantile of the residuals of a clock, in seconds.
const RESIDUAL_S_MAX: f64 = 0.5;

/// Largest plausible deviation of a sender's delay from the median delay, in seconds.
const DELAY_DEVIATION_S_MAX: f64 = 0.5;

/// Largest difference between a transmission in a slot and the start of the slot, in seconds, besides its length.
const SLOT_MARGIN_S: f64 = 1.0;

/// Depths above this are no measurement errors of a vehicle at the surface, in metres.
const IN_AIR_M: f64 = -0.5;

/// A contradiction between the records of the vehicles.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Contradiction {
    /// Many receptions fit no transmission, so clocks, identifiers or records are wrong.
    UnassignedReceptions {
        /// Receptions that fit no transmission, within the record or the schedule of their sender.
        unassigned: usize,
        /// All receptions of messages from vehicles with a recording.
        receptions: usize,
    },
    /// A sender recorded more transmissions than the schedule has slots for it.
    MoreTransmissionsThanSlots {
        /// The sender.
        sender: VehicleId,
        /// Number of its recorded transmissions.
        transmissions: usize,
        /// Number of its slots from its first to its last transmission.
        slots: usize,
    },
    /// Several clock offsets fit equally well, and the offset zero does not fit.
    AmbiguousClock(ClockAmbiguity),
}

impl fmt::Display for Contradiction {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Contradiction::UnassignedReceptions { unassigned, receptions } => write!(
                formatter,
                "{unassigned} of {receptions} receptions fit no recorded transmission or slot; expected at most a tenth: check the clocks \
                 (--clock-offset-s-max), the ids (--ids), the schedule, and whether the records of transmissions are complete"
            ),
            Contradiction::MoreTransmissionsThanSlots { sender, transmissions, slots } => write!(
                formatter,
                "{sender} recorded {transmissions} transmissions, and the schedule gives it {slots} slots in this time: check the schedule"
            ),
            Contradiction::AmbiguousClock(ambiguity) => write!(
                formatter,
                "{}, because slots repeat, and no offset near zero fits: if you know the clock, shift the times of its files, or limit the \
                 offset with --clock-offset-s-max",
                describe(ambiguity)
            ),
        }
    }
}

/// The verdict on the records of a fleet.
pub(crate) struct Verdict {
    pub(crate) contradictions: Vec<Contradiction>,
    /// Doubtful properties, as sentences.
    pub(crate) warnings: Vec<String>,
    /// Number of messages that fit no recorded transmission or slot, by sender.
    pub(crate) unexpected: BTreeMap<VehicleId, usize>,
}

/// All that a verdict is about.
pub(crate) struct Evidence<'a> {
    pub(crate) fleet: &'a Fleet<'a>,
    pub(crate) clocks: &'a FleetClocks,
    pub(crate) transmissions: &'a [Vec<Transmission>],
    pub(crate) matched: &'a MatchTable,
    pub(crate) pairs: &'a PairTable,
    pub(crate) estimates: &'a [ClockEstimate],
    /// Number of transmissions that only receptions show, of senders with a schedule.
    pub(crate) unscheduled: &'a BTreeMap<usize, usize>,
    pub(crate) schedule: Option<&'a Schedule>,
}

impl Verdict {
    /// Examines the records. O(n) in the number of records.
    pub(crate) fn new(evidence: &Evidence) -> Self {
        let mut contradictions: Vec<Contradiction> = unassigned_receptions(evidence).into_iter().collect();
        contradictions.extend(excess_transmissions(evidence));
        let is_contradiction = |ambiguity: &&ClockAmbiguity| {
            let mut offsets_s = ambiguity.others_s.iter().chain([&ambiguity.offset_s]);
            // A reception that is recorded after the message's end resembles a clock that is ahead.
            let latest_s = evidence.fleet.rules.message_s + ZERO_OFFSET_S;
            offsets_s.all(|offset_s| !(-ZERO_OFFSET_S..=latest_s).contains(offset_s))
        };
        let (unknown, near_zero): (Vec<_>, Vec<_>) = evidence.clocks.ambiguities.iter().partition(is_contradiction);
        contradictions.extend(unknown.into_iter().cloned().map(Contradiction::AmbiguousClock));
        let mut warnings: Vec<String> = clock_warnings(evidence).collect();
        warnings.extend(
            near_zero
                .into_iter()
                .map(|ambiguity| format!("{}; --clock-offset-s-max limits the offset", describe(ambiguity))),
        );
        warnings.extend(late_senders(evidence));
        warnings.extend(surfaced_vehicles(evidence.fleet));
        Self { contradictions, warnings, unexpected: unexpected(evidence) }
    }
}

fn describe(ambiguity: &ClockAmbiguity) -> String {
    let others: Vec<String> = ambiguity.others_s.iter().map(|offset_s| format!("{offset_s:+.1} s")).collect();
    format!(
        "the clock of {} fits that of {} with an offset of {:+.1} s, which is used, and as well with {}",
        ambiguity.clock,
        ambiguity.other,
        ambiguity.offset_s,
        others.join(", ")
    )
}

/// Counts the messages that fit no recorded transmission or slot, by sender.
fn unexpected(evidence: &Evidence) -> BTreeMap<VehicleId, usize> {
    let mut counts = BTreeMap::new();
    for (sender, vehicle) in evidence.fleet.vehicles.iter().enumerate() {
        let to_all = evidence.pairs.iter().filter(|(pair, _)| pair.1 == sender);
        let unassigned: usize = to_all.map(|(_, pair)| pair.unassigned).sum();
        let count = unassigned + evidence.unscheduled.get(&sender).copied().unwrap_or(0);
        counts.extend((count > 0).then(|| (vehicle.name.clone(), count)));
    }
    counts
}

/// Compares the receptions that fit nothing with all. A reception before the first or after the last recorded
/// transmission of its sender is no contradiction: the record began late or ended early.
fn unassigned_receptions(evidence: &Evidence) -> Option<Contradiction> {
    let Evidence { matched, pairs, unscheduled, .. } = *evidence;
    let outside: usize = matched.values().map(|matches| matches.outside_record).sum();
    let unassigned: usize = pairs.values().map(|pair| pair.unassigned).sum::<usize>() - outside;
    let unassigned = unassigned + unscheduled.values().sum::<usize>();
    let count = |pair: &PairCounts| pair.assigned + pair.unassigned;
    let receptions: usize = pairs.values().map(count).sum::<usize>() - outside;
    let is_large = unassigned as f64 > UNASSIGNED_SHARE_MAX * receptions as f64;
    is_large.then_some(Contradiction::UnassignedReceptions { unassigned, receptions })
}

/// Returns the senders with more recorded transmissions than slots.
fn excess_transmissions<'a>(evidence: &'a Evidence) -> impl Iterator<Item = Contradiction> + 'a {
    let senders = evidence.transmissions.iter().zip(&evidence.fleet.vehicles);
    senders.filter_map(|(transmissions, vehicle)| {
        let recorded = transmissions
            .iter()
            .filter(|transmission| transmission.evidence == TransmissionEvidence::Recorded)
            .map(|transmission| transmission.time_s);
        let (schedule, rules) = (evidence.schedule?, evidence.fleet.rules);
        let times_s: Vec<f64> = recorded.collect();
        let mut receptions_s: Vec<f64> = vehicle.messages.values().flatten().map(|message| message.time_s).collect();
        receptions_s.sort_by(f64::total_cmp);
        let has_within = |times_s: &[f64], from_s: f64, to_s: f64| {
            times_s.get(times_s.partition_point(|time_s| *time_s < from_s)).is_some_and(|time_s| *time_s <= to_s)
        };
        let slots_s = slots_around_s(schedule, vehicle.name, &times_s, rules.match_s)?;
        // Acknowledgements and replies follow a reception, and need no slot.
        let is_answer = |time_s: &f64| {
            has_within(&receptions_s, time_s - rules.message_s, *time_s)
                && !has_within(&slots_s, time_s - rules.message_s - SLOT_MARGIN_S, time_s + SLOT_MARGIN_S)
        };
        let own: Vec<f64> = times_s.into_iter().filter(|time_s| !is_answer(time_s)).collect();
        excess(vehicle.name, &own, &slots_s, rules.match_s)
    })
}

/// Returns the slots of a sender around its transmissions, which are in the order of time; `None` without both.
fn slots_around_s(schedule: &Schedule, sender: &VehicleId, times_s: &[f64], margin_s: f64) -> Option<Vec<f64>> {
    schedule.senders().find(|name| *name == sender)?;
    Some(schedule.slot_starts_s(sender, times_s.first()? - margin_s, times_s.last()? + margin_s))
}

/// Compares the transmissions of a sender with its slots around them. Both are in the order of time.
fn excess(sender: &VehicleId, times_s: &[f64], slots_s: &[f64], margin_s: f64) -> Option<Contradiction> {
    let span_s = times_s.first()? - margin_s..=times_s.last()? + margin_s;
    let slots = slots_s.iter().filter(|slot_s| span_s.contains(slot_s)).count();
    let (sender, transmissions) = (sender.clone(), times_s.len());
    (transmissions > slots).then_some(Contradiction::MoreTransmissionsThanSlots { sender, transmissions, slots })
}

/// Compares the transmissions in a log of any origin with a schedule. O(n log n).
pub fn compare_with_schedule(log: &EventLog, schedule: &Schedule) -> Vec<Contradiction> {
    let mut by_sender: BTreeMap<&VehicleId, Vec<f64>> = BTreeMap::new();
    for event in &log.events {
        by_sender.entry(&event.transmitter_id).or_default().push(event.time_s);
    }
    let rules = Rules::default();
    let compare = |(sender, mut times_s): (&VehicleId, Vec<f64>)| {
        times_s.sort_by(f64::total_cmp);
        // Some logs have the times at which each receiver recorded the message.
        times_s.dedup_by(|later, earlier| *later - *earlier < rules.message_s);
        let slots_s = slots_around_s(schedule, sender, &times_s, rules.match_s)?;
        excess(sender, &times_s, &slots_s, rules.match_s)
    };
    by_sender.into_iter().filter_map(compare).collect()
}

/// Returns a warning for each clock with an implausible offset, drift or residual.
fn clock_warnings<'a>(evidence: &'a Evidence) -> impl Iterator<Item = String> + 'a {
    let Evidence { fleet, clocks, estimates, .. } = *evidence;
    let reference = fleet.reference_clock().filter(|&vehicle| !fleet.clock_sync_times_s(vehicle).is_empty());
    let was_set = reference.map(|vehicle| {
        format!(
            "the clock of {0}, to which times are corrected, was set during the mission; its times before that are used as they are \
             (name another vehicle with --correct-clocks, unless the steps were small)",
            fleet.vehicles[vehicle].name
        )
    });
    let doubtful = clocks.clocks.iter().enumerate().flat_map(move |(vehicle, clock)| {
        let name = fleet.vehicles[vehicle].name;
        let limit_s = fleet.rules.clock_offset_s_max;
        let offset_s = clock.segments().map(|segment| segment.offset_s.abs()).fold(0.0, f64::max);
        let drift = clock.segments().map(|segment| segment.drift.abs()).fold(0.0, f64::max);
        let residual_s = estimates[vehicle].upper_residual_s;
        let is_searched = limit_s > 0.0 && clock.is_determined;
        let far = (is_searched && offset_s > limit_s + ZERO_OFFSET_S).then(|| {
            format!("the clock of {name} fits best with an offset of {offset_s:.2} s, which is used although it exceeds --clock-offset-s-max {limit_s}")
        });
        let fast = (drift > DRIFT_MAX)
            .then(|| format!("the clock of {name} seems to drift by {:.0} ppm; expected at most 100 ppm: check its times", 1e6 * drift));
        let loose = (residual_s > RESIDUAL_S_MAX).then(|| {
            format!(
                "a quarter of the messages of {name} are recorded more than {residual_s:.1} s earlier or later than expected: its clock was \
                 set during the mission, or its times are those of polling"
            )
        });
        [far, fast, loose].into_iter().flatten()
    });
    let stepped = clocks.steps.iter().map(move |(vehicle, step)| {
        let (name, time) = (fleet.vehicles[*vehicle].name, time_in_words(step.time_s));
        format!("the clock of {name} stepped by {:+.1} s at about {time}, which no record of it shows", step.size_s())
    });
    was_set.into_iter().chain(stepped).chain(doubtful)
}

/// Names the senders whose transmissions are recorded later or earlier than those of others.
fn late_senders<'a>(evidence: &'a Evidence) -> impl Iterator<Item = String> + 'a {
    let delays = &evidence.clocks.delays;
    let median_s = delays.median_s();
    evidence.fleet.vehicles.iter().enumerate().filter_map(move |(sender, vehicle)| {
        let late_s = median_s - delays.of_sender_s(sender);
        let is_late = late_s.abs() > DELAY_DEVIATION_S_MAX && !evidence.transmissions[sender].is_empty();
        let (word, moment) = if late_s > 0.0 { ("later", "end") } else { ("earlier", "start") };
        is_late.then(|| {
            format!(
                "{} records transmissions {:.1} s {word} than other vehicles, relative to receptions: probably the {moment} of each packet",
                vehicle.name,
                late_s.abs()
            )
        })
    })
}

/// Names each vehicle that was at the surface by the rules, or in the air by its own depth, with the spans of time.
fn surfaced_vehicles<'a>(fleet: &'a Fleet) -> impl Iterator<Item = String> + 'a {
    fleet.vehicles.iter().filter_map(|vehicle| {
        let above_m = fleet.rules.surfaced_above_m.unwrap_or(IN_AIR_M);
        let spans = vehicle.track.spans_above(above_m);
        let (from_s, to_s) = spans.first()?;
        let name = vehicle.name;
        let more = if spans.len() > 1 { format!(", and in {} more spans", spans.len() - 1) } else { String::new() };
        let remedy = match fleet.rules.surfaced_above_m {
            Some(_) => "its messages in this time are left out".to_owned(),
            None => format!("was it in the air? --not-listening {name}=FROM/TO leaves out a span"),
        };
        let [from, to] = [*from_s, *to_s].map(time_in_words);
        Some(format!("{name} is above {above_m} m depth from {from} to {to}{more}: {remedy}"))
    })
}

//! Figures of the import over many missions of one kind.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use pingmap_import::{ImportResult, Reference, join};

use super::kinds::MissionKind;
use super::mission::{Mission, Opportunity};
use super::vehicle::vehicle_name;

/// Smallest share of events with the right outcome.
const RIGHT_SHARE_MIN: f64 = 0.98;

/// Largest share of opportunities that are excluded although the receiver was able to receive.
const EXCLUDED_SHARE_MAX: f64 = 0.1;

/// Largest share of missions that are refused.
const REFUSED_SHARE_MAX: f64 = 0.1;

/// Largest difference between included and excluded opportunities, in standard errors.
const ERRORS_MAX: f64 = 2.0;

/// Largest distance between the time of an event and the record of its transmission, in seconds.
const EVENT_S_MAX: f64 = 0.01;

/// Imports a mission with given outcomes; `None` if the records are refused.
pub(super) fn import(mission: &Mission, outcomes: &[Opportunity]) -> Option<ImportResult> {
    let recordings = mission.recordings(outcomes);
    join(&recordings, mission.schedule.as_ref(), &Reference::unknown(), &mission.rules).ok()
}

/// Returns the outcome of each event, by packet and receiver.
pub(super) fn included(mission: &Mission, imported: &ImportResult) -> BTreeMap<(usize, usize), bool> {
    let mut records: BTreeMap<VehicleId, Vec<(f64, usize)>> = BTreeMap::new();
    for (index, packet) in mission.packets.iter().enumerate().filter(|(_, packet)| packet.is_recorded()) {
        records.entry(vehicle_name(packet.sender)).or_default().push((mission.record_s(packet), index));
    }
    let receivers: BTreeMap<VehicleId, usize> = (0..mission.vehicles().len()).map(|n| (vehicle_name(n), n)).collect();
    let mut outcomes = BTreeMap::new();
    for event in &imported.log.events {
        let distance_s = |record: &(f64, usize)| (record.0 - event.time_s).abs();
        let nearest = records[&event.transmitter_id].iter().min_by(|a, b| distance_s(a).total_cmp(&distance_s(b)));
        let (_, packet) = nearest.filter(|record| distance_s(record) < EVENT_S_MAX).unwrap();
        let is_new = outcomes.insert((*packet, receivers[&event.receiver_id]), event.success).is_none();
        assert!(is_new, "a second event of one packet at one receiver: {event:?}");
    }
    outcomes
}

/// Opportunities of one mission whose receiver was able to receive, either included or excluded.
#[derive(Debug, Clone, Copy, Default)]
struct Group {
    count: f64,
    heard: f64,
    /// Sum of the true probabilities.
    expected: f64,
}

/// Figures over many missions of one kind.
///
/// Opportunities of deaf receivers are not compared, because all of them are missed: the exclusion of these is right,
/// and an event of one of them is wrong. The comparison subtracts the true probability of each opportunity. Answers
/// cause exclusions, and near vehicles answer more, so that the plain shares differ without any bias.
#[derive(Debug, Default)]
pub(super) struct Measurement {
    /// Included and excluded opportunities of each mission.
    missions: Vec<[Group; 2]>,
    refused: Vec<u64>,
    events: usize,
    /// Events with an outcome that differs from the true one.
    wrong: usize,
    /// Events of deaf receivers.
    deaf: usize,
    /// Excluded opportunities of deaf receivers.
    excluded_deaf: usize,
}

impl Measurement {
    pub(super) const HEADER: &str =
        " right %  deaf %  excluded %  refused  heard: included excluded  difference ± s.e.  less expected ± s.e.";

    /// Imports the missions of the first seeds.
    pub(super) fn new(kind: MissionKind, seeds: u64) -> Self {
        let mut measurement = Self::default();
        for seed in 0..seeds {
            let mission = Mission::new(kind, seed, false);
            let imported = import(&mission, &mission.opportunities);
            match imported.filter(|imported| imported.contradictions.is_empty()) {
                Some(imported) => measurement.add(&mission, &imported),
                None => measurement.refused.push(seed),
            }
        }
        measurement
    }

    fn add(&mut self, mission: &Mission, imported: &ImportResult) {
        let mut events = included(mission, imported);
        self.events += events.len();
        let mut groups = [Group::default(); 2];
        for opportunity in mission.opportunities.iter().filter(|opportunity| mission.is_opportunity(opportunity)) {
            let event = events.remove(&(opportunity.packet, opportunity.receiver));
            self.wrong += usize::from(event.is_some_and(|is_heard| is_heard != opportunity.is_heard));
            if opportunity.is_deaf {
                *if event.is_some() { &mut self.deaf } else { &mut self.excluded_deaf } += 1;
                continue;
            }
            let group = &mut groups[usize::from(event.is_none())];
            group.count += 1.0;
            group.heard += f64::from(u8::from(opportunity.is_heard));
            group.expected += opportunity.probability;
        }
        assert!(events.is_empty(), "events without an opportunity: {events:?}");
        self.missions.push(groups);
    }

    fn sums(&self, value: impl Fn(&Group) -> f64) -> [f64; 2] {
        [0, 1].map(|group| self.missions.iter().map(|groups| value(&groups[group])).sum())
    }

    /// Returns the share of events that are right: the receiver was able to receive, and the outcome is the true one.
    fn right_share(&self) -> f64 {
        1.0 - (self.wrong + self.deaf) as f64 / self.events as f64
    }

    fn excluded_share(&self) -> f64 {
        let [included, excluded] = self.sums(|group| group.count);
        excluded / (included + excluded)
    }

    /// Returns the difference of a mean between included and excluded opportunities, and its standard error with the
    /// missions as clusters. With few exclusions, the error of independent outcomes is a lower limit.
    fn difference(&self, value: impl Fn(&Group) -> f64) -> (f64, f64) {
        let counts = self.sums(|group| group.count);
        let sums = self.sums(&value);
        let means = [sums[0] / counts[0], sums[1] / counts[1]];
        let influence = |groups: &[Group; 2]| {
            let [included, excluded] =
                [0, 1].map(|group| (value(&groups[group]) - means[group] * groups[group].count) / counts[group]);
            included - excluded
        };
        let missions = self.missions.len() as f64;
        let sum: f64 = self.missions.iter().map(|groups| influence(groups).powi(2)).sum();
        let independent: f64 = counts.iter().map(|count| 0.25 / count).sum();
        (means[0] - means[1], (missions / (missions - 1.0) * sum).max(independent).sqrt())
    }

    pub(super) fn meets_bars(&self) -> bool {
        let missions = (self.missions.len() + self.refused.len()) as f64;
        let (difference, error) = self.difference(|group| group.heard - group.expected);
        self.right_share() >= RIGHT_SHARE_MIN
            && self.excluded_share() <= EXCLUDED_SHARE_MAX
            && self.refused.len() as f64 <= REFUSED_SHARE_MAX * missions
            && (self.excluded_share() == 0.0 || difference.abs() <= ERRORS_MAX * error)
    }

    pub(super) fn row(&self) -> String {
        let (heard, counts) = (self.sums(|group| group.heard), self.sums(|group| group.count));
        let (plain, adjusted) =
            (self.difference(|group| group.heard), self.difference(|group| group.heard - group.expected));
        format!(
            "{:8.2}{:8.2}{:12.2}{:9}{:17.3}{:9.3}{:+12.3} ± {:.3}{:+15.3} ± {:.3}   ({} events, {} wrong, {} deaf, {:?} excluded, {} deaf excluded, refused {:?})",
            100.0 * self.right_share(),
            100.0 * self.deaf as f64 / self.events as f64,
            100.0 * self.excluded_share(),
            self.refused.len(),
            heard[0] / counts[0],
            heard[1] / counts[1],
            plain.0,
            plain.1,
            adjusted.0,
            adjusted.1,
            self.events,
            self.wrong,
            self.deaf,
            counts[1],
            self.excluded_deaf,
            self.refused,
        )
    }
}

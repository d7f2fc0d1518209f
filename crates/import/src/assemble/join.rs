//! The steps from recordings to events.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_agent::VehicleId;

use crate::assemble::clock_estimate::ClockEstimate;
use crate::assemble::clocks::fleet_clocks::FleetClocks;
use crate::assemble::events::make_events;
use crate::assemble::evidence::{complete_from_receptions, unconfirmed_slot_owners, undocumented_destinations};
use crate::assemble::matching::{MatchTable, add_received, match_all, receptions};
use crate::assemble::pair_counts::{PairCounts, PairTable};
use crate::assemble::result::{EvidenceCounts, ImportResult, LeftOutCounts};
use crate::assemble::rules::Rules;
use crate::assemble::validation::{check_inputs, check_reference_clock};
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::{Transmission, documented_transmissions, senders};
use crate::assemble::verdict::{Evidence, Verdict};
use crate::model::error::ImportError;
use crate::model::recording::Recordings;
use crate::model::reference::Reference;
use crate::model::schedule::Schedule;

/// Largest number of rounds that match messages and fit clocks in turn.
const ROUNDS_MAX: usize = 30;

/// Joins the recordings of all vehicles into one event log. O(n log n) in the number of records, times the number of
/// vehicles.
///
/// # Errors
/// [`ImportError::Inconsistent`] if no vehicle recorded receptions, a vehicle has no navigation, or a name belongs to
/// no vehicle.
pub fn join(
    recordings: &Recordings,
    schedule: Option<&Schedule>,
    reference: &Reference,
    rules: &Rules,
) -> Result<ImportResult, ImportError> {
    let fleet = Fleet::new(recordings, reference, rules);
    check_inputs(&fleet, schedule)?;
    let mut join = Join::new(&fleet, schedule);
    check_reference_clock(&fleet, &join.clocks)?;
    join.fit_clocks();
    join.process_unmatched();
    complete_from_receptions(join.fleet, &mut join.transmissions, &join.matched);
    let mut result = join.into_result(schedule);
    result.log.reference = reference.system();
    Ok(result)
}

/// The state between the steps of [`join`].
struct Join<'a> {
    fleet: &'a Fleet<'a>,
    /// The transmissions of each vehicle, in the order of time.
    transmissions: Vec<Vec<Transmission>>,
    /// Senders with a record of their transmissions or slots in the schedule.
    documented_senders: BTreeSet<usize>,
    clocks: FleetClocks,
    matched: MatchTable,
    /// Number of transmissions that only receptions show, of senders with a schedule.
    unscheduled: BTreeMap<usize, usize>,
}

impl<'a> Join<'a> {
    /// Collects the transmissions and estimates a first offset of each clock.
    fn new(fleet: &'a Fleet<'a>, schedule: Option<&Schedule>) -> Self {
        let transmissions = documented_transmissions(fleet, schedule);
        let documented_senders = senders(&transmissions);
        let clocks = initial_clocks(fleet, &transmissions, &documented_senders);
        let (matched, unscheduled) = (MatchTable::new(), BTreeMap::new());
        Self { fleet, transmissions, documented_senders, clocks, matched, unscheduled }
    }

    /// Matches messages to transmissions and fits the clocks, in turn until the matches do not change.
    fn fit_clocks(&mut self) {
        for _ in 0..ROUNDS_MAX {
            let matched = match_all(self.fleet, &self.clocks, &self.transmissions);
            if matched == self.matched {
                break;
            }
            self.clocks.refit(self.fleet, &receptions(self.fleet, &self.transmissions, &matched));
            self.matched = matched;
        }
    }

    /// Adds the transmissions that only receptions show, and matches again.
    ///
    /// A sender's own record is complete. A message that fits none of its transmissions is counted, and yields no
    /// event.
    fn process_unmatched(&mut self) {
        for (sender, transmissions) in self.transmissions.iter_mut().enumerate() {
            if self.fleet.vehicles[sender].recording.transmissions.is_none() {
                let added = add_received(self.fleet, &self.clocks, sender, transmissions);
                if self.documented_senders.contains(&sender) {
                    self.unscheduled.insert(sender, added);
                }
            }
        }
        self.matched = match_all(self.fleet, &self.clocks, &self.transmissions);
    }

    /// Makes the events and collects all counts.
    fn into_result(self, schedule: Option<&Schedule>) -> ImportResult {
        let Self { fleet, transmissions, documented_senders, clocks, matched, unscheduled } = self;
        let undocumented_destinations = undocumented_destinations(&transmissions);
        let (log, mut pairs) = make_events(fleet, &clocks, &transmissions, &matched, &undocumented_destinations);
        for (key, pair) in &mut pairs {
            pair.transmissions = transmissions[key.1].len();
            pair.duplicates = fleet.duplicates.get(key).copied().unwrap_or(0);
            if let Some(matches) = matched.get(key) {
                pair.duplicates += matches.duplicates;
                pair.assigned = matches.assigned.len();
                pair.unassigned = matches.unassigned_decoded;
            }
        }
        let estimates = ClockEstimate::fleet_estimates(fleet, &clocks, &receptions(fleet, &transmissions, &matched));
        let verdict = Verdict::new(&Evidence {
            fleet,
            clocks: &clocks,
            transmissions: &transmissions,
            matched: &matched,
            pairs: &pairs,
            estimates: &estimates,
            unscheduled: &unscheduled,
            schedule,
        });
        let left_out = LeftOutCounts {
            unknown_sources: fleet.unknown_sources.clone(),
            unknown_destinations: fleet.unknown_destinations.clone(),
            duplicates: pairs.values().map(|pair| pair.duplicates).sum(),
            own_messages: fleet.own_messages,
            overheard: pairs.values().map(|pair| pair.overheard).sum(),
            unexpected: verdict.unexpected,
            unprojected: fleet.vehicles.iter().map(|vehicle| vehicle.track.unprojected).sum(),
        };
        let undocumented_senders = senders(&transmissions).difference(&documented_senders).copied().collect();
        ImportResult {
            log,
            pairs: named_pairs(fleet, pairs),
            evidence: EvidenceCounts::new(&transmissions),
            clocks: estimates,
            delay_s: clocks.delays.median_s(),
            warnings: verdict.warnings,
            contradictions: verdict.contradictions,
            left_out,
            undocumented_senders: fleet.names(&undocumented_senders),
            undocumented_destinations: fleet.names(&undocumented_destinations),
            unconfirmed_slot_owners: fleet.names(&unconfirmed_slot_owners(&transmissions)),
        }
    }
}

/// Returns the counts of all pairs with any record, by the names of sender and receiver.
fn named_pairs(fleet: &Fleet, pairs: PairTable) -> BTreeMap<(VehicleId, VehicleId), PairCounts> {
    let name = |vehicle: usize| fleet.vehicles[vehicle].name.clone();
    let recorded = pairs.into_iter().filter(|(_, pair)| *pair != PairCounts::default());
    recorded.map(|((receiver, sender), pair)| ((name(sender), name(receiver)), pair)).collect()
}

/// Estimates a first offset of each clock.
///
/// For an undocumented sender, the receptions of one receiver stand in for its transmissions: of the receiver with the
/// most of them.
fn initial_clocks(
    fleet: &Fleet,
    transmissions: &[Vec<Transmission>],
    documented_senders: &BTreeSet<usize>,
) -> FleetClocks {
    let messages =
        |receiver: usize, sender: usize| fleet.vehicles[receiver].messages.get(&sender).map_or(&[][..], Vec::as_slice);
    let mut initial_transmissions = transmissions.to_vec();
    for sender in (0..transmissions.len()).filter(|sender| !documented_senders.contains(sender)) {
        let Some(receiver) = fleet.receivers().max_by_key(|&receiver| messages(receiver, sender).len()) else {
            continue;
        };
        let derive_transmission = |message| {
            Transmission::from_reception(
                message,
                sender,
                receiver,
                fleet.travel_s((sender, message.time_s), (receiver, message.time_s)),
            )
        };
        initial_transmissions[sender] = messages(receiver, sender).iter().map(derive_transmission).collect();
        initial_transmissions[sender].sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    }
    let mut clocks = FleetClocks::estimate_offsets(fleet, &initial_transmissions);
    for _ in 0..ROUNDS_MAX {
        let matched = match_all(fleet, &clocks, &initial_transmissions);
        if !clocks.correct_round_trips(fleet, &receptions(fleet, &initial_transmissions, &matched)) {
            break;
        }
    }
    clocks.search_segments(fleet, &initial_transmissions);
    for _ in 0..ROUNDS_MAX {
        let matched = match_all(fleet, &clocks, &initial_transmissions);
        if !clocks.split_at_step(fleet, &receptions(fleet, &initial_transmissions, &matched)) {
            break;
        }
    }
    clocks
}

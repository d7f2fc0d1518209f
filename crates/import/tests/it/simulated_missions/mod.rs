//! Simulated missions with known outcomes: the events are right, and the exclusion of an opportunity is independent of
//! its outcome.

mod kinds;
mod measurement;
mod mission;
mod vehicle;

use std::collections::BTreeSet;

use pingmap_import::{Contradiction, Reference, Schedule, join};

use kinds::MissionKind;
use measurement::{Measurement, import, included};
use mission::{Mission, Opportunity};

/// Largest plausible drift of a clock, in seconds per second.
const DRIFT_MAX: f64 = 1e-4;

/// Largest share of inclusions that may change if all outcomes are inverted.
const CHANGED_SHARE_MAX: f64 = 0.01;

/// Prints a row for each kind of mission, and returns the kinds that miss a bar.
fn kinds_below_bars(seeds: u64) -> Vec<MissionKind> {
    let measured = MissionKind::ALL.map(|kind| (kind, Measurement::new(kind, seeds)));
    eprintln!("{:<17}{}", "kind", Measurement::HEADER);
    for (kind, measurement) in &measured {
        eprintln!("{:<17}{}", format!("{kind:?}"), measurement.row());
    }
    measured.into_iter().filter(|(_, measurement)| !measurement.meets_bars()).map(|(kind, _)| kind).collect()
}

#[test]
fn missions_of_each_kind_meet_the_bars() {
    assert_eq!(kinds_below_bars(50), []);
}

#[test]
#[ignore = "many missions; run by .ci/full"]
fn many_missions_of_each_kind_meet_the_bars() {
    assert_eq!(kinds_below_bars(500), []);
}

/// Returns the packet and the receiver of each event, for given outcomes.
fn inclusions(mission: &Mission, outcomes: &[Opportunity]) -> BTreeSet<(usize, usize)> {
    included(mission, &import(mission, outcomes).unwrap()).into_keys().collect()
}

/// Returns the share of inclusions that change if all outcomes are inverted, over many missions.
fn changed_share(kind: MissionKind, seeds: u64, clocks_agree: bool) -> f64 {
    let (mut changed, mut opportunities) = (0, 0);
    for seed in 0..seeds {
        let mission = Mission::new(kind, seed, clocks_agree);
        let [recorded, inverted] = [mission.opportunities.clone(), mission.inverted_outcomes()]
            .map(|outcomes| inclusions(&mission, &outcomes));
        changed += recorded.symmetric_difference(&inverted).count();
        opportunities += mission.opportunities.iter().filter(|one| mission.is_opportunity(one)).count();
    }
    changed as f64 / opportunities as f64
}

/// Checks that inverted outcomes change few inclusions. Clocks and delays are estimated from the receptions, so that
/// other receptions move those near a limit.
fn assert_few_inclusions_change(seeds: u64) {
    for clocks_agree in [true, false] {
        for kind in MissionKind::ALL.into_iter().filter(|kind| !clocks_agree || *kind != MissionKind::ClockStep) {
            let changed = changed_share(kind, seeds, clocks_agree);
            eprintln!("{kind:?}, clocks agree: {clocks_agree}: {:.3} % change", 100.0 * changed);
            // One delay holds for all messages of a pair, so that it does not depend on which of them are heard.
            let has_one_delay = matches!(kind, MissionKind::MixedStamps | MissionKind::Replies);
            let limit = if clocks_agree && has_one_delay { 0.0 } else { CHANGED_SHARE_MAX };
            assert!(changed <= limit, "{kind:?}, clocks agree: {clocks_agree}: {changed}");
        }
    }
}

#[test]
fn inverting_all_outcomes_changes_few_inclusions() {
    assert_few_inclusions_change(15);
}

#[test]
#[ignore = "many missions; run by .ci/full"]
fn inverting_all_outcomes_of_many_missions_changes_few_inclusions() {
    assert_few_inclusions_change(50);
}

#[test]
fn inverting_one_outcome_never_changes_its_own_inclusion() {
    let (changed, total) = own_inclusions_changed(0..1, 12);
    assert!(changed == 0 && total > 100, "{changed} of {total}");
}

#[test]
#[ignore = "many missions; run by .ci/full"]
fn inverting_one_outcome_of_many_missions_rarely_changes_its_own_inclusion() {
    let [first, others] = [0..2, 2..4].map(|seeds| own_inclusions_changed(seeds, 9));
    assert_eq!(first.0, 0);
    let (changed, total) = (first.0 + others.0, first.1 + others.1);
    eprintln!("{changed} of {total} opportunities change their own inclusion");
    // A reception moves the estimated delay of its pair, and with it an opportunity next to a limit.
    assert!(1000 * changed <= total, "{changed} of {total}");
}

/// Inverts every `step`th outcome of missions of each kind, one at a time. Returns how many of them change their own
/// inclusion, and how many were inverted.
fn own_inclusions_changed(seeds: std::ops::Range<u64>, step: usize) -> (usize, usize) {
    let (mut changed, mut total) = (0, 0);
    for (kind, seed) in MissionKind::ALL.into_iter().flat_map(|kind| seeds.clone().map(move |seed| (kind, seed))) {
        let mission = Mission::new(kind, seed, false);
        let recorded = inclusions(&mission, &mission.opportunities);
        let indices = (0..mission.opportunities.len()).step_by(step);
        for index in indices.filter(|&index| !mission.opportunities[index].is_deaf) {
            let mut outcomes = mission.opportunities.clone();
            outcomes[index].is_heard = !outcomes[index].is_heard;
            let key = (outcomes[index].packet, outcomes[index].receiver);
            let is_changed = inclusions(&mission, &outcomes).contains(&key) != recorded.contains(&key);
            if is_changed {
                eprintln!("{kind:?} {seed}: {:?}", outcomes[index]);
            }
            changed += usize::from(is_changed);
            total += 1;
        }
    }
    (changed, total)
}

#[test]
fn a_clock_step_divides_the_offsets_of_its_clock_alone() {
    for seed in 0..50 {
        let mission = Mission::new(MissionKind::ClockStep, seed, false);
        let imported = import(&mission, &mission.opportunities).unwrap();
        for (vehicle, clock) in mission.vehicles().iter().zip(&imported.clocks) {
            assert_eq!(clock.segments.len(), if vehicle.step.is_some() { 2 } else { 1 }, "{seed}: {clock:?}");
            assert!(clock.segments.iter().all(|segment| segment.drift.abs() < DRIFT_MAX), "{seed}: {clock:?}");
            assert!(clock.upper_residual_s < 0.1, "{seed}: {clock:?}");
        }
    }
}

#[test]
fn answers_need_no_slot_and_a_schedule_with_too_few_slots_is_a_contradiction() {
    let mission = Mission::new(MissionKind::Replies, 0, false);
    let recordings = mission.recordings(&mission.opportunities);
    let is_excess = |schedule: &Schedule| {
        let imported = join(&recordings, Some(schedule), &Reference::unknown(), &mission.rules).unwrap();
        let is_excess = |one: &Contradiction| matches!(one, Contradiction::MoreTransmissionsThanSlots { .. });
        imported.contradictions.iter().any(is_excess)
    };
    let mut schedule = mission.schedule.clone().unwrap();
    assert!(!is_excess(&schedule));
    let Schedule::Cyclic { duration_s, .. } = &mut schedule else { panic!("{schedule:?}") };
    *duration_s *= 3.0;
    assert!(is_excess(&schedule));
}

//! Checks that the recordings, the schedule and the rules fit each other.

use pingmap_agent::VehicleId;

use crate::assemble::clocks::fleet_clocks::FleetClocks;
use crate::assemble::rules::SlotUse;
use crate::assemble::vehicles::fleet::{Fleet, Vehicle};
use crate::model::error::ImportError;
use crate::model::schedule::Schedule;
use crate::model::time::time_in_words;

/// Largest number of slots in a mission. A schedule with more of them contains a wrong time.
const SLOTS_MAX: f64 = 1e7;

/// Checks a fleet before its clocks are estimated.
///
/// # Errors
/// [`ImportError::Inconsistent`] if no vehicle recorded receptions, a vehicle has no navigation, a name is unknown, or
/// times are far apart.
pub(crate) fn check_inputs(fleet: &Fleet, schedule: Option<&Schedule>) -> Result<(), ImportError> {
    if fleet.receivers().next().is_none() {
        return fail(
            "no record of receptions; expected one of at least one vehicle (--heard NAME=FILE, or a log with the sentences of its modem) and \
             the navigation of all vehicles (--nav)"
                .into(),
        );
    }
    fleet.vehicles.iter().try_for_each(|vehicle| check_vehicle(fleet, vehicle))?;
    check_names(fleet)?;
    schedule.map_or(Ok(()), |schedule| check_schedule(fleet, schedule))
}

fn fail(problem: String) -> Result<(), ImportError> {
    Err(ImportError::Inconsistent(problem))
}

/// Checks that a vehicle has navigation, at the time of its receptions and transmissions.
fn check_vehicle(fleet: &Fleet, vehicle: &Vehicle) -> Result<(), ImportError> {
    let name = vehicle.name;
    let Some((from_s, to_s)) = vehicle.track.span_s() else {
        return fail(format!(
            "{name}: no record of its position; expected navigation (--nav {name}=FILE), or the place of a fixed station (--fixed)"
        ));
    };
    let received = vehicle.recording.arrivals.iter().flatten().map(|arrival| arrival.time_s);
    let mut times = received
        .chain(vehicle.recording.transmissions.iter().flatten().map(|transmission| transmission.time_s))
        .peekable();
    let margin_s = fleet.rules.clock_offset_s_max + fleet.rules.nav_gap_s_max;
    if times.peek().is_some() && !times.any(|time_s| from_s - margin_s <= time_s && time_s <= to_s + margin_s) {
        let [start, end] = [from_s, to_s].map(time_in_words);
        return fail(format!(
            "{name}: its navigation is from {start} to {end}, but none of its receptions and transmissions is; expected times of one \
             kind in both"
        ));
    }
    Ok(())
}

/// Checks the names of vehicles in the rules.
fn check_names(fleet: &Fleet) -> Result<(), ImportError> {
    let is_unknown = |name: &&VehicleId| fleet.index_of(name).is_none();
    if let Some(name) = fleet.rules.reference_clock.as_ref().filter(is_unknown) {
        return fail(format!("no vehicle is called {name}; expected one of {}", fleet.all_names()));
    }
    if let SlotUse::SomeSenders(listed) = &fleet.rules.slot_use
        && let Some(name) = listed.iter().find(is_unknown)
    {
        return fail(format!(
            "no vehicle is called {name}, which --always-transmits names; expected one of {}",
            fleet.all_names()
        ));
    }
    Ok(())
}

/// Checks the number of slots and the names in a schedule.
fn check_schedule(fleet: &Fleet, schedule: &Schedule) -> Result<(), ImportError> {
    let (from_s, to_s) = fleet.span_s();
    let slots = schedule.slots_between(from_s, to_s);
    if slots > SLOTS_MAX {
        let [start, end] = [from_s, to_s].map(time_in_words);
        return fail(format!(
            "the schedule has {slots:.0} slots between the first and the last record, {start} to {end}; expected at most {SLOTS_MAX:.0} (is a \
             time far from the rest?)"
        ));
    }
    if let Some(name) = schedule.senders().find(|name| fleet.index_of(name).is_none()) {
        return fail(format!(
            "the schedule has slots for {name}, of which no recording exists; expected one of {} (or --ids)",
            fleet.all_names()
        ));
    }
    Ok(())
}

/// Checks that messages compare the reference clock with another clock, if times are to be corrected to it.
///
/// # Errors
/// [`ImportError::Inconsistent`] if no two messages do so.
pub(crate) fn check_reference_clock(fleet: &Fleet, clocks: &FleetClocks) -> Result<(), ImportError> {
    let is_isolated = clocks.clocks.len() > 1 && clocks.clocks.iter().filter(|clock| clock.is_determined).count() == 1;
    match &fleet.rules.reference_clock {
        Some(name) if is_isolated => fail(format!(
            "no two messages compare the clock of {name} with another clock, so no clock can be corrected to it; expected a vehicle that \
             heard others or was heard by them (or --clock-offset-s-max 0, if clocks agree)"
        )),
        _ => Ok(()),
    }
}

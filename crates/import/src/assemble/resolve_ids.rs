//! Replacement of modem ids by vehicles, over the recordings of all vehicles.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_agent::VehicleId;

use crate::model::error::ImportError;
use crate::model::recording::{Arrival, Recordings};

/// Replaces the id of each modem by the vehicle whose recording states this id as its own.
///
/// It also decides about [`reported`](crate::Recording::reported) arrivals: many messages have a source member. A
/// reported arrival becomes an arrival if a recording of its source exists. Returns the number of other reported
/// arrivals by source.
///
/// # Errors
/// [`ImportError::Inconsistent`] if two vehicles state the same id.
pub fn resolve_modem_ids(recordings: &mut Recordings) -> Result<BTreeMap<VehicleId, usize>, ImportError> {
    let mut owners: BTreeMap<VehicleId, VehicleId> = BTreeMap::new();
    for (name, recording) in &*recordings {
        for id in &recording.modem_ids {
            if let Some(other) = owners.insert(VehicleId::new(id), name.clone()) {
                return Err(ImportError::Inconsistent(format!(
                    "the modems of {other} and {name} both state that their id is {id}; expected one vehicle for each id (were files of one \
                     vehicle given for two?)"
                )));
            }
        }
    }
    let replace = |id: &mut VehicleId| {
        if let Some(owner) = owners.get(id) {
            id.clone_from(owner);
        }
    };
    for recording in recordings.values_mut() {
        let arrivals = recording.arrivals.iter_mut().flatten();
        for arrival in arrivals.chain(recording.reported.iter_mut().flatten()) {
            replace(&mut arrival.source);
            arrival.destination.as_mut().map(replace);
        }
        for transmission in recording.transmissions.iter_mut().flatten() {
            transmission.destination.as_mut().map(replace);
        }
    }
    let names: BTreeSet<VehicleId> = recordings.keys().cloned().collect();
    let mut unknown_sources = BTreeMap::new();
    for recording in recordings.values_mut() {
        for reported in std::mem::take(&mut recording.reported) {
            let (accepted, rejected): (Vec<Arrival>, Vec<Arrival>) =
                reported.into_iter().partition(|arrival| names.contains(&arrival.source));
            rejected.into_iter().for_each(|arrival| *unknown_sources.entry(arrival.source).or_default() += 1);
            let record = recording.modem_activity.len();
            accepted.iter().for_each(|arrival| recording.extend_activity(record, arrival.time_s));
            if !accepted.is_empty() {
                recording.arrivals.get_or_insert_default().extend(accepted);
            }
        }
    }
    Ok(unknown_sources)
}

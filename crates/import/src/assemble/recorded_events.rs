//! The log of events that tables contain with their outcomes.

use std::collections::BTreeMap;

use pingmap_agent::{Event, Link, Position, VehicleId};

use crate::assemble::events::event_log;
use crate::assemble::pair_counts::PairCounts;
use crate::assemble::result::{EvidenceCounts, ImportResult, LeftOutCounts};
use crate::model::reference::{Place, Reference};
use crate::readers::event_table::{EventRecord, EventRecords};

/// Converts recorded events to a log in metres. O(n log n).
///
/// Events outside of the reference system are counted and left out.
pub fn join_events(records: &EventRecords, reference: &Reference) -> ImportResult {
    let mut pairs: BTreeMap<(VehicleId, VehicleId), PairCounts> = BTreeMap::new();
    let mut events = Vec::new();
    for record in &records.events {
        let Some(event) = event(record, reference) else { continue };
        let pair = pairs.entry((record.transmitter.clone(), record.receiver.clone())).or_default();
        pair.transmissions += 1;
        *if event.success { &mut pair.heard } else { &mut pair.missed } += 1;
        events.push(event);
    }
    let unprojected = records.events.len() - events.len();
    let evidence = EvidenceCounts { recorded: events.len(), ..EvidenceCounts::default() };
    let mut log = event_log(events);
    log.reference = reference.system();
    ImportResult {
        log,
        pairs,
        evidence,
        clocks: Vec::new(),
        delay_s: 0.0,
        warnings: Vec::new(),
        contradictions: Vec::new(),
        left_out: LeftOutCounts { unprojected, ..LeftOutCounts::default() },
        undocumented_senders: String::new(),
        undocumented_destinations: String::new(),
        unconfirmed_slot_owners: String::new(),
    }
}

fn event(record: &EventRecord, reference: &Reference) -> Option<Event> {
    let position = |(place, depth_m): (Place, Option<f64>)| {
        let (east_m, north_m) = reference.metres(place)?;
        Some(Position { depth_m, ..Position::new(east_m, north_m) })
    };
    let [transmitter, receiver] = record.ends;
    Some(Event {
        time_s: record.time_s,
        transmitter_id: record.transmitter.clone(),
        receiver_id: record.receiver.clone(),
        link: Link { transmitter: position(transmitter)?, receiver: position(receiver)? },
        kind: record.kind.clone(),
        success: record.success,
    })
}

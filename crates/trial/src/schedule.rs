//! Detects the transmission schedule of a log.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_agent::{Slots, VehicleId};
use pingmap_packet::SLOTS;

use crate::event_log::EventLog;
use crate::mission::transmissions;

/// Largest offset between a transmission and the start of its slot, in slots.
const OFF_MAX: f64 = 0.05;

/// Smallest number of cycles that show an order.
const ROUNDS_MIN: usize = 3;

/// Largest number of slots of a cycle per sender.
const SLOTS_PER_SENDER_MAX: usize = 4;

/// Returns the TDMA schedule of a log: slots of equal length in which each sender always uses the same slots of a
/// cycle. The shortest cycle is returned. Returns `None` without such an order, or with fewer than three cycles.
///
/// A sender without any reception is not a member of a team, so its slots have no owner. O(N · slots of a cycle).
pub fn schedule(log: &EventLog) -> Option<Slots> {
    let transmissions = transmissions(&log.events);
    let first = transmissions.iter().filter_map(|events| events.first());
    let (times_s, senders): (Vec<f64>, Vec<&VehicleId>) =
        first.map(|event| (event.time_s, &event.transmitter_id)).unzip();
    let (start_s, duration_s, numbers) = slots(&times_s)?;
    let numbered: Vec<(usize, &VehicleId)> = numbers.into_iter().zip(senders).collect();
    let members = log.vehicles();
    let count = numbered.iter().map(|(_, sender)| *sender).collect::<BTreeSet<_>>().len();
    let last = numbered.last().map_or(0, |(number, _)| *number);
    let mut lengths = (1..=SLOTS_PER_SENDER_MAX * count).take_while(|length| ROUNDS_MIN * length <= last + 1);
    let (length, owners) = lengths.find_map(|length| Some((length, owners(&numbered, length)?)))?;
    let owner = |place| {
        let owner = owners.get(&place).filter(|owner| members.contains(owner));
        owner.map_or_else(|| VehicleId::new(""), |&owner| owner.clone())
    };
    Some(Slots { start_s, ..Slots::cycle(duration_s, (0..length).map(owner).collect()) })
}

/// Returns start and length of the slots, and the slot number of each time. Every time must be at the start of its own
/// slot.
fn slots(times_s: &[f64]) -> Option<(f64, f64, Vec<usize>)> {
    let apart_s = || times_s.windows(2).map(|pair| pair[1] - pair[0]);
    let least_s = apart_s().reduce(f64::min).filter(|&least_s| least_s > 0.0)?;
    let mut numbers = vec![0];
    for apart_s in apart_s() {
        let number = numbers.last()? + (apart_s / least_s).round().min(f64::from(SLOTS)) as usize;
        numbers.push(Some(number).filter(|&number| number < SLOTS as usize)?);
    }
    let duration_s = (times_s.last()? - times_s[0]) / *numbers.last()? as f64;
    let late_s =
        || times_s.iter().zip(&numbers).map(|(time_s, &number)| time_s - times_s[0] - duration_s * number as f64);
    // No transmission starts before its slot.
    let start_s = times_s[0] + late_s().fold(0.0, f64::min);
    late_s().all(|late_s| late_s.abs() <= OFF_MAX * duration_s).then_some((start_s, duration_s, numbers))
}

/// Returns the sender of each slot of a cycle of this length; `None` if two senders use one slot.
fn owners<'a>(numbered: &[(usize, &'a VehicleId)], length: usize) -> Option<BTreeMap<usize, &'a VehicleId>> {
    let mut owners = BTreeMap::new();
    for &(number, sender) in numbered {
        if *owners.entry(number % length).or_insert(sender) != sender {
            return None;
        }
    }
    Some(owners)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pingmap_agent::{Event, Link, Position, ReferenceSystem};

    fn log(sent: &[(f64, &str)]) -> EventLog {
        let event = |&(time_s, sender): &(f64, &str)| {
            let id = |name: &str| VehicleId::new(name);
            let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(9.0, 0.0) };
            let receiver = if sender == "a" { "b" } else { "a" };
            Event { time_s, transmitter_id: id(sender), receiver_id: id(receiver), link, kind: None, success: true }
        };
        let events = sent.iter().map(event).collect();
        EventLog {
            events,
            true_probability: None,
            has_depths: false,
            has_headings: false,
            unknown_columns: Vec::new(),
            reference: ReferenceSystem::Unknown,
        }
    }

    fn names(slots: &Slots) -> Vec<&str> {
        slots.order.iter().map(VehicleId::as_str).collect()
    }

    #[test]
    fn the_shortest_round_is_found_through_gaps_and_small_delays() {
        // The cycle is a, b, a, and a tag without receptions. Some transmissions are missing, and all are slightly
        // late.
        let order = ["a", "b", "a", "tag"];
        let sent: Vec<(f64, &str)> = (0..40)
            .filter(|n| n % 7 != 5)
            .map(|n| (100.0 + 12.0 * f64::from(n) + 0.1 * f64::from(n % 3), order[n as usize % 4]))
            .collect();
        let slots = schedule(&log(&sent)).unwrap();
        assert_eq!(names(&slots), ["a", "b", "a", ""]);
        assert!((slots.duration_s - 12.0).abs() < 0.01 && (99.8..=100.0).contains(&slots.start_s), "{slots:?}");
        for (n, &(time_s, sender)) in sent.iter().enumerate().filter(|(_, (_, sender))| *sender != "tag") {
            let slot = slots.number(time_s).unwrap();
            assert_eq!(slots.sender(slot).map(VehicleId::as_str), Some(sender), "{n}");
        }
    }

    #[test]
    fn logs_without_an_order_have_no_schedule() {
        let by_chance: Vec<(f64, &str)> = [0, 1, 0, 0, 1, 1, 0, 1, 0, 0, 0, 1, 1, 0, 1, 1, 1, 0, 0, 1]
            .iter()
            .enumerate()
            .map(|(n, &sender)| (10.0 * n as f64, ["a", "b"][sender]))
            .collect();
        assert_eq!(schedule(&log(&by_chance)), None);
        let drifting: Vec<(f64, &str)> =
            (0..40).map(|n| (10.0 * f64::from(n).powf(1.1), ["a", "b"][n as usize % 2])).collect();
        assert_eq!(schedule(&log(&drifting)), None);
        for few in [
            &[][..],
            &[(0.0, "a")],
            &[(0.0, "a"), (10.0, "b")],
            &[(5.0, "a"), (5.0, "b")],
            &[(0.0, "a"), (1e-300, "b"), (1000.0, "a")],
        ] {
            assert_eq!(schedule(&log(few)), None, "{few:?}");
        }
    }
}

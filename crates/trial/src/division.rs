//! Divisions of a log into training and held-out events. The meaning of a score depends on the division. Random events
//! have neighbours on the same track among the training events; blocks of time and far ranges do not.

use std::collections::BTreeMap;

use pingmap_agent::{Event, VehicleId};
use rand::seq::SliceRandom;

use crate::event_log::EventLog;
use crate::split::{Split, events_by_vehicle};
use crate::streams::{self, stream};

/// Number of blocks of time. Each has about the same number of transmissions.
const BLOCKS: usize = 20;

/// Rule for the choice of held-out events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DivideBy {
    /// A random share of the events of every vehicle, or of the transmissions of every vehicle.
    Random,
    /// A random share of 20 blocks of time with equal numbers of transmissions.
    Time,
    /// The farthest links. One split.
    Range,
    /// The events of one vehicle, predicted from those of the others. One split per vehicle.
    Vehicle,
}

/// A division of a log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Division {
    /// Rule for the choice of held-out events.
    pub by: DivideBy,
    /// Number of random splits.
    pub repeats: usize,
    /// Share of events, transmissions or blocks that is held out, rounded to whole ones.
    pub test_share: f64,
    /// Whether all receivers of a transmission are held out together. Only for random splits; blocks of time always do
    /// so.
    pub whole_transmissions: bool,
}

/// Reason why a log cannot be divided.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DivisionError {
    /// The share of held-out events is not between 0 and 1.
    #[error("the share of held-out events must be from 0 to 1, found {found}")]
    Share {
        /// The share.
        found: f64,
    },
    /// There is no other vehicle to learn from.
    #[error("only one vehicle received anything; expected at least two, to hold out one and learn from the others")]
    OneVehicle,
    /// The option is only for random splits.
    #[error(
        "only random splits have the option to hold out whole transmissions: blocks of time always do so, and splits by range or \
         receiver cannot"
    )]
    WholeTransmissions,
}

impl Division {
    /// Returns the paper's division: a random share of every vehicle's events, in the paper three times 35 %.
    pub fn random(repeats: usize, test_share: f64) -> Self {
        Self { by: DivideBy::Random, repeats, test_share, whole_transmissions: false }
    }

    /// Divides a log. Split i depends only on the seed and i.
    ///
    /// # Errors
    /// Returns [`DivisionError`] for an invalid share, and for a log or an option that does not suit the rule.
    pub fn splits(&self, log: &EventLog, seed: u64) -> Result<Vec<Split>, DivisionError> {
        if !(0.0..=1.0).contains(&self.test_share) {
            return Err(DivisionError::Share { found: self.test_share });
        }
        if self.whole_transmissions && self.by != DivideBy::Random {
            return Err(DivisionError::WholeTransmissions);
        }
        let draw = |draw: fn(&EventLog, usize, f64, u64) -> Split| {
            (0..self.repeats).map(|repeat| draw(log, repeat, self.test_share, seed)).collect()
        };
        match self.by {
            DivideBy::Random if self.whole_transmissions => Ok(draw(draw_transmissions)),
            DivideBy::Random => Ok(draw(draw_split)),
            DivideBy::Time => Ok(draw(draw_blocks)),
            DivideBy::Range => Ok(vec![farthest(log, self.test_share)]),
            DivideBy::Vehicle => one_vehicle_each(log),
        }
    }
}

/// Returns a split that holds out a share of every vehicle's own events, for a share from 0 to 1.
pub(crate) fn draw_split(log: &EventLog, repeat: usize, test_share: f64, seed: u64) -> Split {
    let own = events_by_vehicle(log).into_values().map(|own| own.into_iter().map(|n| vec![n]).collect());
    hold_out(log, format!("r{repeat}"), own.collect(), test_share, repeat, seed)
}

/// Returns a split that holds out a share of the transmissions of every vehicle, with all their receivers.
fn draw_transmissions(log: &EventLog, repeat: usize, test_share: f64, seed: u64) -> Split {
    let mut by_sender: BTreeMap<&VehicleId, Vec<Vec<usize>>> = BTreeMap::new();
    for transmission in transmissions(log) {
        by_sender.entry(&log.events[transmission[0]].transmitter_id).or_default().push(transmission);
    }
    hold_out(log, format!("r{repeat}"), by_sender.into_values().collect(), test_share, repeat, seed)
}

/// Returns a split that holds out a share of 20 blocks of time.
fn draw_blocks(log: &EventLog, repeat: usize, test_share: f64, seed: u64) -> Split {
    let transmissions = transmissions(log);
    let blocks = BLOCKS.min(transmissions.len()).max(1);
    let bound = |block: usize| block * transmissions.len() / blocks;
    let block = |block: usize| transmissions[bound(block)..bound(block + 1)].concat();
    hold_out(log, format!("t{repeat}"), vec![(0..blocks).map(block).collect()], test_share, repeat, seed)
}

/// Returns a split that holds out a random share of the parts of every group.
fn hold_out(
    log: &EventLog,
    name: String,
    groups: Vec<Vec<Vec<usize>>>,
    test_share: f64,
    repeat: usize,
    seed: u64,
) -> Split {
    let mut rng = stream(seed, streams::SPLITS + repeat as u64);
    let mut held_out = vec![false; log.events.len()];
    for mut parts in groups {
        parts.shuffle(&mut rng);
        let count = (parts.len() as f64 * test_share).round() as usize;
        parts[..count].iter().flatten().for_each(|&n| held_out[n] = true);
    }
    Split { name, held_out }
}

/// Returns the split that holds out the farthest links.
fn farthest(log: &EventLog, test_share: f64) -> Split {
    let mut order: Vec<usize> = (0..log.events.len()).collect();
    let range_m = |n: &usize| log.events[*n].link.range_m();
    order.sort_by(|a, b| range_m(b).total_cmp(&range_m(a)));
    let count = (order.len() as f64 * test_share).round() as usize;
    let mut held_out = vec![false; order.len()];
    order[..count].iter().for_each(|&n| held_out[n] = true);
    Split { name: "far".to_owned(), held_out }
}

/// Returns one split for each vehicle, which holds out its events.
fn one_vehicle_each(log: &EventLog) -> Result<Vec<Split>, DivisionError> {
    let vehicles = log.vehicles();
    if vehicles.len() < 2 {
        return Err(DivisionError::OneVehicle);
    }
    let split = |id: VehicleId| {
        let held_out = log.events.iter().map(|event| event.receiver_id == id).collect();
        Split { name: id.to_string(), held_out }
    };
    Ok(vehicles.into_iter().map(split).collect())
}

/// Returns the indices of the events of every transmission, in the order of time.
fn transmissions(log: &EventLog) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..log.events.len()).collect();
    let events = &log.events;
    order.sort_by(|&a, &b| {
        let [a, b] = [&events[a], &events[b]];
        a.time_s.total_cmp(&b.time_s).then_with(|| a.transmitter_id.cmp(&b.transmitter_id))
    });
    let is_same = |a: &usize, b: &usize| {
        let key = |event: &Event| (event.time_s.to_bits(), event.transmitter_id.clone());
        key(&events[*a]) == key(&events[*b])
    };
    order.chunk_by(is_same).map(<[usize]>::to_vec).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use pingmap_agent::{Link, Position, ReferenceSystem};

    /// Returns a log with a transmission every ten seconds, by three vehicles in cyclic order, each with events of the
    /// two others. The order of the file is not that of time. Ranges grow with time.
    fn log(count: usize) -> EventLog {
        let event = |n: usize, receiver: usize| Event {
            time_s: 10.0 * n as f64,
            transmitter_id: VehicleId::new(format!("v{}", n % 3)),
            receiver_id: VehicleId::new(format!("v{receiver}")),
            link: Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new((n + receiver) as f64, 0.0) },
            kind: None,
            success: n.is_multiple_of(2),
        };
        let both = |n: usize| (0..3).filter(move |receiver| *receiver != n % 3).map(move |receiver| event(n, receiver));
        let mut events: Vec<Event> = (0..count).flat_map(both).collect();
        events.sort_by(|a, b| a.receiver_id.cmp(&b.receiver_id));
        EventLog {
            events,
            true_probability: None,
            has_depths: false,
            has_headings: false,
            unknown_columns: Vec::new(),
            reference: ReferenceSystem::Unknown,
        }
    }

    fn division(by: DivideBy) -> Division {
        Division { by, ..Division::random(4, 0.35) }
    }

    /// Checks that every transmission is held out whole or not at all. Returns the numbers of the held-out ones.
    fn whole(log: &EventLog, split: &Split) -> BTreeSet<usize> {
        let number = |n: &usize| (log.events[*n].time_s / 10.0) as usize;
        let [kept, held_out] = [false, true].map(|held_out| split.indices(held_out).iter().map(number).collect());
        let (kept, held_out): (BTreeSet<usize>, BTreeSet<usize>) = (kept, held_out);
        assert!(kept.is_disjoint(&held_out));
        assert_eq!(2 * held_out.len(), split.indices(true).len());
        held_out
    }

    #[test]
    fn a_share_of_every_vehicle_is_held_out() {
        let log = log(60);
        let splits = division(DivideBy::Random).splits(&log, 1).expect("a share");
        for split in &splits {
            for own in events_by_vehicle(&log).into_values() {
                assert_eq!(own.iter().filter(|&&n| split.held_out[n]).count(), 14);
            }
        }
        assert_ne!(splits[0].held_out, splits[1].held_out);
        // The first splits do not depend on the number of splits. Another seed draws other splits.
        assert_eq!(draw_split(&log, 0, 0.35, 1), splits[0]);
        assert_ne!(draw_split(&log, 0, 0.35, 2), splits[0]);
    }

    #[test]
    fn transmissions_are_held_out_whole() {
        let log = log(60);
        let whole_transmissions = Division { whole_transmissions: true, ..division(DivideBy::Random) };
        for split in whole_transmissions.splits(&log, 1).expect("a share") {
            let held_out = whole(&log, &split);
            for vehicle in 0..3 {
                assert_eq!(held_out.iter().filter(|&n| n % 3 == vehicle).count(), 7);
            }
        }
    }

    #[test]
    fn blocks_of_time_are_held_out_whole() {
        let log = log(60);
        let splits = division(DivideBy::Time).splits(&log, 1).expect("a share");
        for split in &splits {
            // Twenty blocks of three transmissions, of which seven are held out.
            let held_out = whole(&log, split);
            let blocks: BTreeSet<usize> = held_out.iter().map(|n| n / 3).collect();
            assert_eq!((blocks.len(), held_out.len()), (7, 21));
        }
        assert_ne!(splits[0].held_out, splits[3].held_out);
        // Fewer transmissions than blocks.
        assert_eq!(division(DivideBy::Time).splits(&self::log(3), 1).expect("a share")[0].indices(true).len(), 2);
    }

    #[test]
    fn far_links_are_held_out() {
        let log = log(60);
        let splits = Division { test_share: 0.4, ..division(DivideBy::Range) }.splits(&log, 1).expect("a share");
        let range_m = |n: &usize| log.events[*n].link.range_m();
        let nearest = splits[0].indices(true).iter().map(range_m).fold(f64::INFINITY, f64::min);
        let farthest = splits[0].indices(false).iter().map(range_m).fold(0.0, f64::max);
        assert_eq!((splits.len(), splits[0].indices(true).len()), (1, 48));
        assert!(farthest <= nearest, "{farthest} {nearest}");
    }

    #[test]
    fn every_vehicle_is_held_out_once() {
        let log = log(30);
        let splits = division(DivideBy::Vehicle).splits(&log, 1).expect("three vehicles");
        assert_eq!(splits.iter().map(|split| split.name.as_str()).collect::<Vec<_>>(), ["v0", "v1", "v2"]);
        for n in 0..log.events.len() {
            assert_eq!(splits.iter().filter(|split| split.held_out[n]).count(), 1);
        }
        let alone = log.owned_by(&VehicleId::new("v0"));
        assert_eq!(division(DivideBy::Vehicle).splits(&alone, 1), Err(DivisionError::OneVehicle));
    }

    #[test]
    fn invalid_divisions_are_refused() {
        for share in [1.001, -0.1, f64::NAN, f64::INFINITY] {
            assert!(Division::random(1, share).splits(&log(6), 1).is_err(), "{share}");
        }
        assert_eq!(Division::random(1, 1.0).splits(&log(6), 1).expect("all")[0].indices(true).len(), 12);
        for by in [DivideBy::Time, DivideBy::Range, DivideBy::Vehicle] {
            let division = Division { whole_transmissions: true, ..division(by) };
            assert_eq!(division.splits(&log(6), 1), Err(DivisionError::WholeTransmissions));
        }
    }
}

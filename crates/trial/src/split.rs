//! Splits of a log as files, and thinning of large logs.

use std::collections::BTreeMap;
use std::path::Path;

use pingmap_agent::VehicleId;
use rand::seq::SliceRandom;

use crate::event_log::EventLog;
use crate::streams::{self, stream};
use crate::table::{FileError, Problem, Table, open};

/// One division of a log into training and held-out events.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Split {
    /// Name of the split.
    pub name: String,
    /// Whether each event is held out, in log order.
    pub held_out: Vec<bool>,
}

impl Split {
    /// Returns the indices of the held-out events, or of the training events.
    pub fn indices(&self, held_out: bool) -> Vec<usize> {
        (0..self.held_out.len()).filter(|&n| self.held_out[n] == held_out).collect()
    }

    /// Returns the split of the events at `indices` of the log.
    pub fn select(&self, indices: &[usize]) -> Self {
        Self { name: self.name.clone(), held_out: indices.iter().map(|&n| self.held_out[n]).collect() }
    }
}

/// Reads splits from CSV: one column per split, one row per event of `log`, 1 = held out.
///
/// # Errors
/// Returns [`FileError`] for values other than 0 or 1, and for a wrong number of rows.
pub fn read_splits(path: &Path, log: &EventLog) -> Result<Vec<Split>, FileError> {
    let mut table = Table::new(open(path)?, path, &[])?;
    let mut splits: Vec<Split> =
        table.header().iter().map(|name| Split { name: name.clone(), held_out: Vec::new() }).collect();
    while table.next()? {
        for (column, split) in splits.iter_mut().enumerate() {
            split.held_out.push(table.flag_at(column)?);
        }
    }
    let found = splits.first().map_or(0, |split| split.held_out.len());
    if found != log.events.len() {
        return Err(table.error(Problem::WrongLength { expected: log.events.len(), found }));
    }
    Ok(splits)
}

/// Returns splits as CSV that [`read_splits`] can read.
pub fn splits_to_csv(splits: &[Split]) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    // Writing to memory does not fail, and all rows have one length.
    let _ = writer.write_record(splits.iter().map(|split| &split.name));
    for n in 0..splits.first().map_or(0, |split| split.held_out.len()) {
        let _ = writer.write_record(splits.iter().map(|split| if split.held_out[n] { "1" } else { "0" }));
    }
    writer.into_inner().map_or_else(|_| String::new(), |bytes| String::from_utf8_lossy(&bytes).into_owned())
}

/// Draws at most `events_max` events, uniformly among those of a vehicle. Vehicles with few events keep all of them;
/// the others are limited to an equal number. Returns indices in log order; all of them if the log is small enough.
pub fn thin(log: &EventLog, events_max: usize, seed: u64) -> Vec<usize> {
    let mut by_vehicle = events_by_vehicle(log);
    let share = fair_share(by_vehicle.values().map(Vec::len).collect(), events_max);
    let mut rng = stream(seed, streams::THINNING);
    let mut kept = Vec::with_capacity(log.events.len().min(events_max));
    for own in by_vehicle.values_mut() {
        let drawn = if own.len() > share { own.partial_shuffle(&mut rng, share).0 } else { own };
        kept.extend_from_slice(drawn);
    }
    kept.sort_unstable();
    kept
}

/// Returns the largest number of events per vehicle such that at most `total` events are kept.
fn fair_share(mut sizes: Vec<usize>, total: usize) -> usize {
    sizes.sort_unstable();
    let mut left = total;
    for (n, &size) in sizes.iter().enumerate() {
        let share = left / (sizes.len() - n);
        if size > share {
            return share;
        }
        left -= size;
    }
    usize::MAX
}

/// Returns the indices of each receiver's events, in log order.
pub(crate) fn events_by_vehicle(log: &EventLog) -> BTreeMap<&VehicleId, Vec<usize>> {
    let mut by_vehicle: BTreeMap<&VehicleId, Vec<usize>> = BTreeMap::new();
    for (n, event) in log.events.iter().enumerate() {
        by_vehicle.entry(&event.receiver_id).or_default().push(n);
    }
    by_vehicle
}

#[cfg(test)]
mod tests {
    use super::*;
    use pingmap_agent::{Event, Link, Position, ReferenceSystem};

    /// Returns a log in which the n-th vehicle received `sizes[n]` events.
    fn log(sizes: &[usize]) -> EventLog {
        let event = |(n, receiver): (usize, usize)| Event {
            time_s: n as f64,
            transmitter_id: VehicleId::new("t"),
            receiver_id: VehicleId::new(format!("v{receiver}")),
            link: Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(1.0, 1.0) },
            kind: None,
            success: n % 2 == 0,
        };
        let receivers = sizes.iter().enumerate().flat_map(|(vehicle, &size)| std::iter::repeat_n(vehicle, size));
        EventLog {
            events: receivers.enumerate().map(event).collect(),
            true_probability: None,
            has_depths: false,
            has_headings: false,
            unknown_columns: Vec::new(),
            reference: ReferenceSystem::Unknown,
        }
    }

    /// Counts the indices of each vehicle.
    fn counts(log: &EventLog, indices: &[usize]) -> Vec<usize> {
        let kept = log.select(indices);
        events_by_vehicle(&kept).values().map(Vec::len).collect()
    }

    #[test]
    fn thinning_spares_vehicles_with_few_events() {
        let log = log(&[1000, 5, 300]);
        let kept = thin(&log, 405, 1);
        assert_eq!(counts(&log, &kept), [200, 5, 200]);
        assert!(kept.is_sorted() && kept.windows(2).all(|pair| pair[0] != pair[1]));
        assert_ne!(thin(&log, 405, 2), kept);
        assert_eq!(thin(&log, 2000, 1).len(), 1305);
        // The choice is uniform: the mean index of vehicle 0 is within four standard errors of the middle of its 1000
        // events.
        let mean = kept[..200].iter().sum::<usize>() as f64 / 200.0;
        assert!((mean - 499.5).abs() < 4.0 * 1000.0 / 12f64.sqrt() / 200f64.sqrt(), "{mean}");
    }

    #[test]
    fn shares_add_up_to_the_total() {
        for (sizes, total) in
            [(vec![10, 20, 30], 60), (vec![10, 20, 30], 35), (vec![5; 7], 3), (vec![], 9), (vec![4], 0)]
        {
            let share = fair_share(sizes.clone(), total);
            let kept: usize = sizes.iter().map(|&size| size.min(share)).sum();
            assert!(kept <= total && (share == usize::MAX || kept + sizes.len() > total), "{sizes:?} {total}: {share}");
        }
    }
}

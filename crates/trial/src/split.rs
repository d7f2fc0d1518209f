//! Which events are held out: drawn per vehicle, or read from a file.

use std::path::Path;

use rand::seq::SliceRandom;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

use crate::event_log::{EventLog, FileError, Problem, Table, open};

/// One division of a log into training and held-out events.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Split {
    /// What the split is called.
    pub name: String,
    /// Whether each event is held out, in log order.
    pub held_out: Vec<bool>,
}

impl Split {
    /// Indices of the events that are held out, or of those that are not.
    pub fn indices(&self, held_out: bool) -> Vec<usize> {
        (0..self.held_out.len()).filter(|&n| self.held_out[n] == held_out).collect()
    }

    /// The same split over the events at `indices` of the log.
    pub fn select(&self, indices: &[usize]) -> Self {
        Self { name: self.name.clone(), held_out: indices.iter().map(|&n| self.held_out[n]).collect() }
    }
}

/// Draws `repeats` splits that hold out `test_share` of every vehicle's events, rounded to whole events. Split i depends on
/// `seed` and i alone.
pub fn draw_splits(log: &EventLog, repeats: usize, test_share: f64, seed: u64) -> Vec<Split> {
    let draw = |repeat: usize| {
        let mut rng = stream(seed, repeat as u64);
        let mut held_out = vec![false; log.events.len()];
        for vehicle in log.vehicles() {
            let mut own: Vec<usize> = (0..log.events.len()).filter(|&n| log.events[n].receiver_id == vehicle).collect();
            own.shuffle(&mut rng);
            let count = (own.len() as f64 * test_share).round() as usize;
            own[..count].iter().for_each(|&n| held_out[n] = true);
        }
        Split { name: format!("r{repeat}"), held_out }
    };
    (0..repeats).map(draw).collect()
}

/// Reads splits from CSV: one column a split, one row an event of `log`, 1 = held out.
///
/// # Errors
/// [`FileError`] for anything but 0 or 1, or another number of rows than the log has events.
pub fn read_splits(path: &Path, log: &EventLog) -> Result<Vec<Split>, FileError> {
    let mut table = Table::new(open(path)?, path, &[])?;
    let mut splits: Vec<Split> =
        table.header.iter().map(|name| Split { name: name.clone(), held_out: Vec::new() }).collect();
    while table.next()? {
        for split in &mut splits {
            split.held_out.push(table.flag(&split.name)?);
        }
    }
    let found = splits.first().map_or(0, |split| split.held_out.len());
    if found != log.events.len() {
        return Err(table.error(Problem::WrongLength { expected: log.events.len(), found }));
    }
    Ok(splits)
}

/// Draws at most `events_max` events of every vehicle, uniformly; indices in log order. All of them where there are no more.
pub fn thin(log: &EventLog, events_max: usize, seed: u64) -> Vec<usize> {
    let mut rng = stream(seed, u64::MAX);
    let mut kept = Vec::with_capacity(log.events.len());
    for vehicle in log.vehicles() {
        let mut own: Vec<usize> = (0..log.events.len()).filter(|&n| log.events[n].receiver_id == vehicle).collect();
        if own.len() > events_max {
            let _ = own.partial_shuffle(&mut rng, events_max);
            // `partial_shuffle` leaves the drawn ones at the end.
            own.drain(..own.len() - events_max);
        }
        kept.extend(own);
    }
    kept.sort_unstable();
    kept
}

/// Stream `stream` of a seed: independent of all others, whatever the thread count.
pub(crate) fn stream(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

//! Reading a log for use: warnings about what is odd in it, thinning, and the part of one vehicle.

use std::collections::HashSet;
use std::path::Path;

use pingmap_agent::{Link, VehicleId};
use pingmap_trial::{EventLog, Split, thin};

use crate::output::{BadInput, count, warn};

/// Reads an event log and warns about what its reader should know.
pub fn open_log(path: &Path) -> anyhow::Result<EventLog> {
    let log = EventLog::open(path)?;
    if !log.unknown_columns.is_empty() {
        warn(format_args!("{}: ignoring the column {}", path.display(), some_of(&log.unknown_columns)));
    }
    warn_about(&log);
    Ok(log)
}

fn warn_about(log: &EventLog) {
    let successes = log.events.iter().filter(|event| event.success).count();
    if successes == 0 || successes == log.events.len() {
        let class = if successes == 0 { "missed" } else { "heard" };
        let events = count(log.events.len(), "event");
        warn(format_args!("all of {events} {class}: the map can only say so with growing certainty"));
    }
    if let [vehicle] = log.vehicles().as_slice() {
        warn(format_args!("{vehicle} is the only receiver: there is nobody to share with"));
    }
    let bits =
        |link: &Link| link.ends().map(|end| [end.east_m, end.north_m, end.depth_m.unwrap_or(0.0)].map(f64::to_bits));
    let distinct: HashSet<_> = log.events.iter().map(|event| bits(&event.link)).collect();
    if log.events.len() >= 100 && distinct.len() * 20 < log.events.len() {
        warn(format_args!(
            "only {} distinct links among {} events: the map says little between them",
            distinct.len(),
            log.events.len()
        ));
    }
}

/// Keeps at most `events_max` events, and says so.
pub fn thinned(log: EventLog, splits: Vec<Split>, events_max: usize, seed: u64) -> (EventLog, Vec<Split>) {
    let kept = thin(&log, events_max, seed);
    if kept.len() == log.events.len() {
        return (log, splits);
    }
    warn(format_args!(
        "using {} of {} events, drawn with seed {seed}; vehicles with few keep theirs (--events-max, --seed)",
        kept.len(),
        log.events.len()
    ));
    (log.select(&kept), splits.iter().map(|split| split.select(&kept)).collect())
}

/// Gives ends without a depth the mean depth of a log that has depths, and says so.
pub fn fill_depths<'a>(links: impl Iterator<Item = &'a mut Link>, log: &EventLog) {
    let Some(depth_m) = log.mean_depth_m() else { return };
    let unknown = links.flat_map(|link| [&mut link.transmitter.depth_m, &mut link.receiver.depth_m]);
    let mut filled = false;
    for depth in unknown.filter(|depth| depth.is_none()) {
        *depth = Some(depth_m);
        filled = true;
    }
    if filled {
        warn(format_args!("places without a depth are taken to lie at {depth_m:.1} m, the mean depth of the log"));
    }
}

/// The part of a log that one vehicle owns.
pub fn only(log: &EventLog, vehicle: &str) -> anyhow::Result<EventLog> {
    let own = log.owned_by(&VehicleId::new(vehicle));
    if own.events.is_empty() {
        let known: Vec<String> = log.vehicles().iter().map(ToString::to_string).collect();
        let message = format!("no events received by vehicle {vehicle:?}; expected one of {}", some_of(&known));
        return Err(BadInput(message).into());
    }
    Ok(own)
}

/// The first of some names, and how many more there are.
fn some_of(names: &[String]) -> String {
    const NAMED_MAX: usize = 20;
    match names.len().saturating_sub(NAMED_MAX) {
        0 => names.join(", "),
        more => format!("{} and {more} more", names[..NAMED_MAX].join(", ")),
    }
}

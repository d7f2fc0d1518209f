//! Tables of navigation, receptions and transmissions.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use pingmap_agent::{Geographic, VehicleId, bounds};

use crate::columns::{Columns, Named, TableKind};
use crate::error::ImportError;
use crate::ids::Ids;
use crate::lcm_types::LcmTypes;
use crate::moos::PREFIX;
use crate::recording::{Arrival, Fix, Recording, Recordings, Sent};
use crate::reference::Place;
use crate::told::Skipped;

/// How tables are read.
#[derive(Debug, Clone)]
pub struct Reading {
    /// How columns are called that are called otherwise.
    pub columns: Columns,
    /// Who is meant by ids.
    pub ids: Ids,
    /// What stands before the names of the modem's variables in logs of MOOS.
    pub prefix: String,
    /// Types of the messages in logs of LCM.
    pub lcm_types: LcmTypes,
}

impl Default for Reading {
    /// Usual names, and nobody's id.
    fn default() -> Self {
        Self {
            columns: Columns::default(),
            ids: Ids::default(),
            prefix: PREFIX.to_owned(),
            lcm_types: LcmTypes::default(),
        }
    }
}

impl Reading {
    /// Takes a table in. Its lines belong to `vehicle`, or to the vehicles that its column says. O(lines), one at a time.
    ///
    /// # Errors
    /// [`ImportError`] with file, line, column, value and what was expected.
    pub fn take(
        &self,
        kind: TableKind,
        (reader, path): (impl Read, &Path),
        vehicle: Option<&VehicleId>,
        into: &mut Recordings,
    ) -> Result<Skipped, ImportError> {
        let mut named = Named::new(reader, path, kind, &self.columns)?;
        named.require(kind, &["time"])?;
        if vehicle.is_none() {
            named.require(kind, &["vehicle"])?;
        }
        let mut skipped = Skipped::default();
        // Between the last sign of a modem in one file and the first in the next it may have been off.
        let records: BTreeMap<VehicleId, usize> =
            into.iter().map(|(name, recording)| (name.clone(), recording.signs.len())).collect();
        if let (Some(vehicle), true) = (vehicle, kind != TableKind::Navigation) {
            // A record without a line is a record of nothing.
            begin(kind, into.entry(vehicle.clone()).or_default());
        }
        self.require(kind, &named)?;
        while named.table.next()? {
            let whose = match vehicle {
                Some(vehicle) => vehicle.clone(),
                None => self.ids.whom(named.text("vehicle")).ok_or_else(|| named.bad("vehicle", "one vehicle"))?,
            };
            let record = records.get(&whose).copied().unwrap_or(0);
            let recording = into.entry(whose).or_default();
            begin(kind, recording);
            match kind {
                TableKind::Navigation => take_fix(&named, recording, &mut skipped)?,
                TableKind::Heard => self.take_arrival(&named, (recording, record), &mut skipped)?,
                TableKind::Sent => self.take_sent(&named, recording, &mut skipped)?,
            }
        }
        Ok(skipped)
    }

    fn require(&self, kind: TableKind, named: &Named) -> Result<(), ImportError> {
        match kind {
            TableKind::Navigation => require_places(named),
            TableKind::Heard => named.require(kind, &["source"]),
            TableKind::Sent => Ok(()),
        }
    }

    fn take_arrival(
        &self,
        named: &Named,
        (recording, record): (&mut Recording, usize),
        skipped: &mut Skipped,
    ) -> Result<(), ImportError> {
        let time_s = named.time_s()?;
        recording.sign(record, time_s);
        let good = named.flag("good")?.unwrap_or(true);
        let id = named.text("source");
        // A line without a source says that the modem was at work, and no more.
        if id.is_empty() {
            skipped.unattributed += usize::from(!good);
            return Ok(());
        }
        let source = self.ids.whom(id).ok_or_else(|| named.bad("source", "one vehicle, not everybody"))?;
        let arrival = Arrival {
            time_s,
            source,
            destination: self.ids.whom(named.text("destination")),
            frame: named.whole("frame")?,
            frames: named.whole("frames")?,
            good,
            // A level that a receiver notes is that at which it arrived.
            kind: named.table.kind_by(&["rate", "band", "length"])?,
        };
        recording.arrivals.get_or_insert_default().push(arrival);
        Ok(())
    }

    fn take_sent(&self, named: &Named, recording: &mut Recording, skipped: &mut Skipped) -> Result<(), ImportError> {
        if named.flag("sent")? == Some(false) {
            skipped.not_sent += 1;
            return Ok(());
        }
        let sent = Sent {
            time_s: named.time_s()?,
            destination: self.ids.whom(named.text("destination")),
            frames: named.whole("frames")?,
            kind: named.table.kind()?,
            band: Some(named.table.field("band").to_owned()).filter(|band| !band.is_empty()),
        };
        recording.sent.get_or_insert_default().push(sent);
        Ok(())
    }
}

fn begin(kind: TableKind, recording: &mut Recording) {
    match kind {
        TableKind::Navigation => {}
        TableKind::Heard => drop(recording.arrivals.get_or_insert_default()),
        TableKind::Sent => drop(recording.sent.get_or_insert_default()),
    }
}

fn take_fix(named: &Named, recording: &mut Recording, skipped: &mut Skipped) -> Result<(), ImportError> {
    let time_s = named.time_s()?;
    if named.has("clock_set") {
        recording.clock_set.push((time_s, named.flag("clock_set")?.unwrap_or(false)));
    }
    if !named.text("band").is_empty() {
        recording.works_in(time_s, named.text("band").to_owned());
    }
    let Some((place, depth_m)) = place(named)? else {
        skipped.unplaced += 1;
        return Ok(());
    };
    recording.fixes.push(Fix { time_s, place, depth_m });
    Ok(())
}

/// Checks that there are columns of places: in degrees, or else in metres.
pub(crate) fn require_places(named: &Named) -> Result<(), ImportError> {
    let in_degrees = named.has("latitude") || named.has("longitude");
    named.require(TableKind::Navigation, if in_degrees { &["latitude", "longitude"] } else { &["easting", "northing"] })
}

/// The place of a line, and how deep it is; nothing where both numbers are not there.
pub(crate) fn place(named: &Named) -> Result<Option<(Place, Option<f64>)>, ImportError> {
    let in_degrees = named.has("latitude");
    let (first, second) = if in_degrees { ("latitude", "longitude") } else { ("easting", "northing") };
    let (Some(a), Some(b)) = (named.number(first)?, named.number(second)?) else { return Ok(None) };
    let place = if in_degrees {
        let place =
            Geographic::new(a, b).ok_or_else(|| named.bad(first, "degrees: latitudes to 90, longitudes to 180"))?;
        Place::Degrees(place)
    } else {
        Place::Metres(a, b)
    };
    let depth_m = named.number("depth")?;
    if depth_m.is_some_and(|depth_m| bounds::COORDINATE_M.check(depth_m).is_none()) {
        return Err(named.bad("depth", bounds::COORDINATE_M.words).into());
    }
    Ok(Some((place, depth_m)))
}

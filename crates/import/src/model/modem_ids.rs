//! The vehicles behind the ids of modems.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use pingmap_agent::VehicleId;
use pingmap_trial::{Table, is_everybody};

use crate::model::error::ImportError;

/// Vehicles by modem id. An id without a vehicle is the broadcast address.
#[derive(Debug, Clone, Default)]
pub struct ModemIds(BTreeMap<String, Option<VehicleId>>);

impl ModemIds {
    /// Reads a table with the columns `id` and `name`. The name `broadcast` (or `*`) marks the broadcast address.
    ///
    /// # Errors
    /// [`ImportError`] if a line has no id or no name, or an id has two names.
    pub fn read(reader: impl Read, path: &Path) -> Result<Self, ImportError> {
        let mut table = Table::new(reader, path, &["id", "name"])?;
        let mut ids = Self::default();
        while table.next()? {
            let id = table.vehicle("id")?;
            let name = table.vehicle("name")?;
            let vehicle = (!is_everybody(name.as_str())).then_some(name);
            let previous = ids.0.insert(normalized(id.as_str()), vehicle.clone());
            if previous.is_some_and(|previous| previous != vehicle) {
                return Err(table.bad("id", "every id once").into());
            }
        }
        Ok(ids)
    }

    /// Returns the table of these ids and vehicles. The name `broadcast` (or `*`) marks the broadcast address.
    pub fn from_pairs(pairs: impl IntoIterator<Item = (String, VehicleId)>) -> Self {
        let named =
            |(id, name): (String, VehicleId)| (normalized(&id), Some(name).filter(|name| !is_everybody(name.as_str())));
        Self(pairs.into_iter().map(named).collect())
    }

    /// Returns the vehicle that the table lists with an id.
    pub fn lookup(&self, id: &str) -> Option<VehicleId> {
        self.0.get(&normalized(id)).cloned().flatten()
    }

    /// Resolves an address to a vehicle; `None` is a broadcast.
    ///
    /// An id outside of the table is itself the name of a vehicle. An empty id is a broadcast.
    pub fn resolve(&self, id: &str) -> Option<VehicleId> {
        match self.0.get(&normalized(id)) {
            Some(vehicle) => vehicle.clone(),
            None if id.is_empty() || is_everybody(id) => None,
            None => Some(VehicleId::new(id)),
        }
    }
}

/// Returns the canonical form of a numeric id: `7` for `007` and `7.0`.
fn normalized(id: &str) -> String {
    match id.parse::<f64>() {
        Ok(number) if number.fract() == 0.0 && (0.0..1e9).contains(&number) => format!("{number:.0}"),
        _ => id.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_resolve_to_vehicles_or_broadcast() {
        let text = "id;name\n1;auv1\n02;auv2\n15;Broadcast\n";
        let ids = ModemIds::read(text.as_bytes(), Path::new("ids.csv")).unwrap();
        let resolve = |id| ids.resolve(id).map(|vehicle| vehicle.to_string());
        assert_eq!(["1", "2.0", "3", "auv1"].map(resolve), ["auv1", "auv2", "3", "auv1"].map(|name| Some(name.into())));
        assert_eq!(["15", "", "*", "ALL"].map(resolve), [const { None }; 4]);
        let error = ModemIds::read("id,name\n1,a\n1.0,b\n".as_bytes(), Path::new("ids.csv")).unwrap_err().to_string();
        assert!(error.contains("line 3, column id"), "{error}");
    }
}

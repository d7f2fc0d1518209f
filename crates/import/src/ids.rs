//! Who is meant by the numbers that modems have.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use pingmap_agent::VehicleId;
use pingmap_trial::{Table, is_everybody};

use crate::error::ImportError;

/// Names of vehicles by what their modems are called.
#[derive(Debug, Clone, Default)]
pub struct Ids(BTreeMap<String, Option<VehicleId>>);

impl Ids {
    /// Reads a table with the columns `id` and `name`; the name `broadcast` (or `*`) is everybody.
    ///
    /// # Errors
    /// [`ImportError`] where a line says nothing, or one id means two.
    pub fn read(reader: impl Read, path: &Path) -> Result<Self, ImportError> {
        let mut table = Table::new(reader, path, &["id", "name"])?;
        let mut ids = Self::default();
        while table.next()? {
            let id = table.vehicle("id")?;
            let name = table.vehicle("name")?;
            let who = (!is_everybody(name.as_str())).then_some(name);
            let known = ids.0.insert(plain(id.as_str()), who.clone());
            if known.is_some_and(|known| known != who) {
                return Err(table.bad("id", "every id once").into());
            }
        }
        Ok(ids)
    }

    /// The vehicle that is listed with an id.
    pub fn listed(&self, id: &str) -> Option<VehicleId> {
        self.0.get(&plain(id)).cloned().flatten()
    }

    /// Whom an id means: a vehicle, or everybody. What is not listed is a name itself; nothing is everybody.
    pub fn whom(&self, id: &str) -> Option<VehicleId> {
        match self.0.get(&plain(id)) {
            Some(who) => who.clone(),
            None if id.is_empty() || is_everybody(id) => None,
            None => Some(VehicleId::new(id)),
        }
    }
}

/// The number behind `007` and `7.0`.
fn plain(id: &str) -> String {
    match id.parse::<f64>() {
        Ok(number) if number.fract() == 0.0 && (0.0..1e9).contains(&number) => format!("{number:.0}"),
        _ => id.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_mean_vehicles_or_everybody() {
        let text = "id;name\n1;auv1\n02;auv2\n15;Broadcast\n";
        let ids = Ids::read(text.as_bytes(), Path::new("ids.csv")).unwrap();
        let whom = |id| ids.whom(id).map(|vehicle| vehicle.to_string());
        assert_eq!(["1", "2.0", "3", "auv1"].map(whom), ["auv1", "auv2", "3", "auv1"].map(|name| Some(name.into())));
        assert_eq!(["15", "", "*", "ALL"].map(whom), [const { None }; 4]);
        let error = Ids::read("id,name\n1,a\n1.0,b\n".as_bytes(), Path::new("ids.csv")).unwrap_err().to_string();
        assert!(error.contains("line 3, column id"), "{error}");
    }
}

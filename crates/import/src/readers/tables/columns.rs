//! Assignments of columns to roles by the user.

use std::collections::BTreeMap;
use std::path::Path;

use pingmap_agent::VehicleId;
use pingmap_trial::Table;

use crate::model::error::ImportError;
use crate::readers::tables::roles::TableKind;

/// The vehicle or the file that an assignment of a column is limited to; `None` for all tables.
type Scope = Option<String>;

/// Columns with unusual names, by kind of table and role, for all tables or for those of one vehicle or file.
#[derive(Debug, Clone, Default)]
pub struct Columns(BTreeMap<(Scope, TableKind, &'static str), String>);

impl Columns {
    /// Assigns a column to a role with its full name, such as `heard.source`. An empty column name removes the role.
    ///
    /// `cleo:heard.source` applies to the tables of the vehicle or the file `cleo` only.
    ///
    /// # Errors
    /// [`ImportError::Role`] for an unknown role.
    pub fn assign(&mut self, role: &str, column: &str) -> Result<(), ImportError> {
        let (scope, full_role) = match role.trim().rsplit_once(':') {
            Some((scope, role)) => (Some(scope.trim().to_owned()), role.trim()),
            None => (None, role.trim()),
        };
        let kinds = [TableKind::Navigation, TableKind::Receptions, TableKind::Transmissions, TableKind::Events];
        let all_roles = || kinds.iter().flat_map(|kind| kind.roles().iter().map(move |(role, _)| (*kind, *role)));
        let full_name = |(kind, role): (TableKind, &str)| format!("{}.{role}", kind.name());
        let Some((kind, name)) = all_roles().find(|key| full_name(*key) == full_role) else {
            let expected = all_roles().map(full_name).collect::<Vec<_>>().join(", ");
            return Err(ImportError::Role { role: role.to_owned(), expected });
        };
        self.0.insert((scope, kind, name), column.trim().to_lowercase());
        Ok(())
    }

    /// Returns the vehicles and files that assignments are limited to.
    pub fn scopes(&self) -> impl Iterator<Item = &str> {
        self.0.keys().filter_map(|(scope, ..)| scope.as_deref())
    }

    /// Returns the assignments for a table. Those of its vehicle or file replace those of all tables.
    pub(crate) fn of_table(&self, path: &Path, vehicle: Option<&VehicleId>) -> Self {
        let file_name = path.file_name().and_then(|name| name.to_str());
        let is_scope =
            |scope: &str| file_name == Some(scope) || vehicle.is_some_and(|vehicle| vehicle.as_str() == scope);
        let mut columns = BTreeMap::new();
        // All tables come first, because `None` is the least scope.
        for ((scope, kind, role), column) in &self.0 {
            if scope.as_deref().is_none_or(is_scope) {
                columns.insert((None, *kind, *role), column.clone());
            }
        }
        Self(columns)
    }

    /// Returns the assignments whose column a table has.
    pub(crate) fn present_in(&self, table: &Table) -> Self {
        let present = self.0.iter().filter(|(_, column)| column.is_empty() || table.has(column));
        Self(present.map(|(key, column)| (key.clone(), column.clone())).collect())
    }

    pub(crate) fn column(&self, kind: TableKind, role: &'static str) -> Option<&str> {
        self.0.get(&(None, kind, role)).map(String::as_str)
    }
}

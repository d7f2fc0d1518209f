//! Names of columns that options assign.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use anyhow::Context;
use pingmap_agent::VehicleId;
use pingmap_import::{Columns, RecordReader, Recordings};

use super::files::Files;
use super::records::{RecordFile, split_vehicle};
use crate::output::{BadInput, read_text};

impl Files {
    /// Returns the assignments of `--columns` and `--column`. Those of `--column` take precedence.
    pub(super) fn columns(&self) -> anyhow::Result<Columns> {
        let mut columns = Columns::default();
        if let Some(path) = &self.columns {
            let text = read_text(path)?;
            let file: BTreeMap<String, BTreeMap<String, String>> = toml::from_str(&text).map_err(|error| {
                BadInput(format!(
                    "{}: {}; expected tables such as [heard] with source = \"from\"",
                    path.display(),
                    error.message()
                ))
            })?;
            for (kind, roles) in &file {
                for (role, column) in roles {
                    columns.assign(&format!("{kind}.{role}"), column).with_context(|| path.display().to_string())?;
                }
            }
        }
        for (role, column) in &self.column {
            columns.assign(role, column)?;
        }
        Ok(columns)
    }

    /// Checks that assignments of columns for one vehicle or file name an existing one.
    pub(super) fn check_scopes(
        &self,
        reader: &RecordReader,
        recordings: &Recordings,
        files: &[RecordFile],
    ) -> anyhow::Result<()> {
        let option_files = [&self.nav, &self.heard, &self.sent].into_iter().flatten().map(|file| split_vehicle(file).1);
        let paths = option_files
            .chain(self.events.iter().map(PathBuf::as_path))
            .chain(files.iter().map(|file| file.name.as_path()));
        let names: BTreeSet<&str> = paths.filter_map(|path| path.file_name()?.to_str()).collect();
        let is_known = |scope: &&str| names.contains(scope) || recordings.contains_key(&VehicleId::new(*scope));
        match reader.columns.scopes().find(|scope| !is_known(scope)) {
            None => Ok(()),
            Some(scope) => {
                let message = format!(
                    "--column {scope}:…: no table is called {scope} or of a vehicle {scope}; expected the name of one"
                );
                Err(BadInput(message).into())
            }
        }
    }
}

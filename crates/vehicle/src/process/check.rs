//! [`check`]: reads what a process would read at its start, and leaves no file.

use std::path::PathBuf;

use crate::config::settings::Listen;
use crate::process::error::ProcessError;
use crate::process::listener::resolve;
use crate::process::start::Setup;
use crate::store::error::StoreError;
use crate::store::inspection::{Report, inspect};

/// Summary of a vehicle that could start.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// Where the host connects.
    pub listen: Listen,
    /// The store.
    pub store_path: PathBuf,
    /// The content of the store; `None` if there is none yet.
    pub store: Option<Report>,
    /// The snapshot.
    pub snapshot_path: PathBuf,
    /// Whether there is a snapshot.
    pub has_snapshot: bool,
}

/// Checks that the process of a vehicle could start. Leaves no file.
///
/// # Errors
/// [`ProcessError`] with the reason why it would not start. A damaged store is an error here, although a vehicle would
/// start with its snapshot.
pub fn check(setup: &Setup) -> Result<Checked, ProcessError> {
    setup.check()?;
    let (store_path, snapshot_path) = setup.config.store_paths(&setup.folder);
    let store = match inspect(&store_path) {
        Ok(report) => Some(report),
        Err(StoreError::Missing { .. }) => None,
        Err(error) => return Err(error.into()),
    };
    if let Some(report) = &store {
        match setup.adopts_store {
            true => report.identity.check_vehicle(&store_path, &setup.identity())?,
            false => report.identity.check(&store_path, &setup.identity())?,
        }
    }
    let has_snapshot = snapshot_path.exists();
    let listen = setup.config.listen()?;
    if let Listen::Tcp(address) = &listen {
        resolve(address)?;
    }
    Ok(Checked { listen, store_path, store, snapshot_path, has_snapshot })
}

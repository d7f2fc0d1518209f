//! Opens the store and restores the vehicle of a configuration.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use pingmap_agent::{Team, VehicleId};
use pingmap_import::Reference;
use pingmap_packet::to_hex;

use crate::config::settings::VehicleConfig;
use crate::process::error::ProcessError;
use crate::store::adoption::adopt_store;
use crate::store::error::StoreError;
use crate::store::folder::{check_folder, is_replaced_by};
use crate::store::identity::Identity;
use crate::store::recovery::{Opened, Recovery, open_or_recover_with};
use crate::store::snapshot::{read_snapshot, write_snapshot};
use crate::store::tables::Contents;
use crate::store::vehicle_store::Store;
use crate::vehicle::restore::RestoreError;
use crate::vehicle::state::Vehicle;

/// The inputs of the process of a vehicle.
#[derive(Debug, Clone)]
pub struct Setup {
    /// The configuration.
    pub config: VehicleConfig,
    /// The folder of the configuration. Paths of the store and of a socket are relative to it.
    pub folder: PathBuf,
    /// The team, with its key if it has one.
    pub team: Arc<Team>,
    /// Whether the vehicle takes over a store of another team configuration.
    pub adopts_store: bool,
}

impl Setup {
    /// Returns to which vehicle and team the store belongs.
    pub(crate) fn identity(&self) -> Identity {
        Identity { vehicle: self.config.vehicle.to_string(), team_digest: self.team.digest() }
    }

    /// Checks the configuration against the team, and the folders of the store and of its snapshot. Leaves no file
    /// there. Returns the reference system of the model.
    pub(crate) fn check(&self) -> Result<Reference, ProcessError> {
        let Self { config, team, .. } = self;
        if !team.is_member(&config.vehicle) {
            let members = team.members.values().map(VehicleId::to_string).collect();
            return Err(ProcessError::NotAMember { vehicle: config.vehicle.to_string(), members });
        }
        let is_other = |id: &&VehicleId| team.is_member(id) && **id != config.vehicle;
        if let Some(found) = config.muted.iter().find(|id| !is_other(id)) {
            return Err(ProcessError::WrongMuted { found: found.to_string() });
        }
        config.listen()?;
        let (path, snapshot_path) = config.store_paths(&self.folder);
        if is_replaced_by(&path, &snapshot_path) {
            return Err(ProcessError::OneFile { path });
        }
        check_folder(&path)?;
        check_folder(&snapshot_path)?;
        Ok(Reference::new(team.model.chart.reference)?)
    }

    /// Opens the store.
    pub(crate) fn open_store(&self, reference: &Reference) -> Result<OpenedStore, ProcessError> {
        let (path, snapshot_path) = self.config.store_paths(&self.folder);
        let identity = self.identity();
        if self.adopts_store {
            self.adopt(&path, reference)?;
        }
        let mut recovered = None;
        let recover = |snapshot: Option<&[u8]>, problem: &str| {
            let (vehicle, recovery) = self.recovered(reference, snapshot, problem);
            recovered = Some(vehicle);
            recovery
        };
        let (store, opened) = open_or_recover_with(&path, &snapshot_path, &identity, recover)?;
        let content = match (opened, recovered) {
            (Opened::Intact(contents), _) => Content::Stored(contents),
            (Opened::Recovered { kept_as, problem, .. }, Some(vehicle)) => {
                let kept_as = kept_as.map(|path| path.display().to_string());
                tracing::warn!(store = %path.display(), %problem, kept_as, "the store was damaged");
                Content::Recovered(Box::new(vehicle))
            }
            _ => Content::Stored(Contents::default()),
        };
        Ok(OpenedStore { store, path, snapshot_path, content })
    }

    /// Gives the store to this team. A store that is damaged or missing is recovered later.
    fn adopt(&self, path: &Path, reference: &Reference) -> Result<(), ProcessError> {
        let identity = self.identity();
        let convert = |former: &Identity, contents: &Contents| {
            let (config, team, reference) = (self.config.clone(), self.team.clone(), reference.clone());
            let adopted = Vehicle::adopt(config, team, reference, contents, &former.team_digest);
            let wrong = |source| ProcessError::Restore { path: path.into(), source };
            adopted.map(|vehicle| vehicle.base()).map_err(wrong)
        };
        match adopt_store(path, &identity, convert) {
            Ok(former) if former == identity => Ok(()),
            Ok(former) => {
                let former_team = to_hex(&former.team_digest);
                tracing::warn!(store = %path.display(), former_team, "the store was adopted");
                Ok(())
            }
            Err(ProcessError::Store(StoreError::Missing { .. } | StoreError::Damaged { .. })) => Ok(()),
            Err(error) => Err(error),
        }
    }

    /// Returns the vehicle of a snapshot after its store was damaged, and the base of a fresh store.
    fn recovered(&self, reference: &Reference, snapshot: Option<&[u8]>, problem: &str) -> (Vehicle, Recovery) {
        let begin = |base: &[u8]| self.restore(reference, &Contents { base: Some(base.into()), entries: Vec::new() });
        let (mut vehicle, uses_snapshot, problem) = match snapshot.map(begin) {
            Some(Ok(vehicle)) => (vehicle, true, problem.to_owned()),
            Some(Err(error)) => {
                (self.empty(reference), false, format!("{problem}; its snapshot cannot be used: {error}"))
            }
            None => (self.empty(reference), false, problem.to_owned()),
        };
        let base = Some(vehicle.note_recovery(uses_snapshot, &problem));
        (vehicle, Recovery { base, uses_snapshot })
    }

    fn empty(&self, reference: &Reference) -> Vehicle {
        Vehicle::new(self.config.clone(), self.team.clone(), reference.clone())
    }

    fn restore(&self, reference: &Reference, contents: &Contents) -> Result<Vehicle, RestoreError> {
        Vehicle::restore(self.config.clone(), self.team.clone(), reference.clone(), contents)
    }

    /// Returns the vehicle with the content of its store.
    ///
    /// The snapshot becomes equal to the base of the store, if its last write failed: the counters in it are used after
    /// damage.
    pub(crate) fn begin(
        &self,
        reference: &Reference,
        content: Content,
        path: &Path,
        snapshot_path: &Path,
    ) -> Result<Vehicle, ProcessError> {
        let contents = match content {
            Content::Recovered(vehicle) => return Ok(*vehicle),
            Content::Stored(contents) => contents,
        };
        let restored = self.restore(reference, &contents);
        let mut vehicle = restored.map_err(|source| ProcessError::Restore { path: path.into(), source })?;
        if let Some(base) = &contents.base
            && !read_snapshot(snapshot_path).is_ok_and(|snapshot| snapshot == *base)
            && let Err(error) = write_snapshot(snapshot_path, base)
        {
            tracing::error!(%error, "the snapshot could not be written");
            vehicle.snapshot_failed();
        }
        Ok(vehicle)
    }
}

/// A store that is open, and the vehicle in it.
pub(crate) struct OpenedStore {
    pub(crate) store: Store,
    pub(crate) path: PathBuf,
    pub(crate) snapshot_path: PathBuf,
    pub(crate) content: Content,
}

/// The content of a store.
pub(crate) enum Content {
    /// As it was stored.
    Stored(Contents),
    /// That of a snapshot, after the store was damaged.
    Recovered(Box<Vehicle>),
}

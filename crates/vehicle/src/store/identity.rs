//! [`Identity`]: to which vehicle and team a store belongs.

use std::path::Path;

use crate::store::error::StoreError;

/// The vehicle and the team configuration to which a store belongs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Name of the vehicle.
    pub vehicle: String,
    /// Digest of the team configuration. A new epoch or another team file changes it.
    pub team_digest: [u8; 32],
}

impl Identity {
    /// Refuses the store at `path`, which has this identity, if another one is expected.
    pub(crate) fn check(&self, path: &Path, expected: &Self) -> Result<(), StoreError> {
        self.check_vehicle(path, expected)?;
        let (found, expected) = (self.team_digest, expected.team_digest);
        if found != expected {
            return Err(StoreError::OtherTeam { path: path.into(), found, expected });
        }
        Ok(())
    }

    /// Refuses the store at `path`, which has this identity, if another vehicle is expected.
    pub(crate) fn check_vehicle(&self, path: &Path, expected: &Self) -> Result<(), StoreError> {
        let (found, expected) = (&self.vehicle, &expected.vehicle);
        if found != expected {
            let (found, expected) = (found.clone(), expected.clone());
            return Err(StoreError::OtherVehicle { path: path.into(), found, expected });
        }
        Ok(())
    }
}

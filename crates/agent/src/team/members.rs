//! The members of a team.

use std::collections::BTreeMap;
use std::ops::Deref;

use crate::types::event::VehicleId;

/// The members of a team and their numbers in packets. It dereferences to a map from numbers to names.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Members {
    by_number: BTreeMap<u8, VehicleId>,
    by_name: BTreeMap<VehicleId, u8>,
}

impl Members {
    /// Creates the members with these numbers. If a name has several numbers, the smallest one counts.
    pub fn new(by_number: BTreeMap<u8, VehicleId>) -> Self {
        let by_name = by_number.iter().rev().map(|(&number, name)| (name.clone(), number)).collect();
        Self { by_number, by_name }
    }

    /// Returns the number of a member. O(log members).
    pub fn number(&self, id: &VehicleId) -> Option<u8> {
        self.by_name.get(id).copied()
    }
}

impl Deref for Members {
    type Target = BTreeMap<u8, VehicleId>;

    fn deref(&self) -> &Self::Target {
        &self.by_number
    }
}

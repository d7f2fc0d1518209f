//! One vehicle without input or output: the host's messages in, records to store and answers out.

// In the order of the flow: each file uses only those above it.
pub(crate) mod record;
pub(crate) mod ledger;
pub(crate) mod trust;
pub(crate) mod positions;
pub(crate) mod copies;
pub(crate) mod unconfirmed_nav;
pub(crate) mod state;
pub(crate) mod restore;
pub(crate) mod check;
pub(crate) mod clock;
pub(crate) mod slots;
pub(crate) mod frames;
pub(crate) mod answers;
pub(crate) mod status;
pub(crate) mod handle;

//! [`Identity`]: to which vehicle and team a store belongs.

use std::fmt::Write;

/// The vehicle and the team configuration to which a store belongs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Name of the vehicle.
    pub vehicle: String,
    /// Digest of the team configuration. A new epoch or another team file changes it.
    pub team_digest: [u8; 32],
}

/// Returns the digest in hexadecimal digits.
pub(crate) fn hexadecimal(digest: &[u8; 32]) -> String {
    digest.iter().fold(String::new(), |mut text, byte| {
        // Writing to a string does not fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

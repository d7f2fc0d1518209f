//! Authentication of whole frames.

use crate::error::Error;
use crate::hex::from_hex;

/// Length of a key in bytes.
const KEY_BYTES: usize = 32;

/// A team's secret: whoever has it can seal frames, and tell sealed frames from forged ones.
#[derive(Clone)]
pub struct Key([u8; KEY_BYTES]);

impl Key {
    /// A key from 32 bytes that nobody can guess.
    pub fn new(bytes: [u8; KEY_BYTES]) -> Self {
        Self(bytes)
    }

    /// A key from 64 hexadecimal digits; space around them is ignored.
    ///
    /// # Errors
    /// [`Error::Kind`] for anything else. The text itself is not repeated: it may be a secret.
    pub fn parse(text: &str) -> Result<Self, Error> {
        let bytes = from_hex(text.trim()).and_then(|bytes| bytes.try_into().ok());
        bytes.map(Self).ok_or_else(|| Error::Kind { field: "key".into(), expected: "64 hexadecimal digits" })
    }

    /// A digest by which keys are told apart. It does not give the key away.
    pub fn fingerprint(&self) -> [u8; 32] {
        *blake3::keyed_hash(&self.0, b"fingerprint").as_bytes()
    }

    /// The 8-byte tag of a frame: the first bytes of keyed BLAKE3 over `context` (what both ends must agree on without
    /// sending it) and the frame, with the bytes of the tag itself as zeros.
    pub(crate) fn tag(&self, context: &[u8], frame: &[u8]) -> u64 {
        let mut hasher = blake3::Hasher::new_keyed(&self.0);
        hasher.update(&(context.len() as u64).to_le_bytes());
        hasher.update(context);
        hasher.update(frame);
        let mut tag = [0; 8];
        tag.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
        u64::from_le_bytes(tag)
    }
}

/// A key is a secret: it does not print itself.
impl core::fmt::Debug for Key {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str("Key(…)")
    }
}

/// The 32-byte BLAKE3 digest of some bytes: how a team's agreements are told apart.
pub fn digest(bytes: &[u8]) -> [u8; 32] {
    *blake3::hash(bytes).as_bytes()
}

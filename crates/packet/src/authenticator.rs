//! Authentication of whole frames and of a vehicle's snapshots.

use alloc::boxed::Box;
use alloc::vec::Vec;

use zeroize::{Zeroize, ZeroizeOnDrop};

use crate::bits::overwrite;
use crate::error::Error;
use crate::hex::from_hex;

/// Length of a key in bytes.
const KEY_BYTES: usize = 32;

/// Bytes of a tag that depend on the context.
const BOUND_BYTES: usize = 6;

/// The secret of a team. A holder of the key can authenticate frames and detect forged ones. The key encrypts nothing.
///
/// The struct stores one derived key for each use, so a tag made for one use is not valid for another. The derived keys
/// stay at one address in memory, and that memory is wiped when the key is dropped.
#[derive(Clone)]
pub struct Key(Box<Secrets>);

#[derive(Clone, Zeroize, ZeroizeOnDrop)]
struct Secrets {
    frames: [u8; KEY_BYTES],
    memory: [u8; KEY_BYTES],
    fingerprint: [u8; KEY_BYTES],
}

impl Key {
    /// Derives a key from 32 secret random bytes.
    ///
    /// # Errors
    /// [`Error::WeakKey`] if all bytes are equal, as in a file that was never filled.
    pub fn new(mut bytes: [u8; KEY_BYTES]) -> Result<Self, Error> {
        let is_weak = bytes.iter().all(|byte| *byte == bytes[0]);
        let derived = |context: &str| blake3::derive_key(context, &bytes);
        let secrets = Secrets {
            frames: derived("pingmap protocol 3, tag of a frame"),
            memory: derived("pingmap protocol 3, check of a snapshot"),
            fingerprint: derived("pingmap protocol 3, fingerprint of a key"),
        };
        bytes.zeroize();
        if is_weak { Err(Error::WeakKey) } else { Ok(Self(Box::new(secrets))) }
    }

    /// Parses a key of 64 hexadecimal digits. White space around the digits is ignored.
    ///
    /// # Errors
    /// [`Error::Kind`] for any other text, and the errors of [`Key::new`]. The error does not contain the text, which
    /// may be a secret.
    pub fn parse(text: &str) -> Result<Self, Error> {
        let mut bytes = from_hex(text.trim()).unwrap_or_default();
        let key = <[u8; KEY_BYTES]>::try_from(bytes.as_slice());
        bytes.zeroize();
        Self::new(key.map_err(|_| Error::Kind { field: "key".into(), expected: "64 hexadecimal digits" })?)
    }

    /// Returns a digest that identifies the key without revealing it.
    pub fn fingerprint(&self) -> [u8; 32] {
        self.0.fingerprint
    }

    /// Returns the 8-byte tag of a frame whose tag field contains zeros.
    ///
    /// The first 6 bytes are keyed BLAKE3 over the length of `context` (8 bytes), `context` and the frame. `context`
    /// holds the settings that both ends share without sending them. The last 2 bytes are the same digest over an empty
    /// context: they distinguish another context from a forgery.
    pub(crate) fn tag(&self, context: &[u8], frame: &[u8]) -> [u8; 8] {
        let digest = |context: &[u8]| {
            let mut hasher = blake3::Hasher::new_keyed(&self.0.frames);
            hasher.update(&(context.len() as u64).to_le_bytes());
            hasher.update(context);
            hasher.update(frame);
            hasher.finalize()
        };
        let (bound, free) = (digest(context), digest(b""));
        let mut tag = [0; 8];
        tag[..BOUND_BYTES].copy_from_slice(&bound.as_bytes()[..BOUND_BYTES]);
        tag[BOUND_BYTES..].copy_from_slice(&free.as_bytes()[..8 - BOUND_BYTES]);
        tag
    }

    /// Checks the tag of a frame. Cost: O(length).
    pub(crate) fn check(&self, context: &[u8], frame: &[u8], tag: u64) -> Result<(), Error> {
        let (expected, found) = (self.tag(context, frame), tag.to_le_bytes());
        match () {
            () if expected == found => Ok(()),
            () if expected[BOUND_BYTES..] == found[BOUND_BYTES..] => Err(Error::OtherContext),
            () => Err(Error::Forged),
        }
    }

    /// Returns a 32-byte digest that only holders of the key can compute. Snapshots are checked with it.
    pub fn keyed_digest(&self, bytes: &[u8]) -> [u8; 32] {
        *blake3::keyed_hash(&self.0.memory, bytes).as_bytes()
    }
}

/// A key and the settings that both ends must share without sending them.
#[derive(Debug, Clone, Copy)]
pub struct Authenticator<'a> {
    /// The team's secret.
    pub key: &'a Key,
    /// The shared settings, for example the digest of the team's model.
    pub context: &'a [u8],
}

/// Bits of an authentication tag.
pub(crate) const TAG_BITS: u32 = 64;

/// Writes the tag into a message, if the message has a tag field. `place` is the first bit of that field, which
/// contains zeros until then.
pub(crate) fn authenticate(
    mut message: Vec<u8>,
    place: Option<usize>,
    auth: Option<Authenticator<'_>>,
) -> Result<Vec<u8>, Error> {
    match (place, auth) {
        (None, None) => Ok(message),
        (Some(place), Some(auth)) => {
            let tag = auth.key.tag(auth.context, &message);
            overwrite(&mut message, place, TAG_BITS, u64::from_le_bytes(tag));
            Ok(message)
        }
        (Some(_), None) => Err(Error::Authentication("an authenticated message needs a key")),
        (None, Some(_)) => Err(Error::Authentication("a plain message has no field for an authentication tag")),
    }
}

/// Checks the tag of a decoded message. Each message has exactly one encoding, so the received bytes are checked
/// directly.
pub(crate) fn check_tag(
    message: &[u8],
    place: Option<usize>,
    tag: u64,
    auth: Option<Authenticator<'_>>,
) -> Result<(), Error> {
    match (place, auth) {
        (None, None) => Ok(()),
        (Some(place), Some(auth)) => {
            let mut signed = message.to_vec();
            overwrite(&mut signed, place, TAG_BITS, 0);
            auth.key.check(auth.context, &signed, tag)
        }
        (Some(_), None) => Err(Error::Authentication("the message is authenticated, but there is no key to check it")),
        (None, Some(_)) => {
            Err(Error::Authentication("the message is plain, but only authenticated messages are accepted"))
        }
    }
}

/// Prints a placeholder, because the key is a secret.
impl core::fmt::Debug for Key {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str("Key(…)")
    }
}

/// Returns the 32-byte BLAKE3 digest of some bytes. It identifies the settings that a team shares.
pub fn digest(bytes: &[u8]) -> [u8; 32] {
    *blake3::hash(bytes).as_bytes()
}

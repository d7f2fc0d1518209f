//! Authentication of whole frames, and of what a vehicle keeps.

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

/// A team's secret: whoever has it can seal frames, and tell sealed frames from forged ones. Nothing is encrypted by it.
///
/// What is kept are keys derived for one use each, so that what is made for one is worth nothing for another. They stay
/// in one place in memory, and are wiped from there when the key is dropped.
#[derive(Clone)]
pub struct Key(Box<Secrets>);

#[derive(Clone, Zeroize, ZeroizeOnDrop)]
struct Secrets {
    frames: [u8; KEY_BYTES],
    memory: [u8; KEY_BYTES],
    fingerprint: [u8; KEY_BYTES],
}

impl Key {
    /// A key from 32 bytes that nobody can guess.
    ///
    /// # Errors
    /// [`Error::WeakKey`] for bytes that are all equal: a file that was never filled.
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

    /// A key from 64 hexadecimal digits; space around them is ignored.
    ///
    /// # Errors
    /// [`Error::Kind`] for anything else, and as [`Key::new`]. The text itself is not repeated: it may be a secret.
    pub fn parse(text: &str) -> Result<Self, Error> {
        let mut bytes = from_hex(text.trim()).unwrap_or_default();
        let key = <[u8; KEY_BYTES]>::try_from(bytes.as_slice());
        bytes.zeroize();
        Self::new(key.map_err(|_| Error::Kind { field: "key".into(), expected: "64 hexadecimal digits" })?)
    }

    /// A digest by which keys are told apart. It does not give the key away.
    pub fn fingerprint(&self) -> [u8; 32] {
        self.0.fingerprint
    }

    /// The 8-byte tag of a frame with zeros in the place of the tag: 6 bytes of keyed BLAKE3 over the length of
    /// `context` in 8 bytes, `context` (what both ends must agree on without sending it) and the frame, and 2 bytes of
    /// the same over an empty context, by which a holder of the key tells another context from a forgery.
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

    /// Checks the tag of a frame. O(length).
    pub(crate) fn check(&self, context: &[u8], frame: &[u8], tag: u64) -> Result<(), Error> {
        let (expected, found) = (self.tag(context, frame), tag.to_le_bytes());
        match () {
            () if expected == found => Ok(()),
            () if expected[BOUND_BYTES..] == found[BOUND_BYTES..] => Err(Error::OtherContext),
            () => Err(Error::Forged),
        }
    }

    /// The 32-byte digest of some bytes that only holders of the key can make: the check of a snapshot.
    pub fn keyed_digest(&self, bytes: &[u8]) -> [u8; 32] {
        *blake3::keyed_hash(&self.0.memory, bytes).as_bytes()
    }
}

/// A key, and what both ends must agree on without sending it.
#[derive(Debug, Clone, Copy)]
pub struct Seal<'a> {
    /// The team's secret.
    pub key: &'a Key,
    /// Such as the digest of the team's model.
    pub context: &'a [u8],
}

/// Bits of an authentication tag.
pub(crate) const TAG_BITS: u32 = 64;

/// A message with its tag, where it has a place for one: the first bit of it, which is zeros until then.
pub(crate) fn sealed(mut message: Vec<u8>, place: Option<usize>, seal: Option<Seal<'_>>) -> Result<Vec<u8>, Error> {
    match (place, seal) {
        (None, None) => Ok(message),
        (Some(place), Some(seal)) => {
            let tag = seal.key.tag(seal.context, &message);
            overwrite(&mut message, place, TAG_BITS, u64::from_le_bytes(tag));
            Ok(message)
        }
        (Some(_), None) => Err(Error::Seal("a sealed message needs a key")),
        (None, Some(_)) => Err(Error::Seal("an open message cannot be sealed")),
    }
}

/// Checks the tag of a message that was decoded: it has no other form than these bytes, and nothing needs to be encoded again.
pub(crate) fn check_seal(message: &[u8], place: Option<usize>, tag: u64, seal: Option<Seal<'_>>) -> Result<(), Error> {
    match (place, seal) {
        (None, None) => Ok(()),
        (Some(place), Some(seal)) => {
            let mut signed = message.to_vec();
            overwrite(&mut signed, place, TAG_BITS, 0);
            seal.key.check(seal.context, &signed, tag)
        }
        (Some(_), None) => Err(Error::Seal("a sealed message, but no key is at hand")),
        (None, Some(_)) => Err(Error::Seal("an open message where only sealed ones are taken")),
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

//! [`SimDisk`]: a disk in memory that loses power, fails, and fills up.

use std::io::{self, ErrorKind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redb::StorageBackend;

/// A disk in memory. Clones are handles of one disk.
///
/// Writes reach a cache. `sync_data` moves the cache to the medium. When the power is lost, each write in the cache is
/// kept, lost, or kept up to some byte, independently of the others. Changes of the length are kept in their order, as
/// file systems with a journal do.
#[derive(Clone)]
pub struct SimDisk {
    state: Arc<Mutex<State>>,
    /// Number of the power cycle in which this handle works.
    cycle: u64,
}

struct State {
    medium: Vec<u8>,
    /// Content as a running process reads it.
    current: Vec<u8>,
    cache: Vec<Change>,
    random: ChaCha8Rng,
    cycle: u64,
    /// Changes since the power was switched on.
    changes: u64,
    power_fails_at: Option<u64>,
    error_at: Option<u64>,
    full_from: Option<u64>,
}

enum Change {
    Write { offset: usize, data: Vec<u8> },
    Length(usize),
}

impl std::fmt::Debug for SimDisk {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("SimDisk").field("cycle", &self.cycle).finish_non_exhaustive()
    }
}

impl SimDisk {
    /// Returns an empty disk. The seed decides which writes survive a loss of power.
    pub fn new(seed: u64) -> Self {
        Self::with_content(seed, Vec::new())
    }

    /// Returns a disk with this content.
    pub fn with_content(seed: u64, bytes: Vec<u8>) -> Self {
        let state = State {
            medium: bytes.clone(),
            current: bytes,
            cache: Vec::new(),
            random: ChaCha8Rng::seed_from_u64(seed),
            cycle: 0,
            changes: 0,
            power_fails_at: None,
            error_at: None,
            full_from: None,
        };
        Self { state: Arc::new(Mutex::new(state)), cycle: 0 }
    }

    /// Loses power at this change, counted from now. The change is in the cache, and all later operations fail.
    pub fn lose_power_at(&self, change: u64) {
        let mut state = self.lock();
        state.power_fails_at = Some(state.changes + change);
    }

    /// Lets this change fail with an input/output error, counted from now. Later changes work again.
    pub fn fail_at(&self, change: u64) {
        let mut state = self.lock();
        state.error_at = Some(state.changes + change);
    }

    /// Makes the disk full from this change on, counted from now, until the next `crash` or `recover`.
    pub fn fill_at(&self, change: u64) {
        let mut state = self.lock();
        state.full_from = Some(state.changes + change);
    }

    /// Loses power now, if it was not lost before, and switches it on again. Returns a handle of the disk; older
    /// handles fail.
    pub fn crash(&self) -> Self {
        let mut state = self.lock();
        let cache = std::mem::take(&mut state.cache);
        let mut keeps_lengths = true;
        for change in cache {
            state.survive(change, &mut keeps_lengths);
        }
        state.current = state.medium.clone();
        state.cycle += 1;
        state.changes = 0;
        (state.power_fails_at, state.error_at, state.full_from) = (None, None, None);
        Self { state: self.state.clone(), cycle: state.cycle }
    }

    /// Returns the content as a running process reads it.
    pub fn content(&self) -> Vec<u8> {
        self.lock().current.clone()
    }

    /// Ends errors and lack of space. The power stays on.
    pub fn recover(&self) {
        let mut state = self.lock();
        (state.error_at, state.full_from) = (None, None);
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the state, if the power is on.
    fn powered(&self) -> io::Result<MutexGuard<'_, State>> {
        let state = self.lock();
        let lost = state.power_fails_at.is_some_and(|change| state.changes > change);
        if lost || state.cycle != self.cycle {
            return Err(io::Error::other("the power is lost"));
        }
        Ok(state)
    }

    fn change(&self, change: Change) -> io::Result<()> {
        let mut state = self.powered()?;
        let number = state.changes;
        state.changes += 1;
        if state.error_at == Some(number) {
            return Err(io::Error::other("an error of the medium"));
        }
        let grows = match &change {
            Change::Write { .. } => true,
            Change::Length(len) => *len > state.current.len(),
        };
        if grows && state.full_from.is_some_and(|full_from| number >= full_from) {
            return Err(ErrorKind::StorageFull.into());
        }
        apply(&mut state.current, &change);
        state.cache.push(change);
        if state.power_fails_at == Some(number) {
            return Err(io::Error::other("the power is lost"));
        }
        Ok(())
    }
}

impl State {
    /// Decides what of a change in the cache reached the medium.
    fn survive(&mut self, change: Change, keeps_lengths: &mut bool) {
        let chance: u32 = self.random.random_range(0..3);
        match change {
            Change::Length(_) => {
                *keeps_lengths &= chance != 0;
                if *keeps_lengths {
                    apply(&mut self.medium, &change);
                }
            }
            Change::Write { .. } if chance == 0 => {}
            Change::Write { .. } if chance == 1 => apply(&mut self.medium, &change),
            Change::Write { offset, mut data } => {
                data.truncate(self.random.random_range(0..=data.len()));
                apply(&mut self.medium, &Change::Write { offset, data });
            }
        }
    }
}

/// Applies a change. A write beyond the length has no effect there: its change of the length was lost.
fn apply(bytes: &mut Vec<u8>, change: &Change) {
    match change {
        Change::Length(len) => bytes.resize(*len, 0),
        Change::Write { offset, data } => {
            let end = (offset + data.len()).min(bytes.len());
            if *offset < end {
                bytes[*offset..end].copy_from_slice(&data[..end - offset]);
            }
        }
    }
}

impl StorageBackend for SimDisk {
    fn len(&self) -> io::Result<u64> {
        Ok(self.powered()?.current.len() as u64)
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        let state = self.powered()?;
        let source = state.current.get(offset as usize..offset as usize + out.len());
        out.copy_from_slice(source.ok_or(ErrorKind::UnexpectedEof)?);
        Ok(())
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        self.change(Change::Length(len as usize))
    }

    fn sync_data(&self) -> io::Result<()> {
        let mut state = self.powered()?;
        for change in std::mem::take(&mut state.cache) {
            apply(&mut state.medium, &change);
        }
        Ok(())
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        self.change(Change::Write { offset: offset as usize, data: data.to_vec() })
    }
}

//! The events of an LCM log, also of a damaged one.

use std::io::{self, Read};

/// The first bytes of every event.
pub(crate) const MAGIC: &[u8] = &[0xed, 0xa1, 0xda, 0x01];

/// Length of the head of an event: mark, number, time in microseconds, lengths of channel and message.
const HEAD_BYTES: usize = 28;

/// Longest name of a channel and longest message, in bytes.
const CHANNEL_BYTES_MAX: usize = 1 << 12;
const MESSAGE_BYTES_MAX: usize = 1 << 26;

/// Number of bytes that are read at once.
const BLOCK_BYTES: usize = 1 << 16;

/// An event with its channel and its time.
pub(crate) struct Event<'a> {
    pub(crate) channel: String,
    pub(crate) time_s: f64,
    pub(crate) message: &'a [u8],
    /// Number of damaged places before it.
    pub(crate) damaged: usize,
}

/// Iterates over the events. After damage it goes on at the next mark. Holds one event.
pub(crate) struct Events<R> {
    reader: R,
    /// Bytes that were read, and the position of the next event among them.
    buffer: Vec<u8>,
    position: usize,
    /// Number of damaged places.
    pub(crate) damaged: usize,
    /// Whether the log ends within an event.
    pub(crate) is_truncated: bool,
}

impl<R: Read> Events<R> {
    pub(crate) fn new(reader: R) -> Self {
        Self { reader, buffer: Vec::new(), position: 0, damaged: 0, is_truncated: false }
    }

    /// Returns the next event; `None` at the end of the log.
    pub(crate) fn next(&mut self) -> io::Result<Option<Event<'_>>> {
        while let head @ [_, ..] = self.peek(HEAD_BYTES)? {
            if head.len() < HEAD_BYTES && (head.starts_with(MAGIC) || MAGIC.starts_with(head)) {
                self.is_truncated = true;
                return Ok(None);
            }
            let Some((channel_bytes, message_bytes, time_s)) = parse_head(head) else {
                self.skip_damage()?;
                continue;
            };
            let length = HEAD_BYTES + channel_bytes + message_bytes;
            let found = self.peek(length + MAGIC.len())?;
            let (event, following) = found.split_at(length.min(found.len()));
            // If the next event begins within the present event, the lengths of the present event are damaged.
            let is_followed = event.len() == length && MAGIC.starts_with(following);
            if !is_followed && position_of_mark(&event[1..]).is_some() {
                self.skip_damage()?;
                continue;
            }
            if event.len() < length {
                self.is_truncated = true;
                return Ok(None);
            }
            let event = self.position..self.position + length;
            self.position = event.end;
            let (channel, message) = self.buffer[event][HEAD_BYTES..].split_at(channel_bytes);
            let (channel, damaged) = (String::from_utf8_lossy(channel).into_owned(), self.damaged);
            return Ok(Some(Event { channel, time_s, message, damaged }));
        }
        Ok(None)
    }

    /// Returns the next bytes, and fewer than `count` only at the end of the log.
    fn peek(&mut self, count: usize) -> io::Result<&[u8]> {
        while self.buffer.len() - self.position < count {
            if self.position >= BLOCK_BYTES && self.position > self.buffer.len() / 2 {
                self.buffer.drain(..self.position);
                self.position = 0;
            }
            let missing = (self.position + count - self.buffer.len()).max(BLOCK_BYTES) as u64;
            if self.reader.by_ref().take(missing).read_to_end(&mut self.buffer)? == 0 {
                break;
            }
        }
        let end = self.buffer.len().min(self.position + count);
        Ok(&self.buffer[self.position..end])
    }

    /// Counts a damaged place and moves to the next mark, or to the end of the log.
    fn skip_damage(&mut self) -> io::Result<()> {
        self.damaged += 1;
        self.position += 1;
        loop {
            let block = self.peek(BLOCK_BYTES)?;
            if let Some(offset) = position_of_mark(block) {
                self.position += offset;
                return Ok(());
            }
            // A mark may begin in the last bytes of a block.
            self.position += if block.len() < BLOCK_BYTES { block.len() } else { BLOCK_BYTES - MAGIC.len() + 1 };
            if self.peek(1)?.is_empty() {
                return Ok(());
            }
        }
    }
}

/// Returns the lengths of channel and message and the time in seconds; `None` if it is no head of an event.
fn parse_head(head: &[u8]) -> Option<(usize, usize, f64)> {
    let head: &[u8; HEAD_BYTES] = head.try_into().ok().filter(|_| head.starts_with(MAGIC))?;
    let number = |at: usize| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let (channel_bytes, message_bytes) = (number(20) as usize, number(24) as usize);
    let time_us = (u64::from(number(12)) << 32) | u64::from(number(16));
    let is_possible = (1..=CHANNEL_BYTES_MAX).contains(&channel_bytes) && message_bytes <= MESSAGE_BYTES_MAX;
    is_possible.then_some((channel_bytes, message_bytes, time_us as f64 * 1e-6))
}

fn position_of_mark(bytes: &[u8]) -> Option<usize> {
    bytes.windows(MAGIC.len()).position(|window| window == MAGIC)
}

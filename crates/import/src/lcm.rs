//! Logs of LCM: events on channels, each a message of a type that its fingerprint names.

use std::io::{self, Read};

use crate::bag::Bag;
use crate::ids::Ids;
use crate::lcm_types::{LcmTypes, Leaf};
use crate::spoken::Spoken;
use crate::told::Told;

/// What every event begins with.
pub(crate) const MAGIC: &[u8] = &[0xed, 0xa1, 0xda, 0x01];

/// No channel has a longer name, and no message is longer.
const CHANNEL_BYTES_MAX: usize = 1 << 12;
const MESSAGE_BYTES_MAX: usize = 1 << 26;

/// Reads a log event by event. Messages of types that are not given are counted. Holds one message.
///
/// # Errors
/// What is wrong with the file, and what was expected.
pub(crate) fn read(mut reader: impl Read, types: &LcmTypes, ids: &Ids, prefix: &str) -> Result<Told, String> {
    if types.is_empty() {
        return Err("a log of LCM, whose types are not known; expected their definitions (.lcm) among the files".into());
    }
    let names = types.by_fingerprint();
    let (mut bag, mut message, mut cut_off, mut of_no_type) = (Bag::new(ids, prefix), Vec::new(), 0, 0);
    loop {
        match event(&mut reader, &mut message).map_err(|error| format!("not a log of LCM: {error}"))? {
            Event::End => break,
            Event::CutOff => {
                cut_off += 1;
                break;
            }
            Event::On(channel, time_s) if bag.asks_for(&channel) => {
                let fingerprint = message.first_chunk().map(|bytes| u64::from_be_bytes(*bytes));
                match fingerprint.and_then(|fingerprint| names.get(&fingerprint)) {
                    Some(name) => {
                        let taken = take(&mut bag, (time_s, &channel), types, (name, &message[8..]));
                        bag.garbled(taken.is_none());
                    }
                    None => of_no_type += 1,
                }
            }
            Event::On(..) => {}
        }
    }
    let mut told = bag.finish()?;
    told.skipped.cut_off += cut_off;
    told.skipped.of_no_type += of_no_type;
    Ok(told)
}

enum Event {
    /// On this channel, at this time; the message is where it was asked for.
    On(String, f64),
    CutOff,
    End,
}

/// The next event: a mark, its number, when it was in microseconds, how long the channel's name and the message are, and both.
fn event(reader: &mut impl Read, message: &mut Vec<u8>) -> io::Result<Event> {
    let mut head = Vec::new();
    reader.by_ref().take(28).read_to_end(&mut head)?;
    if head.is_empty() {
        return Ok(Event::End);
    }
    if !head.starts_with(MAGIC) && !MAGIC.starts_with(&head) {
        return Err(io::Error::other("an event does not begin with 0xEDA1DA01"));
    }
    let Ok(head) = <[u8; 28]>::try_from(head) else { return Ok(Event::CutOff) };
    let number = |from: usize| u32::from_be_bytes([head[from], head[from + 1], head[from + 2], head[from + 3]]);
    let time_us = (u64::from(number(12)) << 32) | u64::from(number(16));
    let (channel_bytes, message_bytes) = (number(20) as usize, number(24) as usize);
    if channel_bytes > CHANNEL_BYTES_MAX || message_bytes > MESSAGE_BYTES_MAX {
        return Err(io::Error::other(format!("an event says that it has {channel_bytes} and {message_bytes} bytes")));
    }
    let mut channel = Vec::new();
    reader.by_ref().take(channel_bytes as u64).read_to_end(&mut channel)?;
    message.clear();
    reader.by_ref().take(message_bytes as u64).read_to_end(message)?;
    if channel.len() < channel_bytes || message.len() < message_bytes {
        return Ok(Event::CutOff);
    }
    Ok(Event::On(String::from_utf8_lossy(&channel).into_owned(), time_us as f64 * 1e-6))
}

/// Takes in what a message says by the names of its members.
fn take(bag: &mut Bag, (time_s, channel): (f64, &str), types: &LcmTypes, (name, bytes): (&str, &[u8])) -> Option<()> {
    let mut spoken = Spoken::default();
    types.decode(name, bytes, &mut |member, leaf| match leaf {
        Leaf::Flag(flag) => spoken.flag(member, flag),
        Leaf::Number(number) => spoken.number(member, number),
        Leaf::Text(text) => spoken.text(member, text),
        Leaf::Bytes(bytes) => spoken.texts.push(String::from_utf8_lossy(bytes).into_owned()),
    })?;
    bag.take_spoken(time_s, channel, &spoken);
    for text in spoken.texts.iter().filter(|text| text.trim_start().starts_with('{')) {
        bag.spoken(time_s, channel, text);
    }
    Some(())
}

//! LCM logs. An event holds a channel and a message, whose fingerprint identifies its type.
//!
//! The reader is written by hand, because no maintained crate decodes LCM logs with types known only at run time.

use std::io::{self, Read};

use crate::model::modem_ids::ModemIds;
use crate::model::parsed_file::ParsedFile;
use crate::readers::bags::bag_parser::BagParser;
use crate::readers::lcm::types::{LcmTypes, Leaf};
use crate::readers::message_fields::MessageFields;

/// The first bytes of every event.
pub(crate) const MAGIC: &[u8] = &[0xed, 0xa1, 0xda, 0x01];

/// Longest name of a channel and longest message, in bytes.
const CHANNEL_BYTES_MAX: usize = 1 << 12;
const MESSAGE_BYTES_MAX: usize = 1 << 26;

/// Reads a log event by event. Messages of unknown types are counted. Holds one message.
///
/// # Errors
/// The problem with the file, and what was expected.
pub(crate) fn read(
    mut reader: impl Read,
    types: &LcmTypes,
    ids: &ModemIds,
    prefix: &str,
) -> Result<ParsedFile, String> {
    if types.is_empty() {
        return Err("an LCM log without the definitions of its types; expected them (.lcm) among the files".into());
    }
    let names = types.by_fingerprint();
    let (mut bag, mut message, mut truncated, mut unknown_type) = (BagParser::new(ids, prefix), Vec::new(), 0, 0);
    loop {
        match read_event(&mut reader, &mut message).map_err(|error| format!("not a log of LCM: {error}"))? {
            Event::End => break,
            Event::Truncated => {
                truncated += 1;
                break;
            }
            Event::Message(channel, time_s) if bag.selects(&channel) => {
                let fingerprint = message.first_chunk().map(|bytes| u64::from_be_bytes(*bytes));
                match fingerprint.and_then(|fingerprint| names.get(&fingerprint)) {
                    Some(name) => {
                        let decoded = absorb_message(&mut bag, (time_s, &channel), types, (name, &message[8..]));
                        bag.count_garbled(decoded.is_none());
                    }
                    None => unknown_type += 1,
                }
            }
            Event::Message(..) => {}
        }
    }
    let mut parsed = bag.finish()?;
    parsed.skipped.truncated += truncated;
    parsed.skipped.unknown_type += unknown_type;
    Ok(parsed)
}

enum Event {
    /// An event with its channel and its time in seconds. The message is in the buffer of the caller.
    Message(String, f64),
    Truncated,
    End,
}

/// Reads an event: sync word, event number, time in microseconds, lengths of channel and message, channel, message.
fn read_event(reader: &mut impl Read, message: &mut Vec<u8>) -> io::Result<Event> {
    let mut head = Vec::new();
    reader.by_ref().take(28).read_to_end(&mut head)?;
    if head.is_empty() {
        return Ok(Event::End);
    }
    if !head.starts_with(MAGIC) && !MAGIC.starts_with(&head) {
        return Err(io::Error::other("an event does not begin with 0xEDA1DA01"));
    }
    let Ok(head) = <[u8; 28]>::try_from(head) else { return Ok(Event::Truncated) };
    let number =
        |offset: usize| u32::from_be_bytes([head[offset], head[offset + 1], head[offset + 2], head[offset + 3]]);
    let time_us = (u64::from(number(12)) << 32) | u64::from(number(16));
    let (channel_bytes, message_bytes) = (number(20) as usize, number(24) as usize);
    if channel_bytes > CHANNEL_BYTES_MAX || message_bytes > MESSAGE_BYTES_MAX {
        return Err(io::Error::other(format!("an event states lengths of {channel_bytes} and {message_bytes} bytes")));
    }
    let mut channel = Vec::new();
    reader.by_ref().take(channel_bytes as u64).read_to_end(&mut channel)?;
    message.clear();
    reader.by_ref().take(message_bytes as u64).read_to_end(message)?;
    if channel.len() < channel_bytes || message.len() < message_bytes {
        return Ok(Event::Truncated);
    }
    Ok(Event::Message(String::from_utf8_lossy(&channel).into_owned(), time_us as f64 * 1e-6))
}

/// Absorbs the members of a message by their names.
fn absorb_message(
    bag: &mut BagParser,
    (time_s, channel): (f64, &str),
    types: &LcmTypes,
    (name, bytes): (&str, &[u8]),
) -> Option<()> {
    let mut fields = MessageFields::default();
    types.decode(name, bytes, &mut |member, leaf| match leaf {
        Leaf::Flag(flag) => fields.flag(member, flag),
        Leaf::Number(number) => fields.number(member, number),
        Leaf::Text(text) => fields.text(member, text),
        Leaf::Bytes(bytes) => fields.texts.push(String::from_utf8_lossy(bytes).into_owned()),
    })?;
    bag.absorb_fields(time_s, channel, &fields);
    for text in fields.texts.iter().filter(|text| text.trim_start().starts_with('{')) {
        bag.read_text(time_s, channel, text);
    }
    Some(())
}

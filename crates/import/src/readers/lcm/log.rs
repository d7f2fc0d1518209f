//! LCM logs. An event holds a channel and a message, whose fingerprint identifies its type.
//!
//! The reader is written by hand, because no maintained crate decodes LCM logs with types known only at run time.

use std::io::Read;

use crate::model::modem_ids::ModemIds;
use crate::model::parsed_file::ParsedFile;
use crate::readers::bags::bag_parser::BagParser;
use crate::readers::lcm::decoder::Leaf;
use crate::readers::lcm::events::{Event, Events};
use crate::readers::lcm::types::LcmTypes;
use crate::readers::message_fields::MessageFields;

/// Reads a log event by event. Messages of unknown types are counted, and so are damaged places. Holds one message.
///
/// # Errors
/// The problem with the file, and what was expected.
pub(crate) fn read(reader: impl Read, types: &LcmTypes, ids: &ModemIds, prefix: &str) -> Result<ParsedFile, String> {
    if types.is_empty() {
        return Err("an LCM log without the definitions of its types; expected them (.lcm) among the files".into());
    }
    let names = types.by_fingerprint();
    let (mut bag, mut events, mut unknown_type, mut is_empty) =
        (BagParser::new(ids, prefix), Events::new(reader), 0, true);
    let mut damaged = 0;
    loop {
        let next = events.next().map_err(|error| format!("cannot be read: {error}"))?;
        let Some(Event { channel, time_s, message, damaged: damaged_before }) = next else { break };
        if damaged_before > damaged {
            damaged = damaged_before;
            bag.lost.note_damage();
        }
        bag.lost.note_record(time_s);
        is_empty = false;
        if !bag.selects(&channel) {
            continue;
        }
        let fingerprint = message.split_first_chunk().map(|(bytes, rest)| (u64::from_be_bytes(*bytes), rest));
        match fingerprint.and_then(|(fingerprint, rest)| Some((names.get(&fingerprint)?, rest))) {
            Some((name, rest)) => {
                let decoded = absorb_message(&mut bag, (time_s, &channel), types, (name, rest));
                bag.count_garbled(decoded.is_none());
            }
            None => unknown_type += 1,
        }
    }
    if is_empty && events.damaged > 0 {
        return Err("not a log of LCM: none of its events can be read".into());
    }
    let mut parsed = bag.finish()?;
    parsed.skipped.truncated += usize::from(events.is_truncated);
    parsed.skipped.damaged += events.damaged;
    parsed.skipped.unknown_type += unknown_type;
    Ok(parsed)
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

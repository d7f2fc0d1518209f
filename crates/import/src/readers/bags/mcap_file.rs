//! MCAP files from ROS 2 and other systems.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read};

use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::model::modem_ids::ModemIds;
use crate::model::parsed_file::ParsedFile;
use crate::readers::bags::bag_parser::BagParser;
use crate::readers::bags::encoding::TopicFormat;

/// The first bytes of an MCAP file.
pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Longest record outside of a chunk or inside of it, in bytes.
const RECORD_BYTES_MAX: usize = 1 << 26;

/// Longest chunk, as stored, in bytes.
const CHUNK_BYTES_MAX: u64 = 1 << 28;

/// A record behind a chunk. It shows that the chunk was read to its end.
const CHUNK_END: &[u8] = &[op::DATA_END, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];

/// Reads a file from its beginning to its end, or to the point where it is truncated.
///
/// A chunk counts only if its checksum is right. A damaged chunk or record is left out and counted,
/// and its time span is noted. If the length of a
/// record is damaged, the rest of the file is left out. Memory holds one message, or one chunk as stored.
///
/// # Errors
/// The problem with the file, and what was expected.
pub(crate) fn read(mut reader: impl Read, ids: &ModemIds, prefix: &str) -> Result<ParsedFile, String> {
    let unreadable = |error| format!("cannot be read: {error}");
    let (mut topics, mut record) = (Topics::new(BagParser::new(ids, prefix)), Vec::new());
    let (mut is_whole, mut damaged) = (false, 0);
    read_up_to(&mut reader, MAGIC.len() as u64, &mut record).map_err(unreadable)?;
    loop {
        read_up_to(&mut reader, 9, &mut record).map_err(unreadable)?;
        let Some((&opcode, length)) = record.split_first() else { break };
        let Ok(length) = length.try_into().map(u64::from_le_bytes) else { break };
        let is_known = (op::HEADER..=op::DATA_END).contains(&opcode) || opcode >= 0x80;
        let bytes_max = if opcode == op::CHUNK { CHUNK_BYTES_MAX } else { RECORD_BYTES_MAX as u64 };
        let is_used = matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE | op::CHUNK | op::DATA_END);
        if !is_known || is_used && length > bytes_max {
            damaged += 1;
            break;
        }
        if !is_used {
            io::copy(&mut reader.by_ref().take(length), &mut io::sink()).map_err(unreadable)?;
            continue;
        }
        let head = record.clone();
        read_up_to(&mut reader, length, &mut record).map_err(unreadable)?;
        let is_cut = (record.len() as u64) < length;
        if opcode == op::CHUNK {
            // A chunk that the end of the file cuts cannot be checked. Its messages up to the end count.
            let is_intact = is_cut || read_chunk(&head, &record, &mut |_| {});
            if is_intact {
                read_chunk(&head, &record, &mut |record| topics.absorb(record));
            } else {
                damaged += 1;
                topics.bag.lost.note_damage();
            }
        } else if !is_cut {
            match mcap::parse_record(opcode, &record) {
                Ok(record) => topics.absorb(record),
                Err(_) => {
                    damaged += 1;
                    topics.bag.lost.note_damage();
                }
            }
            is_whole |= opcode == op::DATA_END;
        }
    }
    if damaged > 0 && !topics.has_messages {
        return Err("damaged MCAP file: no message of it can be read; expected an undamaged file".into());
    }
    let mut parsed = topics.bag.finish()?;
    parsed.skipped.truncated += usize::from(!is_whole && damaged == 0);
    parsed.skipped.damaged += damaged;
    Ok(parsed)
}

/// Fills a buffer with the next bytes. It is shorter at the end of the file.
fn read_up_to(reader: &mut impl Read, length: u64, buffer: &mut Vec<u8>) -> io::Result<()> {
    buffer.clear();
    reader.by_ref().take(length).read_to_end(buffer).map(drop)
}

/// Emits the records in a chunk. Returns whether it could be read to its end with the right checksum.
fn read_chunk(head: &[u8], chunk: &[u8], emit: &mut dyn FnMut(Record)) -> bool {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_validate_chunk_crcs(true)
        .with_record_length_limit(RECORD_BYTES_MAX);
    let (mut records, mut rest) = (LinearReader::new_with_options(options), head.chain(chunk).chain(CHUNK_END));
    while let Some(event) = records.next_event() {
        match event {
            Ok(LinearReadEvent::ReadRequest(wanted)) => {
                let Ok(read) = rest.read(records.insert(wanted)) else { return false };
                records.notify_read(read);
            }
            Ok(LinearReadEvent::Record { opcode: op::DATA_END, .. }) => return true,
            Ok(LinearReadEvent::Record { opcode, data }) => match mcap::parse_record(opcode, data) {
                Ok(record) => emit(record),
                Err(_) => return false,
            },
            Err(_) => return false,
        }
    }
    false
}

/// The topics of a file, and the parser of their messages.
struct Topics<'a> {
    bag: BagParser<'a>,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, (TopicFormat, String)>,
    /// Channels with a definition, selected or not.
    defined: BTreeSet<u16>,
    /// Whether any topic has a message.
    has_messages: bool,
}

impl<'a> Topics<'a> {
    fn new(bag: BagParser<'a>) -> Self {
        Self { bag, schemas: BTreeMap::new(), channels: BTreeMap::new(), defined: BTreeSet::new(), has_messages: false }
    }

    fn absorb(&mut self, record: Record) {
        match record {
            Record::Schema { header, .. } => drop(self.schemas.insert(header.id, header.name)),
            Record::Channel(channel) => {
                self.defined.insert(channel.id);
                if !self.bag.selects(&channel.topic) {
                    return;
                }
                let kind = self.schemas.get(&channel.schema_id).map_or("", String::as_str);
                let topic = TopicFormat::new(kind, &channel.message_encoding);
                self.channels.insert(channel.id, (topic, channel.topic));
            }
            Record::Message { header, data } => {
                self.has_messages = true;
                let time_s = header.log_time as f64 * 1e-9;
                self.bag.lost.note_record(time_s);
                if !self.defined.contains(&header.channel_id) {
                    self.bag.lost.note_undefined_topic();
                }
                if let Some((topic, name)) = self.channels.get(&header.channel_id) {
                    self.bag.absorb(time_s, (*topic, name), &data);
                }
            }
            _ => {}
        }
    }
}

//! MCAP files from ROS 2 and other systems.

use std::collections::BTreeMap;
use std::io::Read;

use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::model::modem_ids::ModemIds;
use crate::model::parsed_file::ParsedFile;
use crate::readers::bags::bag_parser::{BagParser, TopicFormat};

/// The first bytes of an MCAP file.
pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Longest record, in bytes.
const RECORD_BYTES_MAX: usize = 1 << 26;

/// Reads a file from its beginning to its end, or to the point where it is truncated. Memory holds one message, or one
/// compressed chunk.
///
/// # Errors
/// The problem with the file, and what was expected.
pub(crate) fn read(mut reader: impl Read, ids: &ModemIds, prefix: &str) -> Result<ParsedFile, String> {
    let options = LinearReaderOptions::default().with_record_length_limit(RECORD_BYTES_MAX).with_skip_end_magic(true);
    let mut records = LinearReader::new_with_options(options);
    let (mut bag, mut schemas, mut channels) = (BagParser::new(ids, prefix), BTreeMap::new(), BTreeMap::new());
    let mut is_whole = false;
    while let Some(event) = records.next_event() {
        match event {
            Ok(LinearReadEvent::ReadRequest(wanted)) => {
                let read = reader.read(records.insert(wanted)).map_err(|error| format!("cannot be read: {error}"))?;
                records.notify_read(read);
            }
            Ok(LinearReadEvent::Record { opcode, data }) => {
                match mcap::parse_record(opcode, data).map_err(|error| error.to_string())? {
                    Record::Schema { header, .. } => drop(schemas.insert(header.id, header.name)),
                    Record::Channel(channel) if bag.selects(&channel.topic) => {
                        let kind = schemas.get(&channel.schema_id).map_or("", String::as_str);
                        let topic = TopicFormat::new(kind, &channel.message_encoding);
                        channels.insert(channel.id, (topic, channel.topic));
                    }
                    Record::Message { header, data } => {
                        if let Some((topic, name)) = channels.get(&header.channel_id) {
                            bag.absorb(header.log_time as f64 * 1e-9, (*topic, name), &data);
                        }
                    }
                    Record::DataEnd(_) => is_whole = true,
                    _ => {}
                }
            }
            // A recorder that loses power writes no end of file.
            Err(mcap::McapError::UnexpectedEof) => break,
            Err(error) => return Err(format!("damaged MCAP file: {error}")),
        }
    }
    let mut parsed = bag.finish()?;
    parsed.skipped.truncated += usize::from(!is_whole);
    Ok(parsed)
}

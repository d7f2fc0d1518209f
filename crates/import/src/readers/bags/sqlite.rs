//! ROS 2 bags in SQLite files (`.db3`).

use std::collections::BTreeMap;
use std::path::Path;

use rusqlite::{Connection, OpenFlags};

use crate::model::modem_ids::ModemIds;
use crate::model::parsed_file::ParsedFile;
use crate::readers::bags::bag_parser::{BagParser, TopicFormat};

/// The first bytes of an SQLite database.
pub(crate) const MAGIC: &[u8] = b"SQLite format 3\0";

/// Reads the messages of a bag in the order of their records. Opens the file read-only. Returns `None` if the database
/// is not a bag.
///
/// # Errors
/// The problem with the file, and what was expected.
pub(crate) fn read(path: &Path, ids: &ModemIds, prefix: &str) -> Result<Option<ParsedFile>, String> {
    let bad = |error: rusqlite::Error| format!("not a bag of ROS 2: {error}; expected its tables");
    let database = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY).map_err(bad)?;
    let has = |table: &str| database.table_exists(None, table).map_err(bad);
    if !has("topics")? || !has("messages")? {
        return Ok(None);
    }
    messages(&database, BagParser::new(ids, prefix)).map_err(bad)?.finish().map(Some)
}

fn messages<'a>(database: &Connection, mut bag: BagParser<'a>) -> rusqlite::Result<BagParser<'a>> {
    let mut topics = BTreeMap::new();
    let mut statement = database.prepare("SELECT id, name, type, serialization_format FROM topics")?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let (name, kind, encoding): (String, String, String) = (row.get(1)?, row.get(2)?, row.get(3)?);
        if bag.selects(&name) {
            topics.insert(row.get::<_, i64>(0)?, (TopicFormat::new(&kind, &encoding), name));
        }
    }
    let mut statement = database.prepare("SELECT topic_id, timestamp, data FROM messages ORDER BY id")?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let (topic, time_ns): (i64, i64) = (row.get(0)?, row.get(1)?);
        if let Some((topic, name)) = topics.get(&topic) {
            bag.absorb(time_ns as f64 * 1e-9, (*topic, name), row.get_ref(2)?.as_blob()?);
        }
    }
    Ok(bag)
}

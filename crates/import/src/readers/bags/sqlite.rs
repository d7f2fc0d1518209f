//! ROS 2 bags in SQLite files (`.db3`).

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use pingmap_agent::Interrupt;
use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::{Connection, OpenFlags};
use tempfile::NamedTempFile;

use crate::model::parsed_file::ParsedFile;
use crate::readers::bags::bag_parser::BagParser;
use crate::readers::bags::encoding::TopicFormat;
use crate::readers::bags::sqlite_wal::apply_wal;

/// The first bytes of an SQLite database.
pub(crate) const MAGIC: &[u8] = b"SQLite format 3\0";

/// Longest text or message, in bytes.
const VALUE_BYTES_MAX: i32 = 1 << 26;

/// Position of the two modes of a file in its head: 1 for a rollback journal, 2 for a write-ahead log.
const MODES: Range<usize> = 18..20;

/// The tables of a bag.
const TABLES: [&str; 2] = ["topics", "messages"];

/// The problem with a file, and what was expected.
struct Problem(String);

impl From<rusqlite::Error> for Problem {
    fn from(error: rusqlite::Error) -> Self {
        Self(format!("not a bag of ROS 2: {error}; expected its tables"))
    }
}

impl From<io::Error> for Problem {
    fn from(error: io::Error) -> Self {
        Self(format!("cannot be copied to a temporary file: {error}"))
    }
}

/// Reads the messages of a bag in the order of their records. Returns `None` if the database is not a bag.
///
/// A file is opened as one that does not change: nothing is written to it or next to it. If it has a write-ahead log
/// (`-wal`) or no path, it is copied to a temporary file first. That file has no name, so that the system removes it
/// when the process ends.
///
/// # Errors
/// The problem with the file, and what was expected.
pub(crate) fn read(content: impl Read, path: Option<&Path>, bag: BagParser) -> Result<Option<ParsedFile>, String> {
    let bag = read_bag(content, path, bag).map_err(|Problem(text)| text)?;
    bag.map(BagParser::finish).transpose()
}

fn read_bag<'a>(content: impl Read, path: Option<&Path>, bag: BagParser<'a>) -> Result<Option<BagParser<'a>>, Problem> {
    let (database, bytes) = match (path, path.and_then(open_wal)) {
        (Some(path), None) => (open(path, "immutable=1")?, path.metadata().map_or(0, |metadata| metadata.len())),
        (_, wal) => copy(content, wal)?,
    };
    for table in TABLES {
        if count(&database, "pragma_table_list(?1) WHERE schema = 'main'", table)? == 0 {
            return Ok(None);
        }
    }
    check_schema(&database)?;
    read_messages(&database, bytes, bag).map(Some)
}

/// Opens the write-ahead log of a database, if there is one with content.
fn open_wal(path: &Path) -> Option<File> {
    let mut name = path.as_os_str().to_owned();
    name.push("-wal");
    File::open(PathBuf::from(name)).ok().filter(|file| file.metadata().is_ok_and(|metadata| metadata.len() > 0))
}

/// Opens a database for reading alone, with a parameter of its URI. Its schema is not trusted.
fn open(path: &Path, parameter: &str) -> rusqlite::Result<Connection> {
    let mut uri = String::from("file:");
    for byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            byte if byte.is_ascii_alphanumeric() => uri.push(char::from(*byte)),
            byte => write!(uri, "%{byte:02X}").expect("writing to a String"),
        }
    }
    uri = format!("{uri}?{parameter}");
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let database = Connection::open_with_flags(uri, flags)?;
    database.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
    database.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    database.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW, false)?;
    database.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false)?;
    database.set_limit(Limit::SQLITE_LIMIT_LENGTH, VALUE_BYTES_MAX)?;
    Ok(database)
}

/// Copies a database to a temporary file and opens it. Also returns its length.
fn copy(mut content: impl Read, wal: Option<File>) -> Result<(Connection, u64), Problem> {
    let named = NamedTempFile::new()?;
    // SQLite keeps the file open. The file loses its name while it is still empty.
    let database = open(named.path(), "nolock=1")?;
    let mut file = named.into_file();
    let mut head = Vec::new();
    content.by_ref().take(MODES.end as u64).read_to_end(&mut head)?;
    io::copy(&mut head.as_slice().chain(content), &mut file)?;
    if let Some(mut wal) = wal {
        apply_wal(&mut file, &mut wal)?;
    }
    // SQLite would search for the write-ahead log of a file in this mode.
    if head.starts_with(MAGIC) && head[MODES] == [2, 2] {
        file.seek(SeekFrom::Start(MODES.start as u64))?;
        file.write_all(&[1, 1])?;
    }
    let bytes = file.metadata()?.len();
    Ok((database, bytes))
}

/// Returns the number of rows of a selection, with the name of a table as its parameter.
fn count(database: &Connection, selection: &str, table: &str) -> rusqlite::Result<i64> {
    database.query_row(&format!("SELECT count(*) FROM {selection}"), [table], |row| row.get(0))
}

/// Refuses tables that do not store their values.
fn check_schema(database: &Connection) -> Result<(), Problem> {
    for table in TABLES {
        let tables = "pragma_table_list(?1) WHERE schema = 'main' AND type = 'table' AND wr = 0";
        let generated = "pragma_table_xinfo(?1) WHERE hidden <> 0";
        if count(database, tables, table)? != 1 || count(database, generated, table)? > 0 {
            let problem = format!("{table} is no table, or has generated columns; expected a table of stored values");
            return Err(Problem(format!("not a bag of ROS 2: {problem}")));
        }
    }
    Ok(())
}

/// Counts the bytes of all values. They exceed the length of the file only if rows share pages.
struct Budget(u64);

impl Budget {
    fn spend(&mut self, bytes: usize) -> Result<(), Problem> {
        let left = self.0.checked_sub(bytes as u64 + 1);
        let problem = || Problem("not a bag of ROS 2: its rows share pages; expected an undamaged file".into());
        self.0 = left.ok_or_else(problem)?;
        Ok(())
    }
}

fn read_messages<'a>(database: &Connection, file_bytes: u64, mut bag: BagParser<'a>) -> Result<BagParser<'a>, Problem> {
    let (mut topics, mut budget) = (BTreeMap::new(), Budget(file_bytes));
    let mut statement = database.prepare("SELECT id, name, type, serialization_format FROM topics NOT INDEXED")?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let (name, kind, encoding): (String, String, String) = (row.get(1)?, row.get(2)?, row.get(3)?);
        budget.spend(name.len() + kind.len() + encoding.len())?;
        if bag.selects(&name) {
            topics.insert(row.get::<_, i64>(0)?, (TopicFormat::new(&kind, &encoding), name));
        }
    }
    // Without an index the rows come in the order of their keys, which is that of their records.
    let mut statement = database.prepare("SELECT topic_id, timestamp, data FROM messages NOT INDEXED")?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        Interrupt::check().map_err(|stopped| Problem(stopped.to_string()))?;
        let (topic, time_ns): (i64, i64) = (row.get(0)?, row.get(1)?);
        let data = row.get_ref(2)?.as_blob().map_err(rusqlite::Error::from)?;
        budget.spend(data.len())?;
        if let Some((topic, name)) = topics.get(&topic) {
            bag.absorb(time_ns as f64 * 1e-9, (*topic, name), data);
        }
    }
    Ok(bag)
}

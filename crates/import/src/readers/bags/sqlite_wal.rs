//! Write-ahead logs of SQLite, which hold the last messages of a recorder that lost its power.
//!
//! SQLite itself would write next to the bag to read them.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom, Write};

/// The first bytes of write-ahead logs of both orders of bytes, and of their index (`-shm`).
pub(crate) const MAGICS: [&[u8]; 3] = [&[0x37, 0x7f, 0x06, 0x82], &[0x37, 0x7f, 0x06, 0x83], &[0x18, 0xe2, 0x2d, 0x00]];

const HEAD_BYTES: usize = 32;
const FRAME_HEAD_BYTES: usize = 24;

/// Writes the committed pages of a write-ahead log to its database, as SQLite does when it recovers. Pages after the
/// last whole commit are left out. Memory: 16 bytes a page.
pub(crate) fn apply_wal(database: &mut (impl Write + Seek), wal: &mut (impl Read + Seek)) -> io::Result<()> {
    let mut head = [0; HEAD_BYTES];
    // A log without a whole head holds no commit.
    if wal.read_exact(&mut head).is_err() || !MAGICS[..2].contains(&&head[..4]) {
        return Ok(());
    }
    let (is_big_endian, page_bytes) = (head[3] == 0x83, word(&head, 8) as usize);
    if !page_bytes.is_power_of_two() || !(512..=65536).contains(&page_bytes) {
        return Ok(());
    }
    let mut sum = checksum([0, 0], &head[..24], is_big_endian);
    if sum != [word(&head, 24), word(&head, 28)] {
        return Ok(());
    }
    let (mut committed, mut pending, mut pages) = (BTreeMap::new(), Vec::new(), 0);
    let mut frame = vec![0; FRAME_HEAD_BYTES + page_bytes];
    let mut position = HEAD_BYTES as u64;
    let mut reader = io::BufReader::new(&mut *wal);
    while reader.read_exact(&mut frame).is_ok() && frame[8..16] == head[16..24] {
        sum = checksum(checksum(sum, &frame[..8], is_big_endian), &frame[FRAME_HEAD_BYTES..], is_big_endian);
        if sum != [word(&frame, 16), word(&frame, 20)] {
            break;
        }
        pending.push((word(&frame, 0), position + FRAME_HEAD_BYTES as u64));
        if word(&frame, 4) > 0 {
            pages = word(&frame, 4);
            committed.extend(pending.drain(..));
        }
        position += frame.len() as u64;
    }
    // Every page that the log adds to the database stands in the log.
    if u64::from(pages) * page_bytes as u64 > database.seek(SeekFrom::End(0))? + position {
        return Err(io::Error::other("its write-ahead log (-wal) belongs to another database"));
    }
    let page = &mut frame[..page_bytes];
    for (number, offset) in committed.into_iter().filter(|(number, _)| (1..=pages).contains(number)) {
        let index = u64::from(number) - 1;
        wal.seek(SeekFrom::Start(offset))?;
        wal.read_exact(page)?;
        database.seek(SeekFrom::Start(index * page_bytes as u64))?;
        database.write_all(page)?;
    }
    Ok(())
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// Continues the checksum of the log over bytes, whose number is a multiple of eight.
fn checksum([mut first, mut second]: [u32; 2], bytes: &[u8], is_big_endian: bool) -> [u32; 2] {
    let number = |bytes: [u8; 4]| if is_big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) };
    for pair in bytes.chunks_exact(8) {
        first = first.wrapping_add(number([pair[0], pair[1], pair[2], pair[3]])).wrapping_add(second);
        second = second.wrapping_add(number([pair[4], pair[5], pair[6], pair[7]])).wrapping_add(first);
    }
    [first, second]
}

//! Reads delimited text: line ends of any system, remarks before the header, and detection of the delimiter.

use std::io::{self, BufRead, BufReader, Cursor, Read};

/// Largest length of a header in bytes.
const HEADER_BYTES_MAX: usize = 1 << 20;

/// Longest line in bytes.
const LINE_BYTES_MAX: usize = 1 << 20;

/// A reader of the records after the remarks.
pub(crate) type Records<'a> = csv::Reader<Box<dyn Read + 'a>>;

/// Returns a reader of records, and the remarks before the header. The delimiter is the most frequent of comma,
/// semicolon and tab in the header. Lines that begin with `#` are remarks. Line ends of any system are accepted.
pub(crate) fn records<'a>(reader: impl Read + 'a) -> io::Result<(Records<'a>, Vec<String>)> {
    let mut reader = BufReader::new(LineFeeds::new(reader));
    let mut head = Vec::new();
    let mut line = 0;
    loop {
        let read = reader.by_ref().take((HEADER_BYTES_MAX - head.len()) as u64).read_until(b'\n', &mut head)?;
        let is_remark = head[line..].first().is_none_or(|first| matches!(first, b'#' | b'\n'));
        if read == 0 || !is_remark {
            break;
        }
        line = head.len();
    }
    let delimiter = delimiter(&head[line..]);
    let remarks = String::from_utf8_lossy(&head[..line]).lines().map(str::to_owned).collect();
    let whole: Box<dyn Read + 'a> = Box::new(Cursor::new(head).chain(reader));
    // The reader accepts records of any length, so that bytes other than text are reported before a wrong number of
    // fields.
    let mut builder = csv::ReaderBuilder::new();
    builder.trim(csv::Trim::All).flexible(true).comment(Some(b'#')).delimiter(delimiter);
    Ok((builder.from_reader(whole), remarks))
}

/// Returns the delimiter that is most frequent in a header outside quotes; the first of several.
fn delimiter(header: &[u8]) -> u8 {
    let mut quoted = false;
    let mut counts = [(b',', 0), (b';', 0), (b'\t', 0)];
    for &byte in header {
        quoted ^= byte == b'"';
        let count = counts.iter_mut().find(|(delimiter, _)| *delimiter == byte && !quoted);
        count.into_iter().for_each(|(_, count)| *count += 1);
    }
    counts.into_iter().rev().max_by_key(|(_, count)| *count).map_or(b',', |(delimiter, _)| delimiter)
}

/// Converts the line ends of any system to line feeds, and ends the last line, so that lines can be counted. Fails at a
/// line that is too long.
struct LineFeeds<R> {
    inner: R,
    /// Converted bytes, and the number of them that were read.
    ready: Vec<u8>,
    handed_on: usize,
    /// Whether a carriage return was read but not converted yet.
    carriage_return: bool,
    /// Whether a line has begun but not ended.
    in_line: bool,
    /// Length of the present line.
    line_bytes: usize,
}

impl<R: Read> LineFeeds<R> {
    fn new(inner: R) -> Self {
        Self { inner, ready: Vec::new(), handed_on: 0, carriage_return: false, in_line: false, line_bytes: 0 }
    }

    /// Converts more bytes. None are ready at the end of the input.
    fn make_ready(&mut self) -> io::Result<()> {
        let mut chunk = [0; 8192];
        self.handed_on = 0;
        self.ready.clear();
        while self.ready.is_empty() {
            let read = self.inner.read(&mut chunk)?;
            if read == 0 {
                self.ready.extend(std::mem::take(&mut self.carriage_return).then_some(b'\r'));
                let unended = self.in_line || !self.ready.is_empty();
                self.ready.extend(unended.then_some(b'\n'));
                self.in_line = false;
                return Ok(());
            }
            for &byte in &chunk[..read] {
                if self.carriage_return && byte != b'\n' {
                    self.ready.push(b'\r');
                }
                self.carriage_return = byte == b'\r';
                self.line_bytes = if byte == b'\n' { 0 } else { self.line_bytes + 1 };
                if self.line_bytes > LINE_BYTES_MAX {
                    return Err(io::Error::other("a line is longer than 1 MB; expected shorter lines"));
                }
                if !self.carriage_return {
                    self.ready.push(byte);
                }
            }
        }
        self.in_line = self.ready.last() != Some(&b'\n');
        Ok(())
    }
}

impl<R: Read> Read for LineFeeds<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.handed_on == self.ready.len() {
            self.make_ready()?;
        }
        let waiting = &self.ready[self.handed_on..];
        let count = waiting.len().min(buffer.len());
        buffer[..count].copy_from_slice(&waiting[..count]);
        self.handed_on += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reader that returns a few bytes at a time.
    struct Drops<'a>(&'a [u8], usize);

    impl Read for Drops<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let count = self.1.min(self.0.len()).min(buffer.len());
            let (first, rest) = self.0.split_at(count);
            buffer[..count].copy_from_slice(first);
            self.0 = rest;
            Ok(count)
        }
    }

    #[test]
    fn line_ends_become_one_byte_wherever_reads_are_cut() {
        let text = b"a\r\nb\rc\r\r\n\r\n\nd\r";
        for drop in 1..text.len() {
            let mut found = Vec::new();
            LineFeeds::new(Drops(text, drop)).read_to_end(&mut found).unwrap();
            assert_eq!(String::from_utf8_lossy(&found), "a\nb\rc\r\n\n\nd\r\n", "{drop} at a time");
        }
    }

    #[test]
    fn a_line_has_at_most_a_megabyte() {
        let read = |length: usize| {
            let text = format!("a\n{}\nb\n", "x".repeat(length));
            LineFeeds::new(text.as_bytes()).read_to_end(&mut Vec::new())
        };
        assert!(read(LINE_BYTES_MAX).is_ok());
        assert!(read(LINE_BYTES_MAX + 1).unwrap_err().to_string().contains("1 MB"));
    }

    #[test]
    fn the_header_determines_the_delimiter() {
        let found = |header: &str| delimiter(header.as_bytes()) as char;
        assert_eq!(["a,b", "a;b,5;c", "a\tb", "a", "\"a;b;c\",d"].map(found), [',', ';', '\t', ',', ',']);
    }
}

//! Reads delimited text: line ends of any system, UTF-8 and Windows-1252, remarks before the header, and detection of
//! the delimiter.

use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Largest length of a header in bytes.
const HEADER_BYTES_MAX: usize = 1 << 20;

/// Longest line in bytes.
const LINE_BYTES_MAX: usize = 1 << 20;

/// A reader of the records after the remarks.
pub(crate) type Records<'a> = csv::Reader<Box<dyn Read + 'a>>;

/// The records of a text, its remarks, its delimiter and its encoding.
pub(crate) struct Delimited<'a> {
    pub(crate) records: Records<'a>,
    /// Lines before the header.
    pub(crate) remarks: Vec<String>,
    pub(crate) delimiter: u8,
    /// Whether a line was decoded from Windows-1252, up to the present one.
    pub(crate) is_windows_1252: Arc<AtomicBool>,
}

impl<'a> Delimited<'a> {
    /// Reads the remarks before the header. Lines that begin with `#` are remarks. The delimiter is the most frequent
    /// of comma, semicolon and tab in the header. Line ends of any system are accepted.
    pub(crate) fn new(reader: impl Read + 'a) -> io::Result<Self> {
        let lines = TextLines::new(reader);
        let is_windows_1252 = Arc::clone(&lines.is_windows_1252);
        let mut reader = BufReader::new(lines);
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
        Ok(Self { records: builder.from_reader(whole), remarks, delimiter, is_windows_1252 })
    }
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

/// Converts lines to UTF-8 with line feeds at their ends. A line that is not UTF-8 is decoded from Windows-1252 if it
/// can be; other lines stay. Fails at a line that is too long.
struct TextLines<R> {
    inner: R,
    /// Converted lines, and the number of their bytes that were read.
    ready: Vec<u8>,
    handed_on: usize,
    /// The beginning of the present line.
    line: Vec<u8>,
    /// Whether a carriage return was read but not converted yet.
    carriage_return: bool,
    is_windows_1252: Arc<AtomicBool>,
}

impl<R: Read> TextLines<R> {
    fn new(inner: R) -> Self {
        let is_windows_1252 = Arc::default();
        Self { inner, ready: Vec::new(), handed_on: 0, line: Vec::new(), carriage_return: false, is_windows_1252 }
    }

    /// Converts more lines. None are ready at the end of the input.
    fn make_ready(&mut self) -> io::Result<()> {
        let mut chunk = [0; 8192];
        self.handed_on = 0;
        self.ready.clear();
        while self.ready.is_empty() {
            let read = self.inner.read(&mut chunk)?;
            if read == 0 {
                self.line.extend(std::mem::take(&mut self.carriage_return).then_some(b'\r'));
                if !self.line.is_empty() {
                    self.end_line();
                }
                return Ok(());
            }
            for &byte in &chunk[..read] {
                if self.carriage_return && byte != b'\n' {
                    self.line.push(b'\r');
                }
                self.carriage_return = byte == b'\r';
                if self.line.len() >= LINE_BYTES_MAX && byte != b'\n' {
                    return Err(io::Error::other("a line is longer than 1 MB; expected shorter lines"));
                }
                match byte {
                    b'\n' => self.end_line(),
                    b'\r' => {}
                    byte => self.line.push(byte),
                }
            }
        }
        Ok(())
    }

    /// Moves the present line to the converted lines.
    fn end_line(&mut self) {
        match std::str::from_utf8(&self.line).map_err(|_| windows_1252(&self.line)) {
            Err(Some(text)) => {
                self.is_windows_1252.store(true, Ordering::Relaxed);
                self.ready.extend_from_slice(text.as_bytes());
            }
            Ok(_) | Err(None) => self.ready.extend_from_slice(&self.line),
        }
        self.ready.push(b'\n');
        self.line.clear();
    }
}

/// The characters of the bytes 0x80 to 0x9F in Windows-1252. Five bytes have none.
const WINDOWS_1252: [Option<char>; 32] = {
    let mut characters = [None; 32];
    let text = [
        '€', '\0', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\0', 'Ž', '\0', '\0', '‘', '’', '“', '”',
        '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\0', 'ž', 'Ÿ',
    ];
    let mut n = 0;
    while n < text.len() {
        if text[n] != '\0' {
            characters[n] = Some(text[n]);
        }
        n += 1;
    }
    characters
};

/// Decodes a line of Windows-1252. Returns `None` if it contains control characters or bytes without a character, or no
/// more ASCII characters than others.
fn windows_1252(line: &[u8]) -> Option<String> {
    if line.iter().filter(|byte| byte.is_ascii()).count() <= line.len() / 2 {
        return None;
    }
    let character = |&byte: &u8| match byte {
        b'\t' | b'\r' => Some(char::from(byte)),
        0x80..=0x9f => WINDOWS_1252[usize::from(byte - 0x80)],
        byte => Some(char::from(byte)).filter(|character| !character.is_control()),
    };
    line.iter().map(character).collect()
}

impl<R: Read> Read for TextLines<R> {
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
            TextLines::new(Drops(text, drop)).read_to_end(&mut found).unwrap();
            assert_eq!(String::from_utf8_lossy(&found), "a\nb\rc\r\n\n\nd\r\n", "{drop} at a time");
        }
    }

    #[test]
    fn lines_in_windows_1252_are_decoded_and_binary_lines_stay() {
        let read = |bytes: &[u8]| {
            let mut lines = TextLines::new(bytes);
            let mut found = Vec::new();
            lines.read_to_end(&mut found).unwrap();
            (String::from_utf8(found).ok(), lines.is_windows_1252.load(Ordering::Relaxed))
        };
        assert_eq!(read(b"L\xe4nge \x80\n\xc3\xa4\n"), (Some("L\u{e4}nge \u{20ac}\n\u{e4}\n".into()), true));
        assert_eq!(read("Länge\n".as_bytes()), (Some("Länge\n".into()), false));
        assert_eq!(read(b"a b \x81\n"), (None, false));
        assert_eq!(read(b"\xff\xff,1\n"), (None, false));
        assert_eq!(read(b"\xff\xfet\0i\0\n"), (None, false));
    }

    #[test]
    fn a_line_has_at_most_a_megabyte() {
        let read = |length: usize| {
            let text = format!("a\n{}\nb\n", "x".repeat(length));
            TextLines::new(text.as_bytes()).read_to_end(&mut Vec::new())
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

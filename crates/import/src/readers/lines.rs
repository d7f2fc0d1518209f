//! Line-wise reading of files with bounded memory.

use std::io::{self, BufRead, Read};

/// Longest line in bytes. The rest of a longer line is skipped.
const LINE_BYTES_MAX: u64 = 1 << 20;

/// Iterates over the lines of a text. Replaces bytes that are not UTF-8. Memory holds one line.
pub(crate) struct Lines<R> {
    reader: R,
    bytes: Vec<u8>,
    text: String,
    /// Number of the current line, from 1.
    pub(crate) number: u64,
}

impl<R: BufRead> Lines<R> {
    pub(crate) fn new(reader: R) -> Self {
        Self { reader, bytes: Vec::new(), text: String::new(), number: 0 }
    }

    /// Returns the next line without its line break; `None` at the end of the text.
    pub(crate) fn next(&mut self) -> io::Result<Option<&str>> {
        self.bytes.clear();
        if self.reader.by_ref().take(LINE_BYTES_MAX).read_until(b'\n', &mut self.bytes)? == 0 {
            return Ok(None);
        }
        if self.bytes.last() != Some(&b'\n') {
            self.reader.skip_until(b'\n')?;
        }
        self.number += 1;
        self.text.clear();
        self.text.push_str(&String::from_utf8_lossy(&self.bytes));
        Ok(Some(self.text.trim_end_matches(['\n', '\r'])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_after_a_long_line_is_read() {
        let long = "x".repeat(3 << 20);
        let text = format!("a\r\n{long}\nbé\n\nc");
        let mut lines = Lines::new(text.as_bytes());
        let lengths: Vec<usize> = std::iter::from_fn(|| lines.next().unwrap().map(str::len)).collect();
        assert_eq!(lengths, [1, 1 << 20, 3, 0, 1]);
        let mut lines = Lines::new(&b"\xff$CA\n"[..]);
        assert_eq!(lines.next().unwrap(), Some("\u{fffd}$CA"));
    }
}

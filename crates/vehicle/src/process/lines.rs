//! Lines of an input, of bounded length.

use std::io::{self, BufRead, BufReader, Read};

use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::input::Input;
use crate::protocol::line::{LINE_BYTES_MAX, read_line, too_long};

/// The lines of an input.
pub(crate) struct Lines<R>(BufReader<R>);

impl<R: Read> Lines<R> {
    pub(crate) fn new(input: R) -> Self {
        Self(BufReader::new(input))
    }

    /// Returns the message of the next line, or the fault of the line; `None` at the end of the input. A line that is
    /// too long is skipped to its end.
    pub(crate) fn next_message(&mut self) -> io::Result<Option<Result<Input, Fault>>> {
        let mut line = Vec::new();
        let mut length = 0;
        loop {
            let buffer = match self.0.fill_buf() {
                Ok(buffer) => buffer,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(error),
            };
            if buffer.is_empty() {
                let fault = || Fault::new(FaultCode::NotJson, "the input ended in the middle of a line");
                return Ok((length > 0).then(|| Err(fault())));
            }
            let end = buffer.iter().position(|&byte| byte == b'\n');
            let part = &buffer[..end.unwrap_or(buffer.len())];
            line.extend_from_slice(&part[..part.len().min(LINE_BYTES_MAX - line.len())]);
            length += part.len();
            let used = part.len() + usize::from(end.is_some());
            self.0.consume(used);
            if end.is_some() {
                return Ok(Some(if length > LINE_BYTES_MAX { Err(too_long(length)) } else { read_line(&line) }));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn codes(input: &[u8]) -> Vec<Option<FaultCode>> {
        let mut lines = Lines::new(input);
        std::iter::from_fn(|| lines.next_message().unwrap()).map(|line| line.err().map(|fault| fault.code)).collect()
    }

    #[test]
    fn long_lines_are_skipped_to_their_end() {
        let status = r#"{"type":"status"}"#;
        let padded = format!("{status}{}", " ".repeat(LINE_BYTES_MAX - status.len()));
        assert_eq!(
            codes(format!("{padded}\n{padded} \n{status}\r\n").as_bytes()),
            [None, Some(FaultCode::LineTooLong), None]
        );
    }

    #[test]
    fn half_a_line_at_the_end_is_a_fault() {
        assert_eq!(codes(b"{\"type\":\"status\"}\n{\"type\":\"sta"), [None, Some(FaultCode::NotJson)]);
        assert_eq!(codes(&[b'x'; 3 * LINE_BYTES_MAX]), [Some(FaultCode::NotJson)]);
        assert_eq!(codes(b"\n\xff\n{\"type\":\"\xff\"}\n"), [Some(FaultCode::NotJson); 3]);
        assert_eq!(codes(b""), []);
    }
}

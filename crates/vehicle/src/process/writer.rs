//! The writer thread.

use std::io::{self, BufWriter, Write};
use std::sync::mpsc::Receiver;

use crate::protocol::line::write_line;
use crate::protocol::output::Message;

/// Writes messages until all senders are gone, until the last message of the vehicle, or until the host has closed the
/// connection.
pub(crate) fn write(output: impl Write, messages: &Receiver<Message>) {
    let mut output = BufWriter::new(output);
    if let Err(error) = write_all(&mut output, messages) {
        tracing::warn!(%error, "the host does not take messages any more");
    }
    // The rest cannot be delivered. Dropping would try again.
    drop(output.into_parts());
}

fn write_all(output: &mut impl Write, messages: &Receiver<Message>) -> io::Result<()> {
    let mut next = messages.recv().ok();
    while let Some(message) = next {
        writeln!(output, "{}", write_line(&message))?;
        let is_last = matches!(message, Message::Stopped { .. });
        next = messages.try_recv().ok().filter(|_| !is_last);
        if next.is_none() {
            output.flush()?;
            next = if is_last { None } else { messages.recv().ok() };
        }
    }
    Ok(())
}

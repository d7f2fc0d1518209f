//! The reader thread.

use std::io::Read;
use std::sync::mpsc::{SyncSender, TrySendError};

use crate::process::lines::Lines;
use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::input::Input;
use crate::protocol::output::Message;

/// One line of the host.
pub(crate) struct Arrival {
    /// Number of the line, from 1.
    pub(crate) number: u64,
    /// Its message, or its fault.
    pub(crate) message: Result<Input, Fault>,
    /// Whether lines before it were answered with `busy`.
    pub(crate) is_after_loss: bool,
}

/// Reads lines until the input ends. Lines that find the queue of the owner full are answered with `busy`. `stop` waits
/// instead, as does the end of the input.
pub(crate) fn read(input: impl Read, to_owner: &SyncSender<Arrival>, to_host: &SyncSender<Message>) {
    let (mut lines, mut is_after_loss) = (Lines::new(input), false);
    for number in 1.. {
        let message = match lines.next_message() {
            Ok(Some(message)) => message,
            Ok(None) => return,
            Err(error) => {
                tracing::warn!(%error, "the input of the host failed");
                return;
            }
        };
        let is_stop = matches!(message, Ok(Input::Stop {}));
        let is_question = matches!(message, Ok(Input::Predict(_) | Input::Status {}));
        let sent = to_owner.try_send(Arrival { number, message, is_after_loss });
        is_after_loss = matches!(sent, Err(TrySendError::Full(_))) && (is_after_loss || !is_question);
        let is_passed = match sent {
            Ok(()) => true,
            Err(TrySendError::Full(arrival)) if is_stop => to_owner.send(arrival).is_ok(),
            Err(TrySendError::Full(_)) => {
                let fault =
                    Fault::new(FaultCode::Busy, "the vehicle has too much to do: send this message again later");
                to_host.send(Message::Error { input: number, fault }).is_ok()
            }
            Err(TrySendError::Disconnected(_)) => false,
        };
        if !is_passed {
            return;
        }
    }
}

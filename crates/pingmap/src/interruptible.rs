//! Readers that can be stopped.

use std::io::{self, Read};

use pingmap_agent::Interrupt;

/// A reader that fails after a request of the thread's [`Interrupt`].
pub struct Interruptible<R>(pub R);

impl<R: Read> Read for Interruptible<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        Interrupt::check().map_err(io::Error::other)?;
        self.0.read(buffer)
    }
}

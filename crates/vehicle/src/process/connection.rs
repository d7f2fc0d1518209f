//! [`Connection`]: one host.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};

/// The two directions of the connection to one host.
pub(crate) struct Connection {
    pub(crate) input: Box<dyn Read + Send>,
    pub(crate) output: Box<dyn Write + Send>,
    socket: Option<Socket>,
}

/// A socket that can be closed while threads read and write.
pub(crate) enum Socket {
    Tcp(TcpStream),
    #[cfg(unix)]
    Unix(std::os::unix::net::UnixStream),
}

impl Connection {
    /// Returns standard input and output.
    pub(crate) fn stdio() -> Self {
        Self { input: Box::new(io::stdin()), output: Box::new(io::stdout()), socket: None }
    }

    /// Returns the connection on a socket.
    pub(crate) fn on_socket(socket: Socket) -> io::Result<Self> {
        let (input, output): (Box<dyn Read + Send>, Box<dyn Write + Send>) = match &socket {
            Socket::Tcp(stream) => (Box::new(stream.try_clone()?), Box::new(stream.try_clone()?)),
            #[cfg(unix)]
            Socket::Unix(stream) => (Box::new(stream.try_clone()?), Box::new(stream.try_clone()?)),
        };
        Ok(Self { input, output, socket: Some(socket) })
    }

    /// Returns the two directions, and the handle that closes them.
    pub(crate) fn split(self) -> (Box<dyn Read + Send>, Box<dyn Write + Send>, Closer) {
        (self.input, self.output, Closer(self.socket))
    }
}

/// Closes a connection. Standard input and output stay open.
pub(crate) struct Closer(Option<Socket>);

impl Closer {
    /// Returns whether the connection is a socket.
    pub(crate) fn is_socket(&self) -> bool {
        self.0.is_some()
    }

    /// Ends reads and writes of other threads. A connection that is closed already stays closed.
    pub(crate) fn close(&self) {
        let _ = match &self.0 {
            Some(Socket::Tcp(stream)) => stream.shutdown(Shutdown::Both),
            #[cfg(unix)]
            Some(Socket::Unix(stream)) => stream.shutdown(Shutdown::Both),
            None => Ok(()),
        };
    }
}

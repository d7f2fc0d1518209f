//! [`Listener`]: where hosts connect.

use std::io;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::path::Path;
use std::thread;
use std::time::Duration;

use crate::config::settings::Listen;
use crate::process::connection::{Connection, Socket};
use crate::process::error::ProcessError;
use crate::process::stop_request::StopRequest;

/// Time between two looks for a host that connects.
const POLL: Duration = Duration::from_millis(20);

/// Time without data after which the operating system probes a host, and time between two probes.
#[cfg(target_os = "linux")]
const KEEP_ALIVE: Duration = Duration::from_secs(10);

/// Probes without an answer after which a connection ends.
#[cfg(target_os = "linux")]
const KEEP_ALIVE_PROBES: u32 = 3;

/// Time without an acknowledgement after which a connection ends, in milliseconds.
#[cfg(target_os = "linux")]
const USER_TIMEOUT_MS: u32 = 40_000;

/// Where hosts connect, one after the other. Others wait until the present one has left.
pub(crate) enum Listener {
    /// Standard input and output: one host.
    Stdio,
    Tcp(TcpListener),
    #[cfg(unix)]
    Unix(crate::process::unix_socket::UnixSocket),
}

impl Listener {
    /// Begins to listen. `folder` is that of the configuration.
    pub(crate) fn open(listen: &Listen, folder: &Path) -> Result<Self, ProcessError> {
        match listen {
            Listen::Stdio => Ok(Self::Stdio),
            #[cfg(unix)]
            Listen::Unix(path) => {
                let path = folder.join(path);
                let socket = crate::process::unix_socket::UnixSocket::bind(&path);
                socket.map(Self::Unix).map_err(|error| failed(format!("unix:{}", path.display()), error))
            }
            #[cfg(not(unix))]
            Listen::Unix(path) => {
                let source = io::Error::from(io::ErrorKind::Unsupported);
                Err(failed(format!("unix:{}", folder.join(path).display()), source))
            }
            Listen::Tcp(address) => {
                let addresses = resolve(address)?;
                let listener = TcpListener::bind(&*addresses).and_then(|listener| {
                    listener.set_nonblocking(true)?;
                    Ok(listener)
                });
                if !addresses.iter().all(|address| address.ip().is_loopback()) {
                    tracing::warn!(%address, "other machines can connect: whoever reaches this port controls the vehicle");
                }
                listener.map(Self::Tcp).map_err(|error| failed(format!("tcp:{address}"), error))
            }
        }
    }

    /// Returns whether only one host can connect.
    pub(crate) fn is_stdio(&self) -> bool {
        matches!(self, Self::Stdio)
    }

    /// Waits for the next host. Returns `None` after a request to stop.
    pub(crate) fn accept(&self, stop: &StopRequest<'_>) -> io::Result<Option<Connection>> {
        loop {
            let accepted = match self {
                Self::Stdio => return Ok(Some(Connection::stdio())),
                Self::Tcp(listener) => listener.accept().and_then(|(stream, _)| {
                    stream.set_nonblocking(false)?;
                    stream.set_nodelay(true)?;
                    #[cfg(target_os = "linux")]
                    keep_alive(&stream)?;
                    Connection::on_socket(Socket::Tcp(stream))
                }),
                #[cfg(unix)]
                Self::Unix(socket) => socket.accept().and_then(|stream| Connection::on_socket(Socket::Unix(stream))),
            };
            match accepted {
                Ok(connection) => return Ok(Some(connection)),
                Err(_) if stop.is_made() => return Ok(None),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                // The host left before it was accepted, or the process has too many open files for a moment.
                Err(error) => tracing::warn!(%error, "a host could not connect"),
            }
            thread::sleep(POLL);
        }
    }
}

/// Returns the addresses behind a host name and a port.
pub(crate) fn resolve(address: &str) -> Result<Vec<SocketAddr>, ProcessError> {
    let addresses = address.to_socket_addrs().map_err(|error| failed(format!("tcp:{address}"), error))?;
    Ok(addresses.collect())
}

fn failed(listen: String, source: io::Error) -> ProcessError {
    let remedy = match source.kind() {
        io::ErrorKind::AddrInUse => "Another process or file is there: stop or remove it, or choose another.",
        io::ErrorKind::PermissionDenied => "Choose a path or port that this user may use.",
        _ => "Correct the path or address.",
    };
    ProcessError::Listen { listen, source, remedy }
}

/// Lets the operating system end a connection whose host has vanished, so that the next host can connect.
#[cfg(target_os = "linux")]
fn keep_alive(stream: &std::net::TcpStream) -> io::Result<()> {
    use rustix::net::sockopt;
    sockopt::set_socket_keepalive(stream, true)?;
    sockopt::set_tcp_keepidle(stream, KEEP_ALIVE)?;
    sockopt::set_tcp_keepintvl(stream, KEEP_ALIVE)?;
    sockopt::set_tcp_keepcnt(stream, KEEP_ALIVE_PROBES)?;
    // The same limit for data that the host does not acknowledge.
    Ok(sockopt::set_tcp_user_timeout(stream, USER_TIMEOUT_MS)?)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::net::TcpStream;

    #[test]
    fn connections_are_kept_alive_by_probes() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let _host = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (stream, _) = listener.accept().unwrap();
        keep_alive(&stream).unwrap();
        assert!(rustix::net::sockopt::socket_keepalive(&stream).unwrap());
        assert_eq!(rustix::net::sockopt::tcp_keepidle(&stream).unwrap(), KEEP_ALIVE);
        assert_eq!(rustix::net::sockopt::tcp_keepintvl(&stream).unwrap(), KEEP_ALIVE);
        assert_eq!(rustix::net::sockopt::tcp_keepcnt(&stream).unwrap(), KEEP_ALIVE_PROBES);
        assert_eq!(rustix::net::sockopt::tcp_user_timeout(&stream).unwrap(), USER_TIMEOUT_MS);
    }
}

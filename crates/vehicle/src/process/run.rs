//! [`run`]: the process of one vehicle.

use crate::process::error::ProcessError;
use crate::process::listener::Listener;
use crate::process::log::start_log;
use crate::process::owner::Owner;
use crate::process::start::{OpenedStore, Setup};
use crate::process::stop_request::StopRequest;

/// Runs the process of one vehicle until the host ends it: by `stop`, or by the end of standard input. SIGTERM, SIGINT
/// and `is_stopped` end it as well. Everything that was acknowledged is stored in each case.
///
/// # Errors
/// [`ProcessError`] with the reason why the process does not start.
pub fn run(setup: &Setup, is_stopped: &dyn Fn() -> bool) -> Result<(), ProcessError> {
    start_log(&setup.config.log);
    let reference = setup.check()?;
    let stop = StopRequest::new(is_stopped).map_err(ProcessError::System)?;
    let OpenedStore { store, path, snapshot_path, content } = setup.open_store(&reference)?;
    // Hosts can connect from now on. Their messages wait.
    let listener = Listener::open(&setup.config.listen()?, &setup.folder)?;
    let vehicle = setup.begin(&reference, content, &path, &snapshot_path)?;
    let version = env!("CARGO_PKG_VERSION");
    let (events, listen) = (vehicle.agent().events().len(), &setup.config.host.listen);
    tracing::info!(vehicle = %vehicle.id(), version, events, listen, store = %path.display(), "ready");
    let queue = setup.config.host.queue;
    let mut owner = Owner { vehicle, store, snapshot_path, queue, stop: &stop, has_stopped: false };
    while let Some(connection) = listener.accept(&stop).map_err(ProcessError::System)? {
        owner.serve(connection, listener.is_stdio()).map_err(ProcessError::System)?;
        tracing::info!("the host left");
        if owner.has_stopped {
            break;
        }
    }
    if !owner.has_stopped {
        owner.stop_alone();
    }
    drop(listener);
    if let Err(error) = owner.store.close() {
        tracing::error!(%error, "the store could not be closed");
    }
    tracing::info!("stopped");
    Ok(())
}

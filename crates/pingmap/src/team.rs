//! Opens team files and the files that they name.

use std::fmt::Display;
use std::path::Path;

use dgpc::{Correlation, Term};
use pingmap_agent::{Agent, Key, Team, TeamFile};
use pingmap_packet::to_hex;
use pingmap_trial::EventLog;

use crate::model::{fitting, log_digests, read_model};
use crate::output::{BadInput, count, read_text, warn};

/// Opens a team file for use with a log. The model must suit the log's chart. Vehicles that are not members only
/// listen. Also returns the digests of the logs from which the model was learned.
pub fn open_team(path: &Path, log: &EventLog) -> anyhow::Result<(Team, Vec<String>)> {
    let (mut team, digests) = read_with_digests(path)?;
    team.model = fitting(team.model, path, log)?;
    let columns =
        || team.model.prior.kernel().terms().iter().flat_map(Term::correlations).flat_map(Correlation::columns);
    let beyond = log.events.iter().filter(|event| team.grid.time_cell(event.time_s) == 0).count();
    if beyond > 0 && columns().any(|&column| column == team.model.inputs.time()) {
        let events = count(beyond, "event");
        warn(format_args!(
            "{}: {events} outside the team's time grid; they are encoded without a time",
            path.display()
        ));
    }
    let strangers = log.vehicles().into_iter().filter(|id| team.number(id).is_none());
    let strangers: Vec<String> = strangers.map(|id| id.to_string()).collect();
    if !strangers.is_empty() {
        warn(format_args!("{}: not members, so they only listen: {}", path.display(), strangers.join(", ")));
    }
    Ok((team, digests))
}

/// Reads a team file, and the model and key files that it names.
pub fn read_team(path: &Path) -> anyhow::Result<Team> {
    Ok(read_with_digests(path)?.0)
}

/// Reads a team file for a process that sends. Refuses a key that other users can read.
pub fn read_team_with_private_key(path: &Path) -> anyhow::Result<Team> {
    Ok(read_with(path, &open_private_key)?.0)
}

fn read_with_digests(path: &Path) -> anyhow::Result<(Team, Vec<String>)> {
    read_with(path, &open_key)
}

fn read_with(path: &Path, open_key: &dyn Fn(&Path) -> anyhow::Result<Key>) -> anyhow::Result<(Team, Vec<String>)> {
    let bad = |problem: &dyn Display| BadInput(format!("{}: {problem}", path.display()));
    let file = TeamFile::parse(&read_text(path)?).map_err(|error| bad(&error))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let model = read_model(&folder.join(&file.model_file))?;
    let key = file.key_file.as_ref().map(|name| open_key(&folder.join(name))).transpose()?;
    let digests = log_digests(&model).chain(file.log_digest.as_deref()).map(str::to_owned).collect();
    Ok((file.team(model.model, key).map_err(|error| bad(&error))?, digests))
}

fn open_private_key(path: &Path) -> anyhow::Result<Key> {
    if is_readable_by_others(path) {
        let problem = "others on this machine can read the key; expected a private file (chmod 600)";
        return Err(BadInput(format!("{}: {problem}", path.display())).into());
    }
    open_key(path)
}

/// Reads a team's key, and warns if other users can read it.
pub fn open_key(path: &Path) -> anyhow::Result<Key> {
    if is_readable_by_others(path) {
        warn(format_args!("{}: others on this machine can read the key (chmod 600 changes that)", path.display()));
    }
    Ok(Key::parse(&read_text(path)?).map_err(|error| BadInput(format!("{}: {error}", path.display())))?)
}

#[cfg(unix)]
fn is_readable_by_others(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    std::fs::metadata(path).is_ok_and(|metadata| metadata.permissions().mode() & 0o077 != 0)
}

#[cfg(not(unix))]
fn is_readable_by_others(_: &Path) -> bool {
    false
}

/// Returns the digest of the team configuration, in hexadecimal digits.
pub fn team_digest(listener: &Agent) -> String {
    to_hex(&listener.team().digest())
}

/// Returns the digest of the model.
pub fn model_digest(listener: &Agent) -> String {
    listener.team().model.digest()
}

//! Team files, and the files that they name; `pingmap team`, which writes one.

use std::fmt::Display;
use std::path::Path;

use pingmap_agent::{Grid, Key, Team, TeamError, TeamFile};
use pingmap_trial::EventLog;

use crate::cli;
use crate::output::{BadInput, count, note, read_text, warn, write_file};
use crate::survey::{fitting, open_log, open_model, read_model};

pub fn run(options: &cli::Team) -> anyhow::Result<()> {
    let log = open_log(&options.events)?;
    let model = open_model(&options.model, &log)?;
    let key = options.key_file.as_deref().map(open_key).transpose()?;
    let positions = log.events.iter().flat_map(|event| event.link.ends());
    let mut team = Team {
        frame_bytes: options.frame_bytes,
        key,
        ..Team::new(log.vehicles(), model, positions).map_err(bad_team)?
    };
    if let Some(cell_m) = options.cell_m {
        team.grid.cell_m = cell_m;
        let outside = log.events.iter().filter(|event| !team.wire().holds(&event.link)).count();
        if outside > 0 {
            warn(format_args!("{} beyond the grid: nothing can be told of them", count(outside, "event")));
        }
    }
    let key_name = options.key_file.as_ref().map(|path| beside(path, &options.output)).transpose()?;
    let text = TeamFile::write(&team, &beside(&options.model, &options.output)?, key_name.as_deref());
    write_file(&options.output, text.map_err(bad_team)?.as_bytes())?;
    let Grid { cell_m, .. } = team.grid;
    note(format_args!("team: {}, cells of {cell_m} m", options.output.display()));
    Ok(())
}

/// The name of a file as the team file beside it says it.
fn beside(path: &Path, team_file: &Path) -> anyhow::Result<String> {
    let absolute = std::path::absolute(path)?;
    let folder = std::path::absolute(team_file)?;
    let name = absolute.strip_prefix(folder.parent().unwrap_or(Path::new("/"))).unwrap_or(&absolute);
    Ok(name.display().to_string())
}

fn bad_team(error: TeamError) -> BadInput {
    BadInput(error.to_string())
}

/// Reads a team file for the use of a log: its model must be for such a chart, and who is not a member only listens.
pub fn open_team(path: &Path, log: &EventLog) -> anyhow::Result<Team> {
    let mut team = read_team(path)?;
    team.model = fitting(team.model, path, log)?;
    let strangers = log.vehicles().into_iter().filter(|id| team.number(id).is_none());
    let strangers: Vec<String> = strangers.map(|id| id.to_string()).collect();
    if !strangers.is_empty() {
        warn(format_args!("{}: not members, and only listening: {}", path.display(), strangers.join(", ")));
    }
    Ok(team)
}

/// Reads a team file, and the model and key beside it.
pub fn read_team(path: &Path) -> anyhow::Result<Team> {
    let bad = |problem: &dyn Display| BadInput(format!("{}: {problem}", path.display()));
    let file = TeamFile::parse(&read_text(path)?).map_err(|error| bad(&error))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let model = read_model(&folder.join(&file.model_file))?;
    let key = file.key_file.as_ref().map(|name| open_key(&folder.join(name))).transpose()?;
    Ok(file.team(model, key).map_err(|error| bad(&error))?)
}

/// Reads a team's key.
pub fn open_key(path: &Path) -> anyhow::Result<Key> {
    Ok(Key::parse(&read_text(path)?).map_err(|error| BadInput(format!("{}: {error}", path.display())))?)
}

//! `pingmap vehicle`: the process of one vehicle.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use pingmap_agent::Interrupt;
use pingmap_packet::to_hex;
use pingmap_vehicle::{Checked, Listen, ProcessError, Setup, StoreError, VEHICLE_EXAMPLE, VehicleConfig, check, run};

use crate::output::{BadInput, Results, count, print, print_text, read_text};
use crate::team::read_team_with_private_key;

/// Run one vehicle next to the software that owns its modem, by JSON lines
///
/// The host writes one JSON object a line to standard input, or to the socket of the configuration. It begins with
/// hello. Everything that is answered with ok is stored before the answer. The process ends with the input, with stop,
/// or with SIGTERM. The log goes to standard error.
#[derive(Args)]
#[command(
    after_long_help = "Examples:\n  pingmap vehicle --example > vehicle.toml\n  pingmap vehicle --config vehicle.toml --check\n  pingmap vehicle --config vehicle.toml"
)]
pub struct Options {
    /// Configuration of the vehicle. Paths in it are relative to its folder
    #[arg(long, value_name = "FILE", default_value = "vehicle.toml")]
    config: PathBuf,
    /// Read and check everything, print a summary, and open nothing for writing
    #[arg(long)]
    check: bool,
    /// Keep the events of a store of another team configuration, for example of another epoch
    #[arg(long)]
    adopt_store: bool,
    /// Print a configuration with every key and its default
    #[arg(long, conflicts_with_all = ["config", "check", "adopt_store"])]
    example: bool,
}

impl Options {
    pub fn threads(&self) -> usize {
        1
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        if self.example {
            return print(results, VEHICLE_EXAMPLE);
        }
        let setup = self.setup()?;
        if self.check {
            let checked = check(&setup).map_err(failure)?;
            return print_text(results, &summary(&setup, &checked));
        }
        run(&setup, &|| Interrupt::check().is_err()).map_err(failure)
    }

    fn setup(&self) -> anyhow::Result<Setup> {
        let path = &self.config;
        let config = VehicleConfig::parse(&read_text(path)?)
            .map_err(|error| BadInput(format!("{}: {error}", path.display())))?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let team = read_team_with_private_key(&folder.join(&config.team))?;
        Ok(Setup { config, folder, team: Arc::new(team), adopts_store: self.adopt_store })
    }
}

/// Separates errors of the user's files from others, which have exit status 1.
fn failure(error: ProcessError) -> anyhow::Error {
    match &error {
        ProcessError::Store(StoreError::OtherTeam { .. }) => BadInput(format!("{error} Option: --adopt-store")).into(),
        error if error.is_bad_input() => BadInput(error.to_string()).into(),
        _ => error.into(),
    }
}

fn summary(setup: &Setup, checked: &Checked) -> String {
    let Setup { config, team, .. } = setup;
    let (epoch, digest) = (team.epoch, to_hex(&team.digest()));
    let members = count(team.members.len(), "member");
    let key = if team.key.is_some() { "with a key" } else { "without a key: frames are not authenticated" };
    let listen = match &checked.listen {
        Listen::Stdio => "standard input and output".to_owned(),
        Listen::Unix(path) => format!("Unix socket {}", setup.folder.join(path).display()),
        Listen::Tcp(address) => format!("TCP {address}"),
    };
    let store = match &checked.store {
        None => "new".to_owned(),
        Some(report) => {
            let base = report.base_bytes.map_or("no base".to_owned(), |bytes| format!("a base of {bytes} bytes"));
            format!(
                "{base}, {}",
                if report.entry_count == 1 { "1 entry".into() } else { format!("{} entries", report.entry_count) }
            )
        }
    };
    let snapshot = if checked.has_snapshot { "present" } else { "none yet" };
    format!(
        "vehicle   {}\nteam      {members}, epoch {epoch}, {key}\ndigest    {digest}\nhost      {listen}\nstore     {}: {store}\nsnapshot  {}: {snapshot}",
        config.vehicle,
        checked.store_path.display(),
        checked.snapshot_path.display()
    )
}

//! `pingmap completions` and `pingmap man`: shell completions and manual pages, generated from the definitions of the
//! options.

use std::path::PathBuf;

use clap::Args;
use clap_complete::Shell;

use crate::files::make_folder;
use crate::output::{BadInput, Results, note};
use crate::output_target::Overwrite;

/// Print the completion script of a shell
#[derive(Args)]
#[command(
    hide = true,
    after_help = "Example: pingmap completions bash > /usr/share/bash-completion/completions/pingmap"
)]
pub struct Completions {
    /// Name of the shell
    #[arg(value_enum)]
    shell: Shell,
}

impl Completions {
    pub fn threads(&self) -> usize {
        1
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let mut text = Vec::new();
        clap_complete::generate(self.shell, &mut results.definition(), "pingmap", &mut text);
        results.write_all(&text)?;
        Ok(results.flush()?)
    }
}

/// Print the manual page, or write the pages of all commands to a folder
#[derive(Args)]
#[command(hide = true, after_help = "Example: pingmap man | man -l -")]
pub struct Man {
    /// Folder for the pages
    folder: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
}

impl Man {
    pub fn threads(&self) -> usize {
        1
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let definition = results.definition();
        let Some(folder) = &self.folder else {
            let mut page = Vec::new();
            clap_mangen::Man::new(definition).render(&mut page)?;
            results.write_all(&page)?;
            return Ok(results.flush()?);
        };
        if folder.exists() && !folder.is_dir() {
            return Err(
                BadInput(format!("{} is not a folder; expected a folder for the pages", folder.display())).into()
            );
        }
        make_folder(folder)?;
        for name in pages(&definition, String::new()) {
            self.overwrite.target(&folder.join(name), &[])?;
        }
        clap_mangen::generate_to(definition, folder)?;
        note(format_args!("wrote the pages to {}", folder.display()));
        Ok(())
    }
}

/// Returns the file names of the pages of a command and its subcommands.
fn pages(command: &clap::Command, above: String) -> Vec<String> {
    let name = above + command.get_name();
    let below = command.get_subcommands().filter(|command| !command.is_hide_set());
    let below: Vec<String> = below.flat_map(|command| pages(command, format!("{name}-"))).collect();
    [vec![format!("{name}.1")], below].concat()
}

//! `spinney completions`: completion scripts for shells.

use std::io::{self, Write};

use anyhow::Result;
use clap::CommandFactory;
use clap_complete::Shell;

use super::Cli;

/// Print a completion script for a shell
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  spinney completions bash > ~/.local/share/bash-completion/completions/spinney
  spinney completions fish > ~/.config/fish/completions/spinney.fish")]
pub(crate) struct Args {
    /// The shell
    shell: Shell,
}

pub(crate) fn run(args: Args) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "spinney", &mut script);
    Ok(io::stdout().write_all(&script)?)
}
